"""Closely: what a page needs to show curvature, occlusion and stretched colours, and profiles with their band.

Errors of distances are fields on a coarse grid, whose squares add up: simulated ones of what each pixel has of its own,
and those that all pixels share. A page makes the band of any line of them, beside what is narrower than the grid and
what the width of the pixels leaves, which is a map of all pixels.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.measurement.inspection.curvature import curvature
from hagoromo.measurement.inspection.footprint import unevenness
from hagoromo.measurement.inspection.height_errors import MOST_PIXELS, distance_errors, short_error
from hagoromo.measurement.inspection.occlusion import coarse_occlusion
from hagoromo.measurement.inspection.seen_surface import SeenSurface, seen_surface
from hagoromo.measurement.inspection.stretch import SHOWN_DEVIATIONS, Stretch, decorrelation_stretch
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.photographed import Photographed
from hagoromo_page.publication.planes import PackedPlanes, pack_planes

OCCLUSION_PIXELS, OCCLUSION_DIRECTIONS = 300_000, 16  # of the map of occlusion: seconds
GRID = 40  # cells along the longer side, of errors of distances
DRAWS = 24  # simulated errors: the band is known to 14 %
TOP = 4095  # of their whole numbers
BENT_STOPS = ((0.02, 0.19, 0.38), (0.97, 0.97, 0.97), (0.40, 0.0, 0.12))  # ends and middle of RdBu
OPEN_STOPS = ((0.0, 0.0, 0.0), (0.5, 0.5, 0.5), (1.0, 1.0, 1.0))
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class CloseLook:
    """curvature: (h, w) [1/unit] and occlusion: (h, w), NaN where unknown, at the pixels of the photographs. stretch:
    of the body colours. errors: fields of the distance [m], (n, rows, columns), and short: (rows, columns) standard
    error [m] of what is narrower than a cell; None without errors. step: pixels along each side of a cell. points:
    (h, w, 3) [m] of the surface, 0 where unknown. width: (h, w) standard error of the distance [m] by the width of the
    pixels, see `footprint`; None without errors.
    """

    points: Array
    curvature: Array
    occlusion: Array
    unit: str
    stretch: Stretch | None
    errors: Array | None
    short: Array | None
    step: int
    width: Array | None = None

    def record(self, x: float, y: float) -> dict[str, Any]:
        """What the page's script reads. x, y: place of the picture's first pixel in the photograph [px]."""
        found: dict[str, Any] = {"unit": self.unit}
        if self.stretch is not None:
            three = self.stretch.shown_channels
            gain = 0.5 / SHOWN_DEVIATIONS
            columns = gain * self.stretch.matrix[three]
            found["stretch"] = {"columns": columns.T.tolist(), "offset": (0.5 - columns @ self.stretch.mean).tolist()}
        packed = self.packed
        if packed is not None:
            found["errors"] = {"x": x, "y": y, "step": self.step, "top": TOP, "header": packed.header,
                               "range": self._reach, "short": self._short_reach}  # fmt: skip
        return found

    @property
    def packed(self) -> PackedPlanes | None:
        """Planes e0, e1, … and short of the errors."""
        if self.errors is None or self.short is None:
            return None
        planes = {
            f"e{k}": np.rint((0.5 + 0.5 * one / self._reach) * TOP).astype(np.uint16)
            for k, one in enumerate(self.errors)
        }
        planes["short"] = np.rint(self.short / self._short_reach * TOP).astype(np.uint16)
        return pack_planes(planes, np.ones(self.short.shape, bool))

    @property
    def _reach(self) -> float:
        assert self.errors is not None
        return max(float(np.abs(self.errors).max()), 1e-12)

    @property
    def _short_reach(self) -> float:
        assert self.short is not None
        return max(float(self.short.max()), 1e-12)


def close_look(measurement: Measurement, taken: Photographed) -> CloseLook | None:
    """Of a measurement with depth; None without."""
    fine = measurement.fine
    if (measurement if fine is None else fine).points is None:
        return None
    surface = seen_surface(measurement, taken)
    stretch = None
    if surface.body is not None:
        try:
            stretch = decorrelation_stretch(surface.body, surface.known)
        except InputError:
            stretch = None  # of one channel, or of one colour
    step = -(-max(surface.known.shape) // GRID)
    errors, short = (None, None) if surface.own_variance is None else _errors(surface, step)
    width = None
    if surface.own_variance is not None:
        width = surface.away * unevenness(surface.normals, surface.camera, surface.known, surface.own_variance).left
    open_share = coarse_occlusion(surface, OCCLUSION_PIXELS, OCCLUSION_DIRECTIONS)
    bent = curvature(surface).value
    return CloseLook(surface.points, bent, open_share, surface.unit, stretch, errors, short, step, width)


def _errors(surface: SeenSurface, step: int) -> tuple[Array | None, Array | None]:
    """Fields and short errors on cells of `step` pixels."""
    inner = max(int(np.ceil(np.sqrt(surface.known.sum() / MOST_PIXELS))), 1)
    inner = next(n for n in range(inner, step + 1) if step % n == 0)  # squares that cells are made of
    coarse = surface.averaged(inner)
    if not coarse.known.any():
        return None, None
    fields = distance_errors(coarse, DRAWS)
    short = short_error(coarse, step)
    cells = [_cells(one, coarse.known, step // inner) for one in (*fields, short)]
    return np.stack(cells[:-1]), cells[-1]


def _cells(values: Array, known: NDArray[np.bool_], count: int) -> Array:
    """Means over the known of squares of `count` pixels; of the nearest such square where none is known."""
    height, width = (-(-size // count) * count for size in known.shape)
    pad = [(0, height - known.shape[0]), (0, width - known.shape[1])]
    parts = [np.pad(one, pad).reshape(height // count, count, width // count, count).sum(axis=(1, 3))
             for one in (np.where(known, values, 0.0), known.astype(np.float64))]  # fmt: skip
    empty = parts[1] == 0.0
    mean = parts[0] / np.where(empty, 1.0, parts[1])
    return mean[nearest_known(~empty)]
