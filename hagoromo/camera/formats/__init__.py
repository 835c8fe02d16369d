"""Files of cameras that other programs write: nerfstudio, COLMAP, OpenCV, Middlebury."""
