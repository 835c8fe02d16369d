"""Drape: cloth that hangs in folds. All in mm; the patch faces −y, its lower edge at z = 0."""

from __future__ import annotations

import math
from typing import Any

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, clip
from hagoromo.errors import InputError
from hagoromo.matter.cloth import Weave, check_weave, woven
from hagoromo.matter.fill import Fineness, fill
from hagoromo.matter.noise import random
from hagoromo.matter.shape import coverage, distance_and_normal, rounded_box, unit
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.plan import BoxPlan

GATHERED = 0.88  # width of a folded patch at its upper edge, of that at the hem
SWAY = 0.1  # of the folds to the side between hem and upper edge, of the width
ENTRIES = 1024  # of the table of arc length, which covers the width and SWAY on both sides
SHALLOWEST, DEEPEST = 0.45, 1.1  # folds, of the mean one
ROUNDNESS = 0.03  # of the valleys between pipe folds


def drape_patch(
    material: Reflectance,
    size_mm: tuple[float, float] = (60.0, 70.0),
    weave: Weave = Weave(),  # noqa: B008 (an immutable record)
    folds: tuple[int, float] = (3, 7.0),
    fineness: Fineness = Fineness(0.12, 0.2),  # noqa: B008
    seed: int = 0,
) -> BoxPlan:
    """A woven patch, width × height, that hangs in folds (their number, and depth at the hem [mm]; depth 0: flat).

    It stands on z = 0 around x = 0 and faces −y. Folds are gathered at the upper edge and fan out downwards, where they
    are as much shallower as the cloth is wider there: along the folds yarns keep their distance.
    """
    sheet = Sheet(size_mm, folds, seed)
    thick, soft = check_weave(weave).thickness, fineness.softness
    half = (0.5 * sheet.width, 0.5 * sheet.height)

    def field(point: Any) -> tuple[Any, Any]:
        distance, normal = distance_and_normal(sheet.behind, point)
        front, foot = -normal, point - normal * distance
        across = sheet.across(foot)
        weft = unit(dr.cross(arrays().Array3f(0, 0, 1), front))
        warp = dr.cross(front, weft)
        density, tangent = woven(sheet.arc(sheet.phase(foot)), foot.z, -distance, weave, fineness, seed + 2)
        place = arrays().Array3f((across - 0.5) * sheet.width, 0.0, foot.z - half[1])
        density *= coverage(rounded_box(place, (0.0, 0.0, 0.0), (*half[:1], 1.0, half[1])), soft)
        return density, weft * tangent.x + warp * tangent.y + front * tangent.z

    reach = 0.5 * thick + soft
    deepest = DEEPEST * sheet.depth_at(sheet.height)
    extent = (-half[0] - reach, -deepest - reach, -reach), (half[0] + reach, deepest + reach, sheet.height + reach)
    return fill(
        field, lambda p: abs(sheet.behind(p)) / sheet.steepest - reach, extent, fineness, material, name="drape"
    )


class Sheet:
    """The middle of a patch that hangs in folds: size_mm: width at the hem, height; folds: number, depth at the hem."""

    def __init__(self, size_mm: tuple[float, float], folds: tuple[int, float], seed: int) -> None:
        (self.width, self.height), (self.count, self.depth), self.seed = size_mm, folds, seed
        if self.depth > 1.5 * self.width / self.count:
            raise InputError(
                f"{self.count} folds {self.depth:g} mm deep do not fit {self.width:g} mm: fewer or shallower"
            )
        kinds, share = arrays(), np.linspace(-SWAY, 1.0 + SWAY, ENTRIES)
        profile = self.depth * np.array(_waves(kinds.Float(share * self.count), seed), float)
        length = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(share) * self.width, np.diff(profile)))])
        length -= np.interp(0.0, share, length)
        self.length, self._table = float(np.interp(1.0, share, length)), kinds.Float(length.astype(np.float32))
        self.gathered, self.sway = (GATHERED, SWAY) if self.depth > 0 else (1.0, 0.0)
        narrowest = self.gathered * self.width / self.count
        self.steepest = math.hypot(1.0, 1.3 * math.pi * self.depth_at(self.height) / narrowest)

    def depth_at(self, z: float) -> float:
        """Depth of the folds at a height [mm], such that the folded cloth is as long as at the hem."""
        return float(self._depth(arrays().Float(z))[0])

    def across(self, point: Any) -> Any:
        """Share of the width that lies to the left of `point`, 0…1."""
        return point.x / (self.width * self._narrowing(point.z)) + 0.5

    def phase(self, point: Any) -> Any:
        """Where `point` is among the folds, as a share of the width: folds run a little aslant and bend."""
        fall = clip(1.0 - point.z / self.height, 0.0, 1.0)
        return self.across(point) + self.sway * dr.sin(2.2 * fall)

    def behind(self, point: Any) -> Any:
        """How far `point` is behind the sheet, along y [mm]."""
        return point.y + self._depth(point.z) * (_waves(self.phase(point) * self.count, self.seed) - 0.5)

    def arc(self, phase: Any) -> Any:
        """Length of cloth [mm] from the first fold to a share of the width among the folds."""
        kinds = arrays()
        at = clip((phase + SWAY) / (1.0 + 2.0 * SWAY), 0.0, 1.0) * (ENTRIES - 1)
        first = dr.fmin(dr.floor(at), ENTRIES - 2)
        low, high = (dr.gather(kinds.Float, self._table, kinds.UInt(first) + k) for k in (0, 1))
        return dr.fma(at - first, high - low, low)

    def _narrowing(self, z: Any) -> Any:
        return 1.0 - (1.0 - self.gathered) * clip(z / self.height, 0.0, 1.0)

    def _depth(self, z: Any) -> Any:
        spare = max(self.length**2 - self.width**2, 1e-9)
        return self.depth * dr.sqrt(1.0 + (1.0 - dr.square(self._narrowing(z))) * self.width**2 / spare)


def pipes(turn: Any, count: int, seed: int | Any) -> Any:
    """Pipe folds of a robe, one for every whole step of `turn`: 0 in the sharp valleys, about 1 on the round crests.

    Every fold has a height of its own; after `count` folds they repeat, so that they close around an axis.
    """
    Int = arrays().Int
    index = dr.floor(dr.detach(turn))
    fold = Int(index) + 64 * count
    fold = fold - (fold // count) * count
    half = math.pi * (turn - index)
    crest = dr.sqrt(dr.square(dr.sin(half + 0.2 * dr.sin(2.0 * half))) + ROUNDNESS) - math.sqrt(ROUNDNESS)
    return crest * (SHALLOWEST + (DEEPEST - SHALLOWEST) * random((fold, count, 1), seed))


def _waves(turn: Any, seed: int | Any) -> Any:
    """Round folds of a sheet, one for every whole step of `turn`, each with a height and a lean of its own: 0…1."""
    index = dr.floor(dr.detach(turn))
    part = turn - index
    height, lean = (random((arrays().Int(index), 7, k), seed) for k in (1, 2))
    crest = 0.5 - 0.5 * dr.cos(2.0 * math.pi * part + (1.1 * lean - 0.55) * dr.sin(2.0 * math.pi * part))
    return crest * (SHALLOWEST + (1.0 - SHALLOWEST) * height)
