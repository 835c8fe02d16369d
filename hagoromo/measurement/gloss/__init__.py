"""Gloss that varies over a surface: its patches, maps and intervals."""
