"""Texels of matter: a periodic micro-structure as a texel, its coarser levels, and a surface that carries it."""
