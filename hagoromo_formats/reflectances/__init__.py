"""Measured reflectances of other programs: tables of a BRDF that a material is fitted to."""
