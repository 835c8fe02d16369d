"""Fill: a function of position [mm] that gives density and axis → the plan of a volume box [m]."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip
from hagoromo.errors import InputError
from hagoromo.matter.shape import Shape, coverage
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.field_blocks import FieldBlocks
from hagoromo.volume.store.plan import BoxPlan

MM = 1e-3  # m
LARGEST_EDGE = 4096  # voxels along an edge of the box
CUBES_PER_EDGE = 4  # a brick is tested for matter in PARTS³ cubes
ASKED = 1 << 18  # bricks that are tested together
CORE = 10.0  # density of the core beneath the micro-structure
CORE_FROM, CORE_FULL, CORE_TO = 2.5, 3.5, 4.0  # depth of the core under a surface [mean free paths]
Field = Callable[[Any], tuple[Any, Any]]  # point [mm] → density, unit axis


class Fineness(NamedTuple):
    """How matter is sampled: edge of a voxel, and mean free path of light where the density is 1 [mm]."""

    voxel_mm: float
    mean_free_path_mm: float

    @property
    def softness(self) -> float:
        """Width of an edge [mm]: two voxels let trilinear interpolation show a surface without steps."""
        return 2.0 * self.voxel_mm

    @property
    def deepest(self) -> float:
        """Depth under the surface of a thick thing beyond which `core` leaves no matter [mm]."""
        return CORE_TO * self.mean_free_path_mm + 2.0 * self.softness

    def finer(self, resolution: float) -> Fineness:
        """The same matter on voxels that are `resolution` times smaller."""
        return self._replace(voxel_mm=self.voxel_mm / resolution)

    def resolved(self, size: float) -> float:
        """Share of a structure of `size` [mm] that the lattice resolves: 0 below one voxel, 1 from two voxels on."""
        return min(max(size / self.voxel_mm - 1.0, 0.0), 1.0)

    def core(self, depth: Any) -> Any:
        """Factor on the density at a depth [mm] under the surface of a thick thing.

        1 near the surface, where the micro-structure is visible; CORE below, so that the core is opaque within a short
        distance; 0 deeper still, where no light arrives.
        """
        path, deep = self.mean_free_path_mm, CORE_TO * self.mean_free_path_mm
        dense = clip((depth - CORE_FROM * path) / ((CORE_FULL - CORE_FROM) * path), 0.0, 1.0)
        return (1.0 + (CORE - 1.0) * dense) * coverage(depth - deep - self.softness, self.softness)

    def layer(self, shape: Shape, outside: float, steepest: float = 1.0) -> Shape:
        """Bound of the matter from `outside` [mm] above the surface of `shape` down to the end of the core.

        steepest: the largest slope of `shape` (1 for a true distance).
        """
        top, bottom = outside + self.softness, self.deepest

        def bound(point: Any) -> Any:
            distance = shape(point) * (1.0 / steepest)
            return dr.fmax(distance - top, -distance - bottom)

        return bound


def fill(
    field: Field,
    bound: Shape,
    extent: tuple[Sequence[float], Sequence[float]],
    fineness: Fineness,
    material: Reflectance,
    **record: Any,
) -> BoxPlan:
    """The box of `field`, a function of the point [mm] that gives density (0…CORE) and a unit axis.

    bound: a Shape [mm], a lower bound of the distance to matter; bricks that it excludes are not evaluated.
    extent: low and high corner [mm]. σ = τ ρ with τ = 1 / mean free path. record: name and provenance of the box.
    """
    blocks, pose = blocks_in(field, bound, extent, fineness.voxel_mm)
    tau = 1.0 / (fineness.mean_free_path_mm * MM)
    return BoxPlan(BoxHeader(fineness.voxel_mm * MM, tau, (material,), pose, **record), blocks)


def blocks_in(
    field: Callable[[Any], Any], bound: Shape, extent: tuple[Sequence[float], Sequence[float]], voxel: float
) -> tuple[FieldBlocks, NDArray[np.float64]]:
    """Blocks of a function of the point [mm] on voxels of edge `voxel` [mm], and the pose of their box [m]."""
    low, high = (np.asarray(corner, float) for corner in extent)
    voxels = np.ceil((high - low) / voxel)
    if not voxels.max() <= LARGEST_EDGE:
        raise InputError(
            f"voxel_mm {voxel:g} is too fine for a box of {(high - low).max():g} mm: "
            f"{LARGEST_EDGE} voxels a side at most"
        )
    pose = np.eye(4)
    pose[:3, 3] = low * MM

    def in_mm(point: Any) -> Any:
        return type(point)(*(point[k] * (1.0 / MM) + float(low[k]) for k in range(3)))

    blocks = FieldBlocks(
        lambda point: field(in_mm(point)),
        (int(voxels[2]) + 1, int(voxels[1]) + 1, int(voxels[0]) + 1),
        voxel * MM,
        lambda centre, radius: _may_hold(bound, in_mm(centre), radius / MM),
    )
    return blocks, pose


def _may_hold(bound: Shape, centre: Any, radius: float) -> NDArray[np.bool_]:
    """Whether the balls around `centre` [mm] may hold matter, by `bound`.

    Each ball is tested in PARTS³ parts: the bound of a shape with steep slopes then keeps fewer empty bricks.
    """
    jit, parts = arrays(), CUBES_PER_EDGE**3
    dr.eval(centre)
    may_hold = []
    for first in range(0, dr.width(centre), ASKED):
        count = min(ASKED, dr.width(centre) - first)
        index = dr.arange(jit.UInt, count * parts)
        part = index % parts
        place = jit.Array3f(part % CUBES_PER_EDGE, (part // CUBES_PER_EDGE) % CUBES_PER_EDGE, part // CUBES_PER_EDGE**2)
        shift = (place - 0.5 * (CUBES_PER_EDGE - 1)) * (2.0 * radius / math.sqrt(3.0) / CUBES_PER_EDGE)
        middle = dr.gather(jit.Array3f, centre, index // parts + dr.opaque(jit.UInt, first))
        near = dr.select(bound(middle + shift) < radius / CUBES_PER_EDGE, jit.UInt(1), 0)
        may_hold.append(np.array(dr.block_sum(near, parts)) > 0)
    return np.concatenate(may_hold)
