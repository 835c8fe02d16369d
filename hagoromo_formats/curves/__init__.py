"""Curves of files: hair and lines."""
