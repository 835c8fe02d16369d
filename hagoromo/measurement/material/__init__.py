"""Materials: from photographs of a known shape to the reflectance of what it is made of, with intervals."""
