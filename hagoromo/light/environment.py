"""Environment: light from all around, infinitely far away, as a map of the sphere with a radiance in each pixel.

A map is equirectangular: its rows go from straight up to straight down, its columns around. Its colours are linear
sRGB. They become spectra by the basis of Mallett & Yuksel 2019: three spectra, which add up to 1 and give back the
colours exactly under D65. What is grey in a pixel, and what is left of each colour, are kept apart: so all weights are
positive, and the first part is white.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.exr import read_exr
from hagoromo.files.hdr import STARTS, read_hdr
from hagoromo.files.memory import require
from hagoromo.light.environment_light import EnvironmentLight
from hagoromo.light.lamp import Lamp
from hagoromo.light.light_points import FEWEST_ROWS, LightPoints, cut_light
from hagoromo.light.other_programs import MitsubaPlugin, UsdLight
from hagoromo.light.spectrum import Spectrum, checked_spectrum

LARGEST_RADIANCE = 1e15
SAME_COLOUR = 1e-6  # of the brightest channel, within which all pixels have one colour
LEAST_ROWS = 256  # of a map for Mitsuba, whose pixels stand as 2 × 2 or more, as it interpolates
FROM_MITSUBA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # axes of our map from those of `envmap`
PARTS = ("white", "red", "green", "blue")
BYTES_PER_PIXEL = 96.0  # of the tables by which a map is sampled


class EnvironmentPart(NamedTuple):
    """Light of one spectrum of an environment: its name, and the radiance of each pixel (height, width)."""

    name: str
    spectrum: Spectrum
    radiance: NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Environment:
    """Light from all around: `values`, the radiance of each pixel of a map, (height, 2 · height) or with R, G, B.

    A pixel is a patch of the sphere of constant radiance, `scale` · value · `spectrum` [W/(m² sr) times the unit of the
    spectrum]; the colours R, G, B are linear sRGB and multiply the spectrum by the basis of Mallett & Yuksel 2019.
    With no rotation the middle of the map lies towards +x, its top is +z, and columns go round clockwise seen from
    above, as in Blender. rotation: (3, 3) from there into the world. visible: whether the camera sees it behind all
    matter. `InputError` for a map that is not twice as wide as high, and for light that is negative, not
    finite or none.

    >>> sky = hg.Environment(np.ones((4, 8)), scale=2.0)
    >>> float(sky.radiance_from([0.0, 0.6, 0.8])[0])
    2.0
    """

    values: NDArray[np.float32]
    scale: float
    spectrum: Spectrum
    rotation: NDArray[np.float64]
    visible: bool
    name: str
    what = "environment"
    surface = None

    def __init__(
        self,
        values: ArrayLike,
        scale: float = 1.0,
        spectrum: Spectrum | None = None,
        rotation: ArrayLike | None = None,
        visible: bool = False,
        name: str = "environment",
    ) -> None:
        keep = object.__setattr__
        keep(self, "name", name or "environment")
        keep(self, "values", checked_map(values, self.name))
        if not (np.isfinite(scale) and scale > 0.0):
            raise InputError(f"{self.name}: scale is {scale!r:.60}: give a finite number above 0")
        if not float(self.values.max()) * scale <= LARGEST_RADIANCE:
            raise InputError(f"{self.name} has radiance beyond {LARGEST_RADIANCE:g}: make scale smaller")
        turn = np.eye(3) if rotation is None else np.array(rotation, np.float64)
        if turn.shape != (3, 3) or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise InputError(f"{self.name}: rotation is not a (3, 3) matrix that turns: give one, or leave it out")
        keep(self, "scale", float(scale))
        keep(
            self,
            "spectrum",
            Spectrum.constant(1.0)
            if spectrum is None
            else checked_spectrum(spectrum, f"environment {name!r}: spectrum"),
        )
        keep(self, "rotation", turn)
        keep(self, "visible", bool(visible))

    @classmethod
    def from_file(
        cls,
        path: str | Path,
        scale: float = 1.0,
        spectrum: Spectrum | None = None,
        rotation: ArrayLike | None = None,
        visible: bool = False,
        name: str = "",
    ) -> Environment:
        """The environment in an EXR (channels R, G, B, or Y) or a Radiance picture (.hdr).

        `InputError` for another file, a damaged one, or one that is no map of light.
        """
        name = name or Path(path).stem
        try:
            return cls(read_map(path), scale, spectrum, rotation, visible, name)
        except InputError as error:
            raise InputError(str(error) if str(path) in str(error) else f"{path}: {error}") from error

    def __repr__(self) -> str:
        """The name, and the size of the map."""
        height, width = self.values.shape[:2]
        return f"Environment({self.name!r}, {width} × {height} px, scale {self.scale:g})"

    @property
    def parts(self) -> tuple[EnvironmentPart, ...]:
        """The map as a sum of maps of one spectrum each; one of them where all pixels have one colour."""
        return self._parts

    @cached_property
    def _parts(self) -> tuple[EnvironmentPart, ...]:
        if self.values.ndim == 2:
            return (EnvironmentPart(self.name, self.spectrum, np.float32(self.scale) * self.values),)
        brightest = self.values.max(axis=2)
        colour = self.values[np.unravel_index(brightest.argmax(), brightest.shape)] / brightest.max()
        if np.abs(self.values - brightest[..., None] * colour).max() <= SAME_COLOUR * brightest.max():
            tint = upsampled(colour) * self.spectrum if np.ptp(colour) > 0.0 else self.spectrum
            return (EnvironmentPart(self.name, tint, np.float32(self.scale) * brightest),)
        white = self.values.min(axis=2)
        maps = [white, *np.moveaxis(self.values - white[..., None], 2, 0)]
        spectra = [self.spectrum, *(upsampled(row) * self.spectrum for row in np.eye(3))]
        scaled = [np.ascontiguousarray(np.float32(self.scale) * values) for values in maps]
        every = zip(PARTS, spectra, scaled, strict=True)
        # white stays, also where no pixel has any: pictures count from the spectrum of the first lamp
        return tuple(
            EnvironmentPart(f"{self.name} {part}", s, v) for part, s, v in every if v.any() or part == PARTS[0]
        )

    @property
    def solid_angles(self) -> NDArray[np.float64]:
        """Solid angle of a pixel of each row [sr]: (height,)."""
        height, width = self.values.shape[:2]
        polar = math.pi * np.arange(height + 1) / height
        return np.maximum(-np.diff(np.cos(polar)), 1e-300) * 2.0 * math.pi / width

    def directions(self, rows: ArrayLike, columns: ArrayLike) -> NDArray[np.float64]:
        """Unit directions (…, 3), world, towards places of the map: 0…height from the top, 0…width from the left."""
        height, width = self.values.shape[:2]
        polar = math.pi * np.asarray(rows, np.float64) / height
        azimuth = math.pi - 2.0 * math.pi * np.asarray(columns, np.float64) / width
        local = [np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)]
        return np.stack(np.broadcast_arrays(*local), axis=-1) @ self.rotation.T

    def pixels(self, directions: ArrayLike) -> tuple[NDArray[np.intp], NDArray[np.intp]]:
        """Row and column (…) of the pixel in the unit `directions` (…, 3), world."""
        height, width = self.values.shape[:2]
        x, y, z = np.moveaxis(np.asarray(directions, np.float64) @ self.rotation, -1, 0)
        row = np.arctan2(np.hypot(x, y), z) * height / math.pi
        column = (math.pi - np.arctan2(y, x)) * width / (2.0 * math.pi)
        return np.clip(row.astype(int), 0, height - 1), np.clip(column.astype(int), 0, width - 1)

    def radiance_from(self, directions: ArrayLike) -> NDArray[np.float64]:
        """Radiance of each of the `parts` from unit `directions` (…, 3), world: (…, parts)."""
        row, column = self.pixels(directions)
        return np.stack([part.radiance[row, column] for part in self.parts], axis=-1).astype(np.float64)

    @property
    def stands_at(self) -> NDArray[np.float64]:
        """(0, 3): it is far."""
        return np.empty((0, 3))

    def corners(self) -> NDArray[np.float64]:
        """(0, 3): it is far."""
        return np.empty((0, 3))

    def points(self, low: NDArray[np.float64], high: NDArray[np.float64], tolerance: float) -> LightPoints:
        """Far lamps in its place, those of its parts together at each; see `WideLight`. They do not depend on where
        the matter is.
        """
        cut = self._with_cut_pixels()
        height, width = cut.values.shape[:2]
        light = np.stack([part.radiance for part in cut.parts], axis=-1) * cut.solid_angles[:, None, None]
        rows, columns = np.meshgrid(np.arange(height) + 0.5, np.arange(width) + 0.5, indexing="ij")
        ways, irradiances, error = cut_light(cut.directions(rows, columns), light, tolerance)
        lamps = [
            Lamp(to_lamp=way, intensity=float(irradiance), spectrum=part.spectrum, name=part.name)
            for way, each in zip(ways, irradiances, strict=True)
            for part, irradiance in zip(self.parts, each, strict=True)
        ]
        return LightPoints(lamps, len(ways), error)

    def _with_cut_pixels(self) -> Environment:
        """The same light as a map of FEWEST_ROWS or more, by cutting each pixel in equal parts."""
        parts = -(-FEWEST_ROWS // self.values.shape[0])
        if parts == 1:
            return self
        return replace(self, values=self.values.repeat(parts, axis=0).repeat(parts, axis=1))

    def on_device(self) -> EnvironmentLight:
        """Its light in kernels."""
        return EnvironmentLight([part.radiance for part in self.parts], self.solid_angles, self.rotation, self.visible)

    def seen_on_device(self) -> EnvironmentLight:
        """See `WideLight`."""
        return self.on_device()

    def mitsuba(self) -> tuple[MitsubaPlugin, list[str]]:
        """The map, of one colour or of R, G, B as they are."""
        values = self.values[..., None] if self.values.ndim == 2 else self.values
        times = max(2, math.ceil(LEAST_ROWS / values.shape[0]))
        values = np.repeat(np.repeat(values, times, axis=0), times, axis=1)
        tint = self.spectrum
        scale = self.scale * (float(tint.values[0]) if np.ptp(tint.values) == 0.0 else tint.mean())
        channels = {c: np.ascontiguousarray(values[..., k if values.shape[2] == 3 else 0]) for k, c in enumerate("RGB")}
        pose = np.eye(4)
        pose[:3, :3] = self.rotation @ FROM_MITSUBA
        stated = {"filename": "environment.exr", "scale": scale, "to_world": pose}
        return MitsubaPlugin("emitter", "envmap", stated, maps={"environment.exr": channels}), [
            "the edges between pixels of the environment: Mitsuba interpolates; each pixel stands as 2 × 2 or more",
            "the spectrum of the environment: in spectral variants Mitsuba takes white for D65",
        ]

    def gltf(self) -> tuple[None, list[str]]:
        """None: glTF has lights of a place or a direction."""
        return None, ["the environment"]

    def usd(self) -> tuple[UsdLight, list[str]]:
        """The mean over the sphere, from all around: rows of the map are as wide as the sine says."""
        rows = np.reshape(self.values.mean(axis=1), (len(self.values), -1))
        weights = np.sin(np.pi * (np.arange(len(rows)) + 0.5) / len(rows))
        mean = weights @ rows / weights.sum() * np.ones(3)
        lost = ["the map of the environment, of which the mean shines from all around"]
        light = UsdLight("DomeLight", np.eye(4), self.spectrum, self.scale * mean, {})
        return light, lost if np.ptp(self.values) > 0.0 else []

    def record(self) -> dict[str, object]:
        """What metadata say of it: not the map itself."""
        height, width = self.values.shape[:2]
        return {
            "name": self.name, "size": [width, height], "scale": self.scale, "spectrum": self.spectrum.record(),
            "rotation": self.rotation.tolist(), "visible": self.visible,
        }  # fmt: skip


def upsampled(rgb: ArrayLike) -> Spectrum:
    """Spectrum of linear sRGB (3,) by the basis of Mallett & Yuksel 2019, held beyond 380–780 nm.

    Under D65 it has exactly that colour; (1, 1, 1) is 1 at every wavelength.
    """
    import colour

    basis = colour.recovery.MSDS_BASIS_FUNCTIONS_sRGB_MALLETT2019
    values = basis.values / basis.values.sum(axis=1, keepdims=True)  # as printed they add up to 1 to five digits
    return Spectrum(basis.wavelengths, values @ np.asarray(rgb, np.float64)).held(360.0, 830.0)


def read_map(path: str | Path) -> NDArray[np.float32]:
    """(height, width[, 3]) of a file."""
    with existing_file(path).open("rb") as file:
        start = file.read(max(map(len, STARTS)))
    if start.startswith(STARTS):
        return read_hdr(path)
    channels, _ = read_exr(path)
    if all(name in channels for name in "RGB"):
        return np.stack([channels[name] for name in "RGB"], axis=-1)
    if "Y" in channels:
        return channels["Y"]
    raise InputError(f"{path} has the channels {', '.join(channels)[:80]}: an environment has R, G and B, or Y")


def checked_map(values: ArrayLike, name: str) -> NDArray[np.float32]:
    """The map of an environment, read-only; name: in messages. `InputError` as of `Environment`."""
    try:
        given = np.asarray(values)
        shape = given.shape
    except (TypeError, ValueError) as error:
        raise InputError(f"{name}: the map must hold numbers") from error
    if len(shape) not in (2, 3) or shape[1] != 2 * shape[0] or shape[0] < 1 or shape[2:] not in ((), (3,)):
        size = " × ".join(str(side) for side in (*shape[1::-1], *shape[2:]))
        raise InputError(f"{name} is {size}: give a map twice as wide as high, of one number or R, G, B a pixel")
    require(BYTES_PER_PIXEL * shape[0] * shape[1], f"{name}, a map of {shape[1]} × {shape[0]} pixels,")
    with np.errstate(over="ignore"):
        try:
            light = np.array(given, np.float32)
        except (TypeError, ValueError) as error:
            raise InputError(f"{name}: the map must hold numbers") from error
    for wrong, what in ((~np.isfinite(light), "that is not finite"), (light < 0.0, "below 0")):
        if wrong.any():
            row, column = np.argwhere(wrong)[0][:2]
            raise InputError(
                f"{name} has light {what} in {int(wrong.sum())} values, first in row {row}, column {column}: correct it"
            )
    if not light.any():
        raise InputError(f"{name} has no light in any pixel: give a map that has some, or leave it out")
    light.flags.writeable = False
    return light
