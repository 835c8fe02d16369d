"""Scenes of other programs: glTF and USD, both ways."""
