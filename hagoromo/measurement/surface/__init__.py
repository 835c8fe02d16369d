"""Surface: normals → depth, near lamps, and photographs that do not fit the memory."""
