"""Surface moves: how a signed distance follows its gradient, near the surface, and stays a distance."""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, clip, lookup
from hagoromo_recovery.field.matter_moves import Adam, MatterMoves
from hagoromo_recovery.outline.hull import redistanced

if TYPE_CHECKING:
    from hagoromo_recovery.field.distance_field import DistanceField

BAND = 3.0  # voxels from the surface within which nodes move
LARGEST_CHANGE = 0.3  # [voxel] of a distance in a step
EIKONAL, BENDING = 2.0, 0.2  # of |∇d| from 1, and of the Laplacian of d, in units of a pixel's squared error


class SurfaceMoves(MatterMoves):
    """Distances near the surface move [voxel]; far ones are made distances again."""

    field: DistanceField
    rates = 0.08, 0.05  # [voxel]
    colour_rates = 0.12, 0.06  # on coarse levels a surface moves to where colours that lag behind ask for it

    def choose(self) -> None:
        """Choose the nodes near the surface."""
        self.field.distance = lookup(arrays().Float, redistanced(self.field.distances()))
        super().choose()
        self.by_distance = Adam(dr.width(self.nodes))

    def held(self) -> NDArray[np.bool_]:
        """Near the surface."""
        return np.abs(self.field.distances()) < BAND

    def move_values(self, rate: float, fall: float) -> None:
        """Move distances [voxel]."""
        by_distance = self.field.by_distance
        dr.eval(by_distance)
        slope = dr.gather(arrays().Float, by_distance, self.nodes) + smoothness_slope(self.field, self.nodes)
        change = clip(self.by_distance.step(slope, rate), -LARGEST_CHANGE, LARGEST_CHANGE)
        dr.scatter_reduce(dr.ReduceOp.Add, self.field.distance, -change, self.nodes, mode=dr.ReduceMode.NoConflicts)
        dr.eval(self.field.distance)


def smoothness_slope(field: DistanceField, nodes: UInt) -> Float:
    """Gradient, at the nodes that move, of what keeps the field a distance and its surface even."""
    jit, share = arrays(), 1.0 / dr.width(nodes)

    def sides(values: Float, row: UInt) -> tuple[Float, Float]:
        return dr.gather(jit.Float, values, nodes - row), dr.gather(jit.Float, values, nodes + row)

    def among_all(values: Float) -> Float:
        spread = dr.zeros(jit.Float, dr.width(field.distance))
        dr.make_opaque(spread)
        dr.scatter(spread, values, nodes, mode=dr.ReduceMode.NoConflicts)
        return spread

    around = [sides(field.distance, row) for row in field.rows]
    slope = jit.Array3f(*(0.5 * (high - low) for low, high in around))
    length = dr.norm(slope)
    by_slope = slope * (2.0 * EIKONAL * share * (length - 1.0) / dr.fmax(length, 1e-6))
    laplacian = sum(low + high for low, high in around) - 6.0 * dr.gather(jit.Float, field.distance, nodes)
    bending = among_all(2.0 * BENDING * share * laplacian)
    total = -6.0 * dr.gather(jit.Float, bending, nodes)
    for k, row in enumerate(field.rows):
        low, high = sides(among_all(by_slope[k]), row)
        total += 0.5 * (low - high) + sum(sides(bending, row))
    return total
