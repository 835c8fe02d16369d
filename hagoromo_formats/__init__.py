"""Files of other programs: cameras, volumes, curves, meshes, scenes, relightable images. See `table.py`."""
