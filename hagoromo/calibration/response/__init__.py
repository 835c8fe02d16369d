"""Calibration of a camera's spectral response from known spectra, or from photographs of a colour chart."""
