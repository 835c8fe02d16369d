"""Formats: the table of all that is read and written, what a file is, and its conversion."""
