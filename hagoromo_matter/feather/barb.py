"""Barb: the branches of a feather (rami), where they are on its vanes, and where they have come apart. All in mm."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.files.record import NotNegative, Positive, about
from hagoromo_matter.feather.rod import rod
from hagoromo_matter.noise import gradient_noise, random

SPLIT_SPREAD = 0.4  # share of the way between splits over which barbs are pushed together beside one
THIN = 0.6  # share of its width that a barb loses from the shaft to the edge


class Barbs(NamedTuple):
    """The barbs of a pennaceous vane.

    Orders of magnitude: Lucas & Stettenheim 1972; Bachmann et al. 2007 (pigeon).
    """

    per_mm: Annotated[Positive, about("barbs along the shaft [1/mm]")] = 2.2
    outer_deg: Annotated[
        Positive, about("angle between shaft and barbs of the outer vane, where they leave it [°]")
    ] = 28.0
    inner_deg: Annotated[
        Positive, about("angle between shaft and barbs of the inner vane, where they leave it [°]")
    ] = 44.0
    curl_deg: Annotated[NotNegative, about("turn of the barbs towards the tip at the edge [°]")] = 12.0
    steepen: Annotated[Positive, about("factor on the steepness of the barbs at the tip of the feather")] = 1.8
    width_mm: Annotated[Positive, about("width of the section of a barb [mm]")] = 0.05
    height_mm: Annotated[Positive, about("height of the section of a barb [mm]")] = 0.16
    splits_per_cm: Annotated[NotNegative, about("places where the hooks have let go [1/cm]")] = 0.35
    split_mm: Annotated[NotNegative, about("greatest width of such a gap at the edge [mm]")] = 1.6
    ragged_mm: Annotated[NotNegative, about("difference between the lengths of barbs [mm]")] = 0.2
    waver: Annotated[
        NotNegative, about("slow deviation of the barbs from their line, as a share of their distance")
    ] = 0.35


class Barb(NamedTuple):
    """The barb nearest to a place on a vane.

    number: of the barb. start: where on the shaft the line of barbs through the place begins [mm]. beside: distance
    from the barb, above 0 towards the tip. spacing: distance between barbs here. out: distance from the shaft.
    along, aside: unit (across, along) directions of the barb, outwards, and beside it, towards the tip.
    gap: above 0 where barbs have come apart [mm].
    """

    number: Any
    start: Any
    beside: Any
    spacing: Any
    out: Any
    along: Any
    aside: Any
    gap: Any


def barb_at(across: Any, along: Any, plume: Any, barbs: Barbs, seed: Any) -> Barb:
    """The barb at a place of a feather with the form `plume`."""
    jit = arrays()
    inner = across >= 0
    out, half = abs(across), dr.select(inner, jit.Float(plume.inner_mm), plume.outer_mm)
    begin, bend = _slopes(barbs, inner)
    reach = out * (begin + 0.5 * bend * out / half)  # along the shaft from a barb's foot, at the foot of the vane
    more = (barbs.steepen - 1.0) / plume.length_mm
    start = (along - reach) / (1.0 + more * reach)
    if barbs.waver > 0:
        place = jit.Array3f(across * 0.23, along * 0.17, dr.select(inner, 0.5, 7.5))
        start = start + gradient_noise(place, seed) * (barbs.waver / barbs.per_mm)
    slope = (begin + bend * out / half) * (1.0 + more * start)
    sine = dr.rsqrt(1.0 + slope * slope)
    place, squeezed, gap = _parted(start, out / half, inner, barbs, seed)
    number = dr.floor(place * barbs.per_mm)
    wide = (1.0 + more * reach) * sine * squeezed  # across the barbs per mm along the shaft
    beside = (place - (number + 0.5) / barbs.per_mm) * wide
    side = dr.select(inner, jit.Float(1.0), -1.0)
    tangent = jit.Array2f(side * sine, slope * sine)
    aside = jit.Array2f(-side * slope * sine, sine)
    return Barb(number, start, beside, wide / barbs.per_mm, out, tangent, aside, gap * wide)


def barb_density(barb: Barb, height: Any, share: Any, barbs: Barbs, softness: float) -> Any:
    """Density of the barbs themselves; share: of the way to the edge of the vane. Their upper edge is at height 0."""
    radius, tall = section(share, barbs)
    return rod(barb.beside, height + tall + radius, radius, tall, softness)


def barb_area(share: Any, barbs: Barbs) -> Any:
    """Area of a barb's section [mm²] at a share of the way to the edge."""
    radius, tall = section(share, barbs)
    return radius * (math.pi * radius + 4.0 * tall)


def section(share: Any, barbs: Barbs) -> tuple[Any, Any]:
    """Radius, and half the height by which the disc is drawn out."""
    radius = 0.5 * barbs.width_mm * (1.0 - THIN * share)
    return radius, 0.5 * (barbs.height_mm - barbs.width_mm) * (1.0 - THIN * share)


def way_along(out: Any, start: Any, inner: Any, plume: Any, barbs: Barbs) -> Any:
    """Length of a barb from its foot to the distance `out` from the shaft (Simpson's rule)."""
    begin, bend = _slopes(barbs, inner)
    half = dr.select(inner, arrays().Float(plume.inner_mm), plume.outer_mm)
    steep = 1.0 + (barbs.steepen - 1.0) / plume.length_mm * start

    def rate(at: Any) -> Any:
        return dr.sqrt(1.0 + dr.square((begin + bend * at / half) * steep))

    return out * (1.0 / 6.0) * (rate(0.0 * out) + 4.0 * rate(0.5 * out) + rate(out))


def nominal_spacing(barbs: Barbs) -> float:
    """Distance between barbs at the foot of the inner vane [mm]."""
    return math.sin(math.radians(barbs.inner_deg)) / barbs.per_mm


def _slopes(barbs: Barbs, inner: Any) -> tuple[Any, Any]:
    """Slope of the barbs (along / across) at the shaft, and by how much it has grown at the edge."""
    jit, slopes = arrays(), []
    for degrees in (barbs.outer_deg, barbs.inner_deg):
        foot, edge = (1.0 / math.tan(math.radians(angle)) for angle in (degrees, degrees - barbs.curl_deg))
        slopes.append((foot, edge - foot))
    (outer, outer_more), (own, own_more) = slopes
    return dr.select(inner, jit.Float(own), outer), dr.select(inner, jit.Float(own_more), outer_more)


def _parted(start: Any, share: Any, inner: Any, barbs: Barbs, seed: Any) -> tuple[Any, Any, Any]:
    """Where barbs stood before a split pushed them aside, how closely they are pressed, and the depth in the gap."""
    jit = arrays()
    if barbs.splits_per_cm <= 0:
        return start, 1.0, 0.0 * start - 1e3
    every = 10.0 / barbs.splits_per_cm
    cell = dr.floor(start / every)
    side = dr.select(inner, jit.Int(0), 1)
    place, wide, deep = (random((jit.Int(cell), side, k), seed + 9) for k in range(3))
    off = start - (cell + 0.5 + (place - 0.5) * 0.2) * every
    zone = SPLIT_SPREAD * every
    gape = dr.fmin(0.5 * barbs.split_mm, 0.5 * zone) * wide * wide
    gape = gape * clip((share - 0.9 * deep) / (1.0 - 0.85 * deep), 0.0, 1.0)
    far = abs(off)
    pressed = 1.0 - gape / zone
    was = (far - gape) / pressed
    moved = dr.select(off < 0, -was, was) - off
    near = (far < zone) & (far > gape)
    return start + dr.select(near, moved, 0.0), dr.select(near, pressed, 1.0), gape - far
