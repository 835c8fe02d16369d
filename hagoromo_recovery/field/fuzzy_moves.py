"""Fuzzy moves: how extinctions and axes of fibres follow their gradients, and what is known of them beforehand.

Extinctions move by their logarithm, so that none becomes negative. Neighbours have opacities and axes that are alike,
and there is no more matter than photographs need.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip
from hagoromo_recovery.field.matter_field import AXES
from hagoromo_recovery.field.matter_moves import Adam, MatterMoves

if TYPE_CHECKING:
    from hagoromo_recovery.field.density_field import DensityField

BESIDE = 1.0  # voxels from the reach within which nodes move
LEAST, MOST = 2e-4, 8.0  # extinction [1/voxel]
LARGEST_CHANGE = 0.5  # of the logarithm of an extinction in a step
AXIS_RATE = 0.06  # of an axis, in a level's first step
# in units of a pixel's squared error: of the differences of neighbours' opacities (of a voxel) and axes, and of opacity
OPACITY_EVENNESS, AXIS_EVENNESS, SPARSITY = 10.0, 3.0, 0.3


class FuzzyMoves(MatterMoves):
    """Logarithms of extinctions move, and axes of unit length, wherever there may be matter."""

    field: DensityField
    rates = 0.25, 0.12  # of the logarithm

    def choose(self) -> None:
        """Choose the nodes within reach."""
        super().choose()
        count = dr.width(self.nodes)
        self.by_density, self.by_axes = Adam(count), [Adam(count) for _ in range(AXES)]

    def held(self) -> NDArray[np.bool_]:
        """Within reach."""
        return np.array(self.field.reach).reshape(self.field.shape) < BESIDE

    def move_values(self, rate: float, fall: float) -> None:
        """Move logarithms of extinctions, and axes."""
        jit, field = arrays(), self.field
        by_density, by_axes = field.by_density, field.by_axes
        opacity = 1.0 - dr.exp(-field.density)
        dr.eval(by_density, by_axes, opacity)
        old = dr.gather(jit.Float, field.density, self.nodes)
        known = self.unevenness(opacity, 1, 0, OPACITY_EVENNESS) + SPARSITY / dr.width(self.nodes)
        slope = old * (dr.gather(jit.Float, by_density, self.nodes) + dr.exp(-old) * known)
        change = clip(self.by_density.step(slope, rate), -LARGEST_CHANGE, LARGEST_CHANGE)
        new = clip(old * dr.exp(-change), LEAST, MOST)
        dr.scatter(field.density, new, self.nodes, mode=dr.ReduceMode.NoConflicts)
        moved = []
        for k in range(AXES):
            index = self.nodes * AXES + k
            slope = dr.gather(jit.Float, by_axes, index) + self.unevenness(field.axes, AXES, k, AXIS_EVENNESS)
            moved.append(dr.gather(jit.Float, field.axes, index) - self.by_axes[k].step(slope, AXIS_RATE * fall))
        axis = dr.normalize(jit.Array3f(*moved))
        dr.eval(axis)
        for k in range(AXES):
            dr.scatter(field.axes, axis[k], self.nodes * AXES + k, mode=dr.ReduceMode.NoConflicts)
        dr.eval(field.density, field.axes)
