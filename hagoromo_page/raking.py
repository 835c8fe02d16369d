"""Raking light: a film, or frames, of a measured object under a lamp that goes round it just above its surface.

Each pixel is lit by its measured reflectance, with cast shadows from the measured surface. What other parts of the
object send to it is left out. All frames have one exposure.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.film_file import check_film_name, write_film
from hagoromo.files.png import write_png
from hagoromo.files.whole import replaceable_file, replaceable_folder, whole_file, whole_folder
from hagoromo.image.film.film import chosen, frame_name, sheet
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.surface.horizon import height_over_horizon
from hagoromo.progress import Progress, silent
from hagoromo_page.publication.lit import reflected, shown
from hagoromo_page.publication.publish import page_source
from hagoromo_page.publication.surface_maps import FLIP, SurfaceMaps

ELEVATION, FRAMES, RATE = 15.0, 72, 12.0  # °, a frame every 5°, and frames a second
LOWEST, HIGHEST = 1.0, 89.0  # ° of elevation
MOST_FRAMES = 3600
LONGEST_SIDE = 1080  # px of a frame
LAMP_RADIUS = math.radians(0.7)  # of its disc, which makes edges of shadows as soft as on a page
WHITE_KEY, WHITE_PERCENTILE = 0.8, 99.0  # display value of the brightest hundredth of the lit pixels
METERED_FRAMES = 8
SPIKES_PX = 5  # px: spikes of the measured depth that are narrower throw no shadow
SHEET, SHEET_FRAMES = "sheet.png", 12
Array = NDArray[np.float64]


@dataclass(frozen=True)
class RakingFilm:
    """path: of the film, or of the folder of frames. count: of frames. width, height: of a frame [px]. elevation: [°],
    of the lamp.
    """

    path: Path
    count: int
    width: int
    height: int
    elevation: float

    def __str__(self) -> str:
        """One line."""
        return f"{self.count} frames of {self.width} × {self.height} px, the lamp {self.elevation:g}° above the surface"


def raking(
    measured: Measurement | str | Path,
    out: str | Path,
    *,
    elevation: float = ELEVATION,
    frames: int = FRAMES,
    rate: float = RATE,
    longest: int = LONGEST_SIDE,
    force: bool = False,
    progress: Progress = silent,
) -> RakingFilm:
    """A measured object under a far lamp that turns once round it, clockwise from the top of the picture.

    measured: a Measurement, or the folder that `measure` wrote. out: NAME.mp4, .webm or .gif, or a folder of frames as
    PNG with a sheet of them. elevation: of the lamp over the mean plane of the surface [°]. rate: frames a second.
    longest: side of a frame [px], at most. `InputError` for an elevation outside 1 … 89°, and a measurement without
    depth.
    """
    target = Path(out)
    if not LOWEST <= elevation <= HIGHEST:
        raise InputError(f"a lamp {elevation:g}° above the surface: give {LOWEST:g} to {HIGHEST:g}° (--elevation)")
    if not 1 <= frames <= MOST_FRAMES or not 1.0 <= rate <= 240.0 or longest < 16:
        raise InputError(
            f"{frames} frames, {rate:g} a second, {longest} px: give 1 to {MOST_FRAMES}, 1 to 240 and 16 px or more"
        )
    if target.suffix:
        check_film_name(target)
        replaceable_file(target, force)
    else:
        replaceable_folder(target, force)
    measurement = measured if isinstance(measured, Measurement) else Measurement.load(measured)
    maps = page_source(measurement, None).maps
    if maps.depth is None:
        raise InputError("the measurement has no depth, which casts the shadows: measure the photographs again")
    factor = max(maps.labels.shape) / longest
    maps = maps.reduced(factor) if factor > 1.0 else maps
    light = RakingLight(maps, elevation)
    white = max(light.level(number / METERED_FRAMES) for number in range(METERED_FRAMES))

    def pictures() -> Iterator[NDArray[np.uint8]]:
        for number in range(frames):
            progress(number / frames, f"frame {number + 1} of {frames}")
            yield light.picture(number / frames, white)

    if target.suffix:
        with whole_file(target, force) as partial:
            write_film(partial, target.suffix.lower(), pictures(), rate)
    else:
        with whole_folder(target, force) as home:
            some, of_sheet = set(chosen(frames, SHEET_FRAMES)), []
            for number, picture in enumerate(pictures()):
                write_png(home / frame_name(number), picture)
                of_sheet += [picture] if number in some else []
            write_png(home / SHEET, sheet(of_sheet))
    progress(1.0, "")
    height, width = maps.labels.shape
    return RakingFilm(target, frames, width, height, elevation)


class RakingLight:
    """Pictures of `maps`, with depth, under a lamp at `elevation` [°] above the mean plane of its normals."""

    def __init__(self, maps: SurfaceMaps, elevation: float) -> None:
        self.maps = maps
        up = maps.normals[maps.known].mean(axis=0)
        self.up = up / np.linalg.norm(up)
        top = np.array([0.0, 1.0, 0.0]) - self.up[1] * self.up
        self.top = top / np.linalg.norm(top)
        self.right = np.cross(self.top, self.up)
        self.elevation = math.radians(elevation)
        self.points = _points(maps)

    def to_lamp(self, turn: float) -> Array:
        """(3,) unit direction, page's axes; turn: share of a whole one, clockwise from the top."""
        across = math.cos(2.0 * math.pi * turn) * self.top + math.sin(2.0 * math.pi * turn) * self.right
        return math.cos(self.elevation) * across + math.sin(self.elevation) * self.up

    def lit(self, turn: float) -> Array:
        """(h, w, 3) linear values, with cast shadows."""
        to_lamp = self.to_lamp(turn)
        return reflected(self.maps, to_lamp) * self.arriving(to_lamp)[..., None]

    def arriving(self, to_lamp: Array) -> Array:
        """(h, w) share of the lamp's light that nothing stands in the way of."""
        maps, (rows, columns) = self.maps, np.nonzero(self.maps.known)
        pixels = rows, columns
        world = maps.camera.camera_to_world[:3, :3] @ (FLIP @ to_lamp)
        height = height_over_horizon(self.points, maps.camera, pixels, np.broadcast_to(world, (len(rows), 3)))
        share = np.zeros(maps.known.shape)
        share[pixels] = np.clip(0.5 + 0.5 * height / LAMP_RADIUS, 0.0, 1.0)
        return share

    def level(self, turn: float) -> float:
        """Linear value of the brightest hundredth of the pixels over WHITE_KEY."""
        values = self.lit(turn)[self.maps.known].max(axis=1)
        return max(float(np.percentile(values, WHITE_PERCENTILE)), 1e-9) / WHITE_KEY

    def picture(self, turn: float, white: float) -> NDArray[np.uint8]:
        """(h, w, 3) display values; `white` is shown as white."""
        return np.rint(255.0 * shown(self.lit(turn), white)).astype(np.uint8)


def _points(maps: SurfaceMaps) -> Array:
    """(h, w, 3) points of the surface without spikes [m], world axes, 0 where unknown."""
    from scipy.ndimage import median_filter

    assert maps.depth is not None
    depth = median_filter(maps.depth[nearest_known(maps.known)], size=SPIKES_PX, mode="nearest")
    ray = maps.camera.pixel_directions()
    along = depth / (ray @ maps.camera.camera_to_world[:3, 2])
    points = maps.camera.position + ray * along[..., None]
    return np.where(maps.known[..., None], points, 0.0)
