"""Density field: an extinction, the axis of fibres and body colours, free at every node of a lattice.

All three are trilinear between nodes, as in a volume box, so that a box on the same lattice is the same matter.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays, lookup
from hagoromo_recovery.field.fuzzy_march import FuzzyMarch
from hagoromo_recovery.field.fuzzy_moves import FuzzyMoves
from hagoromo_recovery.field.matter_field import AXES, COLOURS, MatterField, add_to, gradient_of, no_sums

if TYPE_CHECKING:
    from hagoromo_recovery.descent.pixel_table import Drawn


class DensityField(MatterField):
    """density: Float (nodes,) extinction [1/voxel]. axes: Float (nodes · 3) tangents of fibres, of length 1 at nodes.

    reach: Float (nodes,) signed distance to where there may be matter [voxel], negative inside: rays skip what is
    outside. It has no gradient.
    """

    element, shown_around = "cylinder", 2
    moving = {"density": 1, "axes": AXES, "colours": COLOURS}

    def __init__(
        self,
        density: NDArray[np.floating],
        axes: NDArray[np.floating],
        colours: NDArray[np.floating],
        reach: NDArray[np.floating],
    ) -> None:
        """density, reach: (nz, ny, nx). axes, colours: (nz, ny, nx, 3)."""
        kind = arrays().Float
        self.density, self.axes, self.reach = (lookup(kind, np.asarray(a, np.float32)) for a in (density, axes, reach))
        super().__init__(colours)

    def no_gradients(self) -> None:
        """Gradients of 0."""
        super().no_gradients()
        self.sums_by_density = no_sums(dr.width(self.density))
        self.sums_by_axes = no_sums(dr.width(self.axes))

    @property
    def by_density(self) -> Float:
        """Float (nodes,), the gradient by extinctions."""
        return gradient_of(self.sums_by_density)

    @property
    def by_axes(self) -> Float:
        """Float (nodes · 3), the gradient by axes."""
        return gradient_of(self.sums_by_axes)

    def march(self, shading: Any, softness: float, shadows: bool) -> FuzzyMarch:
        """What rays see of the fibres, with their shadows; no surface is soft."""
        return FuzzyMarch(self, shading, shadows)

    def moves(self) -> FuzzyMoves:
        """How its numbers follow their gradients."""
        return FuzzyMoves(self)

    def densities(self) -> NDArray[np.float32]:
        """Extinctions (nz, ny, nx) [1/voxel]."""
        return np.array(self.density).reshape(self.shape)

    def tangents(self) -> NDArray[np.float32]:
        """Axes (nz, ny, nx, 3)."""
        return np.array(self.axes).reshape(*self.shape, AXES)

    def plain(self) -> tuple[NDArray[np.float32], ...]:
        """Extinctions, axes, body colours and reach."""
        reach = np.array(self.reach).reshape(self.shape)
        return self.densities(), self.tangents(), self.body_colours(), reach

    def outline_weight(self, drawn: Drawn) -> Float:
        """That of the pixel beside the silhouette; in it, the light says how opaque fibres before the dark are."""
        return dr.select(drawn.share > 0.0, 0.0, drawn.share_weight)

    def value_at(self, place: Array3f) -> Float:
        """Extinction [1/voxel]."""
        jit, total = arrays(), arrays().Float(0)
        for node, weight in self.corner_nodes(place):
            total = dr.fma(weight, dr.gather(jit.Float, self.density, node), total)
        return total

    def axis_at(self, place: Array3f) -> Array3f:
        """Mean tangent of fibres."""
        jit, axis = arrays(), [arrays().Float(0)] * AXES
        for node, weight in self.corner_nodes(place):
            for k in range(AXES):
                axis[k] = dr.fma(weight, dr.gather(jit.Float, self.axes, node * AXES + k), axis[k])
        return jit.Array3f(*axis)

    def reach_at(self, place: Array3f) -> Float:
        """Distance from the nearest node to where there may be matter [voxel]."""
        return dr.gather(arrays().Float, self.reach, self.node_at(place))

    def add_by_value(self, place: Array3f, by: Float) -> None:
        """Add the gradient of by · value_at(place)."""
        for node, weight in self.corner_nodes(place):
            add_to(self.sums_by_density, node, weight * by)

    def add_by_axis(self, place: Array3f, by: Array3f) -> None:
        """Add the gradient of by · axis_at(place)."""
        for node, weight in self.corner_nodes(place):
            for k in range(AXES):
                add_to(self.sums_by_axes, node * AXES + k, weight * by[k])
