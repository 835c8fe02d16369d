"""Development: exposures of one view → linear camera colours with their variance."""
