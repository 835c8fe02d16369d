"""Volume boxes on disk and on their way there: Zarr v3 groups, read and written block by block."""
