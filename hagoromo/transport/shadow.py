"""Shadow: how much of a lamp's light arrives through all volume boxes, by brute march or by deep shadow maps."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays
from hagoromo.light.lamp import Lamp
from hagoromo.transport.frames import TOLERANCE
from hagoromo.transport.lighting import Attenuation
from hagoromo.transport.march import optical_depth
from hagoromo.transport.medium import Medium
from hagoromo.transport.shadow_map import ShadowMaps

TEXELS_PER_VOXEL = 1.2  # at TOLERANCE
MOST_TEXELS = 1024  # a side: 96 MiB a lamp
DIFFERING = (
    0.15,
    0.3,
)  # between the rays around a point, from which the way to it is marched: transmittance, share of it
STEEPEST = 4.0  # slope against light, up to which a surface stands clear of its own shadow in a map
NEAR, STRIDE = 8.0, 2.0  # voxels that are marched there, and length of a step in usual ones


def brute_attenuation(medium: Medium) -> Attenuation:
    """`Attenuation` by marching from every point to the lamp: slow, exact up to the step; the oracle of the maps."""

    def transmittance(lamp: int, point: Any, to_lamp: Any, distance: Any, within: Any) -> Any:
        return dr.exp(-optical_depth(medium, point, to_lamp, arrays().Float(0), arrays().Float(distance)))

    return transmittance


def mapped_attenuation(
    medium: Medium, lamps: Sequence[Lamp], resolution: int | None = None, tolerance: float = TOLERANCE
) -> Attenuation:
    """`Attenuation` by one deep shadow map a lamp; `resolution` texels a side (default: `fitting_resolution`).

    Where the rays of a map around a point differ, at edges of shadows and under light that grazes, the first few
    voxels towards the lamp are marched, and the map is looked up behind them: `tolerance` (see `Settings`) says where.
    """
    kinds, finer = arrays(), math.sqrt(tolerance / TOLERANCE)
    maps = ShadowMaps(medium, lamps, resolution or fitting_resolution(medium, tolerance))
    least, share = (dr.opaque(kinds.Float, figure * finer) for figure in DIFFERING)
    near = dr.opaque(kinds.Float, NEAR / math.sqrt(finer) * min(box.voxel_size for box in medium.boxes))

    def transmittance(lamp: int, point: Any, to_lamp: Any, distance: Any, within: Any) -> Any:
        if within is None:  # no box has a texel, or the point is on a surface
            return looked_up(lamp, point, to_lamp, distance)
        return dr.if_stmt(
            (point, to_lamp, distance, within), within.textured,
            lambda point, to_lamp, distance, within: out_of_texel(lamp, point, to_lamp, distance, within),
            lambda point, to_lamp, distance, within: looked_up(lamp, point, to_lamp, distance),
        )  # fmt: skip

    def out_of_texel(lamp: int, point: Any, to_lamp: Any, distance: Any, within: Any) -> Any:
        depth, length = medium.through(within, to_lamp, distance)
        slope = dr.abs(dr.dot(within.frame.normal, to_lamp))
        length += maps.width(lamp, point) * (1.0 + dr.fmin(dr.rcp(dr.fmax(slope, 1e-2)), STEEPEST))
        return dr.exp(-depth) * maps.look(lamp, dr.fma(to_lamp, dr.fmin(length, distance), point))[0]

    def looked_up(lamp: int, point: Any, to_lamp: Any, distance: Any) -> Any:
        def marched(point: Any, to_lamp: Any, distance: Any, passed: Any) -> Any:
            reach = dr.fmin(near, distance)
            depth = optical_depth(medium, point, to_lamp, kinds.Float(0), reach, STRIDE)
            return dr.exp(-depth) * maps.look(lamp, dr.fma(to_lamp, reach, point))[0]

        passed, difference = maps.look(lamp, point)
        args = (point, to_lamp, kinds.Float(distance), passed)
        return dr.if_stmt(
            args, difference > dr.fma(share, passed, least), marched, lambda point, to_lamp, distance, passed: passed
        )

    return transmittance


def fitting_resolution(medium: Medium, tolerance: float = TOLERANCE) -> int:
    """Texels a side: TEXELS_PER_VOXEL of the smallest voxel over the extent of all boxes, from 128 to MOST_TEXELS.

    A tolerance of a sixteenth takes twice as many.
    """
    corners = np.concatenate([box.corners() for box in medium.boxes])
    voxels = np.linalg.norm(np.ptp(corners, axis=0)) / min(box.voxel_size for box in medium.boxes)
    finer = (TOLERANCE / tolerance) ** 0.25
    return int(np.clip(64 * round(TEXELS_PER_VOXEL * finer * voxels / 64), 128, MOST_TEXELS))
