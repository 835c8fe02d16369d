"""Pixel table: the pixels of all photographs on the device, of which descent draws some."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy import ndimage
from scipy.special import expit

from hagoromo.backend import Array3f, Float, UInt, arrays, evaluate, lookup
from hagoromo_recovery.field.matter_march import LatticeRays
from hagoromo_recovery.outline.hull import signed_distance, way_to
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.object_view import ObjectView

CHUNK = 16  # pixels that are drawn together: neighbours, so that their rays meet the same matter
TILE = 4  # px, side of such a neighbourhood
BESIDE = 4.0  # voxels around a silhouette whose pixels count, too
AT_EDGE = 0.1  # weight of the silhouette's edge, which is known to half a pixel
ROBUST, UNLIT_ROBUST = 7.0, 20.0  # standard deviations from which a pixel loses weight; without lamps
UNLIT_ERROR = 0.02  # error of the model without lamps, of the value of a bright pixel
INSIDE = 1.5  # nodes from the edge of the lattice where rays begin: a spline needs neighbours


class Drawn(NamedTuple):
    """Some pixels: rays, number of photograph, values and weights of 3 channels, silhouette and its weight."""

    rays: LatticeRays
    photograph: UInt
    values: list[Float]
    weights: list[Float]
    share: Float
    share_weight: Float


class PixelTable:
    """All pixels of some views near the object. model_error: relative error of the model, beside the noise.

    Without lamps it is the same in dark and bright pixels: what a body colour cannot hold, such as a shadow that one
    view shows and another does not, is of the size of the light.
    """

    def __init__(
        self,
        views: Sequence[ObjectView],
        lattice: Lattice,
        model_error: float,
        scale: float,
        softness: float | None = None,
    ) -> None:
        """scale: value of a bright pixel; model_error is of it, too. softness: s of a surface in the end [voxel], which
        blurs its outline; None: matter without an outline.
        """
        columns: list[list[NDArray]] = []
        for number, view in enumerate(views):
            columns.append(_pixels_of(view, number, lattice, model_error, scale, softness))
        joined = [np.concatenate(each) for each in zip(*columns, strict=True)]
        self.scale = scale
        self.limit = ROBUST if any(view.photograph.lamps for view in views) else UNLIT_ROBUST
        self.count = len(joined[0]) // CHUNK * CHUNK
        number, *floats = joined
        self.photograph = lookup(arrays().UInt, number[: self.count].astype(np.uint32))
        self.table = [lookup(arrays().Float, each[: self.count].astype(np.float32)) for each in floats]
        places = np.stack([lattice.from_world(v.photograph.camera.position) for v in views])
        self.places, self.voxel = places, lattice.voxel
        cameras = [view.photograph.camera for view in views]
        axes = [c.world_to_camera[:3, :3] / np.array([[c.focal[0]], [c.focal[1]], [1.0]]) for c in cameras]
        self.axes = lookup(arrays().Float, np.stack(axes).astype(np.float32).ravel())  # a pixel right and down; ahead
        away = [np.linalg.norm(v.photograph.camera.position - lattice.middle) for v in views]
        self.distance = float(np.median(away))  # of cameras from the object [m]
        self.move(np.zeros((len(views), 3)), np.zeros((len(views), 3)))
        dr.eval(self.photograph, self.table)

    def move(self, turns: NDArray[np.floating], shifts: NDArray[np.floating]) -> None:
        """Move the camera of each photograph. turns: (photographs, 3) rotation vectors, small [rad]. shifts: [m]."""
        self.turns = lookup(arrays().Float, np.asarray(turns, np.float32).ravel())
        eyes = self.places + np.asarray(shifts) / self.voxel
        self.eyes = lookup(arrays().Float, eyes.astype(np.float32).ravel())
        dr.eval(self.turns, self.eyes)

    def of(self, chunks: NDArray[np.integer]) -> Drawn:
        """The pixels of some chunks, by number below `count` // CHUNK."""
        jit = arrays()
        lane = dr.arange(jit.UInt, len(chunks) * CHUNK)
        first = dr.gather(jit.UInt, lookup(jit.UInt, chunks.astype(np.uint32)), lane // CHUNK)
        index = first * CHUNK + lane % CHUNK
        photograph = dr.gather(jit.UInt, self.photograph, index)
        x, y, z, near, far, *rest = (dr.gather(jit.Float, each, index) for each in self.table)
        way = jit.Array3f(x, y, z)
        way = dr.normalize(way + dr.cross(dr.gather(jit.Array3f, self.turns, photograph), way))
        rays = LatticeRays(dr.gather(jit.Array3f, self.eyes, photograph), way, near, far)
        drawn = Drawn(rays, photograph, rest[:3], rest[3:6], rest[6], rest[7])
        evaluate(drawn)
        return drawn

    def beside(self, drawn: Drawn, right: float, down: float) -> Drawn:
        """The same pixels, by rays that are so far from the middle of each [px]."""
        jit = arrays()

        def axis(which: int) -> Array3f:
            first = drawn.photograph * 9 + which * 3
            return jit.Array3f(*(dr.gather(jit.Float, self.axes, first + k) for k in range(3)))

        way = drawn.rays.direction
        way = dr.normalize(way + (right * axis(0) + down * axis(1)) * dr.dot(way, axis(2)))
        moved = drawn._replace(rays=drawn.rays._replace(direction=way))
        evaluate(moved)
        return moved


def _pixels_of(
    view: ObjectView, number: int, lattice: Lattice, model_error: float, scale: float, softness: float | None
) -> list[NDArray]:
    """Number of the photograph, then columns of the table, of the pixels of a view near the object."""
    p = view.photograph
    camera, w = p.camera, p.values.shape[1]
    directions = camera.pixel_directions()
    origin = lattice.from_world(camera.position)
    near, far = span(origin, directions, lattice)
    distance = np.linalg.norm(lattice.middle - camera.position)
    voxel = lattice.voxel * min(camera.focal) / float(distance)  # px
    beside = int(np.ceil(BESIDE * voxel)) + 1
    outside = ~view.silhouette
    used = (far > near) & ~outside.all()
    if view.stated:
        used &= way_to(~outside) <= beside
    rows, cols = np.nonzero(used)
    tile = (rows // TILE) * ((w + TILE - 1) // TILE) + cols // TILE
    order = np.lexsort((cols, rows, tile))
    at = rows[order], cols[order]
    values = p.values[at].astype(np.float64)
    values = values if values.shape[1] == 3 else np.repeat(values[:, :1], 3, axis=1)
    variance = p.variance[at].astype(np.float64)
    variance = variance if variance.shape[1] == 3 else np.repeat(variance[:, :1], 3, axis=1)
    lit = p.mask[at] & np.isfinite(values).all(axis=1)
    error = (model_error * np.maximum(values, 0.0)) ** 2 + (0.25 * model_error * scale) ** 2
    if not p.lamps:
        error = np.full_like(error, (UNLIT_ERROR * scale) ** 2)
    if softness is not None:
        error = error + blurred(view, softness * voxel)[at] ** 2
    weights = np.where(lit[:, None], 1.0 / (np.where(lit[:, None], variance, 1.0) + error), 0.0)
    edge = (view.share > 0.0) & (view.share < 1.0)
    edge |= (way_to(~outside) <= 1.0) & (way_to(outside) <= 1.0)
    share_weight = np.where(edge[at], AT_EDGE, 1.0) * float(view.stated)
    columns = [np.full(len(rows), number), *directions[at].T, near[at], far[at]]
    return [*columns, *np.where(lit[:, None], values, 0.0).T, *weights.T, view.share[at], share_weight]


def blurred(view: ObjectView, softness: float) -> NDArray:
    """(h, w, channels) error of light beside the outline of a surface whose edge is soft by s [px], as it is in no
    photograph.

    A ray that passes the outline at a distance d is opaque by Φ(d/s), in a photograph wholly or not at all: the
    difference is a share of the light that the surface has there. Were it not known as an error, the surface would grow
    until its edge is as bright as in photographs.
    """
    values = np.nan_to_num(np.maximum(view.photograph.values, 0.0))
    ways: Any = ndimage.distance_transform_edt(~view.silhouette, return_distances=False, return_indices=True)
    off = expit(-np.abs(signed_distance(view.silhouette)) / softness)
    return np.asarray(off[..., None] * values[ways[0], ways[1]])


def span(origin: NDArray, directions: NDArray, lattice: Lattice) -> tuple[NDArray, NDArray]:
    """Where rays enter and leave the lattice [voxel]."""
    low, high = np.full(3, INSIDE), np.array(lattice.shape[::-1]) - 1.0 - INSIDE
    with np.errstate(divide="ignore", invalid="ignore"):
        first, last = (low - origin) / directions, (high - origin) / directions
    near = np.nanmax(np.minimum(first, last), axis=-1)
    far = np.nanmin(np.maximum(first, last), axis=-1)
    return np.maximum(near, 0.0), far
