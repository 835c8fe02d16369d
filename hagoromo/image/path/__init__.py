"""Mode path: pictures by random walks, their noise, and walks that were interrupted."""
