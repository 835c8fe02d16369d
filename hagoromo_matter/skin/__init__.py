"""Skin: scales over granules, lines and pores."""
