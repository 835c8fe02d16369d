"""The photometric model that all fits share: what a pixel reads, and what else its photographs have in common."""
