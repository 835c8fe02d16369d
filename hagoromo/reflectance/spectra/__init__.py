"""Reflectance spectra from camera colours, and the priors that they are learnt from."""
