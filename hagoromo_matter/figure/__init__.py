"""Figures of the paper: an angel and a nun, 270 mm high."""
