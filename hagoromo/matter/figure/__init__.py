"""Figure: an angel and a nun: bodies, hair and garments."""
