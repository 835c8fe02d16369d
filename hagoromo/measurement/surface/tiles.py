"""Tiles: normals and depth of photographs that do not fit the memory.

Gloss, lamps, distance and a coarse surface come from the small capture of a `TileStore`; with them known, every tile is
solved for its normals and body colours, and its depth is integrated around the coarse surface, steps kept.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.measurement.normals.normals import NormalMap, robust_lambert, solve_normals
from hagoromo.measurement.normals.photometric_model import evenness, precision
from hagoromo.measurement.normals.photometric_prior import Prior
from hagoromo.measurement.normals.pixel_fit import Light, fit_pixels
from hagoromo.measurement.normals.views import Array, views_of
from hagoromo.measurement.surface.depth import Surface, anchored_surface, surface_from_normals
from hagoromo.measurement.surface.shape import has_near_lamps, solve_shape
from hagoromo.measurement.surface.tile_store import TileStore
from hagoromo.photograph.capture import Capture
from hagoromo.progress import Progress, silent

MARGIN = 2  # coarse pixels around a tile that its depth is integrated with, so that neighbours meet


@dataclass(frozen=True, eq=False)
class Coarse:
    """The small capture, what was found on it, its surface, and its labels."""

    capture: Capture
    found: NormalMap
    surface: Surface


@dataclass(frozen=True, eq=False)
class Fine:
    """Full-size maps: normals, points (h, w, 3), body (h, w, C), 0 where unknown; labels (h, w), −1 unknown.

    variance (h, w) of the normals [rad²] and depth_variance (h, w) of the distance [m²], inf where unknown: the latter
    is the coarse surface's. converged (h, w): whether the fit of a pixel's normal did.
    """

    normals: NDArray[np.float32]
    variance: NDArray[np.float32]
    body: NDArray[np.float32]
    labels: NDArray[np.int16]
    points: NDArray[np.float32]
    depth_variance: NDArray[np.float32]
    converged: NDArray[np.bool_]

    def remarks(self) -> list[str]:
        """One line where the normals of some pixels did not converge."""
        known = np.isfinite(self.variance)
        share = float(np.mean(~self.converged[known]))
        return [f"the normal of {100.0 * share:.2g} % of all pixels did not converge"] if share > 0.0 else []


def solve_coarse(store: TileStore, distance: float, prior: Prior | None = None, progress: Progress = silent) -> Coarse:
    """Everything that the tiles share, from the small capture; distance: about, to the surface [m]."""
    capture = store.coarse
    if has_near_lamps(capture):
        shape = solve_shape(capture, distance, prior, progress)
        return Coarse(capture, shape.found, shape.surface)
    found = solve_normals(capture, prior=prior, progress=progress)
    camera = capture.photographs[0].camera
    return Coarse(capture, found, surface_from_normals(found.normals, camera, distance, found.variance))


def solve_tiles(store: TileStore, coarse: Coarse, progress: Progress = silent, tiles: range | None = None) -> Fine:
    """All tiles (or those in `tiles`), from what is known of the coarse capture. `InputError` when nothing is lit."""
    camera = store.camera
    size = camera.height, camera.width
    fine = Fine(
        np.zeros((*size, 3), np.float32),
        np.full(size, np.inf, np.float32),
        np.zeros((*size, store.channels), np.float32),
        np.full(size, -1, np.int16),
        np.zeros((*size, 3), np.float32),
        np.full(size, np.inf, np.float32),
        np.zeros(size, bool),
    )
    known = tiles or range(store.count)
    for i, tile in enumerate(known):
        progress(0.7 * i / len(known), f"normals of tile {i + 1} of {len(known)}")
        _solve_tile(store, coarse, tile, fine)
    if not np.isfinite(fine.variance).any():
        raise InputError("no pixel is lit by three lamps: expose longer")
    for i, tile in enumerate(known):
        progress(0.7 + 0.3 * i / len(known), f"depth of tile {i + 1} of {len(known)}")
        _integrate_tile(store, coarse, tile, fine)
    progress(1.0, "")
    return fine


def _solve_tile(store: TileStore, coarse: Coarse, tile: int, fine: Fine) -> None:
    """Normals and body colours of a tile, on the coarse surface and with its gloss and lamps."""
    fit, small = coarse.found.fit, coarse.found.seen
    stack, *at = store.stack(tile)
    pixels = at[0], at[1]
    if not len(pixels[0]):
        return
    depth, _, _ = _coarse_depth(store, coarse, pixels)
    points = _points(store.camera, pixels, depth)
    seen = views_of(stack, store.camera, small.lamps, points, pixels)
    if not len(seen.rows):
        return
    label_of = np.zeros(small.shape, np.intp)
    label_of[small.rows, small.columns] = fit.labels
    inside = np.minimum(seen.rows // store.factor, small.shape[0] - 1)
    labels = label_of[inside, np.minimum(seen.columns // store.factor, small.shape[1] - 1)]
    even = evenness(fit.strength, fit.slope, _place(seen.rows, seen.columns, coarse, store.factor))
    light = Light(fit.gloss.rows[labels], even, precision(seen, fit.model_error))
    pixels_fit = fit_pixels(seen, light, *robust_lambert(seen))
    fine.normals[seen.rows, seen.columns] = pixels_fit.normals
    fine.body[seen.rows, seen.columns] = pixels_fit.body.T
    fine.variance[seen.rows, seen.columns] = pixels_fit.variance
    fine.converged[seen.rows, seen.columns] = pixels_fit.converged
    fine.labels[seen.rows, seen.columns] = labels


def _integrate_tile(store: TileStore, coarse: Coarse, tile: int, fine: Fine) -> None:
    """Points of a tile: its normals integrated around the coarse surface, over a margin that its neighbours share."""
    (rows, columns), camera, margin = store.place(tile), store.camera, MARGIN * store.factor
    top, left = max(rows.start - margin, 0), max(columns.start - margin, 0)
    wide = np.s_[top : min(rows.stop + margin, camera.height), left : min(columns.stop + margin, camera.width)]
    normals = fine.normals[wide]
    known = np.asarray(np.linalg.norm(normals, axis=2) > 0.5)
    if not known.any():
        return
    here = replace(
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
        return
    points = anchored_surface(normals, here, fine.variance[wide], level, store.factor)
    own = np.s_[rows.start - top : rows.stop - top, columns.start - left : columns.stop - left]
    fine.points[rows, columns] = points[own]
    errors = np.full(known.shape, np.inf, np.float32)
    errors[known] = spread
    fine.depth_variance[rows, columns] = errors[own]


def _coarse_depth(
    store: TileStore, coarse: Coarse, pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> tuple[Array, Array, NDArray[np.bool_]]:
    """Depth (P,) along the axis of fine `pixels`, its variance (P,), whether (P,) all coarse pixels around are known.

    Bilinear, the nearest known one standing in for those that are not.
    """
    from scipy.ndimage import distance_transform_edt, map_coordinates

    camera, points = store.camera, coarse.surface.points
    known = np.asarray(np.linalg.norm(points, axis=2) > 0.0)
    depth = (points - camera.position) @ camera.camera_to_world[:3, 2]
    filled = np.asarray(distance_transform_edt(~known, return_distances=False, return_indices=True))
    depth, spread = depth[filled[0], filled[1]], coarse.surface.variance[filled[0], filled[1]]
    at = np.stack([(axis + 0.5) / store.factor - 0.5 for axis in pixels])
    nearest = tuple(np.clip(np.rint(axis).astype(np.intp), 0, n - 1) for axis, n in zip(at, depth.shape, strict=True))
    between = np.asarray(map_coordinates(depth, at, order=1, mode="nearest"), np.float64)
    whole = np.asarray(map_coordinates(known.astype(np.float64), at, order=1, mode="nearest")) > 0.999
    return between, spread[nearest].astype(np.float64), whole


def _points(camera: Camera, pixels: tuple[NDArray[np.intp], NDArray[np.intp]], depth: Array) -> Array:
    """(P, 3) [m] at `depth` (P,) along the axis."""
    rays = camera.unproject(np.stack([pixels[1] + 0.5, pixels[0] + 0.5], axis=1))
    return camera.position + rays * (depth / (rays @ camera.camera_to_world[:3, 2]))[:, None]


def _place(rows: NDArray[np.intp], columns: NDArray[np.intp], coarse: Coarse, factor: int) -> Array:
    """(P, 2) place of fine pixels on the object, as `Views.place` has it for the coarse ones."""
    small = coarse.found.seen
    middle = np.array([small.columns.mean(), small.rows.mean()])
    at = np.stack([(columns + 0.5) / factor - 0.5, (rows + 0.5) / factor - 0.5], axis=1)
    return (at - middle) / np.sqrt(len(small.rows) / np.pi)
