"""Reflectance: the dichromatic Torrance–Sparrow model, its micro-elements, spectra, and the record of a material."""
