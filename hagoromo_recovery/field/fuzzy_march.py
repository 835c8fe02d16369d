"""Fuzzy march: the law of matter without a surface, such as fur and down, by a free density of fibres.

The extinction is the same towards all sides, as in Tanaka's volume box (MODEL §3), and linear along a piece of a ray.
Light of lamps is weakened on its way in to every piece, as its share changes along a ray.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays, clip
from hagoromo.transport.crossing import share_at_depth
from hagoromo.transport.step_elements import centroid
from hagoromo_recovery.field.matter_march import LAST_DEPTH, LatticeRays, MatterMarch, Piece

if TYPE_CHECKING:
    from hagoromo_recovery.field.density_field import DensityField

STEP, LARGEST_STEP = 0.8, 64.0  # [voxel] in matter; through empty space
NEAR = 2.7  # [voxel] of a node's reach, within which there may be matter between nodes: half a diagonal and a whole one
LEAST_DEPTH = 1e-4  # optical depth of a piece that counts
INSIDE = 1.0  # [voxel] from the edge of the lattice where shadow rays end


class FuzzyMarch(MatterMarch):
    """field: extinctions. shading: see `NodeShading`. shadows: whether the matter keeps light from itself."""

    lights_pieces = True

    def __init__(self, field: DensityField, shading: Any, shadows: bool = True) -> None:
        super().__init__(field, shading)
        self.reach_at, self.shadows = field.reach_at, shadows

    @property
    def least_depth(self) -> float:
        """Optical depth of a piece that counts: less than of a surface, as thin matter is much of it."""
        return LEAST_DEPTH

    def step_length(self, value: Float, place: Array3f) -> Float:
        """By the reach: that of the steps of all rays is held."""
        return clip(self.reach_at(place) - NEAR, STEP, LARGEST_STEP)

    def depth_of(self, piece: Piece) -> Float:
        """The extinction is linear along a piece."""
        return 0.5 * (piece.first + piece.second) * piece.length

    def share_of(self, piece: Piece) -> Float:
        """Where the mean of exp(−depth) is reached; it is held, as shadows begin there."""
        first, second = dr.detach(piece.first), dr.detach(piece.second)
        depth = centroid(0.5 * (first + second) * piece.length)
        return share_at_depth(depth, (second - first) / dr.fmax(first + second, 1e-9))

    def arriving(self, place: Array3f) -> list[Float] | None:
        """Share of each lamp's light that arrives at a place."""
        lamps = self.shading.lamps
        if not (self.shadows and lamps.each):
            return None
        return [self.transmittance(self._to_lamp(place, k)) for k in range(lamps.each)]

    def add_by_arriving(self, place: Array3f, by_logarithm: list[Float]) -> None:
        """Add the gradient of Σ by_logarithm · ln(share of each lamp's light that arrives), by extinctions."""
        for k, by in enumerate(by_logarithm):
            self._add_by_depth(self._to_lamp(place, k), -by)

    def _to_lamp(self, place: Array3f, lamp: int) -> LatticeRays:
        to_lamp, distance, _ = self.shading.lamps.arriving(self.shading.photograph, lamp, place)
        far = dr.fmin(distance, self.field.way_to_edge(place, to_lamp, INSIDE))
        return LatticeRays(place, to_lamp, arrays().Float(0), far)

    @dr.syntax
    def _add_by_depth(self, rays: LatticeRays, by: Float) -> None:
        """Add the gradient of by · the optical depth of rays; the pieces are those of `transmittance`."""
        jit, count = arrays(), dr.width(rays.direction)
        depth, before = dr.zeros(jit.Float, count), dr.zeros(jit.Float, count)
        t = dr.zeros(jit.Float, count)
        first = self.field.value_at(rays.at(t))
        while (t < rays.far) & (depth < LAST_DEPTH):
            length = dr.fmin(self.step_length(first, rays.at(t)), rays.far - t)
            second = self.field.value_at(rays.at(t + length))
            self.field.add_by_value(rays.at(t), 0.5 * by * (before + length))
            depth += self.depth_of(Piece(t, length, first, second))
            t += dr.fmax(length, 1e-3)
            first, before = second, length
        self.field.add_by_value(rays.at(t), 0.5 * by * before)
