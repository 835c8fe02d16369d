"""Vane: density, tangent and colour at a place on a feather: shaft, barbs, barbules, down. Lengths in mm."""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.matter.fill import Fineness
from hagoromo.matter.shape import coverage, unit
from hagoromo_matter.feather.barb import Barb, Barbs, barb_area, barb_at, barb_density, nominal_spacing
from hagoromo_matter.feather.barbule import Barbules, barbule_density, barbule_thickness
from hagoromo_matter.feather.down import Down, down_density, fluff_at
from hagoromo_matter.feather.marking import Marking, is_marked
from hagoromo_matter.feather.plume import Plume, Spot, outline, shaft
from hagoromo_matter.feather.rod import film
from hagoromo_matter.noise import random

RESOLVED_RATIO = 0.6  # voxel size over distance of strands below which single strands are resolved


class Feather(NamedTuple):
    """The parts of a feather; after: length of its afterfeather as a share of its own (0: none)."""

    plume: Plume = Plume()
    barbs: Barbs = Barbs()
    barbules: Barbules = Barbules()
    down: Down = Down()
    marking: Marking = Marking()
    after: float = 0.0


class Web(NamedTuple):
    """The vane at a place: its barb, share of the way from the shaft to the edge, and downiness.

    edge: distance to where barbs end or gape, negative within; rim: the same to the outline of the whole vane.
    """

    barb: Barb
    share: Any
    fluff: Any
    edge: Any
    rim: Any


def feather_at(spot: Spot, made: Feather, fineness: Fineness, seed: Any) -> tuple[Any, Any, Any]:
    """Density, tangent and colour (UInt: 0, 1 for the marking, 2 for the shaft) of a feather at a place on it."""
    jit, soft, web = arrays(), fineness.softness, web_at(spot.across, spot.along, made, seed)
    density, way = closed_vane(spot, web, made, fineness, seed)
    if made.down.share > 0:
        loose, loose_way = down_density(web.barb, spot.height, made.down, fineness, seed)
        loose = loose * coverage(web.edge, 4.0 * soft) * web.fluff
        density = density * dr.square(1.0 - web.fluff)
        way = dr.select(loose > density, loose_way, way)
        density = dr.fmin(density + loose, 1.0)
    along, aside = web.barb.along, web.barb.aside
    tangent = (
        spot.right * (along.x * way.x + aside.x * way.y)
        + spot.ahead * (along.y * way.x + aside.y * way.y)
        + spot.above * way.z
    )
    stem, taken = shaft(spot, made.plume, soft)
    density = density * (1.0 - taken)
    stiff = stem > density
    marked = is_marked(spot.across, spot.along, web.rim, web.barb.number, made.plume, made.marking, seed)
    colour = dr.select(stiff, jit.UInt(2), dr.select(marked, jit.UInt(1), 0))
    return dr.fmin(density + stem, 1.0), unit(dr.select(stiff, spot.ahead, tangent)), colour


def web_at(across: Any, along: Any, made: Feather, seed: Any) -> Web:
    """The vane of a feather at a place."""
    plume, jit = made.plume, arrays()
    barb = barb_at(across, along, plume, made.barbs, seed)
    fluff = fluff_at(barb.start, plume, made.down)
    longer = random((jit.Int(barb.number), dr.select(across < 0, jit.Int(0), 1), 5), seed) - 0.5
    rim = outline(across, along, plume) + longer * made.barbs.ragged_mm * (1.0 + 2.0 * fluff)
    edge = dr.fmax(rim, dr.fmax(plume.quill * plume.length_mm - barb.start, barb.gap))
    half = dr.select(across < 0, plume.outer_mm, jit.Float(plume.inner_mm))
    return Web(barb, clip(barb.out / half, 0.0, 1.0), fluff, edge, rim)


def closed_vane(spot: Spot, web: Web, made: Feather, fineness: Fineness, seed: Any) -> tuple[Any, Any]:
    """Density of barbs and barbules, and their tangent: along the barb, beside it, up.

    Strands that the lattice cannot resolve become a film of the same mass with their mean tangent: barbules
    lean to both sides of the barb, so their mean is along it.
    """
    jit, soft, (barb, share, _, edge, _) = arrays(), fineness.softness, web
    barbs_shown, barbules_shown = shown(made, fineness)
    inside, way = coverage(edge, soft), jit.Array3f(1, 0, 0)
    # the edge is stiff barbs alone: barbules end before it
    webbed = inside * clip(-edge / made.barbules.distal_mm, 0.3, 1.0)
    middle = spot.height + 0.5 * made.barbs.height_mm
    rami = 0.0 * spot.height
    if barbs_shown > 0:
        rami = barbs_shown * barb_density(barb, spot.height, share, made.barbs, soft)
    if barbs_shown < 1:
        mass = barb_area(share, made.barbs) / barb.spacing
        rami = rami + (1.0 - barbs_shown) * film(middle, made.barbs.height_mm, mass, soft)
    web_density = 0.0 * spot.height
    if barbules_shown > 0:
        inner = spot.across >= 0
        fine, fine_way = barbule_density(barb, spot.height, share, inner, made, soft, seed)
        web_density = barbules_shown * fine
        way = dr.select(web_density > rami, fine_way, way)
    if barbules_shown < 1:
        mass = barbule_thickness(barb.spacing, share, made)
        thick = made.barbules.height_mm + made.barbules.rise_mm
        level = spot.height + 0.5 * made.barbules.height_mm
        web_density = web_density + (1.0 - barbules_shown) * film(level, thick, mass, soft)
    return dr.fmin(rami * inside + web_density * webbed, 1.0), way


def shown(made: Feather, fineness: Fineness) -> tuple[float, float]:
    """Share of barbs and of barbules that the lattice resolves one by one, 0…1."""
    barbules = made.barbules
    fine = min(1.0 / barbules.distal_per_mm, 1.0 / barbules.proximal_per_mm)
    return fineness.resolved(RESOLVED_RATIO * nominal_spacing(made.barbs)), fineness.resolved(RESOLVED_RATIO * fine)


def vane_thickness(across: Any, along: Any, made: Feather, seed: Any) -> Any:
    """Volume of barbs and barbules over the area of a closed vane [mm]: times 1 / mean free path, its optical depth."""
    web = web_at(across, along, made, seed)
    spacing = web.barb.spacing
    return barb_area(web.share, made.barbs) / spacing + barbule_thickness(spacing, web.share, made)
