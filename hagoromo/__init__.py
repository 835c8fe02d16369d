"""Hagoromo: from calibrated photographs to measured reflectance, volume boxes and rendered images."""

__version__ = "0.1.0"
