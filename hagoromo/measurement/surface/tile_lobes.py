"""Tile lobes: the highlight of photographs that exceed the memory, from some pixels of full size.

Squares of pixels blur a narrow lobe, and so does the noise of a pixel's own normal. Where the surface is smooth, lobes
are therefore found on the normals of a smooth surface within some squares near highlights; else on single pixels. They
are not refined on normals that go with all lobes, as those of photographs that are solved as a whole are: the lamps of
the reduced photographs are less well known, and a lobe that is refined under them becomes too narrow.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.normals.highlight_check import angles
from hagoromo.measurement.normals.lobe_fit import (
    FoundLobes,
    find_lobes,
    fit_with,
    most_pixels,
    with_bodies,
)
from hagoromo.measurement.normals.lobe_samples import trust_of
from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.normals.smooth_normals import TILE
from hagoromo.measurement.normals.views import Array, Stack, Views
from hagoromo.measurement.surface.smooth_tiles import smooth_squares, square_of, with_stiffness
from hagoromo.measurement.surface.tile_pixels import (
    Coarse,
    TilePixels,
    nearest_coarse,
    with_one_lobe,
)
from hagoromo.measurement.surface.tile_store import TileStore

STRATA = (0.0, 2.0, 4.0, 8.0, 16.0)  # [°] least angles of the strata between normal and half vector of the nearest lamp
OF_SQUARES = 6.0  # pixels of the squares for each pixel from which lobes are estimated, at most about

Pixels = tuple[Stack, tuple[NDArray[np.intp], NDArray[np.intp]]]


def with_lobes_of_tiles(store: TileStore, coarse: Coarse, seed: int = 0) -> Coarse:
    """`coarse` with how smooth the surface is, and with further lobes of each material where pixels of full size need
    them.
    """
    coarse = with_stiffness(store, coarse)
    if not np.any(np.exp(coarse.normal_map.fit.gloss.rows[:, 0]) > 0.0):
        return coarse
    random = np.random.default_rng(seed)
    if coarse.stiffness is None:
        pixels = sampled(store, coarse, random)
        each = [] if pixels is None else find_lobes(pixels.views, pixels.fit, pixels.place, pixels.trust, seed)
        return _having(coarse, each)
    squares = _squares(store, coarse, random)
    pixels = None if squares is None else with_one_lobe(store, coarse, *squares)
    if squares is None or pixels is None:
        return coarse
    chosen = np.flatnonzero(
        random.random(len(pixels.views.rows)) < _chances(pixels.fit, pixels.views, most_pixels(len(store.lamps)))
    )
    some = _some(smooth_squares(pixels, coarse.stiffness), chosen)
    each = find_lobes(some.views, some.fit, some.place, some.trust, seed)
    if not any(each):
        return coarse
    return with_stiffness(store, _having(coarse, each))


def _having(coarse: Coarse, each: Sequence[FoundLobes | None]) -> Coarse:
    """`coarse`, whose fit has one lobe, with the lobes `each`; as it is without any."""
    if not any(each):
        return coarse
    fit, views = coarse.normal_map.fit, coarse.normal_map.views
    whole = with_bodies(views, fit_with(fit, each), views.place, trust_of(coarse.capture, views), each)
    body = views.image(whole.body.T.astype(np.float32))
    normal_map = replace(coarse.normal_map, fit=whole, body=body)
    return replace(coarse, normal_map=normal_map, gloss=fit.gloss.rows, lobes=tuple(each))


def sampled(store: TileStore, coarse: Coarse, random: np.random.Generator) -> TilePixels | None:
    """Pixels of full size, `most_pixels` of each material or fewer: as many in each of the strata of the half angle."""
    wanted, of_each = most_pixels(len(store.lamps)), float(store.factor) ** 2
    chance = _chances(coarse.normal_map.fit, coarse.normal_map.views, wanted, of_each)
    parts = []
    for tile in range(store.count):
        stack, rows, columns = store.stack(tile)
        chosen = random.random(len(rows)) < nearest_coarse(store, coarse, chance, (rows, columns))
        parts.append(_part(stack, rows, columns, chosen))
    return with_one_lobe(store, coarse, *_joined(parts))


def _squares(store: TileStore, coarse: Coarse, random: np.random.Generator) -> Pixels | None:
    """Whole squares of pixels, with more of them near highlights; None where there are none."""
    wanted, of_each = OF_SQUARES * most_pixels(len(store.lamps)), float(store.factor) ** 2
    wanted *= len(coarse.normal_map.fit.gloss.rows)
    chance = _chances(coarse.normal_map.fit, coarse.normal_map.views, wanted, of_each)
    squares = max(wanted / TILE**2, 1.0) / (of_each * chance.sum())  # expected number for each unit of chance
    if wanted >= of_each * len(chance):
        squares = np.inf
    parts = []
    for tile in range(store.count):
        stack, rows, columns = store.stack(tile)
        if not len(rows):
            continue
        number = np.unique(square_of(rows, columns, store.camera.width), return_inverse=True)[1]
        weight = np.bincount(number, np.maximum(nearest_coarse(store, coarse, chance, (rows, columns)), 1e-9))
        parts.append(_part(stack, rows, columns, (random.random(len(weight)) < squares * weight)[number]))
    pixels = _joined(parts) if parts else None
    return pixels if pixels is not None and len(pixels[1][0]) else None


def _chances(fit: Fit, views: Views, wanted: float, of_each: float = 1.0) -> Array:
    """(N,) chance of a pixel of full size within each of the pixels of `fit`, `of_each` in it: `wanted` of each
    material in all, as many in each of the strata of the half angle.
    """
    nearest = np.degrees(angles(fit.normals, views).min(axis=0))
    stratum = len(STRATA) * fit.labels + np.digitize(nearest, STRATA) - 1
    numbers = np.bincount(stratum, minlength=len(STRATA) * len(fit.gloss.rows)) * of_each
    return np.minimum(wanted / len(STRATA) / np.maximum(numbers, 1.0), 1.0)[stratum]


def _some(pixels: TilePixels, chosen: NDArray[np.intp]) -> TilePixels:
    views, fit, place, trust, converged = pixels
    return TilePixels(views.pixels(chosen), fit.pixels(chosen), place[chosen], trust.pixels(chosen), converged[chosen])


def _part(stack: Stack, rows: NDArray[np.intp], columns: NDArray[np.intp], chosen: NDArray[np.bool_]) -> Pixels:
    some = Stack(stack.values[:, chosen], stack.variance[:, chosen], stack.valid[:, chosen])
    return some, (rows[chosen], columns[chosen])


def _joined(parts: Sequence[Pixels]) -> Pixels:
    stacks, places = zip(*parts, strict=True)
    names = ("values", "variance", "valid")
    stack = Stack(*(np.concatenate([getattr(one, name) for one in stacks], axis=1) for name in names))
    rows, columns = (np.concatenate(axis) for axis in zip(*places, strict=True))
    return stack, (rows, columns)
