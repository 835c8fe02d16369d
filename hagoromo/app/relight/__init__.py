"""Relight: what was measured, as volume boxes under lamps and cameras that were not in the capture."""
