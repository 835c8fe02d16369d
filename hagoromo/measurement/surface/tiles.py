"""Tiles: normals and depth of photographs that exceed the memory.

Gloss, lamps, distance and a coarse surface are estimated from the coarse capture of a `TileStore`. Under far lamps
further lobes of the interface are found on pixels of full size, chosen at random, as squares of pixels blur a narrow
lobe. Normals and body colours of each tile are then fitted with these known, its normals made those of a smooth surface
where halves of the lamps show it to be one (`smooth_tiles`), and its depth integrated around the coarse surface.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.cluster.cluster import Here, Workers
from hagoromo.errors import InputError
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel
from hagoromo.measurement.normals.lobe_fit import with_bodies
from hagoromo.measurement.normals.normals import NormalMap, solve_with_one_lobe, with_shared_errors
from hagoromo.measurement.normals.photometric_model import Prior
from hagoromo.measurement.normals.pixel_errors import UNKNOWN_DIRECTION, footprint
from hagoromo.measurement.normals.pixel_fit import STILL_MOVING_SHARE
from hagoromo.measurement.normals.smooth_share import Stiffness
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.surface.cast_shadows import cast_shadows
from hagoromo.measurement.surface.depth import anchored_surface, surface_of
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.measurement.surface.smooth_tiles import margin_of, noise_of, smooth_tile, with_stiffness
from hagoromo.measurement.surface.tile_lobes import with_lobes_of_tiles
from hagoromo.measurement.surface.tile_pixels import (
    Coarse,
    Known,
    Shared,
    coarse_depth,
    known_of,
    nearest_coarse,
    shared_file,
    with_all_lobes,
)
from hagoromo.measurement.surface.tile_store import TileStore
from hagoromo.progress import Progress, part_of, silent

STRIP = 256  # rows of a picture whose footprints are computed at once
MARGIN = 2  # coarse pixels around a tile that its integration includes, so that neighbouring tiles join


@dataclass(frozen=True, eq=False)
class Fine:
    """Full-size maps: normals, points (h, w, 3), body (h, w, C), 0 where unknown; labels (h, w), −1 unknown.

    variance (h, w) of the normals [rad²] and depth_variance (h, w) of the distance [m²], inf where unknown; the latter
    is that of the coarse surface. converged (h, w): whether the fit of a pixel's normal converged. stiffness: how
    smooth normals are; None: they were not smoothed. summed: (h, w) own variance of the normals [rad²] as it counts in
    sums over pixels, where they were smoothed; else None.
    """

    normals: NDArray[np.float32]
    variance: NDArray[np.float32]
    body: NDArray[np.float32]
    labels: NDArray[np.int16]
    points: NDArray[np.float64]
    depth_variance: NDArray[np.float32]
    converged: NDArray[np.bool_]
    stiffness: Stiffness | None = None
    summed: NDArray[np.float32] | None = None

    def remarks(self) -> list[str]:
        """A line if normals are smooth, and one if those of more pixels than the fit leaves did not converge."""
        known = np.isfinite(self.variance)
        share = float(np.mean(~self.converged[known]))
        remark = f"the normal of {100.0 * share:.2g} % of all pixels did not converge"
        smooth = [] if self.stiffness is None else [self.stiffness.remark()]
        return [*smooth, remark] if share > STILL_MOVING_SHARE else smooth


def solve_coarse(
    store: TileStore,
    distance: float,
    prior: Prior | None = None,
    progress: Progress = silent,
    model: GlossModel = BY_EVIDENCE,
) -> Coarse:
    """Everything that the tiles share, from the coarse capture; distance: approximate, to the surface [m]."""
    capture = store.coarse
    if has_near_lamps(capture):
        shape = solve_shape(capture, distance, prior, progress, model)
        return with_stiffness(store, Coarse(capture, shape.normal_map, shape.surface))
    plain = solve_with_one_lobe(capture, prior=prior, progress=progress, model=model)
    normal_map = with_shared_errors(plain)
    shadows = cast_shadows(normal_map, normal_map.views.valid(capture.photographs))
    surface = surface_of(normal_map, capture.photographs[0].camera, distance, shadows=shadows)
    coarse = with_lobes_of_tiles(store, Coarse(capture, plain, surface))
    if any(coarse.lobes):  # errors of normals under all of them
        plain, normal_map = coarse.normal_map, with_shared_errors(coarse.normal_map)
    return replace(coarse, normal_map=normal_map, misfit=_misfit(plain, normal_map))


def _misfit(plain: NormalMap, found: NormalMap) -> Array | None:
    """See `Coarse`; plain: `found` without the errors of lamps that are left out."""
    errors = found.fit.errors
    return None if errors is None else np.maximum(errors.own - plain.fit.variance, 0.0)


class SolvedTile(NamedTuple):
    """The pixels (P,) of a tile whose normals are solved, and what is known of each, as in `Fine`.

    own, shared: variance of the normals [rad²] that a pixel has of its own, and with all others. noise: that by which
    normals are weighed against those of neighbours.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    normals: NDArray
    own: NDArray
    shared: NDArray
    noise: NDArray
    body: NDArray
    converged: NDArray[np.bool_]
    labels: NDArray[np.intp]


def solve_tiles(
    store: TileStore,
    coarse: Coarse,
    progress: Progress = silent,
    tiles: range | None = None,
    workers: Workers | None = None,
) -> Fine:
    """All tiles (or those in `tiles`), given the coarse capture. `InputError` when three lamps light no pixel.

    workers: who solves the tiles; those of other processes must see the file of the store.
    """
    camera = store.camera
    size = camera.height, camera.width
    fine = Fine(
        np.zeros((*size, 3), np.float32),
        np.full(size, np.inf, np.float32),
        np.zeros((*size, store.channels), np.float32),
        np.full(size, -1, np.int16),
        np.zeros((0, 0, 3)),
        np.zeros((0, 0), np.float32),
        np.zeros(size, bool),
    )
    known = tiles or range(store.count)
    shared: Shared = Known(store, coarse) if workers is None else shared_file(Known(store, coarse))
    runner = workers or Here()
    own, noise = (np.full(size, np.inf, np.float32) for _ in range(2))
    for done, (_, solved) in enumerate(runner.results(_solve_tile, ((shared, tile) for tile in known)), 1):
        progress(0.6 * done / len(known), f"normals of tile {done} of {len(known)}")
        if solved is not None:
            _put(fine, solved)
            own[solved.rows, solved.columns], noise[solved.rows, solved.columns] = solved.own, solved.noise
    if not np.isfinite(fine.variance).any():
        raise InputError("no pixel is lit by three lamps: expose longer")
    if coarse.stiffness is not None:
        fine = _smoothed(fine, (shared, known, runner), coarse.stiffness, (own, noise), part_of(progress, 0.6, 0.1))
    else:
        fine.variance[:] += own
    del own, noise
    if coarse.misfit is not None:
        _add_footprint(fine)
    fine = replace(fine, points=np.zeros((*size, 3)), depth_variance=np.full(size, np.inf, np.float32))
    maps = fine.normals, fine.variance
    windows = ((shared, tile, *(part[_window(store, tile)] for part in maps)) for tile in known)
    for done, (number, points) in enumerate(runner.results(_integrate_tile, windows), 1):
        progress(0.7 + 0.3 * done / len(known), f"depth of tile {done} of {len(known)}")
        if points is not None:
            place = store.place(known[number])
            fine.points[place], fine.depth_variance[place] = points
    progress(1.0, "")
    return fine


def _smoothed(
    fine: Fine,
    solving: tuple[Shared, range, Workers],
    stiffness: Stiffness,
    variances: tuple[NDArray[np.float32], NDArray[np.float32]],
    progress: Progress,
) -> Fine:
    """`fine`, whose variance lacks the pixels' own, with the normals of a smooth surface, and their variance."""
    (shared, known, runner), (own, noise) = solving, variances
    store, margin = known_of(shared).store, margin_of(stiffness, noise)
    plain, body = fine.normals, fine.body
    normals, summed = plain.copy(), own.copy()

    def tasks() -> Iterator[tuple]:
        for tile in known:
            window, place = _window(store, tile, margin), store.place(tile)
            corner = window[0].start, window[1].start
            yield shared, tile, corner, plain[window], noise[window], body[place]

    for done, (_, smooth) in enumerate(runner.results(smooth_tile, tasks()), 1):
        progress(done / len(known), f"smooth normals of tile {done} of {len(known)}")
        if smooth is not None:
            place = smooth.rows, smooth.columns
            normals[place], own[place] = smooth.normals, own[place] * smooth.share
            fine.body[place] = smooth.body
    return replace(fine, normals=normals, variance=fine.variance + own, stiffness=stiffness, summed=summed)


def _add_footprint(fine: Fine) -> None:
    """Add what a pixel's width makes of its normal to the variance, in strips of rows that bound the memory."""
    for top in range(0, len(fine.normals), STRIP):
        bottom, first = min(top + STRIP, len(fine.normals)), max(top - 1, 0)
        strip = fine.normals[first : bottom + 1].astype(np.float64)
        added = np.sum(footprint(strip)[:, top - first : bottom - first] ** 2, axis=(0, 3))
        part = fine.variance[top:bottom]
        fine.variance[top:bottom] = np.where(np.isfinite(part), np.minimum(part + added, UNKNOWN_DIRECTION), np.inf)


def _put(fine: Fine, solved: SolvedTile) -> None:
    place = solved.rows, solved.columns
    fine.normals[place] = solved.normals
    fine.body[place] = solved.body
    fine.variance[place] = solved.shared
    fine.converged[place] = solved.converged
    fine.labels[place] = solved.labels


def _solve_tile(shared: Shared, tile: int) -> SolvedTile | None:
    """Normals and body colours of a tile, on the coarse surface and with its gloss and lamps; None where are none."""
    store, coarse = known_of(shared)
    stack, *rows_columns = store.stack(tile)
    solved = with_all_lobes(store, coarse, stack, (rows_columns[0], rows_columns[1]))
    if solved is None:
        return None
    views, fit = solved.views, solved.fit
    noise = fit.variance if coarse.stiffness is None else noise_of(solved)
    if any(coarse.lobes) and coarse.stiffness is None:
        fit = with_bodies(views, fit, solved.place, solved.trust, coarse.lobes)
    errors, own, beside = coarse.normal_map.fit.errors, fit.variance, np.zeros(len(views.rows))
    if errors is not None:
        pixels = views.rows, views.columns
        beside = nearest_coarse(store, coarse, errors.shared, pixels)
        if coarse.misfit is not None:
            own = own + nearest_coarse(store, coarse, coarse.misfit, pixels)
    return SolvedTile(
        *(views.rows, views.columns), fit.normals, own, beside, noise, fit.body.T, solved.converged, fit.labels
    )


def _window(store: TileStore, tile: int, margin: int | None = None) -> tuple[slice, slice]:
    """Rows and columns of a tile with the margin [px] that it shares with its neighbours: that of its integration."""
    (rows, columns), camera = store.place(tile), store.camera
    margin = MARGIN * store.factor if margin is None else margin
    top, left = max(rows.start - margin, 0), max(columns.start - margin, 0)
    return np.s_[top : min(rows.stop + margin, camera.height), left : min(columns.stop + margin, camera.width)]


def _integrate_tile(
    shared: Shared, tile: int, normals: NDArray[np.float32], variance: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float32]] | None:
    """Points of a tile and the variance of their distance: its normals integrated around the coarse surface.

    normals, variance: of the `_window` of the tile. None where nothing is known.
    """
    store, coarse = known_of(shared)
    (rows, columns), camera = store.place(tile), store.camera
    top, left = (part.start for part in _window(store, tile))
    known = np.asarray(np.linalg.norm(normals, axis=2) > 0.5)
    if not known.any():
        return None
    part_camera = replace(
        camera,
        width=normals.shape[1],
        height=normals.shape[0],
        principal=(camera.principal[0] - left, camera.principal[1] - top),
        sensor=None,
    )
    pixels = np.nonzero(known)
    depth, spread, sure = coarse_depth(store, coarse, (pixels[0] + top, pixels[1] + left))
    level = np.full(known.shape, np.nan)
    level[known] = np.where(sure, np.log(depth), np.nan)
    if not sure.any():
        return None
    points = anchored_surface(normals, part_camera, variance, level, store.factor)
    own = np.s_[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    errors = np.full(known.shape, np.inf, np.float32)
    errors[known] = spread
    return points[own], errors[own]
