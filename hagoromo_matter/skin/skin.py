"""Skin: scales of horn over granules (element sphere), cut by lines and pores, with a soft outer edge. Lengths in mm.

The scales of the stratum corneum are plane elements that lie, a little tilted, on the skin; the granules under them
reflect alike in all directions. Structures that the lattice cannot resolve fade out.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Annotated, Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.errors import InputError
from hagoromo.files.record import NotNegative, Positive, about
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.fill import Fineness, fill
from hagoromo.matter.shape import Shape, distance_and_normal, rounded_box, smooth_intersection, sphere, unit
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.store.plan import BoxPlan
from hagoromo_matter.noise import cellular_noise, hashed, seed_of, uniform
from hagoromo_matter.skin.skin_lines import FurrowLattice, furrows

RISE = 0.15  # height of a granule above its neighbours [diameters]
EDGE_VOXELS = (
    3.0  # width of the edge of skin: over two, light that grazes shows the lattice as bands of 1.2 %, not 0.5 %
)


class Granules(NamedTuple):
    """Micro-structure of skin: granules, scales, lines and pores (see `FurrowLattice`), and the fade outside.

    The horny layer is 10–20 µm thick but for palms and soles; cells of the horn are 30–50 µm wide and peel in flakes.
    The defaults are life-size.
    """

    granule_mm: Annotated[Positive, about("diameter of the granules of the living layers [mm]")] = 0.12
    corneum_mm: Annotated[NotNegative, about("thickness of the horny layer of scales above them; 0: none [mm]")] = 0.02
    scale_mm: Annotated[Positive, about("width of a scale [mm]")] = 0.08
    scale_deg: Annotated[NotNegative, about("tilt of a scale against the surface [°]")] = 6.0
    primary_mm: Annotated[Positive, about("distance of the primary lines [mm]")] = FurrowLattice().primary_mm
    primary_depth_mm: Annotated[NotNegative, about("depth of the primary lines [mm]")] = (
        FurrowLattice().primary_depth_mm
    )
    secondary_mm: Annotated[Positive, about("distance of the secondary lines [mm]")] = FurrowLattice().secondary_mm
    secondary_depth_mm: Annotated[NotNegative, about("depth of the secondary lines [mm]")] = (
        FurrowLattice().secondary_depth_mm
    )
    rhomb_deg: Annotated[Positive, about("angle at which two sets of primary lines cross [°]")] = (
        FurrowLattice().rhomb_deg
    )
    pore_mm: Annotated[Positive, about("diameter of the pores [mm]")] = FurrowLattice().pore_mm
    pores_per_cm2: Annotated[NotNegative, about("pores per area [1/cm²]")] = FurrowLattice().pores_per_cm2
    fade_mm: Annotated[NotNegative, about("thickness of the soft outermost surface [mm]")] = 0.015

    @property
    def lines(self) -> FurrowLattice:
        """The lines and pores of this skin."""
        return FurrowLattice(*(getattr(self, name) for name in FurrowLattice._fields))


class Flush(NamedTuple):
    """Where skin is redder: `share` 0…1 of a point [mm], and its body colour there."""

    share: Callable[[Any], Any]
    colour: Spectrum


def check_granules(granules: Granules) -> Granules:
    """The granules, unchanged; raises `InputError` for furrows without skin between them, or impossible angles."""
    for kind in ("primary", "secondary"):
        spacing, depth = (getattr(granules, name) for name in (f"{kind}_mm", f"{kind}_depth_mm"))
        if depth > 0.4 * spacing:
            raise InputError(
                f"{kind}_depth_mm {depth:g} leaves no skin between lines every {kind}_mm {spacing:g}: give at most "
                f"{0.4 * spacing:g}"
            )
    if not 10.0 <= granules.rhomb_deg <= 170.0:
        raise InputError(f"rhomb_deg is {granules.rhomb_deg:g}: give an angle from 10 to 170")
    if not 0.0 <= granules.scale_deg <= 45.0:
        raise InputError(f"scale_deg is {granules.scale_deg:g}: give a tilt from 0 to 45")
    taken = granules.pores_per_cm2 * 0.01 * granules.pore_mm**2
    if taken > 0.5:
        raise InputError(f"pores of pore_mm {granules.pore_mm:g} take up {taken:.2g} of the skin: give at most half")
    return granules


def skin(point: Any, shape: Shape, granules: Granules, fineness: Fineness, seed: Any) -> tuple[Any, Any, Any]:
    """Density, axis and layer (0 granules, 1 scales) of the skin of `shape` at points [mm]."""
    seed = seed_of(seed)
    distance, normal = distance_and_normal(shape, point)
    height, slope = _height_and_slope(point, normal, granules, fineness, seed)
    depth = height - distance
    outside = dr.square(clip(1.0 + depth / edge_mm(granules, fineness), 0.0, 1.0))
    axis = unit(normal - (slope - normal * dr.dot(normal, slope)) + _tilt(point, granules, fineness, seed))
    horn = (depth < granules.corneum_mm) & (granules.corneum_mm > 0)
    return outside * fineness.core(depth), axis, dr.select(horn, arrays().UInt(1), 0)


def edge_mm(granules: Granules, fineness: Fineness) -> float:
    """Width over which the density of skin rises from 0 at its outside [mm]."""
    return granules.fade_mm + EDGE_VOXELS * fineness.voxel_mm


def skin_on(
    shape: Shape,
    extent: tuple[Any, Any],
    material: Reflectance,
    granules: Granules = Granules(),  # noqa: B008 (an immutable record)
    fineness: Fineness = Fineness(0.02, 0.04),  # noqa: B008
    seed: int = 0,
    steepest: float = 1.0,
    flush: Flush | None = None,
    **record: Any,
) -> BoxPlan:
    """The box of the skin of `shape` inside `extent` (corners) [mm]; steepest: largest slope of `shape`.

    material: of the granules, and on plane elements of the scales, alone where these reach as deep as light; flush:
    where it has another colour, as on lips.
    """
    granules = check_granules(granules)

    all_horn = granules.corneum_mm >= fineness.deepest
    scales = replace(material, element="plane", name=f"{material.name} scales".strip())

    def field(point: Any) -> Any:
        density, axis, layer = skin(point, shape, granules, fineness, seed)
        values = {"density": density, "axis": axis} | ({} if all_horn else {"material": layer})
        if flush is None:
            return values
        share = flush.share(point)
        return values | {"colour": [1.0 - share, share]}

    plan = fill(
        field,
        fineness.layer(shape, edge_mm(granules, fineness) - fineness.softness + RISE * granules.granule_mm, steepest),
        extent,
        fineness,
        material,
        **record,
    )
    layers = (scales,) if all_horn else (material, scales)
    basis = () if flush is None else (material.body_colour, flush.colour)
    return replace(plan, header=replace(plan.header, materials=layers, basis=basis))


def skin_patch(
    material: Reflectance,
    size_mm: float = 10.0,
    granules: Granules = Granules(),  # noqa: B008
    fineness: Fineness = Fineness(0.02, 0.04),  # noqa: B008
    seed: int = 0,
) -> BoxPlan:
    """A square of skin that bulges like a cheek, stands on z = 0 around x = 0 and faces −y."""
    half, bulge = 0.5 * size_mm, 0.18 * size_mm
    front, back = -bulge - 0.05 * size_mm, 0.1 * size_mm
    radius = half * half / (2.0 * bulge) + 0.5 * bulge  # of the sphere with this bulge over the square

    def cheek(point: Any) -> Any:
        block = rounded_box(point, (0.0, 0.5 * (back + front), half), (half, 0.5 * (back - front), half), back)
        return smooth_intersection(block, sphere(point, (0.0, radius - bulge, half), radius), 0.1 * size_mm)

    room = 0.025 * size_mm + granules.fade_mm + RISE * granules.granule_mm
    extent = (-half - room, -bulge - room, -room), (half + room, back + room, size_mm + room)
    return skin_on(cheek, extent, material, granules, fineness, seed, name="skin patch")


def _height_and_slope(point: Any, normal: Any, granules: Granules, fineness: Fineness, seed: Any) -> tuple[Any, Any]:
    """Height of the relief over the surface [mm], 0 between the lines on average, and its gradient."""
    moved = type(point)(dr.detach(point))
    dr.enable_grad(moved)
    height = -furrows(moved, dr.detach(normal), granules.lines, fineness, seed)
    sharp = fineness.resolved(granules.granule_mm)
    if sharp > 0:
        grain = cellular_noise(moved * (1.0 / granules.granule_mm), seed)
        round_ = clip(1.0 - dr.square(grain.nearest / (0.75 + 0.35 * uniform(grain.number))), 0.0, 1.0)
        height += RISE * sharp * granules.granule_mm * (round_ - 0.5)
    if not dr.grad_enabled(height):
        return height, type(point)(0.0)
    dr.backward(height)
    return dr.detach(height), dr.grad(moved)


def _tilt(point: Any, granules: Granules, fineness: Fineness, seed: Any) -> Any:
    """Tilt of the axes of scales against the normal: one vector per scale, of about the sine of scale_deg."""
    sharp = fineness.resolved(granules.scale_mm) * granules.scale_deg * math.radians(1.0)
    if sharp == 0:
        return type(point)(0.0)
    number = cellular_noise(point * (1.0 / granules.scale_mm), seed + 3).number
    return sharp * (2.0 * type(point)(*(uniform(part) for part in hashed((number, 0, 0), 5))) - 1.0)
