"""Barbule: the branches of barbs that close a vane: distal ones with hooklets, which hold the proximal ones of the
next barb. All in mm.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.files.record import Positive, about, from_to
from hagoromo.matter.shape import unit
from hagoromo_matter.feather.barb import Barb, section, way_along
from hagoromo_matter.feather.rod import rod
from hagoromo_matter.noise import random

MOST_HOOKS = 100
BASE = 0.5  # share of a barbule's length that is a flat lamella; the rest is a thin thread
BARBULE_TAPER = 0.6  # relative loss of width along a barbule
HOOKED = 0.5, 0.9  # shares of a distal barbule's length between which hooklets sit
BARBULE_SPREAD = 0.25  # relative spread of the place and length of barbules
HOOK = 0.4  # thickness of a hooklet, as a share of the barbule's


class Barbules(NamedTuple):
    """The barbules of a pennaceous vane.

    Orders of magnitude: Lucas & Stettenheim 1972; Bachmann et al. 2007 (pigeon).
    """

    distal_per_mm: Annotated[Positive, about("distal barbules along a barb: with hooks, towards the tip [1/mm]")] = 25.0
    proximal_per_mm: Annotated[
        Positive, about("proximal barbules along a barb: with grooves, towards the quill [1/mm]")
    ] = 20.0
    distal_deg: Annotated[Positive, about("angle between barb and distal barbules [°]")] = 48.0
    proximal_deg: Annotated[Positive, about("angle between barb and proximal barbules [°]")] = 40.0
    distal_mm: Annotated[Positive, about("length of the distal barbules [mm]")] = 0.42
    proximal_mm: Annotated[Positive, about("length of the proximal barbules [mm]")] = 0.46
    width_mm: Annotated[Positive, about("width of the section at their foot [mm]")] = 0.011
    height_mm: Annotated[Positive, about("height of the section at their foot [mm]")] = 0.024
    rise_mm: Annotated[float, about("height by which distal barbules climb over proximal ones [mm]")] = 0.016
    hooks: Annotated[int, from_to(0, MOST_HOOKS), about("hooklets of a distal barbule")] = 4
    hook_mm: Annotated[Positive, about("distance that hooklets reach down [mm]")] = 0.03


class Between(NamedTuple):
    """A place between two barbs: number of the one towards the quill, distances from both [mm]."""

    lower: Any
    distal: Any
    proximal: Any


def between(barb: Barb) -> Between:
    """The two barbs on either side of a place."""
    before = barb.beside < 0
    distal = dr.select(before, barb.beside + barb.spacing, barb.beside)
    return Between(barb.number - dr.select(before, 1.0, arrays().Float(0.0)), distal, barb.spacing - distal)


def barbule_density(
    barb: Barb, height: Any, share: Any, inner: Any, made: Any, softness: float, seed: Any
) -> tuple[Any, Any]:
    """Density of barbules and hooklets, and their tangent: along the barb, beside it, up."""
    jit, barbules = arrays(), made.barbules
    where = between(barb)
    density, tangent = jit.Float(0.0) * height, jit.Array3f(1, 0, 0)
    for distal in (True, False):
        angle = math.radians(barbules.distal_deg if distal else barbules.proximal_deg)
        per_mm = barbules.distal_per_mm if distal else barbules.proximal_per_mm
        long = barbules.distal_mm if distal else barbules.proximal_mm
        away, sign = (where.distal, 1.0) if distal else (where.proximal, -1.0)
        out = barb.out + sign * away * abs(barb.along.y)
        number = where.lower + (0.0 if distal else 1.0)
        shift = random((jit.Int(number), int(distal), dr.select(inner, jit.Int(0), 1)), seed + 5)
        foot = way_along(out, barb.start, inner, made.plume, made.barbs) - away / math.tan(angle)
        place = foot * per_mm + shift
        own = dr.floor(place)
        nudge, longer = (random((jit.Int(own), jit.Int(number), k), seed + 6) - 0.5 for k in range(2))
        aside = (place - own - 0.5 + BARBULE_SPREAD * nudge) / per_mm * math.sin(angle)
        run = away / (math.sin(angle) * long * (1.0 + BARBULE_SPREAD * longer))  # share of the barbule's length
        middle = sign * barbules.rise_mm * run - 0.5 * barbules.height_mm
        radius, tall = _section(run, barbules)
        here = rod(aside, height - middle, radius, tall, softness)
        here = dr.select((run < 1.0) & (away > section(share, made.barbs)[0]), here, 0.0)
        pitch = math.atan(sign * barbules.rise_mm / long)
        way = jit.Array3f(math.cos(angle) * math.cos(pitch), sign * math.sin(angle) * math.cos(pitch), math.sin(pitch))
        density, tangent = dr.fmin(density + here, 1.0), dr.select(here > density, way, tangent)
        if distal and barbules.hooks:
            here, turn = _hooklet(run * long, height - middle, aside, barbules, softness)
            flat = jit.Array3f(math.cos(angle), math.sin(angle), 0.0)
            hook = unit(flat * turn.x + jit.Array3f(0, 0, 1) * turn.y)
            tangent = dr.select(here > density, hook, tangent)
            density = dr.fmax(density, here)
    return density, tangent


def barbule_thickness(spacing: Any, share: Any, made: Any) -> Any:
    """Volume of the barbules (without hooklets) over the area of the vane [mm]."""
    barbules, total = made.barbules, 0.0
    for per_mm, degrees, long in (
        (barbules.distal_per_mm, barbules.distal_deg, barbules.distal_mm),
        (barbules.proximal_per_mm, barbules.proximal_deg, barbules.proximal_mm),
    ):
        sine = math.sin(math.radians(degrees)) * long
        begin = section(share, made.barbs)[0] / sine
        end = dr.fmin(spacing / sine, 1.0)
        total = total + per_mm * long * (_volume(end, barbules) - _volume(begin, barbules)) / spacing
    return total


def _section(run: Any, barbules: Barbules) -> tuple[Any, Any]:
    """Radius, and half the height by which the disc is drawn out, at a share of the length."""
    radius = 0.5 * barbules.width_mm * (1.0 - BARBULE_TAPER * run)
    tall = 0.5 * (barbules.height_mm - barbules.width_mm)
    return radius, tall * dr.fmax(1.0 - run / BASE, 0.0)


def _volume(run: Any, barbules: Barbules) -> Any:
    """∫ of the section's area from 0 to a share `run` of the length [mm²]."""
    radius, tall = 0.5 * barbules.width_mm, 0.5 * (barbules.height_mm - barbules.width_mm)
    low = dr.fmin(run, BASE)
    thread = run - BARBULE_TAPER * run * run + BARBULE_TAPER**2 / 3.0 * run**3
    ribbon = low - 0.5 * (BARBULE_TAPER + 1.0 / BASE) * low * low + BARBULE_TAPER / (3.0 * BASE) * low**3
    return math.pi * radius * radius * thread + 4.0 * radius * tall * ribbon


def _hooklet(run: Any, height: Any, aside: Any, barbules: Barbules, softness: float) -> tuple[Any, Any]:
    """Density of half rings that leave a distal barbule forwards and come back beneath; tangent (along it, up)."""
    jit = arrays()
    first, last = (share * barbules.distal_mm for share in HOOKED)
    every, radius = (last - first) / barbules.hooks, 0.5 * barbules.hook_mm
    place = (run - first) / every
    x, y = (place - dr.floor(place) - 0.5) * every, height + radius
    round_ = dr.sqrt(x * x + y * y + 1e-12)
    off = dr.select(x > 0, round_ - radius, dr.sqrt(x * x + dr.square(abs(y) - radius)))
    there = rod(dr.sqrt(off * off + aside * aside), 0.0, HOOK * barbules.width_mm, 0.0, softness)
    inside = (place >= 0.0) & (place < float(barbules.hooks))
    turn = dr.select(x > 0, jit.Array2f(y, -x) / round_, jit.Array2f(1.0, 0.0))
    return dr.select(inside, there, 0.0), turn
