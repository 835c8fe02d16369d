"""Profile: heights of a surface along a straight line of its picture, with the band in which they are known.

Heights are over the chord, the straight line in space between the points at both ends; they are 0 there, and positive
towards the camera. Where the whole surface lies, and how it is tilted, does not enter: integration does not know it.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.inspection.height_errors import LinePlaces, height_variance
from hagoromo.measurement.inspection.seen_surface import SeenSurface, seen_surface
from hagoromo.measurement.measurement import Measurement

Array = NDArray[np.float64]
LEAST_LENGTH = 2.0  # px of a line
ZERO = 1e-9  # of a unit: what rounding makes of 0
NO_ERRORS = "the shape was given without errors: there is no band"
PARTS = "the line crosses a gap or a step: normals do not say how high one side stands over the other: no band"
MANY_LAMPS = "errors of light between parts of the object, and of shadows that were not seen, are not in the band"


@dataclass(frozen=True, eq=False, repr=False)
class HeightProfile:
    """Heights at n places along a line.

    line: its ends (x, y) [px], from the upper left corner of the picture. image: (n, 2) places [px]. distance: (n,)
    along the chord, and height: (n,) over it, in `unit` (mm, or px where the scale is unknown); NaN where unknown.
    own, shared: (n,) standard errors of the height by what pixels have of their own and by what all have in common; 0
    at the ends, NaN where unknown, None where the shape was given. remarks: what is doubted or left out, in words.
    """

    line: tuple[tuple[float, float], tuple[float, float]]
    image: Array
    distance: Array
    height: Array
    own: Array | None
    shared: Array | None
    unit: str
    remarks: tuple[str, ...] = ()

    @property
    def error(self) -> Array:
        """(n,) standard error of the height, NaN where unknown."""
        if self.own is None or self.shared is None:
            return np.full(len(self.height), np.nan)
        return np.hypot(self.own, self.shared)

    @property
    def band_95(self) -> tuple[Array, Array]:
        """Lower and upper end (n,) of the interval that holds the height of each place with 95 % probability."""
        return self.height - NORMAL_95 * self.error, self.height + NORMAL_95 * self.error

    @property
    def known(self) -> NDArray[np.bool_]:
        """(n,) whether the height is known."""
        return np.isfinite(self.height)

    def __repr__(self) -> str:
        return f"HeightProfile({self.sentence})"

    @property
    def sentence(self) -> str:
        """Its length, heights and band, in a line."""
        height, error, unit = self.height[self.known], self.error, self.unit
        low, high = (0.0 if abs(one) < ZERO else one for one in (height.min(), height.max()))
        said = f"{self.distance[-1]:.4g} {unit} long, heights {low:.3g} to {high:.3g} {unit} over the chord"
        if not np.isfinite(error).any():
            return f"{said}, without a band"
        return f"{said}, known to ± {NORMAL_95 * np.nanmax(error):.2g} {unit} or better (95 %)"

    def columns(self) -> dict[str, Array]:
        """What a table of it holds: name → (n,), NaN where unknown."""
        found = {"x_px": self.image[:, 0], "y_px": self.image[:, 1]}
        found |= {f"distance_{self.unit}": self.distance, f"height_{self.unit}": self.height}
        if self.own is None or self.shared is None:
            return found
        parts = (*self.band_95, self.error, self.own, self.shared)
        names = "low_95", "high_95", "standard_error", "own_error", "shared_error"
        return found | {f"{name}_{self.unit}": part for name, part in zip(names, parts, strict=True)}

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the CSV table `path` and, beside it, the plot NAME.png, whole or not at all."""
        from hagoromo.measurement.inspection.profile_files import write_profile

        return write_profile(self, Path(path), force)


Point = ArrayLike  # x and y [px]


def profile(measurement: Measurement | SeenSurface | str | Path, start: Point, end: Point) -> HeightProfile:
    """Heights of a measured surface along the line between two places of its picture, with their 95 % band.

    measurement: a Measurement, or the folder that `measure` wrote. start, end: (x, y) [px], from the upper left corner
    of the picture. There is about one height for each pixel of the line.

    The band holds what the measurement states: the errors of normals that each pixel has of its own, followed through
    the integration, and those that all pixels share. It is 0 at the ends, which are what heights are counted from. An
    error of the scale is not in it. `InputError` where the measurement has no depth, or the line is too short, leaves
    the picture, or has its ends beside the object.
    """
    surface = measurement if isinstance(measurement, SeenSurface) else seen_surface(_loaded(measurement))
    line = checked_line(surface, start, end)
    count = max(int(np.ceil(np.linalg.norm(line[1] - line[0]))) + 1, 3)
    image = line[0] + np.linspace(0.0, 1.0, count)[:, None] * (line[1] - line[0])
    points = points_at(surface, image)
    for name, point, place in zip(("first", "last"), points[[0, -1]], line, strict=True):
        if not np.isfinite(point).all():
            raise InputError(
                f"the {name} end of the line ({place[0]:g}, {place[1]:g} px) is beside the object, or unknown there: "
                "move it onto the surface"
            )
    along, up = chord_axes(surface, points)
    rise = points - points[0]
    distance, height = rise @ along, rise @ up
    unit, factor = surface.unit, surface.units_per_metre
    ends = (float(line[0, 0]), float(line[0, 1])), (float(line[1, 0]), float(line[1, 1]))
    if surface.own_variance is None:
        return HeightProfile(ends, image, distance * factor, height * factor, None, None, unit, (NO_ERRORS,))
    known = np.flatnonzero(np.isfinite(height))
    ray = points[known] - surface.camera.position
    away = np.linalg.norm(ray, axis=1)
    share = np.clip(distance[known] / distance[-1], 0.0, 1.0)
    variance = height_variance(surface, LinePlaces(image[known], share, ray @ up / away, away))
    own, shared = (np.full(count, np.nan) for _ in range(2))
    own[known], shared[known] = (factor * np.sqrt(one) for one in variance)
    part = _parts(surface, image)
    apart = (part != part[0]) | (part != part[-1])
    own[apart] = shared[apart] = np.nan
    remarks = (*((PARTS,) if apart[known].any() else ()), MANY_LAMPS)
    return HeightProfile(ends, image, distance * factor, height * factor, own, shared, unit, remarks)


def checked_line(surface: SeenSurface, start: Point, end: Point) -> Array:
    """(2, 2) the ends of a line; `InputError` unless it is one, and within the picture."""
    line = np.array([start, end], np.float64)
    height, width = surface.known.shape
    if line.shape != (2, 2) or not np.isfinite(line).all():
        raise InputError(f"a line from {start} to {end}: give two places, x and y of each in pixels")
    if not ((line >= 0.0) & (line <= (width, height))).all():
        said = ", ".join(f"({x:g}, {y:g})" for x, y in line)
        raise InputError(f"the line {said} leaves the picture, which is {width} × {height} px: give ends within it")
    if np.linalg.norm(line[1] - line[0]) < LEAST_LENGTH:
        raise InputError(f"the line is {np.linalg.norm(line[1] - line[0]):.2g} px long: give two ends that are apart")
    return line


def points_at(surface: SeenSurface, image: Array) -> Array:
    """(n, 3) points between pixels [m], NaN next to unknown ones: on the ray of the place, by ln distance."""
    from scipy.ndimage import map_coordinates

    size = np.array(surface.known.shape)[:, None] - 1.0
    place = np.clip(np.stack([image[:, 1], image[:, 0]]) - 0.5, 0.0, size)
    known = np.asarray(map_coordinates(surface.known.astype(np.float64), place, order=1)) > 1.0 - 1e-6
    away = np.log(np.where(surface.known, surface.away, 1.0))
    distance = np.exp(np.asarray(map_coordinates(away, place, order=1)))
    ray = surface.camera.unproject(image)
    return np.where(known[:, None], surface.camera.position + ray * distance[:, None], np.nan)


def chord_axes(surface: SeenSurface, points: Array) -> tuple[Array, Array]:
    """Unit vectors along the chord from the first to the last of `points` (n, 3), and across it towards the camera."""
    along = (points[-1] - points[0]) / np.linalg.norm(points[-1] - points[0])
    to_eye = surface.camera.position - 0.5 * (points[0] + points[-1])
    up = to_eye - (to_eye @ along) * along
    return along, up / np.linalg.norm(up)


def _parts(surface: SeenSurface, image: Array) -> NDArray[np.intp]:
    """(n,) number of the part of the surface that each place is on."""
    height, width = surface.known.shape
    columns, rows = (np.clip(np.floor(image[:, k]).astype(int), 0, n - 1) for k, n in ((0, width), (1, height)))
    return surface.parts[rows, columns]


def _loaded(measurement: Measurement | str | Path) -> Measurement:
    return measurement if isinstance(measurement, Measurement) else Measurement.load(measurement)
