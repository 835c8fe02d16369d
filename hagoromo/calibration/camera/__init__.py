"""Calibrate a camera: its lens from photographs of a board."""
