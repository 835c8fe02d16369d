"""Cloth: drafts, yarns and their fibres, woven and knitted, as periodic fields of micro-structure."""
