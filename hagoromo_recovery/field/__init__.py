"""Matter on a lattice, as a distance or a density: its march, the adjoint of that, and what a step moves."""
