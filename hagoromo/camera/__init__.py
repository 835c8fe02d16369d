"""Cameras: where an image point looks (eq. 7–9, 12), how a sensor sees colour (eq. 10), and its noise."""
