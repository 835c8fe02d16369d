"""Feather: the plan of a feather, or of a patch of its vane under the microscope. All in mm.

Elements are cylinders: their tangents run along shaft, barbs and barbules. The vane is thin: light passes.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from hagoromo.errors import InputError
from hagoromo.matter.fill import MM, Fineness, blocks_in
from hagoromo.matter.shape import Shape
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box_header import BoxHeader
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.feather.check import check_feather
from hagoromo_matter.feather.kinds import FEATHERS
from hagoromo_matter.feather.plume import flat_spot, spot_on
from hagoromo_matter.feather.vane import Feather, feather_at

FEATHER_FINENESS = Fineness(0.08, 0.03)
PATCH_FINENESS = Fineness(0.01, 0.03)


def feather(
    material: Reflectance | Sequence[Reflectance],
    made: Feather = FEATHERS["primary"],
    fineness: Fineness = FEATHER_FINENESS,
    seed: int = 0,
) -> BoxPlan:
    """A feather that stands on its quill at z = 0 around x = 0 and shows its upper side to −y.

    material: one, or two (the second is the marking's), or three (the third is the shaft's). Raises
    `InputError` for impossible sizes.
    """
    made = check_feather(made)
    plume = made.plume
    frayed = 2.0 * made.barbs.ragged_mm + 3.0 * fineness.softness
    widest = max(plume.outer_mm, plume.inner_mm) * 1.05 + frayed
    loft = 2.6 * made.down.loft_mm if made.down.share > 0 else 0.0
    deep = max(loft, plume.rachis_mm, 1.5 * made.barbs.height_mm) + 2.0 * fineness.softness

    def field(point: Any) -> tuple[Any, Any, Any]:
        density, tangent, colour = feather_at(spot_on(point, plume), made, fineness, seed)
        if made.after > 0:
            other, other_way, other_colour = feather_at(
                spot_on(_behind(point, made), after.plume), after, fineness, seed + 1
            )
            more = other > density
            density, tangent = dr.fmax(density, other), dr.select(more, other_way, tangent)
            colour = dr.select(more, other_colour, colour)
        return density, tangent, colour

    after = afterfeather(made)

    def bound(point: Any) -> Any:
        spot = spot_on(point, plume)
        quill = plume.quill * plume.length_mm
        bare = dr.fmax(abs(spot.across), abs(spot.height)) - plume.rachis_mm - fineness.softness
        webbed = dr.fmax(dr.fmax(abs(spot.height) - deep, abs(spot.across) - widest), quill - spot.along)
        ends = dr.fmax(-spot.along, spot.along - plume.length_mm) - frayed
        near = dr.fmin(dr.fmax(dr.fmin(bare, webbed), ends), 1e3)
        return 0.7 * near

    side, back = widest + abs(plume.bow_mm) + 2.0, plume.arch_mm + plume.camber_mm + deep + 1.0
    extent = (-side, -deep - 1.0 - max(-plume.arch_mm, 0.0), -1.0), (side, back, plume.length_mm + frayed + 1.0)
    return plan_of(field, bound, extent, fineness, material, "feather")


def vane_patch(
    material: Reflectance | Sequence[Reflectance],
    made: Feather = FEATHERS["primary"],
    crop_mm: tuple[float, float] = (3.0, 3.0),
    middle_mm: tuple[float, float] = (4.0, 55.0),
    fineness: Fineness = PATCH_FINENESS,
    seed: int = 0,
) -> BoxPlan:
    """A patch of a vane laid flat: `crop_mm` across and along the feather, around `middle_mm` (across, along).

    Stands on z = 0 around x = 0 and shows its upper side to −y. material: see `feather`.
    """
    made = check_feather(made)
    (wide, tall), (across, along) = crop_mm, middle_mm
    if min(wide, tall) <= 0:
        raise InputError(f"crop_mm is {wide:g}, {tall:g}: give two lengths above 0")
    if not (-made.plume.outer_mm <= across <= made.plume.inner_mm and 0.0 <= along <= made.plume.length_mm):
        raise InputError(
            f"middle_mm {across:g}, {along:g} is not on the feather: give (across, along) within its vanes"
        )

    def field(point: Any) -> tuple[Any, Any, Any]:
        there = type(point)(point.x + across, point.y, point.z - 0.5 * tall + along)
        return feather_at(flat_spot(there), made, fineness, seed)

    half, soft = 0.5 * wide, fineness.softness
    up, under = 2.0 * made.barbules.rise_mm + made.barbules.height_mm + soft, made.barbs.height_mm + soft
    if abs(across) < half + made.plume.rachis_mm:
        under, up = max(under, made.plume.rachis_mm), max(up, 0.5 * made.plume.rachis_mm)
    if made.down.share > 0 and along < made.plume.length_mm * (made.plume.quill + 1.3 * made.down.share):
        under, up = max(under, 2.0 * made.down.loft_mm), max(up, 2.0 * made.down.loft_mm)
    extent = (-half, -up, 0.0), (half, under, tall)
    return plan_of(field, lambda point: abs(point.y) - 2.0 * under - up, extent, fineness, material, "vane")


def afterfeather(made: Feather) -> Feather:
    """The second, wholly downy feather that grows from the same quill."""
    plume, share = made.plume, max(made.after, 1e-3)
    small = plume._replace(
        length_mm=plume.length_mm * share, outer_mm=0.8 * plume.outer_mm, inner_mm=0.8 * plume.inner_mm,
        rachis_mm=0.3 * plume.rachis_mm, quill=min(plume.quill / share, 0.5), tip=0.7, bow_mm=0.0,
    )  # fmt: skip
    return made._replace(plume=small, down=made.down._replace(share=1.0), after=0.0)


def _behind(point: Any, made: Feather) -> Any:
    """The point in the coordinates of the afterfeather, which lies beneath its feather."""
    return type(point)(point.x, point.y - 0.8 * made.plume.rachis_mm - 0.4 * made.down.loft_mm, point.z)


def plan_of(
    field: Any, bound: Shape, extent: Any, fineness: Fineness, material: Reflectance | Sequence[Reflectance], name: str
) -> BoxPlan:
    """The plan of a field of density, tangent and colour; up to three materials, one for each colour."""
    given = (material,) if isinstance(material, Reflectance) else tuple(material)
    if not 1 <= len(given) <= 3:
        raise InputError(f"{len(given)} materials of a feather: give one, two (the marking's) or three (the shaft's)")
    three = (*given, *(given[0],) * (3 - len(given)))
    blocks, pose = blocks_in(field, bound, extent, fineness.voxel_mm)
    header = BoxHeader(fineness.voxel_mm * MM, 1.0 / (fineness.mean_free_path_mm * MM), three, pose, name=name)
    return BoxPlan(header, blocks)
