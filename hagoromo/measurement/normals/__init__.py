"""Normals: photometric stereo with gloss and uneven lamps."""
