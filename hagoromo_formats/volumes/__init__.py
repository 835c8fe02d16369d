"""Files of volumes: a number at each point of a lattice, in the formats of other programs."""
