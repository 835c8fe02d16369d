"""Files: reading and writing of file formats, between bytes on disk and plain arrays and records."""
