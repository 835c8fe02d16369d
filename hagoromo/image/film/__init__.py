"""Film: a scene that moves, frame by frame."""
