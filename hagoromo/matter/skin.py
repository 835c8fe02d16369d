"""Skin: granules (element sphere) packed under a surface, furrows between fields of them, a soft fade. All in mm."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import clip
from hagoromo.matter.fill import Fineness, fill
from hagoromo.matter.noise import cellular_noise, uniform
from hagoromo.matter.shape import Shape, distance_and_normal, rounded_box, smooth_intersection, sphere
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.plan import BoxPlan


class Granules(NamedTuple):
    """Micro-structure of skin: size of the granules, of the fields between furrows, depth of these, fade outside."""

    granule_mm: float = 0.3
    field_mm: float = 0.9
    furrow_mm: float = 0.06
    fade_mm: float = 0.1


def skin(point: Any, shape: Shape, granules: Granules, fineness: Fineness, seed: int) -> tuple[Any, Any]:
    """Density and outward axis of skin under the surface of `shape`.

    Structures that the lattice cannot carry are left out.
    """
    distance, normal = distance_and_normal(shape, point)
    furrows = cellular_noise(point * (1.0 / granules.field_mm), seed + 1, 0.9)
    border = furrows.second - furrows.nearest  # [fields]
    deep = granules.furrow_mm * fineness.resolved(0.3 * granules.field_mm)
    grain = cellular_noise(point * (1.0 / granules.granule_mm), seed)
    round_ = clip(1.0 - dr.square(grain.nearest / (0.75 + 0.35 * uniform(grain.number))), 0.0, 1.0) - 0.5
    sharp = fineness.resolved(granules.granule_mm)
    depth = 0.25 * sharp * granules.granule_mm * round_ - distance - deep * dr.exp(-dr.square(border * 6.0))
    outside = dr.square(clip(1.0 + depth / (granules.fade_mm + fineness.softness), 0.0, 1.0))
    return outside * (1.0 + 0.6 * sharp * round_) * fineness.core(-distance), normal


def skin_patch(
    material: Reflectance,
    size_mm: float = 40.0,
    granules: Granules = Granules(),  # noqa: B008 (an immutable record)
    fineness: Fineness = Fineness(0.12, 0.3),  # noqa: B008
    seed: int = 0,
) -> BoxPlan:
    """A square of skin that bulges like a cheek, stands on z = 0 around x = 0 and faces −y."""
    half, bulge = 0.5 * size_mm, 0.18 * size_mm
    front, back = -bulge - 0.05 * size_mm, 0.1 * size_mm
    radius = half * half / (2.0 * bulge) + 0.5 * bulge  # of the sphere that bulges so far over the square

    def cheek(point: Any) -> Any:
        block = rounded_box(point, (0.0, 0.5 * (back + front), half), (half, 0.5 * (back - front), half), back)
        return smooth_intersection(block, sphere(point, (0.0, radius - bulge, half), radius), 0.1 * size_mm)

    return fill(
        lambda point: skin(point, cheek, granules, fineness, seed),
        fineness.layer(cheek, granules.fade_mm + granules.granule_mm),
        ((-half - 1.0, -bulge - 1.0, -1.0), (half + 1.0, back + 1.0, size_mm + 1.0)),
        fineness,
        material,
        name="skin patch",
    )
