"""Cameras of other programs: OpenCV, COLMAP, Middlebury, lensfun."""
