"""Volume boxes: their sparse lattices, their files, and their interpolation."""
