"""Volume boxes: their sparse lattices, their files, and how rays meet them."""
