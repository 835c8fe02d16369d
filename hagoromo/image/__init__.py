"""Images: scenes and surfaces, rendering, previews, simulated photographs, exposure and comparison."""
