"""Smooth tiles: normals of photographs that exceed the memory, as those of a smooth surface (`smooth_normals`).

How smooth it is follows from some squares of pixels of full size. Each tile is then smoothed with a margin of its
neighbours, so wide that what lies beyond has no weight: neighbouring tiles join as if they had been solved together.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.measurement.normals.lobe_fit import fit_with, with_bodies
from hagoromo.measurement.normals.pixel_fit import NormalFit
from hagoromo.measurement.normals.smooth_normals import (
    CHOICE_PIXELS,
    TILE,
    WINDOW,
    bodies_at,
    chosen_stiffness,
    known_variance,
    noise_factor,
    of_halves,
    smooth_surface,
)
from hagoromo.measurement.normals.smooth_share import Stiffness
from hagoromo.measurement.normals.views import FEWEST_LAMPS, Array, Stack, Views
from hagoromo.measurement.surface.tile_pixels import (
    Coarse,
    Shared,
    TilePixels,
    fine_fit,
    known_of,
    on_surface,
    trust_in,
    with_all_lobes,
)
from hagoromo.measurement.surface.tile_store import TileStore

LENGTHS = 8.0  # over which errors are alike: so wide is the margin, beyond which weights are below half a per cent
LEAST_MARGIN, MOST_MARGIN = 8, 96  # [px]
WIDE = 95.0  # percentile of the variances: noisier normals are smoothed over more pixels
APART = math.ceil(8.0 * WINDOW)  # [px] between squares that are laid out beside one another
STEPS = 1  # from the normals of all lamps to those of a half


def with_stiffness(store: TileStore, coarse: Coarse, seed: int = 0) -> Coarse:
    """`coarse` with how smooth the surface is in pixels of full size."""
    if len(store.lamps) < 2 * FEWEST_LAMPS:
        return coarse
    return replace(coarse, stiffness=_chosen(store, coarse, np.random.default_rng(seed)))


def noise_of(solved: TilePixels) -> Array:
    """(P,) variance of the normals [rad²] by the scatter between halves of the lamps."""
    return known_variance(noise_factor(_near(solved.views), _halves(solved)) * solved.fit.variance)


def smooth_squares(solved: TilePixels, stiffness: Stiffness) -> TilePixels:
    """`solved`, pixels in some squares of the grid of `TILE`, with the normals of a smooth surface within each square,
    their variance, and the body colours that go with them.
    """
    views, fit = solved.views, solved.fit
    laid = _laid_out(views)
    noise = known_variance(noise_factor(laid, _halves(solved)) * fit.variance)
    normals, share = smooth_surface(laid, stiffness.value, fit.normals, noise)
    fit = replace(fit, normals=normals, variance=share * fit.variance)
    return solved._replace(fit=replace(fit, body=bodies_at(views, fit, solved.place)))


def square_of(rows: NDArray[np.intp], columns: NDArray[np.intp], width: int) -> NDArray[np.intp]:
    """(P,) number of the square of `TILE` that pixels of a picture of this width lie in."""
    return rows // TILE * -(-width // TILE) + columns // TILE


def _laid_out(views: Views) -> Views:
    """`views` in a picture in which the squares that have pixels lie side by side, APART."""
    number = np.unique(square_of(views.rows, views.columns, views.shape[1]), return_inverse=True)[1]
    columns = views.columns % TILE + (TILE + APART) * number
    return replace(views, rows=views.rows % TILE, columns=columns, shape=(TILE, int(columns.max()) + 1))


def _halves(solved: TilePixels) -> list[NormalFit]:
    return of_halves(solved.views, solved.fit, solved.place, STEPS)


def _chosen(store: TileStore, coarse: Coarse, random: np.random.Generator) -> Stiffness | None:
    """`chosen_stiffness` of squares that are chosen at random, CHOICE_PIXELS in all or fewer."""
    parts: list[tuple[Views, list[NormalFit], Array]] = []
    count = 0
    for tile in random.permutation(store.count).tolist():
        stack, rows, columns = store.stack(tile)
        if not len(rows):
            continue
        top, left = (part.start for part in store.place(tile))
        number = (rows - top) // TILE * store.camera.width + (columns - left) // TILE
        names, sizes = np.unique(number, return_counts=True)
        square = random.choice(names, p=sizes / len(rows))
        own = number == square
        part = Stack(stack.values[:, own], stack.variance[:, own], stack.valid[:, own])
        solved = with_all_lobes(store, coarse, part, (rows[own], columns[own]))
        if solved is None:
            continue
        if parts and count + len(solved.views.rows) > CHOICE_PIXELS:
            break
        count += len(solved.views.rows)
        both, views = _halves(solved), _near(solved.views)
        parts.append((views, both, noise_factor(views, both)))
    return chosen_stiffness(*_beside(parts)) if parts else None


def _near(views: Views) -> Views:
    """`views` in a picture that is no larger than their pixels need."""
    rows, columns = views.rows - views.rows.min(), views.columns - views.columns.min()
    return replace(views, rows=rows, columns=columns, shape=(int(rows.max()) + 1, int(columns.max()) + 1))


def _beside(parts: list[tuple[Views, list[NormalFit], Array]]) -> tuple[Views, list[NormalFit], Array]:
    """Squares as one picture, so far APART that they have nothing to do with one another."""
    first, pitch = parts[0][0], TILE + APART
    rows = np.concatenate([views.rows for views, _, _ in parts])
    columns = np.concatenate([views.columns + pitch * k for k, (views, _, _) in enumerate(parts)])
    shape, to_eye = (TILE, pitch * len(parts)), np.concatenate([views.to_eye for views, _, _ in parts])
    both = [
        NormalFit(*(np.concatenate([getattr(halves[k], name) for _, halves, _ in parts], axis=axis) for name, axis in (
            ("normals", 0), ("body", 1), ("variance", 0), ("status", 0))))
        for k in range(2)
    ]  # fmt: skip
    scatter = np.concatenate([one for _, _, one in parts])
    return _seen(first, (rows, columns), shape, to_eye), both, scatter


def _seen(views: Views, pixels: tuple[NDArray[np.intp], NDArray[np.intp]], shape: tuple[int, int], eye: Array) -> Views:
    """Pixels of a picture under no lamp, in the directions `eye` (P, 3) to the camera of `views`."""
    count, channels = len(pixels[0]), views.values.shape[1]
    none = np.zeros((0, channels, count))
    return replace(
        views, values=none, variance=none, light=none, used=np.zeros((0, count), bool), to_lamp=np.zeros((0, count, 3)),
        to_eye=eye, points=np.zeros((count, 3)), rows=pixels[0], columns=pixels[1], shape=shape, lamps=(), lower=None,
    )  # fmt: skip


def margin_of(stiffness: Stiffness, noise: NDArray[np.float32]) -> int:
    """[px] of the margin of a tile; noise: (h, w) variance of the normals [rad²], inf where unknown."""
    wide = float(np.percentile(noise[np.isfinite(noise)], WIDE))
    return int(np.clip(math.ceil(LENGTHS * (stiffness.value * wide / 2.0) ** 0.25), LEAST_MARGIN, MOST_MARGIN))


class SmoothTile(NamedTuple):
    """rows, columns: (P,) pixels of a tile, their smooth normals (P, 3), the share (P,) of the variance that is left,
    and body colours (P, C).
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    normals: NDArray[np.float32]
    share: NDArray[np.float32]
    body: NDArray[np.float32]


def smooth_tile(
    shared: Shared,
    tile: int,
    corner: tuple[int, int],
    normals: NDArray[np.float32],
    noise: NDArray[np.float32],
    body: NDArray[np.float32],
) -> SmoothTile | None:
    """Smooth normals of a tile, and the body colours that go with them; None where it has none.

    normals (h, w, 3), noise (h, w) [rad²]: of a window around the tile, whose first pixel is `corner` of the picture.
    body: (h, w, C) of the tile.
    """
    store, coarse = known_of(shared)
    assert coarse.stiffness is not None
    down, across = np.nonzero(np.isfinite(noise))
    known = down, across
    inside = np.zeros(noise.shape, bool)
    inside[tuple(slice(p.start - c, p.stop - c) for p, c in zip(store.place(tile), corner, strict=True))] = True
    own = inside[known]
    if not own.any():
        return None
    rows, columns = known[0] + corner[0], known[1] + corner[1]
    window = _seen(coarse.normal_map.views, known, noise.shape, -_rays(store.camera, rows, columns))
    smooth, share = smooth_surface(
        window, coarse.stiffness.value, normals[known].astype(np.float64), noise[known].astype(np.float64)
    )
    smooth = smooth[own].astype(np.float32)
    rows, columns = rows[own], columns[own]
    place = store.place(tile)
    start = body[rows - place[0].start, columns - place[1].start].T.astype(np.float64)
    found = (smooth.astype(np.float64), start, share[own] * noise[known][own])
    of_tile = _bodies(store, coarse, tile, (rows, columns), found)
    return SmoothTile(rows, columns, smooth, share[own].astype(np.float32), of_tile.T.astype(np.float32))


def _bodies(
    store: TileStore, coarse: Coarse, tile: int, pixels: tuple[NDArray, NDArray], found: tuple[Array, Array, Array]
) -> Array:
    """(C, P) body colours of `pixels` of a tile; found: normals (P, 3), body colours so far (C, P), variance (P,)."""
    stack, rows, columns = store.stack(tile)
    wanted = np.isin(rows * store.camera.width + columns, pixels[0] * store.camera.width + pixels[1])
    stack = Stack(stack.values[:, wanted], stack.variance[:, wanted], stack.valid[:, wanted])
    views = on_surface(store, coarse, stack, (rows[wanted], columns[wanted]))
    fit, place = fine_fit(store, coarse, (views.rows, views.columns), found)
    fit = fit_with(fit, coarse.lobes)
    fit = replace(fit, body=bodies_at(views, fit, place))
    return with_bodies(views, fit, place, trust_in(views), coarse.lobes).body if any(coarse.lobes) else fit.body


def _rays(camera: Camera, rows: NDArray[np.intp], columns: NDArray[np.intp]) -> Array:
    return camera.unproject(np.stack([columns + 0.5, rows + 0.5], axis=1))
