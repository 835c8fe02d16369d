"""Calibration: photographs of known things → the camera, its spectral response, and the lamps."""
