"""Tiles: normals and depth of photographs that exceed the memory.

Gloss, lamps, distance and a coarse surface are estimated from the coarse capture of a `TileStore`. Under far lamps
further lobes of the interface are found on pixels of full size, chosen at random, as squares of pixels blur a narrow
lobe. Normals and body colours of each tile are then fitted with these known, and its depth is integrated around the
coarse surface.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.cluster.cluster import Here, Workers
from hagoromo.errors import InputError
from hagoromo.files.array_tree import read_tree, write_tree
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.normals.gloss_choice import BY_EVIDENCE, GlossModel
from hagoromo.measurement.normals.highlight_check import angles
from hagoromo.measurement.normals.lobe_fit import FoundLobes, find_lobes, fit_with, most_pixels, with_bodies
from hagoromo.measurement.normals.lobe_samples import Trust, trust_of
from hagoromo.measurement.normals.normals import (
    NormalMap,
    robust_lambert,
    solve_with_one_lobe,
    with_shared_errors,
)
from hagoromo.measurement.normals.photometric_model import Fit, Prior, evenness, precision
from hagoromo.measurement.normals.pixel_errors import UNKNOWN_DIRECTION, footprint
from hagoromo.measurement.normals.pixel_fit import STILL_MOVING_SHARE, PixelConditions, fit_pixels
from hagoromo.measurement.normals.shading import Gloss
from hagoromo.measurement.normals.views import CLIPPED, Array, Stack, Views, views_from_stack
from hagoromo.measurement.surface.cast_shadows import cast_shadows
from hagoromo.measurement.surface.depth import DepthSurface, anchored_surface, surface_of
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.measurement.surface.tile_store import TileStore
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent

STRATA = (0.0, 2.0, 4.0, 8.0, 16.0)  # [°] least angles of the strata between normal and half vector of the nearest lamp
STRIP = 256  # rows of a picture whose footprints are computed at once
MARGIN = 2  # coarse pixels around a tile that its integration includes, so that neighbouring tiles join


@dataclass(frozen=True, eq=False)
class Coarse:
    """The coarse capture, its normals and their fit, and its surface.

    gloss: (M, G) rows of `Gloss` of one lobe of each material, under which normals are solved; None: those of the fit.
    lobes: of each material, found on pixels of full size; none: those of the fit. misfit: (N,) own variance of the
    coarse normals [rad²] beyond that of noise, model error and the width of a pixel: pixels of full size have it, too;
    None where no lamps were left out.
    """

    capture: Capture
    normal_map: NormalMap
    surface: DepthSurface
    gloss: Array | None = None
    lobes: tuple[FoundLobes | None, ...] = ()
    misfit: Array | None = None

    @property
    def rows(self) -> Array:
        """(M, G) rows of `Gloss` under which normals are solved."""
        return self.normal_map.fit.gloss.rows if self.gloss is None else self.gloss


@dataclass(frozen=True, eq=False)
class Fine:
    """Full-size maps: normals, points (h, w, 3), body (h, w, C), 0 where unknown; labels (h, w), −1 unknown.

    variance (h, w) of the normals [rad²] and depth_variance (h, w) of the distance [m²], inf where unknown; the latter
    is that of the coarse surface. converged (h, w): whether the fit of a pixel's normal converged.
    """

    normals: NDArray[np.float32]
    variance: NDArray[np.float32]
    body: NDArray[np.float32]
    labels: NDArray[np.int16]
    points: NDArray[np.float64]
    depth_variance: NDArray[np.float32]
    converged: NDArray[np.bool_]

    def remarks(self) -> list[str]:
        """One line if the normals of more pixels than the fit leaves did not converge."""
        known = np.isfinite(self.variance)
        share = float(np.mean(~self.converged[known]))
        remark = f"the normal of {100.0 * share:.2g} % of all pixels did not converge"
        return [remark] if share > STILL_MOVING_SHARE else []


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
        return Coarse(capture, shape.normal_map, shape.surface)
    plain = solve_with_one_lobe(capture, prior=prior, progress=progress, model=model)
    normal_map = with_shared_errors(plain)
    shadows = cast_shadows(normal_map, normal_map.views.valid(capture.photographs))
    surface = surface_of(normal_map, capture.photographs[0].camera, distance, shadows=shadows)
    return _with_lobes(store, Coarse(capture, normal_map, surface, misfit=_misfit(plain, normal_map)))


def _misfit(plain: NormalMap, found: NormalMap) -> Array | None:
    """See `Coarse`; plain: `found` without the errors of lamps that are left out."""
    errors = found.fit.errors
    return None if errors is None else np.maximum(errors.own - plain.fit.variance, 0.0)


class Known(NamedTuple):
    """What all tiles need."""

    store: TileStore
    coarse: Coarse


Shared: TypeAlias = "Known | str"  # or the file that has it


class SolvedTile(NamedTuple):
    """The pixels (P,) of a tile whose normals are solved, and what is known of each, as in `Fine`."""

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    normals: NDArray
    variance: NDArray
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
        np.zeros((*size, 3)),
        np.full(size, np.inf, np.float32),
        np.zeros(size, bool),
    )
    known = tiles or range(store.count)
    shared: Shared = Known(store, coarse) if workers is None else _shared_file(Known(store, coarse))
    runner = workers or Here()
    for done, (_, solved) in enumerate(runner.results(_solve_tile, ((shared, tile) for tile in known)), 1):
        progress(0.7 * done / len(known), f"normals of tile {done} of {len(known)}")
        if solved is not None:
            _put(fine, solved)
    if not np.isfinite(fine.variance).any():
        raise InputError("no pixel is lit by three lamps: expose longer")
    if coarse.misfit is not None:
        _add_footprint(fine)
    maps = fine.normals, fine.variance
    windows = ((shared, tile, *(part[_window(store, tile)] for part in maps)) for tile in known)
    for done, (number, points) in enumerate(runner.results(_integrate_tile, windows), 1):
        progress(0.7 + 0.3 * done / len(known), f"depth of tile {done} of {len(known)}")
        if points is not None:
            place = store.place(known[number])
            fine.points[place], fine.depth_variance[place] = points
    progress(1.0, "")
    return fine


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
    fine.variance[place] = solved.variance
    fine.converged[place] = solved.converged
    fine.labels[place] = solved.labels


def _shared_file(known: Known) -> str:
    """A file beside the tiles with what all workers need; its path."""
    path = known.store.path.with_name("shared")
    write_tree(path, known)
    return str(path)


@lru_cache(maxsize=1)
def _from_file(path: str) -> Known:
    if not Path(path).is_file():
        raise InputError(f"a worker does not see {path}: write to a folder that all workers share")
    return read_tree(Path(path), Known)


def _known(shared: Shared) -> Known:
    return _from_file(shared) if isinstance(shared, str) else shared


def _solve_tile(shared: Shared, tile: int) -> SolvedTile | None:
    """Normals and body colours of a tile, on the coarse surface and with its gloss and lamps; None where are none."""
    store, coarse = _known(shared)
    stack, *rows_columns = store.stack(tile)
    solved = _solved(store, coarse, stack, (rows_columns[0], rows_columns[1]))
    if solved is None:
        return None
    views, fit = solved.views, solved.fit
    if any(coarse.lobes):
        fit = with_bodies(views, fit_with(fit, coarse.lobes), solved.place, solved.trust, coarse.lobes)
    errors, variance = coarse.normal_map.fit.errors, fit.variance
    if errors is not None:
        beside = errors.shared if coarse.misfit is None else errors.shared + coarse.misfit
        variance = variance + _nearest(store, coarse, beside, (views.rows, views.columns))
    return SolvedTile(views.rows, views.columns, fit.normals, variance, fit.body.T, solved.converged, fit.labels)


class _Pixels(NamedTuple):
    """Some pixels of full size: their views and fit with one lobe, their place, and which values count."""

    views: Views
    fit: Fit
    place: Array
    trust: Trust
    converged: NDArray[np.bool_]


def _solved(
    store: TileStore, coarse: Coarse, stack: Stack, pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> _Pixels | None:
    """Normals and body colours of `pixels` of full size on the coarse surface; None where three lamps light none."""
    fit, small = coarse.normal_map.fit, coarse.normal_map.views
    if not len(pixels[0]):
        return None
    depth, _, _ = _coarse_depth(store, coarse, pixels)
    views = views_from_stack(stack, store.camera, small.lamps, _points(store.camera, pixels, depth), pixels)
    if not len(views.rows):
        return None
    labels = _nearest(store, coarse, fit.labels, (views.rows, views.columns))
    place = _place(views.rows, views.columns, coarse, store.factor)
    light = PixelConditions(
        coarse.rows[labels], evenness(fit.strength, fit.slope, place), precision(views, fit.model_error)
    )
    found = fit_pixels(views, light, *robust_lambert(views))
    trusted = np.asarray(np.isfinite(views.variance).all(axis=1))
    top = store.scale[:, None, None] / np.maximum(views.light, 1e-300)  # the largest valid value, under its light
    lower = ~trusted[:, None] & (views.values >= CLIPPED * top)
    fine = replace(
        fit, normals=found.normals, body=found.body, variance=found.variance, labels=labels, gloss=Gloss(coarse.rows),
        pixel_status=None, lobes=None, own=None, errors=None,
    )  # fmt: skip
    return _Pixels(views, fine, place, Trust(trusted, lower), found.converged)


def _nearest(
    store: TileStore, coarse: Coarse, values: NDArray, pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> NDArray:
    """(P,) of the coarse `values` (N,) those at fine `pixels`; 0 where a coarse pixel is not known."""
    small = coarse.normal_map.views
    image = small.image(values)
    inside = np.minimum(pixels[0] // store.factor, small.shape[0] - 1)
    return image[inside, np.minimum(pixels[1] // store.factor, small.shape[1] - 1)]


def _with_lobes(store: TileStore, coarse: Coarse, seed: int = 0) -> Coarse:
    """`coarse` with further lobes of each material where pixels of full size need them."""
    fit, views = coarse.normal_map.fit, coarse.normal_map.views
    if not np.any(np.exp(fit.gloss.rows[:, 0]) > 0.0):
        return coarse
    pixels = _sampled(store, coarse, np.random.default_rng(seed))
    each = [] if pixels is None else find_lobes(pixels.views, pixels.fit, pixels.place, pixels.trust, seed)
    if not any(each):
        return coarse
    whole = with_bodies(views, fit_with(fit, each), views.place, trust_of(coarse.capture, views), each)
    body = views.image(whole.body.T.astype(np.float32))
    normal_map = replace(coarse.normal_map, fit=whole, body=body)
    return replace(coarse, normal_map=normal_map, gloss=fit.gloss.rows, lobes=tuple(each))


def _sampled(store: TileStore, coarse: Coarse, random: np.random.Generator) -> _Pixels | None:
    """Pixels of full size, `most_pixels` of each material or fewer: as many in each of the strata of the half angle."""
    fit = coarse.normal_map.fit
    nearest = np.degrees(angles(fit.normals, coarse.normal_map.views).min(axis=0))
    stratum = len(STRATA) * fit.labels + np.digitize(nearest, STRATA) - 1
    numbers = np.bincount(stratum, minlength=len(STRATA) * len(fit.gloss.rows)) * float(store.factor) ** 2
    chance = np.minimum(most_pixels(len(store.lamps)) / len(STRATA) / np.maximum(numbers, 1.0), 1.0)[stratum]
    stacks, places = [], []
    for tile in range(store.count):
        stack, *pixels = store.stack(tile)
        chosen = random.random(len(pixels[0])) < _nearest(store, coarse, chance, (pixels[0], pixels[1]))
        stacks.append((stack.values[:, chosen], stack.variance[:, chosen], stack.valid[:, chosen]))
        places.append((pixels[0][chosen], pixels[1][chosen]))
    stack = Stack(*(np.concatenate(parts, axis=1) for parts in zip(*stacks, strict=True)))
    rows, columns = (np.concatenate(parts) for parts in zip(*places, strict=True))
    return _solved(store, coarse, stack, (rows, columns))


def _window(store: TileStore, tile: int) -> tuple[slice, slice]:
    """Rows and columns of a tile with the margin that it shares with its neighbours."""
    (rows, columns), camera, margin = store.place(tile), store.camera, MARGIN * store.factor
    top, left = max(rows.start - margin, 0), max(columns.start - margin, 0)
    return np.s_[top : min(rows.stop + margin, camera.height), left : min(columns.stop + margin, camera.width)]


def _integrate_tile(
    shared: Shared, tile: int, normals: NDArray[np.float32], variance: NDArray[np.float32]
) -> tuple[NDArray[np.float64], NDArray[np.float32]] | None:
    """Points of a tile and the variance of their distance: its normals integrated around the coarse surface.

    normals, variance: of the `_window` of the tile. None where nothing is known.
    """
    store, coarse = _known(shared)
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
    depth, spread, sure = _coarse_depth(store, coarse, (pixels[0] + top, pixels[1] + left))
    level = np.full(known.shape, np.nan)
    level[known] = np.where(sure, np.log(depth), np.nan)
    if not sure.any():
        return None
    points = anchored_surface(normals, part_camera, variance, level, store.factor)
    own = np.s_[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    errors = np.full(known.shape, np.inf, np.float32)
    errors[known] = spread
    return points[own], errors[own]


def _coarse_depth(
    store: TileStore, coarse: Coarse, pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Depth (P,) along the axis of fine `pixels`, its variance (P,), whether (P,) all coarse pixels around are known.

    Bilinear; unknown coarse pixels take the value of the nearest known one.
    """
    from scipy.ndimage import map_coordinates

    camera, points = store.camera, coarse.surface.points
    known = np.asarray(np.linalg.norm(points, axis=2) > 0.0)
    depth = (points - camera.position) @ camera.camera_to_world[:3, 2]
    filled = nearest_known(known)
    depth, spread = depth[filled], coarse.surface.variance[filled]
    position = np.stack([(axis + 0.5) / store.factor - 0.5 for axis in pixels])
    nearest = tuple(
        np.clip(np.rint(axis).astype(np.intp), 0, n - 1) for axis, n in zip(position, depth.shape, strict=True)
    )
    between = np.asarray(map_coordinates(depth, position, order=1, mode="nearest"), np.float64)
    whole = np.asarray(map_coordinates(known.astype(np.float64), position, order=1, mode="nearest")) > 0.999
    return between, spread[nearest].astype(np.float64), whole


def _points(camera: Camera, pixels: tuple[NDArray[np.intp], NDArray[np.intp]], depth: Array) -> Array:
    """(P, 3) [m] at `depth` (P,) along the axis."""
    rays = camera.unproject(np.stack([pixels[1] + 0.5, pixels[0] + 0.5], axis=1))
    return camera.position + rays * (depth / (rays @ camera.camera_to_world[:3, 2]))[:, None]


def _place(rows: NDArray[np.intp], columns: NDArray[np.intp], coarse: Coarse, factor: int) -> Array:
    """(P, 2) position of fine pixels on the object, in the coordinates of `Views.place` of the coarse ones."""
    small = coarse.normal_map.views
    middle = np.array([small.columns.mean(), small.rows.mean()])
    position = np.stack([(columns + 0.5) / factor - 0.5, (rows + 0.5) / factor - 0.5], axis=1)
    return (position - middle) / np.sqrt(len(small.rows) / np.pi)
