"""Image plate: a rendered image, or a spectral one of any program, exposed anew under other lamps and cameras."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from hagoromo.image.picture.image import Image
from hagoromo.image.picture.spectral_exr import SpectralPicture
from hagoromo.light.spectrum import Spectrum
from hagoromo.transport.palette import Palette
from hagoromo_page.viewer.development import linear_picture
from hagoromo_page.viewer.plates import (
    LARGEST_NOISE,
    NOISE_LAYER,
    Picture,
    PlateLight,
    as_bytes,
    grey,
    in_colours,
    numbered,
    scaled,
    shrunk,
)
from hagoromo_page.viewer.probe import NOISE_OF_95, Probe, probe
from hagoromo_page.viewer.view_state import ViewTransform

PARTS = ("body", "interface", "through", "higher")  # of the light
STORED = {"normals": "normal.X", "depth": "depth.Z", "material": "material.id"}  # layers of a file, and one channel


class ImagePlate:
    """An image of weights: rendered, or a spectral picture of any program."""

    turns = False

    def __init__(self, image: Image) -> None:
        self.image = image
        height, width = image.alpha.shape
        palette = image.palette
        self.size = (width, height)
        groups = palette.lamp_groups or tuple(range(len(palette.lamps)))
        alike = [
            [name for name, own in zip(image.lamp_names, groups, strict=True) if own == group]
            for group in range(len(palette.lamps))
        ]
        self.lamps = tuple(names[0] if len(names) == 1 else f"({len(names)} lamps)" for names in alike)
        parts = {"interface": palette.interfaces, "through": palette.transmitted, "higher": palette.bands}
        found = ["picture", *(["body"] if any(parts.values()) else []), *(name for name, own in parts.items() if own)]
        found += ["opacity"] + ([NOISE_LAYER] if image.variance is not None else [])
        stored = image.layers or {}
        found += [name for name, key in STORED.items() if key in stored]
        self.layers = tuple(found)

    @property
    def cover(self) -> Picture:
        """See `Plate`."""
        return self.image.alpha

    def part(self, rows: slice, columns: slice, size: tuple[int, int]) -> ImagePlate:
        """See `Plate`."""
        image, cut = self.image, (rows, columns)
        share = image.weights[cut].shape[0] * image.weights[cut].shape[1] / (size[0] * size[1])
        variance = None if image.variance is None else shrunk(image.variance[cut], size) / np.float32(share)
        return ImagePlate(
            replace(
                image,
                weights=shrunk(image.weights[cut], size),
                alpha=shrunk(image.alpha[cut], size),
                variance=None if variance is None else np.asarray(variance, np.float32),
                layers=None if image.layers is None else {k: shrunk(v[cut], size) for k, v in image.layers.items()},
                sums=None,
            )
        )

    def linear(self, layer: str, light: PlateLight, development: ViewTransform) -> Picture | None:
        """See `Plate`."""
        if layer != "picture" and layer not in PARTS:
            return None
        image = self._lit(light)
        return linear_picture(image if layer == "picture" else image.part(layer), development, light.response)

    def coded(self, layer: str) -> Picture:
        """See `Plate`. Uncertainty: relative standard error of Y, black 0 to bright LARGEST_NOISE."""
        image = self.image
        if layer == "opacity":
            return grey(image.alpha)
        if layer == NOISE_LAYER:
            return in_colours(self._noise() / LARGEST_NOISE, image.alpha > 0.0)
        stored = image.layers or {}
        if layer == "normals":
            return as_bytes(0.5 + 0.5 * np.stack([stored[f"normal.{axis}"] for axis in "XYZ"], axis=2))
        if layer == "material":
            return numbered(np.rint(stored["material.id"]).astype(np.int64))
        depth = stored["depth.Z"]
        return scaled(depth, depth > 0.0)

    def probe(self, x: float, y: float, light: PlateLight) -> Probe:
        """See `Plate`; the band is the 95 % one of the noise of Y."""
        found = probe(self._lit(light), x, y)
        if self.image.variance is None:
            return found
        half = NOISE_OF_95 * float(self._noise()[found.row, found.column])
        said = (f"noise of Y: ± {100 * half:.1f} % (95 %)",)
        return replace(found, low=found.values * max(1.0 - half, 0.0), high=found.values * (1.0 + half), said=said)

    def _noise(self) -> Picture:
        """Relative standard error of Y."""
        assert self.image.variance is not None
        bright = self.image.xyz()[..., 1]
        noise = np.sqrt(np.maximum(self.image.variance, 0.0))
        return np.divide(noise, bright, out=np.zeros_like(bright), where=bright > 0.0)

    def _lit(self, light: PlateLight) -> Image:
        """The image under other strengths and spectra of its lamp groups."""
        image = self.image
        if not light.strengths and not light.spectra:
            return image
        palette = image.palette
        each = np.repeat([light.strengths.get(k, 1.0) for k in range(len(palette.lamps))], len(palette.colours))
        lamps = tuple(light.spectra.get(k, own) for k, own in enumerate(palette.lamps))
        return replace(image, weights=image.weights * each.astype(np.float32), palette=replace(palette, lamps=lamps))


def plate_of_spectra(picture: SpectralPicture) -> ImagePlate:
    """A spectral picture as an image, which may be lit anew where it is a reflectance.

    Values are linear between wavelengths and 0 beyond them: a sum of hat functions, whose weights they are.
    """
    waves = picture.wavelengths
    step = np.diff(waves)
    knots = np.concatenate([[waves[0] - step[0] * 1e-6], waves, [waves[-1] + step[-1] * 1e-6]])
    hats = tuple(Spectrum(knots[k : k + 3], [0.0, 1.0, 0.0]) for k in range(len(waves)))
    lamp = Spectrum.constant(1.0) if picture.is_light else Spectrum.named("D65")
    # a reflectance of 1 is white, and so is a radiance of 1 under an irradiance of π, which an Image counts by
    palette = Palette(hats, (), (lamp,), ("lamp",), (0,))
    known = np.asarray(np.isfinite(picture.values).all(axis=2, keepdims=True))
    values = np.where(known, picture.values, 0.0).astype(np.float32)
    plate = ImagePlate(Image(values, known[..., 0].astype(np.float32), palette))
    if picture.is_light:
        plate.lamps = ()
    return plate
