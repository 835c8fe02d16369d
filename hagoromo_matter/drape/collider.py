"""Collider: bodies that cloth lies on, as signed distances on a lattice, where every look-up costs the same. mm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip
from hagoromo.errors import InputError
from hagoromo.matter.shape import Shape
from hagoromo_matter.drape.resident import resident

LARGEST_LATTICE = 1 << 26  # largest number of lattice points
NO_BODY_MM = 1e4  # [mm] distance where there is no body


class Collider:
    """Signed distances of `bodies` within the corners low … high, on a lattice of `step`; far outside there is no body.

    common: a solid that belongs to all of them.
    Between lattice points distances are trilinear: edges are rounded over about a step.
    """

    def __init__(
        self,
        bodies: Sequence[Shape],
        low: Sequence[float],
        high: Sequence[float],
        step: float,
        common: Shape | None = None,
    ) -> None:
        jit = arrays()
        self.low, self.step = tuple(float(x) for x in low), float(step)
        self.shape = np.ceil(np.subtract(high, self.low) / step).astype(int) + 1
        count = int(np.prod(self.shape.astype(float)))
        if not (0 < count * max(len(bodies), 1) <= LARGEST_LATTICE and self.shape.min() >= 2):
            raise InputError(
                f"a lattice of {step:g} mm for bodies from {list(low)} to {list(high)} mm: give another step"
            )
        nx, ny = (int(n) for n in self.shape[:2])
        index = dr.arange(jit.UInt, count)
        at = jit.Array3f(index % nx, (index // nx) % ny, index // (nx * ny)) * self.step + jit.Array3f(*self.low)
        values = [np.array(body(at), np.float32) for body in bodies] or [np.full(count, NO_BODY_MM, np.float32)]
        if common is not None:
            shared = np.array(common(at), np.float32)
            values = [np.minimum(shared, own) for own in values]
        self.count, self.values = count, resident(jit.Float, np.concatenate(values))

    def distance_and_normal(self, point: Any, layer: Any) -> tuple[Any, Any]:
        """Distance to body number `layer` (UInt) and the outward direction, for points (Array3f)."""
        jit = arrays()
        nx, ny, nz = (int(n) for n in self.shape)
        at = (point - jit.Array3f(*self.low)) * (1.0 / self.step)
        inside = jit.Array3f(*(clip(a, 0.0, n - 1.001) for a, n in zip(at, (nx, ny, nz), strict=True)))
        cell = dr.floor(inside)
        x, y, z = inside - cell
        first = jit.UInt(cell.x) + nx * (jit.UInt(cell.y) + ny * jit.UInt(cell.z)) + layer * self.count
        c = [dr.gather(jit.Float, self.values, first + i + nx * j + nx * ny * k)
             for k in (0, 1) for j in (0, 1) for i in (0, 1)]  # fmt: skip
        along = [dr.lerp(c[2 * k], c[2 * k + 1], x) for k in range(4)]
        slope_x = dr.lerp(dr.lerp(c[1] - c[0], c[3] - c[2], y), dr.lerp(c[5] - c[4], c[7] - c[6], y), z)
        slope_y = dr.lerp(along[1] - along[0], along[3] - along[2], z)
        low, high = dr.lerp(along[0], along[1], y), dr.lerp(along[2], along[3], y)
        slope = jit.Array3f(slope_x, slope_y, high - low)
        away = dr.norm(at - inside) * self.step  # outside the lattice
        return dr.lerp(low, high, z) + away, slope * dr.rsqrt(dr.squared_norm(slope) + 1e-12)
