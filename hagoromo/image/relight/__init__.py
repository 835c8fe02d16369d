"""Relight: photographs of a measured object predicted by volume boxes, under lamps and cameras of their own."""
