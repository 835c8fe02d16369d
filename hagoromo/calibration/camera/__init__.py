"""Calibration of a camera's intrinsics and lens distortion from photographs of a board."""
