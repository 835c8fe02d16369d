"""Hair: fibres along curves, from a file or grown on a shape."""
