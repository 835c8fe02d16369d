"""Relief: the volume boxes of a measured surface."""
