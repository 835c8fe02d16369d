"""Where an object can be: lattices, the hull of its masks, and what masks disagree on."""
