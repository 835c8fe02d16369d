"""Meshes that trimesh does not read: Alembic and VTK."""
