"""Least squares: one driver for every small fit, its losses, and how each fit ended."""
