"""Mode full: pictures by light that is solved, the walks that state what they are off, and their mend."""
