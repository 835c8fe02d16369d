"""Reflectance: the dichromatic Torrance–Sparrow model, its micro-elements, and their measurement."""
