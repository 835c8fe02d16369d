"""Files: bytes on disk to plain arrays and records, and back. Knows formats, not meaning."""
