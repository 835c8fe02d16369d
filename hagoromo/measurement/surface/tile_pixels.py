"""Tile pixels: pixels of full size, whose gloss, lamps and rough surface are those of the coarse capture.

Enters: values of a `TileStore`, and what is known of the coarse capture. Leaves: views of these pixels with their
normals and body colours.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.array_tree import read_tree, write_tree
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.normals.lobe_fit import FoundLobes, fit_with
from hagoromo.measurement.normals.lobe_samples import Trust
from hagoromo.measurement.normals.neighbours import with_neighbours
from hagoromo.measurement.normals.normals import NormalMap, robust_lambert
from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.normals.pixel_fit import fit_pixels
from hagoromo.measurement.normals.shading import Gloss
from hagoromo.measurement.normals.smooth_normals import conditions
from hagoromo.measurement.normals.smooth_share import Stiffness
from hagoromo.measurement.normals.views import CLIPPED, Array, Stack, Views, views_from_stack
from hagoromo.measurement.surface.depth import DepthSurface
from hagoromo.measurement.surface.tile_store import TileStore
from hagoromo.photograph.capture import Capture

FIRST_STEPS = 3  # with one lobe, from which the fit with all lobes starts


@dataclass(frozen=True, eq=False)
class Coarse:
    """The coarse capture, its normals and their fit, and its surface.

    gloss: (M, G) rows of `Gloss` of one lobe of each material, under which normals are solved; None: those of the fit.
    lobes: of each material, found on pixels of full size; none: those of the fit. misfit: (N,) own variance of the
    coarse normals [rad²] beyond that of noise, model error and the width of a pixel: pixels of full size have it, too;
    None where no lamps were left out. stiffness: how smooth the surface is in pixels of full size; None: normals stay.
    """

    capture: Capture
    normal_map: NormalMap
    surface: DepthSurface
    gloss: Array | None = None
    lobes: tuple[FoundLobes | None, ...] = ()
    misfit: Array | None = None
    stiffness: Stiffness | None = None

    @property
    def rows(self) -> Array:
        """(M, G) rows of `Gloss` under which normals are solved."""
        return self.normal_map.fit.gloss.rows if self.gloss is None else self.gloss


class Known(NamedTuple):
    """What all tiles need."""

    store: TileStore
    coarse: Coarse


Shared: TypeAlias = "Known | str"  # or the file that has it


def shared_file(known: Known) -> str:
    """A file beside the tiles with what all workers need; its path."""
    path = known.store.path.with_name("shared")
    write_tree(path, known)
    return str(path)


@lru_cache(maxsize=1)
def _from_file(path: str) -> Known:
    if not Path(path).is_file():
        raise InputError(f"a worker does not see {path}: write to a folder that all workers share")
    return read_tree(Path(path), Known)


def known_of(shared: Shared) -> Known:
    """What is shared, read from its file where it is one."""
    return _from_file(shared) if isinstance(shared, str) else shared


class TilePixels(NamedTuple):
    """Some pixels of full size: their views and fit, their place on the object, and which values count."""

    views: Views
    fit: Fit
    place: Array
    trust: Trust
    converged: NDArray[np.bool_]


def with_one_lobe(
    store: TileStore,
    coarse: Coarse,
    stack: Stack,
    pixels: tuple[NDArray[np.intp], NDArray[np.intp]],
    steps: int | None = None,
) -> TilePixels | None:
    """Normals and body colours of `pixels` of full size on the coarse surface; None where three lamps light none."""
    views = on_surface(store, coarse, stack, pixels) if len(pixels[0]) else None
    if views is None or not len(views.rows):
        return None
    count = len(views.rows)
    nothing = np.zeros((count, 3)), np.zeros((store.channels, count)), np.full(count, np.inf)
    fit, place = fine_fit(store, coarse, (views.rows, views.columns), nothing)
    found = fit_pixels(views, conditions(views, fit, place), *robust_lambert(views), steps)
    fit = replace(fit, normals=found.normals, body=found.body, variance=found.variance)
    return TilePixels(views, with_neighbours(views, fit, place), place, trust_in(views), found.converged)


def with_all_lobes(
    store: TileStore, coarse: Coarse, stack: Stack, pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> TilePixels | None:
    """As `with_one_lobe`, then with all lobes that were found."""
    if not any(coarse.lobes):
        return with_one_lobe(store, coarse, stack, pixels)
    solved = with_one_lobe(store, coarse, stack, pixels, FIRST_STEPS)
    if solved is None:
        return None
    views, fit = solved.views, fit_with(solved.fit, coarse.lobes)
    found = fit_pixels(views, conditions(views, fit, solved.place), fit.normals, fit.body)
    fit = replace(fit, normals=found.normals, body=found.body, variance=found.variance)
    return solved._replace(fit=with_neighbours(views, fit, solved.place), converged=found.converged)


def fine_fit(
    store: TileStore,
    coarse: Coarse,
    pixels: tuple[NDArray[np.intp], NDArray[np.intp]],
    found: tuple[Array, Array, Array],
) -> tuple[Fit, Array]:
    """The fit of fine `pixels` with one lobe of each material, and their place (P, 2) on the object.

    found: their normals (P, 3), body colours (C, P), and variance (P,).
    """
    fit, (normals, body, variance) = coarse.normal_map.fit, found
    fine = replace(
        fit, normals=normals, body=body, variance=variance, labels=nearest_coarse(store, coarse, fit.labels, pixels),
        gloss=Gloss(coarse.rows), pixel_status=None, lobes=None, own=None, errors=None, smooth=None,
    )  # fmt: skip
    return fine, place_of(*pixels, coarse, store.factor)


def on_surface(
    store: TileStore, coarse: Coarse, stack: Stack, pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> Views:
    """Views of `pixels` of full size at the coarse surface, without those that fewer than three lamps light."""
    depth, _, _ = coarse_depth(store, coarse, pixels)
    at = _points(store.camera, pixels, depth)
    views = views_from_stack(stack, store.camera, coarse.normal_map.views.lamps, at, pixels)
    top = store.scale[:, None, None] / np.maximum(views.light, 1e-300)  # the largest valid value, under its light
    trusted = np.asarray(np.isfinite(views.variance).all(axis=1))
    lower = ~trusted[:, None] & (views.values >= CLIPPED * top)
    return replace(views, lower=lower if lower.any() else None)


def trust_in(views: Views) -> Trust:
    """Which values of pixels of full size count."""
    return Trust.of(views, np.asarray(np.isfinite(views.variance).all(axis=1)))


def nearest_coarse(
    store: TileStore, coarse: Coarse, values: NDArray, pixels: tuple[NDArray[np.intp], NDArray[np.intp]]
) -> NDArray:
    """(P,) of the coarse `values` (N,) those at fine `pixels`; 0 where a coarse pixel is not known."""
    small = coarse.normal_map.views
    image = small.image(values)
    inside = np.minimum(pixels[0] // store.factor, small.shape[0] - 1)
    return image[inside, np.minimum(pixels[1] // store.factor, small.shape[1] - 1)]


def coarse_depth(
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


def place_of(rows: NDArray[np.intp], columns: NDArray[np.intp], coarse: Coarse, factor: int) -> Array:
    """(P, 2) position of fine pixels on the object, in the coordinates of `Views.place` of the coarse ones."""
    small = coarse.normal_map.views
    middle = np.array([small.columns.mean(), small.rows.mean()])
    position = np.stack([(columns + 0.5) / factor - 0.5, (rows + 0.5) / factor - 0.5], axis=1)
    return (position - middle) / np.sqrt(len(small.rows) / np.pi)
