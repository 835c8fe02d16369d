"""Height errors: how far heights along a line err, relative to the straight line between its ends.

Distances of a solved surface are its normals, integrated over the picture (`surface/depth.py`). The error of one
normal so moves all that lies around it: distances err far, and neighbours nearly alike. A height over the chord,
h = d − (1 − s) d₀ − s d₁, is nearly free of that. With A = DᵀWD the matrix of the integration, and c the row that makes
h of the distances, its change by the normals n is

    ∂h/∂n = cᵀ A⁻¹ Dᵀ W ∂(chords)/∂n,

solved once for each height. The squares of it, times the variances of the normals, add up. Beside them stand the error
of the rule of chords, as the integration has it, that of the width of the pixels (`footprint`), and what all pixels
share, whose distances the measurement states.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import map_coordinates

from hagoromo.measurement.inspection.footprint import unevenness
from hagoromo.measurement.inspection.seen_surface import SeenSurface
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.surface.graph import Graph, graph

Array = NDArray[np.float64]
MOST_PIXELS = 60_000  # around a line, whose errors are followed; more are averaged over squares
MARGIN, LEAST_MARGIN = 0.5, 24.0  # of the length of a line, and px: errors beyond it move both ends alike
BESIDE = 12  # px around a line of which the bending counts
HEIGHTS = 48  # along a line, at which errors are solved for; between them they are interpolated


class HeightVariance(NamedTuple):
    """Variances (n,) of heights over the chord [m²]: own, of errors that pixels have of their own, and shared."""

    own: Array
    shared: Array


class LinePlaces(NamedTuple):
    """Places on a line. image: (n, 2) (x, y) [px]. share: (n,) of the chord, from 0 to 1. along: (n,) change of the
    height by one of the distance from the camera. away: (n,) that distance [m].
    """

    image: Array
    share: Array
    along: Array
    away: Array

    def of(self, chosen: NDArray[np.intp]) -> LinePlaces:
        """Some of them."""
        return LinePlaces(*(one[chosen] for one in self))


def height_variance(surface: SeenSurface, places: LinePlaces) -> HeightVariance:
    """Of heights over the chord from the first to the last of `places`, all on the known part of `surface`, whose
    errors are known.
    """
    share = places.share
    wanted = 0.5 - 0.5 * np.cos(np.linspace(0.0, np.pi, HEIGHTS))  # denser at the ends, where errors grow fastest
    chosen = np.unique(np.searchsorted(share, wanted).clip(0, len(share) - 1))
    own = np.interp(share, share[chosen], _own(surface, places.of(chosen))) + _of_width(surface, places)
    shared = np.zeros(len(share))
    for mode in () if surface.shared is None else surface.shared.distance:
        moved = places.along * _between(mode.astype(np.float64), surface.known, places.image)
        shared += (moved - (1.0 - share) * moved[0] - share * moved[-1]) ** 2
    return HeightVariance(own, shared)


def distance_errors(surface: SeenSurface, draws: int, seed: int = 0) -> Array:
    """(draws + m, h, w) changes of the distance [m], 0 where unknown: simulated ones by errors that pixels have of
    their own, over √draws, and those of the m modes that all share. Their squares add up to the variance of any sum.

    surface: with errors, of MOST_PIXELS or fewer.
    """
    assert surface.summed_variance is not None
    net = graph(surface.normals, surface.camera, surface.known, surface.own_variance)
    level = np.log(surface.away[surface.known])
    net = net.settled(level, net.gauge)
    random, root = np.random.default_rng(seed), np.sqrt(0.5 * surface.summed_variance[surface.known])[:, None]
    changes = (net.chords.of_errors(root * random.standard_normal((len(root), 3))) for _ in range(draws))
    found = np.zeros((draws, *surface.known.shape))
    found[:, surface.known] = net.responses(changes, np.zeros(len(level))) / np.sqrt(max(draws, 1))
    found = found * surface.away
    shared = () if surface.shared is None else surface.shared.distance
    return np.concatenate([found, *(np.where(surface.known, mode, 0.0)[None] for mode in shared)]).astype(np.float64)


def short_error(surface: SeenSurface, step: float) -> Array:
    """(h, w) standard error of the distance [m] by waves shorter than two squares of `step` pixels of the photograph.

    ∫ v/k² d²k/4π² from π/step to π, v the variance of a slope. surface: with pixels of any size.
    """
    assert surface.summed_variance is not None
    return np.sqrt(0.5 * surface.summed_variance * np.log(max(step, 1.0)) / (2.0 * np.pi)) * surface.pitch


def _own(surface: SeenSurface, places: LinePlaces) -> Array:
    """(n,) own variance [m²]."""
    near, corner, step = _around(surface, places.image)
    net = graph(near.normals, near.camera, near.known, near.own_variance)
    level = np.log(near.away[near.known])
    net = net.settled(level, net.gauge)
    solve = net.solver(net.open, net.gauge)
    # normals turn less from pixel to pixel than from square to square
    weight, rule = net.weight * net.open, (net.chords.rule / step) ** 2
    assert near.summed_variance is not None
    half = 0.5 * near.summed_variance[near.known]  # of a turn about one axis
    found = np.zeros(len(places.share))
    for k, row in enumerate(_rows(net, (places.image - corner) / step, places)):
        steps = weight * (net.difference @ solve(row))
        by_turn = net.chords.by_normals(steps)
        found[k] = float(half @ np.sum(by_turn**2, axis=1)) + float(rule @ steps**2)
    if step > 1:
        short = float(np.mean(short_error(near, step)[near.known] ** 2))
        ends = (1.0 - places.share) ** 2 + places.share**2
        found += np.where((places.share > 0.0) & (places.share < 1.0), short * places.along**2 * (1.0 + ends), 0.0)
    return found


def _of_width(surface: SeenSurface, places: LinePlaces) -> Array:
    """(n,) variance [m²] by the width of the pixels."""
    low = np.maximum(np.floor(places.image.min(axis=0)) - BESIDE, 0.0).astype(int)
    high = np.minimum(np.ceil(places.image.max(axis=0)) + BESIDE, surface.known.shape[::-1]).astype(int)
    part = surface.part(slice(low[1], high[1]), slice(low[0], high[0]))
    assert part.own_variance is not None
    bending = unevenness(part.normals, part.camera, part.known, part.own_variance)
    found = places.along * places.away * _between(bending.left, part.known, places.image - low)
    share = places.share
    inner = np.where((share > 0.0) & (share < 1.0), 1.0, 0.0)
    return inner * (found**2 + (1.0 - share) ** 2 * found[0] ** 2 + share**2 * found[-1] ** 2)


def _around(surface: SeenSurface, image: Array) -> tuple[SeenSurface, Array, int]:
    """The surface around a line, its corner (x, y) [px], and how many pixels one of it is wide."""
    margin = max(MARGIN * float(np.linalg.norm(image[-1] - image[0])), LEAST_MARGIN)
    low = np.maximum(np.floor(image.min(axis=0) - margin), 0.0).astype(int)
    high = np.minimum(np.ceil(image.max(axis=0) + margin), surface.known.shape[::-1]).astype(int)
    part = surface.part(slice(low[1], high[1]), slice(low[0], high[0]))
    step = max(int(np.ceil(np.sqrt(part.known.sum() / MOST_PIXELS))), 1)
    return part.averaged(step), low.astype(np.float64), step


def _rows(net: Graph, at: Array, places: LinePlaces) -> Array:
    """(n, P) that make heights of ln distances of the pixels of the graph."""
    index = net.chords.index
    nearest = nearest_known(net.chords.known)
    height, width = net.chords.known.shape
    rows = np.zeros((len(at), int(net.chords.known.sum())))
    low = np.floor(at - 0.5).astype(int)
    for down in (0, 1):
        for right in (0, 1):
            corner = low + np.array([right, down])
            share = np.prod(1.0 - np.abs(at - 0.5 - corner), axis=1)
            r, c = np.clip(corner[:, 1], 0, height - 1), np.clip(corner[:, 0], 0, width - 1)
            pixel = index[nearest[0][r, c], nearest[1][r, c]]
            np.add.at(rows, (np.arange(len(at)), pixel), share * places.along * places.away)
    return rows - (1.0 - places.share)[:, None] * rows[:1] - places.share[:, None] * rows[-1:]


def _between(values: Array, known: NDArray[np.bool_], image: Array) -> Array:
    """(n,) of a map (h, w) at places (x, y) [px], between its known pixels."""
    place = np.stack([image[:, 1], image[:, 0]]) - 0.5
    weight = np.asarray(map_coordinates(known.astype(np.float64), place, order=1, mode="nearest"))
    total = np.asarray(map_coordinates(np.where(known, values, 0.0), place, order=1, mode="nearest"))
    return total / np.maximum(weight, 1e-9)
