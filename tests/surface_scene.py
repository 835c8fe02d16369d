"""The scene file before a surface: a camera over the plane and a lamp, for tests of what lies on its UVs."""

BEFORE_A_SURFACE = """
[camera]
size = [24, 24]
focal = [24.0, 24.0]
eye = [0.0, 0.0, 2.0]
up = [0.0, 1.0, 0.0]
[[lamp]]
to_lamp = [0.48, 0.0, 0.64]
"""
