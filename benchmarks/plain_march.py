"""The march as one writes it first: a dense grid in single precision, every half voxel, nothing skipped."""

from __future__ import annotations

from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.sample import Element

REFERENCE_END_TRANSMITTANCE = 1e-3  # transmittance at which rays end


class DenseGrid:
    """A dense grid over the cube −1…1, held in a plain object so that loops do not take it into their state."""

    def __init__(self, voxels: np.ndarray) -> None:
        """voxels: density and normal (n, n, n, 4)."""
        self.values, self.side = arrays().Float(voxels.ravel()), len(voxels)

    def at(self, point: Any) -> Any:
        """Trilinear density and normal."""
        jit = arrays()
        place = (point * 0.5 + 0.5) * self.side - 0.5
        cell = dr.minimum(dr.maximum(jit.Array3i(dr.floor(place)), 0), self.side - 2)
        part = place - jit.Array3f(cell)
        part = jit.Array3f(*(dr.fmin(dr.fmax(part[k], 0.0), 1.0) for k in range(3)))
        total: Any = 0.0
        for z, y, x in np.ndindex(2, 2, 2):
            weight = (part.z if z else 1 - part.z) * (part.y if y else 1 - part.y) * (part.x if x else 1 - part.x)
            index = ((cell.z + int(z)) * self.side + cell.y + int(y)) * self.side + cell.x + int(x)
            total = total + weight * dr.gather(jit.Array4f, self.values, jit.UInt(index))
        return total


@dr.syntax
def plain_march(grid: DenseGrid, tau: float, lighting: Lighting, origin: Any, direction: Any) -> Any:
    """Radiance towards the origin of rays; tau: extinction per unit of density [1/m]."""
    jit, step = arrays(), 1.0 / grid.side
    near, far = (-1.0 - origin) / direction, (1.0 - origin) / direction
    t = dr.fmax(dr.max(dr.minimum(near, far)), 0.0) + 0.5 * step
    end = dr.min(dr.maximum(near, far))
    passed = dr.ones(jit.Float, dr.width(direction))
    channels = [dr.zeros(jit.Float, dr.width(direction)) for _ in range(2)]
    while (t < end) & (passed > REFERENCE_END_TRANSMITTANCE):
        point = dr.fma(direction, t, origin)
        voxel = grid.at(point)
        depth = tau * voxel[0] * step
        if depth > 1e-6:
            axis = dr.normalize(jit.Array3f(voxel[1], voxel[2], voxel[3]) + 1e-9)
            material = jit.UInt(0)
            light, _ = lighting.reflected_radiance(
                point, -direction, [Element(axis, material)], [lighting.materials.coefficients(material)]
            )
            radiance = lighting.in_groups(light)
            gain = passed * (1.0 - dr.exp(-depth))
            channels = [dr.fma(gain, radiance[0], channels[0]), dr.fma(gain, radiance[1], channels[1])]
            passed *= dr.exp(-depth)
        t += step
    return channels[0] + channels[1]
