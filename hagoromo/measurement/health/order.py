"""Order: whether the photographs stand in the order of their lamps.

Other arrangements are tried: all shifts, the reversed order with all shifts, and two exchanged. Lamps that stand in a
ring explain the readings as well when all are shifted, with a surface that is turned; so it counts, too, whether the
normals belong to a surface (their curl), and whether they face outward at the object's outline.
"""

from __future__ import annotations

from itertools import combinations
from typing import NamedTuple

import numpy as np

from hagoromo.measurement.health.health import Check, doubtful, good
from hagoromo.measurement.health.lamps import fitted_lamps
from hagoromo.measurement.health.shading import Array, ShadingSample

MOST_LOOKED_AT = 12  # photographs of which pairs are tried: those that fit worst
BETTER = 0.75  # misfit of another arrangement over the stated one's, from which it explains the readings better
ALIKE = 1.15  # misfit of one that explains them as well
STEEPEST = 0.3  # cosine of the view, below which slopes are too uncertain
SHAPELIER = 0.35  # by which curl and outline must be better
NO_WORSE = 0.1
SAME = 0.01  # relative difference of two photographs that are one
DIFFERS = 3.0  # times SAME: what two lamps must make of the object's own shape, which may look alike under both
APART_DEG = 4.0  # between lamps, whose light then differs by more
MISTAKE = "give the photographs in the order of the lamps"


class Arrangement(NamedTuple):
    """words: what was done to the photographs. order: lamp of each photograph."""

    words: str
    order: Array


def order_check(shading: ShadingSample) -> Check:
    """Whether another arrangement explains the photographs better."""
    twice = _same(shading)
    if twice:
        return doubtful(
            "order",
            f"{twice[0]} and {twice[1]} are the same picture, and their lamps differ",
            "take the photograph of one of them again, or leave it out",
        )
    tried, best, misfit = _better(shading)
    if best is not None:
        lamps = fitted_lamps(shading, (1.0,))
        if lamps.uneven and lamps.misfit[0] < misfit:  # strengths that differ explain more than another order
            tried, best, _ = _better(lamps.even(shading))
    if best is None:
        return good("order", f"none of {tried} other arrangements explains the photographs better")
    return doubtful("order", f"the photographs fit better {best.words}", MISTAKE)


def _better(shading: ShadingSample) -> tuple[int, Arrangement | None, float]:
    """How many arrangements were tried, the one that explains the photographs best if it does so better than the
    stated one, and its misfit.
    """
    few = shading.few()
    residual, _ = few.fit()
    stated = few.misfit()
    worst = np.argsort(-(residual * few.usable).sum(axis=1) / np.maximum(few.usable.sum(axis=1), 1))
    own = _shape_fault(shading)
    best, least, lowest = None, np.inf, np.inf
    tried = _arrangements(shading.names, worst[:MOST_LOOKED_AT])
    for one in tried:
        misfit = few.arranged(one.order).misfit()
        if misfit > ALIKE * stated:
            continue
        fault = _shape_fault(shading.arranged(one.order))
        better = misfit < BETTER * stated and fault < own + NO_WORSE
        shapelier = fault < own - SHAPELIER
        if (better or shapelier) and misfit / stated + fault < least:
            best, least, lowest = one, misfit / stated + fault, misfit
    return len(tried), best, lowest


def _arrangements(names: tuple[str, ...], worst: Array) -> list[Arrangement]:
    count = len(names)
    number, found = np.arange(count), []
    for by in range(count):
        if by:
            found.append(Arrangement(f"shifted by {by if by <= count // 2 else by - count}", np.roll(number, -by)))
        turned = np.roll(number[::-1], -by)
        found.append(Arrangement("in reversed order" + (f", shifted by {by}" if by else ""), turned))
    for a, b in combinations(sorted(worst.tolist()), 2):
        order = number.copy()
        order[[a, b]] = b, a
        found.append(Arrangement(f"with {names[a]} and {names[b]} exchanged", order))
    return found


def _shape_fault(shading: ShadingSample) -> float:
    """Curl of the slopes over their size, and how far normals at the outline are from facing outward; 0 … 2."""
    _, g = shading.fit()
    normals = g / np.maximum(np.linalg.norm(g, axis=1, keepdims=True), 1e-300)
    slopes = np.full((*shading.shape, 2), np.nan)
    steep = -normals[:, 2] < STEEPEST
    facing = np.where(steep, np.nan, -normals[:, 2])
    slopes[shading.row, shading.column] = normals[:, :2] / facing[:, None]
    down = np.diff(slopes, axis=0)[:, :-1]
    across = np.diff(slopes, axis=1)[:-1]
    curl = np.abs(down[..., 0] - across[..., 1])
    size = np.abs(down).sum(axis=2) + np.abs(across).sum(axis=2)
    known = np.isfinite(curl) & np.isfinite(size)
    turned = float(np.sqrt(np.mean(curl[known] ** 2) / np.mean(size[known] ** 2))) if size[known].any() else 0.0
    edge = np.linalg.norm(shading.outline, axis=1) > 0.5
    if edge.sum() < 10:
        return turned
    outward = float(np.median(np.sum(normals[edge, :2] * shading.outline[edge], axis=1)))
    return turned + 0.5 * (1.0 - outward)


def _same(shading: ShadingSample) -> tuple[str, str] | None:
    """Two photographs that are alike though their lamps are not, and should differ: by the fit to all photographs.

    Pictures are compared as they were taken: divided by the light of two near lamps, one picture is two.
    """
    seen = shading.usable.all(axis=0)
    seen = seen if np.count_nonzero(seen) >= 20 else shading.usable
    _, g = shading.fit()
    expected = shading.light * np.maximum(np.einsum("kpi,pi->kp", shading.to_lamp, g), 0.0)
    apart = shading.direction @ shading.direction.T < np.cos(np.radians(APART_DEG))
    apart &= _differences(np.where(seen, expected, 0.0)) > DIFFERS * SAME
    alike = np.argwhere(np.triu(apart & (_differences(np.where(seen, shading.taken, 0.0)) < SAME), 1))
    return None if not len(alike) else (shading.names[alike[0][0]], shading.names[alike[0][1]])


def _differences(light: Array) -> Array:
    """(K, K) of pictures (K, P), each over its own size."""
    unit = light / np.maximum(np.linalg.norm(light, axis=1, keepdims=True), 1e-300)
    return np.sqrt(np.maximum(2.0 - 2.0 * unit @ unit.T, 0.0))
