"""Recovery: a volume box from photographs of many views and lamps."""
