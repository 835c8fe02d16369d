"""Solid: meshes, signed distances and reliefs of photographs filled with matter."""
