"""Studies: what Hagoromo makes of real photographs and of many cameras, with reports."""
