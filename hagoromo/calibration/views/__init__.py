"""Cameras of photographs of many views, from the photographs alone; their scale and lamps."""
