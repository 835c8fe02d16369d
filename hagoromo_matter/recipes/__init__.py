"""Recipes: what a matter TOML of each kind may say, and the plan of its box. One file a kind."""
