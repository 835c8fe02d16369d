"""Figure: the winged, draped figure of Tanaka's fig. 8, about 0.3 m high, as one volume box a material."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any, NamedTuple

from hagoromo.errors import InputError
from hagoromo.matter.body import body
from hagoromo.matter.fill import Field, Fineness, fill
from hagoromo.matter.robe import cloth, robe
from hagoromo.matter.shape import SLOPES, Shape
from hagoromo.matter.skin import Granules, skin
from hagoromo.matter.wing import wing, wing_bound
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.plan import BoxPlan

PARTS = ("skin", "cloth", "feather")
GRANULES = Granules(granule_mm=0.3, fade_mm=0.05)


class Part(NamedTuple):
    """What one box of the figure holds: field, bound and extent (corners) [mm]."""

    field: Callable[[Fineness, int], Field]
    bound: Callable[[Fineness, int], Shape]
    extent: tuple[tuple[float, ...], tuple[float, ...]]
    fineness: Fineness


FIGURE = {
    "skin": Part(
        lambda fine, seed: lambda point: skin(point, body, GRANULES, fine, seed)[:2],
        lambda fine, seed: fine.layer(body, 0.3, 2.0),
        ((-16.0, -55.0, 177.0), (16.0, 17.0, 268.0)),
        Fineness(0.28, 0.45),
    ),
    "cloth": Part(
        lambda fine, seed: lambda point: cloth(point, fine, seed),
        lambda fine, seed: fine.layer(lambda point: robe(point, seed), 0.3, SLOPES[1]),
        ((-64.0, -59.0, -0.5), (64.0, 62.0, 273.0)),
        Fineness(0.45, 0.55),
    ),
    "feather": Part(
        lambda fine, seed: lambda point: wing(point, fine, seed),
        lambda fine, seed: wing_bound,
        ((-129.0, 17.0, 61.0), (129.0, 74.0, 305.0)),
        Fineness(0.45, 0.4),
    ),
}


def angel(
    materials: Mapping[str, Reflectance],
    resolution: float = 1.0,
    seed: int = 1,
    parts: tuple[str, ...] = PARTS,
    progress: Callable[[float], None] | None = None,
) -> tuple[VolumeBox, ...]:
    """A draped, winged figure that stands on z = 0 and looks towards −y, one box for each of `parts`.

    materials: by part: "skin" (sphere), "cloth" (cylinder) and "feather" (cylinder). resolution: voxels per mm, of
    those of the demo; yarns, barbs and granules that the lattice then carries appear. progress: told the share done.
    """
    boxes = []
    for number, part in enumerate(parts):
        if part not in FIGURE or part not in materials:
            known = ", ".join(name for name in PARTS if name in materials) or "none"
            raise InputError(f"the figure has no part {part!r} with a material: parts with one are {known}")
        boxes.append(figure_part(part, materials[part], resolution, seed).box())
        if progress:
            progress((number + 1) / len(parts))
    return tuple(boxes)


def figure_part(part: str, material: Reflectance, resolution: float = 1.0, seed: int = 1) -> BoxPlan:
    """One box of the figure: part "skin", "cloth" or "feather"."""
    field, bound, (low, high), fineness = FIGURE[part]
    fine = fineness.finer(resolution)
    extent = [x - fine.softness for x in low], [x + fine.softness for x in high]
    record: dict[str, Any] = {"kind": "figure", "part": part, "resolution": resolution, "seed": seed}
    return fill(field(fine, seed), bound(fine, seed), extent, fine, material, name=part, provenance=record)
