"""Feather: shafts, barbs, barbules and down; wings of many feathers."""
