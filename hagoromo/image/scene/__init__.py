"""A scene as its file states it: boxes, surfaces, textures, lights, camera and settings."""
