"""Measurement: photographs and known lamps → materials, gloss, normals and surface, each with its uncertainty."""
