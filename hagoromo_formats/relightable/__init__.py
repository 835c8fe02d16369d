"""A measured object in the formats of other programs, each with what is lost by it."""
