"""Images: scenes, the march, shadows, surfaces, exposure and comparison."""
