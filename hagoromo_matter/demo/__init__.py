"""Demo: the paper end to end, and its report."""
