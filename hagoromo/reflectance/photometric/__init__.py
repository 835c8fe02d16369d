"""Photometric: normals, shape and gloss from photographs of one camera under many lamps."""
