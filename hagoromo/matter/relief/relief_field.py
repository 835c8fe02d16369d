"""Relief field: images of a measured surface → density, axis, material and body colour at points of a volume box.

Every pixel stands for a facet, the plane through its point across its normal; matter is a skin below the facets. Axes
and colours go over from facet to facet: voxels are not where pixels are, but at the mean depth.

Where a pixel stands before another, its skin ends at the border between them. Density falls to 0 over a voxel, and of
an opaque skin nearly all of that voxel is opaque: so the outermost voxels are thinner, see `_thinned`. Rays pass them,
and the skin behind goes on below that pixel. What they keep is a sheet along their facet: light that comes from aside
meets as much of it as the eye, so that shadows of an outline begin at the outline.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, clip
from hagoromo.camera.camera import Camera
from hagoromo.matter.shape import rising

EDGE = 2.0  # voxels from outside to full density, measured along the normal
SKIN_VOXELS = 4.0  # voxels of matter along the normal
# least cosine to the line of sight for thickness: a steeper skin would be deeper than the object
LEAST_SKIN_COSINE = 0.3
# the same for the edge: of a steeper skin it would reach far towards the eye, and throw shadows
LEAST_EDGE_COSINE = 0.5
FRONT = (0.5 * EDGE + 2.0) / LEAST_EDGE_COSINE  # voxels before a facet in which there may be matter
FOLD = 1.0  # voxels by which the point beside a facet may be off its plane: what is farther is no part of its surface
OUTLINE_LIFT = 0.9  # voxels by which the sheet along an outline is before its facet, as what is seen of a skin is
SHEET = EDGE * 9.0 / 70.0  # voxels of full density that it amounts to, in all: EDGE ∫ s (1 − s) dt, s of `rising`
DEPTH = 36.0  # optical depth of the skin along its normal: its visible part is a third of a voxel deep
BACK_VOXELS = (SKIN_VOXELS + EDGE + 2.0) / LEAST_SKIN_COSINE  # voxels behind it
BESIDE = [(down, right) for down in (-1, 0, 1) for right in (-1, 0, 1) if down or right]  # the pixels around one
Array = NDArray[np.float64]


class ReliefLattice(NamedTuple):
    """Where the box lies before the camera: its low corner [m] in the camera's axes, along which it lies; voxel [m]."""

    camera: Camera
    low: Array
    voxel: float


class ReliefField:
    """A function of box coordinates [m] for `FieldBlocks`, from images (h, w, …) of the surface on the device.

    known: pixels of the surface. places: their points in box coordinates [m]. facing: normals in the camera's axes.
    colour: body colours on the box's basis. labels: of the materials, and of the surfaces between whose pixels axes
    and colours go over.
    """

    def __init__(
        self,
        known: NDArray[np.bool_],
        places: Array,
        facing: Array,
        colour: Array,
        labels: tuple[NDArray[np.integer], NDArray[np.integer]],
        lattice: ReliefLattice,
    ) -> None:
        rows, columns = np.nonzero(known)
        self.first = int(columns.min()), int(rows.min())
        crop = np.s_[rows.min() : rows.max() + 1, columns.min() : columns.max() + 1]
        self.rows, self.columns = known[crop].shape
        self.voxel, self.low, self.camera = float(lattice.voxel), lattice.low.tolist(), lattice.camera
        jit = arrays()

        def images(values: NDArray) -> list[Any]:
            return [jit.Float(values[crop][..., i].astype(np.float32).ravel()) for i in range(values.shape[2])]

        (self.known,) = images(known[..., None])
        self.place, self.facing, self.colour = images(places), images(facing), images(colour)
        self.labels, self.surfaces = (jit.UInt(np.maximum(one[crop], 0).astype(np.uint32).ravel()) for one in labels)
        self.before = jit.UInt(_before(known[crop], places[crop], facing[crop], FOLD * self.voxel).ravel())
        self.levels = _levels(
            np.where(known, places[..., 2], np.inf)[crop], np.where(known, places[..., 2], -np.inf)[crop]
        )

    def occupied(self, centre: Any, radius: float) -> Any:
        """Whether there may be matter in the ball [m] around `centre` (Array3f): never False where there is."""
        jit = arrays()
        # pixels that the ball may cover: of its own size, and as lines of sight part over its depth
        nearest = max(self.low[2], 1e-9)
        aside = 1.0 + max(self.camera.width, self.camera.height) / min(self.camera.focal)
        reach = max(self.camera.focal) * radius * aside / nearest + 1.0
        level = min(max(math.ceil(math.log2(2.0 * reach)), 0), len(self.levels) - 1)
        near, far, rows, columns = self.levels[level]
        column, row = (place / 2**level for place in self._pixel(centre))
        holds = jit.Bool(False)
        for down in (-0.5, 0.5):
            for right in (-0.5, 0.5):
                at = jit.UInt(clip(row + down, 0.0, rows - 1.0)) * columns
                at += jit.UInt(clip(column + right, 0.0, columns - 1.0))
                before = dr.gather(jit.Float, near, at) - FRONT * self.voxel - radius
                behind = dr.gather(jit.Float, far, at) + BACK_VOXELS * self.voxel + radius
                holds |= (centre.z > before) & (centre.z < behind)
        return holds

    def _pixel(self, p: Any) -> tuple[Any, Any]:
        """Column and row (from those of the first pixel) where box coordinates `p` [m] are projected."""
        (ax, ay), (x0, y0) = self.camera.focal, self.camera.principal
        away = p.z + self.low[2]
        column = (p.x + self.low[0]) / away * ax + (x0 - self.first[0])
        return column, (p.y + self.low[1]) / away * ay + (y0 - self.first[1])

    def __call__(self, p: Any) -> tuple[Any, Any, Any, list[Any]]:
        """Density, axis, material number and body colour at `p` (Array3f)."""
        jit = arrays()
        column, row = self._pixel(p)
        inside = (column >= 0.0) & (row >= 0.0) & (column < self.columns) & (row < self.rows)
        at = jit.UInt(clip(row, 0.0, self.rows - 1.0)) * self.columns
        at += jit.UInt(clip(column, 0.0, self.columns - 1.0))
        inside &= dr.gather(jit.Float, self.known, at) > 0.5
        off, beside = self._outline(column, row, at)
        density, cosine = self._skin(p, at)
        inwards = off * (p.z + self.low[2]) / self.voxel
        sheet, _ = self._skin(p, at, 0.0, OUTLINE_LIFT)
        sheet *= _thinned(inwards, DEPTH / SKIN_VOXELS * SHEET / cosine)
        density = dr.select(inwards < 1.0, sheet, density)
        # what is behind an outline goes on for a pixel: rays pass the thin voxels
        hidden, _ = self._skin(p, beside)
        hidden = dr.select(beside == at, 0.0, hidden)
        at, density = dr.select(hidden > density, beside, at), dr.fmax(density, hidden)
        axis = jit.Array3f(*(dr.gather(jit.Float, part, at) for part in self.facing))
        place = jit.Array3f(*(dr.gather(jit.Float, part, at) for part in self.place))
        colour = [dr.gather(jit.Float, part, at) for part in self.colour]
        label = dr.gather(jit.UInt, self.labels, at)
        surface = dr.gather(jit.UInt, self.surfaces, at)
        weight, bent, *between = self._between(column, row, place, axis, surface)
        bent = dr.select(inside & (weight < 1e-6), axis, bent)  # a pixel aside of its surface
        # what is beside the picture has no matter, but its colour is mixed into that of the outermost
        colour = [dr.select(inside & (weight >= 1e-6), new, old) for new, old in zip(between, colour, strict=True)]
        return dr.select(inside, density, 0.0), bent, label, colour

    def _skin(self, p: Any, at: Any, thickness: float = SKIN_VOXELS, lift: float = 0.0) -> tuple[Any, Any]:
        """Density at `p` of the skin of the facet of pixel `at`; cosine of the facet, as it counts for thickness.

        thickness: of the skin, and lift: how far it is before a facet that faces the eye [voxels]; at a limb less.
        By the distance below the plane of the facet, along its line of sight (no steeper than LEAST_SKIN_COSINE) and
        aside.
        """
        jit = arrays()
        axis = jit.Array3f(*(dr.gather(jit.Float, part, at) for part in self.facing))
        place = jit.Array3f(*(dr.gather(jit.Float, part, at) for part in self.place))
        ray = (place + jit.Array3f(*self.low)) / (place.z + self.low[2])
        deeper = p.z - place.z
        aside = p - place - ray * deeper
        cosine, aside = -dr.dot(axis, ray), dr.dot(axis, aside)
        above, below = (
            (deeper * dr.fmax(cosine, least) - aside) / self.voxel + lift * dr.square(cosine)
            for least in (LEAST_EDGE_COSINE, LEAST_SKIN_COSINE)
        )
        density = rising(above / EDGE + 0.5) * rising((thickness + 0.5 * EDGE - below) / EDGE)
        return density, dr.fmax(cosine, LEAST_SKIN_COSINE)

    def _outline(self, column: Any, row: Any, at: Any) -> tuple[Any, Any]:
        """Angle to the nearest border of pixel `at` with one that it stands before (else huge); that one, or `at`."""
        before, off, nearest = dr.gather(arrays().UInt, self.before, at), arrays().Float(1e9), at
        part = row - dr.floor(row), column - dr.floor(column)
        for bit, (down, right) in enumerate(BESIDE):
            each = [
                {-1: here, 0: 0.0, 1: 1.0 - here}[way] / focal
                for here, way, focal in zip(part, (down, right), self.camera.focal[::-1], strict=True)
            ]
            angle = dr.sqrt(each[0] * each[0] + each[1] * each[1])
            nearer = ((before >> bit) & 1 == 1) & (angle < off)
            off = dr.select(nearer, angle, off)
            nearest = dr.select(nearer, arrays().UInt(arrays().Int(at) + down * self.columns + right), nearest)
        return off, nearest

    def _between(self, column: Any, row: Any, place: Any, axis: Any, surface: Any) -> tuple[Any, ...]:
        """Axis and body colours between pixels of one `surface`, and of one sheet with the facet at `place` across
        `axis`; before them the weight of these pixels, 0 where there is none.
        """
        jit = arrays()
        left, top = dr.floor(column - 0.5), dr.floor(row - 0.5)
        sums = [jit.Float(0) for _ in (*self.facing, *self.colour, self.known)]
        for down in (0.0, 1.0):
            for right in (0.0, 1.0):
                at = jit.UInt(clip(top + down, 0.0, self.rows - 1.0)) * self.columns
                at += jit.UInt(clip(left + right, 0.0, self.columns - 1.0))
                beside = jit.Array3f(*(dr.gather(jit.Float, part, at) for part in self.place))
                weight = (1.0 - dr.abs(column - 0.5 - left - right)) * (1.0 - dr.abs(row - 0.5 - top - down))
                weight *= dr.gather(jit.Float, self.known, at)
                together = dr.abs(dr.dot(axis, beside - place)) < FOLD * self.voxel
                together &= dr.gather(jit.UInt, self.surfaces, at) == surface
                weight = dr.select(together, weight, 0.0)
                parts = zip((*self.facing, *self.colour, self.known), sums, strict=True)
                sums = [dr.fma(weight, dr.gather(jit.Float, part, at), sum_) for part, sum_ in parts]
        weight = sums.pop()
        scale = dr.rcp(dr.fmax(weight, 1e-6))  # 0 where nothing is known
        return weight, dr.normalize(jit.Array3f(*sums[:3]) + 1e-9), *(colour * scale for colour in sums[3:])


def _thinned(off: Any, depth: Any) -> Any:
    """Factor of the density `off` voxels inside an outline.

    A ray along the outline passes 1 − off of the way to the next, empty voxel and meets that share of the optical
    `depth` of the sheet: with ln 2 of it, half the light passes.
    """
    return dr.fmin(math.log(2.0) / (depth * dr.fmax(1.0 - off, 1e-6)), 1.0)


def _before(known: NDArray[np.bool_], places: Array, facing: Array, fold: float) -> NDArray[np.uint32]:
    """(h, w) bits in the order of BESIDE: the known pixel there is behind the plane of this one by more than `fold`."""
    rows, columns = known.shape
    framed, around = np.pad(places, ((1, 1), (1, 1), (0, 0))), np.pad(known, 1)
    bits = np.zeros(known.shape, np.uint32)
    for bit, (down, right) in enumerate(BESIDE):
        there = np.s_[1 + down : 1 + down + rows, 1 + right : 1 + right + columns]
        behind = np.sum(facing * (framed[there] - places), axis=2) < -fold
        bits |= (known & around[there] & behind).astype(np.uint32) << bit
    return bits


def _levels(near: Array, far: Array) -> list[tuple[Any, Any, int, int]]:
    """Least and greatest depth of blocks of 2ⁿ × 2ⁿ pixels, and how many rows and columns of them there are."""
    jit, levels = arrays(), []
    while True:
        rows, columns = near.shape
        least, greatest = (jit.Float(depth.astype(np.float32).ravel()) for depth in (near, far))
        levels.append((least, greatest, rows, columns))
        if max(near.shape) == 1:
            return levels
        even = ((0, rows % 2), (0, columns % 2))
        near, far = np.pad(near, even, constant_values=np.inf), np.pad(far, even, constant_values=-np.inf)
        shape = near.shape[0] // 2, 2, near.shape[1] // 2, 2
        near, far = near.reshape(shape).min(axis=(1, 3)), far.reshape(shape).max(axis=(1, 3))
