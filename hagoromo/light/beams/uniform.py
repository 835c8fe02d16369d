"""Uniform: the beam of a lamp that shines alike all around."""

from __future__ import annotations

import numpy as np

from hagoromo.light.beams.beam import Array, Beam, BeamKeys


class UniformBeam(Beam):
    """1 in every direction."""

    word = "uniform"

    @classmethod
    def of(cls, keys: BeamKeys) -> UniformBeam:
        """Whatever the keys."""
        return cls()

    @property
    def key(self) -> str:
        """Its word."""
        return self.word

    def relative_intensity(self, directions: Array) -> Array:
        """1."""
        return np.ones(directions.shape[:-1])

    def on_device(self) -> None:
        """None: nothing is computed."""
