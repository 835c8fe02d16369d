"""Pictures of all orders of light: walks through every pixel, their mean and its variance.

Enters: a scene. Leaves: an `Image` whose palette has bands for light that was scattered more than once.
"""

from __future__ import annotations

import math
import time
from dataclasses import dataclass, replace

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.camera.response import Response, response_matrix
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.image.image import Image
from hagoromo.image.lamp_batches import WeightsOfLamps, lamp_batches
from hagoromo.image.render import PreparedScene, SceneCache, metadata
from hagoromo.image.scene import Scene
from hagoromo.image.settings import Settings
from hagoromo.light.spectrum import Spectrum
from hagoromo.progress import Progress, part_of, silent
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.lighting import Palette, distinct
from hagoromo.transport.path.bands import Bands, bands_of
from hagoromo.transport.path.free_flight import Matter
from hagoromo.transport.path.path import Walks, light_of_walks, random_numbers
from hagoromo.transport.path.scatter import Scattering
from hagoromo.volume.box import VolumeBox

WALKS_AT_ONCE = 1 << 18  # of one launch; progress is reported, and an interrupt taken, between launches
ALL_ORDERS = 2**32 - 1
FIRST_WALKS = 16  # a pixel, from which the error is estimated first
MOST_WALKS = 1 << 20  # a pixel
LARGEST_ALBEDO = 1.002  # of voxels, whose colours are halves
BRICKS_READ = 1 << 12  # at once


def path_picture(scene: Scene, settings: Settings, progress: Progress = silent) -> Image:
    """The image of a scene by `settings.samples` walks through each pixel; see `render`.

    `InputError` for a box whose matter would send on more light than it takes.
    """
    for box in scene.boxes:
        check_matter(box)
    batches, cache, parts = lamp_batches(scene.lamps), SceneCache(), []
    reflectances = [m for box in scene.boxes for m in box.materials] + [s.reflectance for s in scene.surfaces]
    basis = [spectrum for box in scene.boxes for spectrum in box.basis]
    bands = bands_of(albedos(reflectances, basis), distinct([lamp.spectrum for lamp in scene.lamps]))
    scattered = _Scattered(reflectances, bands, scene.lamps[0].spectrum)
    for number, batch in enumerate(batches):
        lit = scene.with_lamps(*(scene.lamps[lamp] for lamp in batch))
        part = part_of(progress, number / len(batches), 1.0 / len(batches))
        parts.append(_under_one_batch(lit, settings, cache, scattered, (number, 1.0 / len(batches)), part))
    if len(parts) == 1:
        return parts[0]
    palette = parts[0].palette.with_lamps(scene.lamps, settings.separate_lamps)
    total = WeightsOfLamps(palette, parts[0].alpha.shape)
    for batch, part in zip(batches, parts, strict=True):
        total.add(batch, part.palette, part.weights)
    record = metadata(scene, settings) | {key: parts[0].metadata[key] for key in ("mode", "bands_error")}
    variances = [part.variance for part in parts if part.variance is not None]
    variance = np.asarray(np.sum(variances, axis=0), np.float32) if len(variances) == len(parts) else None
    return Image(total.values, parts[0].alpha, palette, record, variance)


@dataclass(frozen=True)
class _Scattered:
    """What all batches of lamps have in common: reflectances, bands, and the lamp that Y is counted from."""

    reflectances: list[Reflectance]
    bands: Bands
    white: Spectrum


def check_matter(box: VolumeBox) -> None:
    """`InputError` for a box whose light of all orders is not computed."""
    elements = sorted({material.element for material in box.materials} - {"sphere"})
    if box.extinction == "isotropic" and elements:
        raise InputError(
            f"volume box {box.name!r} has isotropic extinction, by which a {elements[0]} that is lit again sends back "
            'more light than it takes: set extinction = "projected"'
        )
    if box.basis and (albedo := largest_albedo(box)) > LARGEST_ALBEDO:
        raise InputError(
            f"volume box {box.name!r}: its voxels send back up to {albedo:.3g} of the light at some wavelength: lower "
            "their body colours, or alpha"
        )


def largest_albedo(box: VolumeBox) -> float:
    """Largest albedo of the body colours of a box's voxels, with the largest α of its materials and their interface."""
    wavelengths = np.linspace(400.0, 700.0, 31)
    basis = np.array([spectrum.at(wavelengths) for spectrum in box.basis])
    brightest = 0.0
    for begin in range(0, box.bricks.kept, BRICKS_READ):
        held = box.bricks.read(begin, min(begin + BRICKS_READ, box.bricks.kept))
        colours = held["colour"][held["density"] > 0.0][:, : len(basis)].astype(np.float32)
        brightest = max(brightest, float((colours @ basis).max(initial=0.0)))
    sent = [(math.pi * m.alpha * brightest, m.interface_albedo) for m in box.materials]
    return max(body + interface for body, interface in sent)


def _under_one_batch(
    scene: Scene,
    settings: Settings,
    cache: SceneCache,
    scattered: _Scattered,
    batch: tuple[int, float],
    progress: Progress,
) -> Image:
    """batch: its number, and its share of the time that the picture may take."""
    bands, (number, share) = scattered.bands, batch
    prepared = PreparedScene(scene, replace(settings, shadows="none"), cache)
    palette = replace(prepared.palette, bands=bands.spectra)
    scattering = Scattering(scattered.reflectances, prepared.lighting.materials)
    matter = Matter(prepared.medium) if prepared.medium is not None else None
    walks = Walks(matter, prepared.surfaces, prepared.first_on_surface, prepared.lighting, scattering, bands)
    sums = Sums(scene.camera.height, scene.camera.width, palette, scattered.white)
    stream = _Stream(prepared, walks, settings, number)
    stop, walks_so_far = Stop(settings, share), 0
    while (wanted := stop.wanted(sums, walks_so_far)) > walks_so_far:
        for begin, end, sample, count in _launches(sums.pixels, walks_so_far, wanted):
            sums.add(begin, end, stream.walk(begin, end, sample, count))
            progress(stop.progress(sample + count * end / sums.pixels))
        walks_so_far = wanted
    record = metadata(scene, settings) | {"mode": "path", "bands_error": bands.error, "walks": walks_so_far}
    return Image(*sums.mean(walks_so_far), palette, record, sums.variance(walks_so_far))


def albedos(reflectances: list[Reflectance], basis: list[Spectrum]) -> list[Spectrum]:
    """What bodies and interfaces send on of the light of each wavelength, about; basis: of the colours of voxels."""
    most = max(r.alpha for r in reflectances)
    scaled = [(math.pi * r.alpha, r.body_colour) for r in reflectances] + [(math.pi * most, s) for s in basis]
    scaled += [(r.interface_albedo, r.interface_colour) for r in reflectances]
    return [Spectrum(s.wavelengths, factor * s.values) for factor, s in scaled]


def _launches(pixels: int, first: int, samples: int) -> list[tuple[int, int, int, int]]:
    """Pixels begin … end − 1, first sample and number of samples of each launch of WALKS_AT_ONCE walks at most, of the
    samples `first` … `samples` − 1.
    """
    together = min(max(WALKS_AT_ONCE // pixels, 1), samples - first)
    return [
        (begin, min(begin + WALKS_AT_ONCE, pixels), sample, min(together, samples - sample))
        for sample in range(first, samples, together)
        for begin in range(0, pixels, WALKS_AT_ONCE)
    ]


@dataclass
class _Stream:
    """Walks through pixels of the camera's picture."""

    prepared: PreparedScene
    walks: Walks
    settings: Settings
    batch: int  # of lamps: each has random numbers of its own

    def walk(self, begin: int, end: int, sample: int, count: int) -> NDArray[np.float32]:
        """`count` walks from number `sample` on through the pixels begin … end − 1: (pixels, count, channels + 1)."""
        jit, camera = arrays(), self.prepared.camera
        lane = dr.arange(jit.UInt, (end - begin) * count)
        each, width = dr.opaque(jit.UInt, count), dr.opaque(jit.UInt, camera.width)
        pixel = lane // each + dr.opaque(jit.UInt, begin)
        seed = self.settings.seed + (self.batch << 32)
        random = random_numbers(pixel, lane % each + dr.opaque(jit.UInt, sample), seed)
        x = jit.Float(pixel % width) + random.next_float32()
        y = jit.Float(pixel // width) + random.next_float32()
        origin, direction = camera.rays(x, y, self.prepared.ahead)
        most = dr.opaque(jit.UInt, self.settings.orders or ALL_ORDERS)
        channels, met = light_of_walks(self.walks, origin, direction, random, most)
        dr.eval(channels, met)
        values = np.stack([np.array(each) for each in (*channels, met)], axis=-1)
        return values.reshape(end - begin, count, -1)


class Stop:
    """When to stop: after a number of walks a pixel, at an estimated error, or after a time."""

    def __init__(self, settings: Settings, share: float) -> None:
        """`share`: of `settings.seconds`."""
        self.settings, self.begin, self.last = settings, time.monotonic(), settings.samples
        self.seconds = math.inf if settings.seconds is None else share * settings.seconds

    def wanted(self, sums: Sums, walks: int) -> int:
        """Number of walks a pixel to go on to, after some: at most twice as many at a time."""
        settings = self.settings
        open_ended = settings.error is not None or settings.seconds is not None
        if walks == 0 or not open_ended:
            return max(settings.samples, FIRST_WALKS) if open_ended else settings.samples
        wanted, seconds = float(MOST_WALKS), time.monotonic() - self.begin
        if settings.error is not None:
            wanted = walks * (sums.error(walks) / settings.error) ** 2
            if wanted > MOST_WALKS and settings.seconds is None:
                raise InputError(
                    f"an error of {settings.error:g} takes about {wanted:.2g} walks a pixel, and {MOST_WALKS} are the "
                    f"most: after {walks} it is {sums.error(walks):.2g}; give a larger error, or a time"
                )
        wanted = min(wanted, walks * self.seconds / max(seconds, 1e-9), MOST_WALKS)
        self.last = max(math.ceil(wanted), walks)
        return min(self.last, 2 * walks)

    def progress(self, walks: float) -> float:
        """Share that is done after some walks a pixel, 0…1."""
        return min(walks / max(self.last, 1), 1.0)


class Sums:
    """Sums over walks of the weights, the coverage, and the square of Y, of every pixel."""

    def __init__(self, height: int, width: int, palette: Palette, white: Spectrum) -> None:
        """`white`: see `luminance`."""
        self.size, self.pixels, self.palette = (height, width), height * width, palette
        require(8.0 * self.pixels * (palette.channels + 2), f"an image of {width} × {height} pixels")
        self.values, self.squares = np.zeros((self.pixels, palette.channels + 1)), np.zeros(self.pixels)
        self.luminance = luminance(palette, white)

    def add(self, begin: int, end: int, values: NDArray[np.float32]) -> None:
        """Add walks: (pixels, walks, channels + 1)."""
        self.values[begin:end] += values.sum(axis=1, dtype=np.float64)
        self.squares[begin:end] += np.square(values[..., :-1] @ self.luminance, dtype=np.float64).sum(axis=1)

    def mean(self, samples: int) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Weights (height, width, channels) and coverage (height, width)."""
        mean = (self.values / samples).astype(np.float32).reshape(*self.size, -1)
        return mean[..., :-1], mean[..., -1]

    def variance(self, samples: int) -> NDArray[np.float32] | None:
        """Variance of the mean of Y (height, width); None of one walk."""
        if samples == 1:
            return None
        mean = self.values[:, :-1] @ self.luminance / samples
        spread = np.maximum(self.squares / samples - mean * mean, 0.0) / (samples - 1)
        return spread.astype(np.float32).reshape(self.size)

    def error(self, samples: int) -> float:
        """Noise of Y: root mean square over the mean, of the pixels that show matter; 0 where none does."""
        variance, seen = self.variance(samples), self.values[:, -1] > 0.0
        mean = float((self.values[seen, :-1] @ self.luminance).mean()) / samples if seen.any() else 0.0
        return math.sqrt(float(variance.ravel()[seen].mean())) / mean if variance is not None and mean > 0.0 else 0.0


def luminance(palette: Palette, white: Spectrum) -> NDArray[np.float64]:
    """Y of `Image.xyz` of one unit of each weight: (channels,); `white`: the spectrum of the picture's first lamp."""
    observer = Response.load("cie1931")
    scale = response_matrix([Spectrum.constant(1.0)], white, observer)[1, 0]
    return np.concatenate([response_matrix(palette.colours, lamp, observer)[1] for lamp in palette.lamps]) / scale
