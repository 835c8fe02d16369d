"""Calibration of the lamps of a fixed set-up beside one another: strength and fall-off of each."""
