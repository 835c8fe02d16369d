"""Matter: recipes that fill volume boxes with skin, cloth, feathers and solids."""
