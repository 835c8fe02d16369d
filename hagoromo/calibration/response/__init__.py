"""Calibrate the spectral response of a camera: from known spectra, or from photographs of a colour chart."""
