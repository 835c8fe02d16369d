"""Yarn: fibres twisted to plies, and plies twisted around each other."""

from __future__ import annotations

import math
from typing import Annotated, NamedTuple

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.record import NotNegative, Positive, about, from_to, one_of

HEXAGONAL = math.pi / (2.0 * math.sqrt(3.0))  # largest share of a plane that equal discs can cover (Lagrange, 1773)
# ° between the yarn and the middle line of its plies (of one ply: its outside): beyond, two plies that touch along the
# middle of the yarn would enter each other beside it (Bohr & Olsen, "The ancient art of laying rope", 2011)
LARGEST_TWIST_DEG = 45.0
# radius of plies that flatten each other, relative to plies that only touch: a choice, without a measurement behind it;
# two plies fill 0.61 of the round yarn with it, where round ones would fill 0.50
PRESSED = 1.15
MOST_PLIES, MOST_FIBRES = 8, 2000
MOST_HAIRS, MOST_SLUBS = 1000.0, 100.0  # per cm of yarn
HANDS = {"Z": 1.0, "S": -1.0}  # of twist: Z is a right-handed screw


class Yarn(NamedTuple):
    """The dimensions of a yarn."""

    diameter_mm: Annotated[Positive, about("diameter of the round yarn [mm]")] = 0.34
    flatness: Annotated[
        float, about("factor by which it lies wider in the cloth, and as much thinner, 1 (round) … 2")
    ] = 1.15
    plies: Annotated[int, from_to(0, MOST_PLIES), about("number of plies, 1…8")] = 1
    twist_per_cm: Annotated[
        NotNegative, about("turns of the plies around one another; of one ply: of its fibres [1/cm]")
    ] = 6.0
    hand: Annotated[str, one_of("Z", "S"), about("direction of the twist")] = "Z"
    ply_twist_per_cm: Annotated[
        NotNegative, about("turns of the fibres in their ply, of the other hand; 0: as the ply [1/cm]")
    ] = 0.0
    fibres: Annotated[int, from_to(0, MOST_FIBRES), about("number of fibres of a ply")] = 150
    fibre_um: Annotated[Positive, about("diameter of a fibre [µm]")] = 18.0
    migration: Annotated[NotNegative, about("wandering of fibres through the yarn, of its ply's radius, 0…0.5")] = 0.12
    hairs_per_cm: Annotated[NotNegative, about("fly-away fibres [1/cm]")] = 12.0
    hair_mm: Annotated[NotNegative, about("mean length of fly-away fibres [mm]")] = 0.6
    uneven: Annotated[NotNegative, about("standard deviation of the girth, as a share of it, 0…0.3")] = 0.06
    slubs_per_cm: Annotated[NotNegative, about("slubs: thick places, a third thicker than the yarn [1/cm]")] = 0.1

    @property
    def width_mm(self) -> float:
        """Across the cloth."""
        return self.diameter_mm * self.flatness

    @property
    def thickness_mm(self) -> float:
        """Along the cloth's normal."""
        return self.diameter_mm / self.flatness

    @property
    def ply(self) -> tuple[float, float]:
        """Radius of a ply and of the circle on which the plies lie, of the yarn's radius."""
        if self.plies == 1:
            return 1.0, 0.0
        radius = PRESSED / (1.0 + 1.0 / math.sin(math.pi / self.plies))
        return radius, 1.0 - radius

    @property
    def kept(self) -> float:
        """Share of a ply's disc that remains where plies flatten each other: that in the ply's own sector."""
        if self.plies == 1:
            return 1.0
        radius, offset = self.ply
        half = math.pi / self.plies  # angle of the sector, seen from the axis of the yarn, to either side
        sine = offset * math.sin(half) / radius
        cut = sine * math.sqrt(1.0 - sine * sine) + math.asin(sine)
        # 2 ∫ ρ dρ over the sector, between the near and the far side of the disc, or from an axis that lies in the disc
        holds_axis = offset < radius
        return (half + 0.5 * (offset / radius) ** 2 * math.sin(2.0 * half) + cut if holds_axis else 2.0 * cut) / math.pi

    @property
    def rates(self) -> tuple[float, float]:
        """Turn of the plies around the yarn and of the fibres around their ply [rad/mm], right-handed above 0."""
        turn, back = (0.2 * math.pi * HANDS[self.hand] * t for t in (self.twist_per_cm, self.ply_twist_per_cm))
        return turn, turn - back

    @property
    def packing(self) -> float:
        """Share of a ply's section that its fibres would fill without twist."""
        return self.fibres * (self.fibre_um * 1e-3 / (self.diameter_mm * self.ply[0])) ** 2 / self.kept

    @property
    def lengthening(self) -> float:
        """Length of the fibres per length of the yarn: the mean secant of their angles."""
        return mean_secant(self)


def mean_secant(yarn: Yarn) -> float:
    """Mean over a ply's section of √(1 + slope²) of the fibres' helices."""
    (radius, offset), (turn, spin) = yarn.ply, yarn.rates
    share, around = (np.arange(64) + 0.5) / 64, 2.0 * np.pi * np.arange(64) / 64
    reach = radius * np.sqrt(share)[:, None]  # rings of equal area
    slope = np.hypot(turn * offset + spin * reach * np.cos(around), spin * reach * np.sin(around))
    return float(np.sqrt(1.0 + (0.5 * yarn.diameter_mm * slope) ** 2).mean())


def check_yarn(yarn: Yarn, name: str) -> Yarn:
    """`yarn`, or `InputError` in one line where it cannot be spun; name: what messages call it."""
    for key in ("diameter_mm", "flatness", "plies", "fibres", "fibre_um"):
        _check(yarn, key, name, getattr(yarn, key) > 0, "a number above 0")
    for key in ("twist_per_cm", "ply_twist_per_cm", "migration", "hairs_per_cm", "hair_mm", "uneven", "slubs_per_cm"):
        _check(yarn, key, name, getattr(yarn, key) >= 0, "a number, 0 or more")
    for key, most in (("plies", MOST_PLIES), ("fibres", MOST_FIBRES)):
        whole = isinstance(getattr(yarn, key), int)
        _check(yarn, key, name, whole and getattr(yarn, key) <= most, f"a whole number from 1 to {most}")
    _check(yarn, "hand", name, yarn.hand in HANDS, "Z or S")
    _check(yarn, "flatness", name, 1 <= yarn.flatness <= 2, "a number from 1 (round) to 2")
    for key, most in (("migration", 0.5), ("uneven", 0.3), ("hairs_per_cm", MOST_HAIRS), ("slubs_per_cm", MOST_SLUBS)):
        _check(yarn, key, name, getattr(yarn, key) <= most, f"at most {most:g}")
    if yarn.ply_twist_per_cm and yarn.plies == 1:
        raise InputError(f"ply_twist_per_cm of the {name} is {yarn.ply_twist_per_cm:g}: a yarn of one ply has none")
    if yarn.packing > HEXAGONAL:
        most = int(yarn.fibres * HEXAGONAL / yarn.packing)
        raise InputError(f"{yarn.fibres} fibres of {yarn.fibre_um:g} µm do not fit a ply of the {name}: at most {most}")
    angle = math.degrees(math.atan(0.5 * yarn.diameter_mm * abs(yarn.rates[0]) * (yarn.ply[1] or 1.0)))
    if angle > LARGEST_TWIST_DEG or yarn.packing * yarn.lengthening > HEXAGONAL:
        raise InputError(
            f"twist_per_cm {yarn.twist_per_cm:g} of the {name} is beyond the packing limit ({angle:.0f}° outside, "
            f"{yarn.packing * yarn.lengthening:.2f} of the section filled): less twist or fewer fibres"
        )
    return yarn


def _check(yarn: Yarn, key: str, name: str, right: bool, wanted: str) -> None:
    value = getattr(yarn, key)
    if not right or (isinstance(value, float) and not math.isfinite(value)):
        raise InputError(f"{key} of the {name} is {value}: give {wanted}")
