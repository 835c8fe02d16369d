"""Down: loose barbs that wave freely, with long fine barbules without hooks. Lengths in mm."""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import drjit as dr

from hagoromo.backend import arrays, clip
from hagoromo.files.record import NotNegative, Positive, about
from hagoromo.matter.fill import Fineness
from hagoromo.matter.shape import unit
from hagoromo_matter.feather.barb import Barb
from hagoromo_matter.feather.rod import rod
from hagoromo_matter.noise import gradient_noise, random

NEIGHBOUR_BARBS = (-1, 0, 1)  # neighbouring barbs that are evaluated: none waves further than to the next
STALK = 0.03  # radius of a downy barb
THREAD = 0.008  # width of a downy barbule (Lucas & Stettenheim 1972: threads of a few µm with nodes)


class Down(NamedTuple):
    """The downy foot of a vane."""

    share: Annotated[NotNegative, about("share of the vane that is downy, 0…1")] = 0.12
    per_mm: Annotated[Positive, about("barbules along a barb, on each side [1/mm]")] = 30.0
    barbule_mm: Annotated[Positive, about("length of the barbules [mm]")] = 1.1
    wave_mm: Annotated[Positive, about("length of the waves of a barb [mm]")] = 5.0
    loft_mm: Annotated[NotNegative, about("distance that barbs stand off the vane [mm]")] = 2.0


def fluff_at(start: Any, plume: Any, down: Down) -> Any:
    """How downy a barb is that leaves the shaft at `start`: 1 at the foot of the vane, 0 where the vane is closed."""
    quill = plume.length_mm * plume.quill
    share = (start - quill) / (plume.length_mm - quill)
    return clip((1.25 * down.share - share) / (0.5 * down.share + 1e-6), 0.0, 1.0)


def down_density(barb: Barb, height: Any, down: Down, fineness: Fineness, seed: Any) -> tuple[Any, Any]:
    """Density of downy barbs and their barbules, and their tangent: along the barb, beside it, up."""
    jit, softness = arrays(), fineness.softness
    density, tangent = 0.0 * height, jit.Array3f(1, 0, 0)
    grown = dr.fmin(barb.out / (1.2 * down.loft_mm), 1.0)
    for step in NEIGHBOUR_BARBS:
        number = jit.Int(barb.number) + step
        lift, own, side = random((number, 0, 3), seed + 21), barb.number * 5.3 + 5.3 * step, barb.along.x
        place = jit.Array3f(barb.out * (2.0 / down.wave_mm), own, side)
        wave = gradient_noise(place, seed + 22)
        beside = barb.beside - (step + 1.3 * wave * grown) * barb.spacing
        sway = gradient_noise(place * jit.Array3f(0.7, 1, 1) + 0.37, seed + 23)
        up = height - grown * down.loft_mm * (1.4 * (lift - 0.6) + 1.2 * sway)
        far = dr.sqrt(beside * beside + up * up + 1e-9)
        core = rod(beside, up, STALK, 0.0, softness)
        radial = jit.Array3f(0.0, beside / far, up / far)
        halo = _halo(barb, far, height, down, fineness, seed)
        here = dr.fmax(core, halo)
        lean = jit.Array3f(1.0, wave * grown, sway * grown)
        along = dr.select(core > halo, unit(lean), unit(radial + jit.Array3f(0.5, 0, 0)))
        tangent = dr.select(here > density, along, tangent)
        density = dr.fmin(density + here, 1.0)
    return density, tangent


def _halo(barb: Barb, far: Any, height: Any, down: Down, fineness: Fineness, seed: Any) -> Any:
    """Mean density of barbules that leave a barb to all sides, in wisps.

    Such fine threads shade by their width, not by their volume: the density gives the extinction of opaque threads.
    """
    mass = 2.0 * down.per_mm * THREAD * fineness.mean_free_path_mm
    wisp = gradient_noise(arrays().Array3f(barb.out * 1.9, barb.start * 2.3 + 3.0 * far, height * 2.1), seed + 4)
    fade = clip(1.5 * (1.0 - far / (down.barbule_mm * (0.8 + 0.6 * wisp))), 0.0, 1.0)
    ring = (2.0 * math.pi) * dr.sqrt(far * far + fineness.softness**2)
    return mass / ring * fade * dr.square(1.0 + 1.2 * wisp)
