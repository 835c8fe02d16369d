"""What every mode makes of a scene on the device: rays, lights by kind, what rays hit, lights that are seen."""
