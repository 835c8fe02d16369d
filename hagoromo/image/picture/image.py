"""Image: what a camera would see, kept as geometric weights, and its exposure through any response and lamp spectrum.

ρ_c = Σ_k [ Σ_j W_kj ∫ B_j E_k R_c dλ ], k the groups of lamps with one spectrum, B_j the body and interface colours
of the scene (MODEL §5): the integrals are small matrices, so another camera or lamp spectrum needs no new rendering.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import Response, response_matrix
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.finite import finite_json
from hagoromo.files.png import png_bytes
from hagoromo.files.record import json_value
from hagoromo.files.sources import sources
from hagoromo.files.whole import whole_files
from hagoromo.image.picture.full_error import FullError
from hagoromo.image.picture.palette_record import palette_of_text, record_of_palette
from hagoromo.image.picture.shown import DisplayTransform, DisplayView
from hagoromo.image.picture.sums_channels import channels_of_sums, sums_of_channels
from hagoromo.light.colour import srgb_encode, srgb_from_xyz
from hagoromo.light.spectrum import Spectrum
from hagoromo.transport.palette import Palette

StrengthOfLamp: TypeAlias = Mapping[Any, float]  # by name, or by number from 0
SpectrumOfLamp: TypeAlias = Mapping[Any, Spectrum]
KEY = 0.9  # display value that the brightest half percent of a picture is exposed to


@dataclass(frozen=True, eq=False)
class Image:
    """Weights (height, width, lamps · colours) float32 and coverage alpha (height, width).

    A weight is radiance per unit of lamp spectrum and colour [1/m² for a lamp intensity of 1].
    metadata: scene, settings, seed and version that made it. variance: (height, width), of the noise of Y of `xyz`,
    where the image was estimated by random walks; None elsewhere. sums: (batches of lamps, height, width, columns)
    of an unfinished one, from which `render` goes on; None elsewhere. layers: further channels (height, width) by their
    names in an EXR, see `layers_of`; None unless they were asked for.

    >>> reddish = hg.Spectrum([400, 600, 700], [0, 0, 1])
    >>> red = hg.Reflectance.matte(0.25, reddish)
    >>> camera = hg.Camera(9, 7, (20, 20), (4.5, 3.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
    >>> ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=red)
    >>> image = hg.render(hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0)),), surfaces=(ball,)))
    >>> response = hg.Response.load("canon_eos_300d")
    >>> day, bulb = (image.expose(response, [hg.Spectrum.named(name)]) for name in ("D65", "A"))
    >>> day.shape, bool(bulb[3, 4, 0] > day[3, 4, 0] > day[3, 4, 1])  # another lamp without another render
    ((7, 9, 3), True)
    """

    weights: NDArray[np.float32]
    alpha: NDArray[np.float32]
    palette: Palette
    metadata: dict[str, Any] = field(default_factory=dict)
    variance: NDArray[np.float32] | None = None
    sums: NDArray[np.float64] | None = None
    layers: Mapping[str, NDArray[np.float32]] | None = None

    def __repr__(self) -> str:
        """The size and the number of weights."""
        height, width, channels = self.weights.shape
        return f"Image({width} × {height} px, {channels} weights a pixel)"

    def _repr_png_(self) -> bytes:
        """The image in a notebook."""
        return png_bytes(self.display())

    def expose(self, response: Response | None, lamps: Sequence[Spectrum] | None = None) -> NDArray[np.float32]:
        """ρ_c of eq. (10) for every pixel: (height, width, channels). `lamps`: other spectra, one per lamp group."""
        if response is None:
            raise InputError("the camera has no response: give one, such as hg.Response.load('canon_eos_300d')")
        lamps = self.palette.lamps if lamps is None else tuple(lamps)
        if len(lamps) != len(self.palette.lamps):
            raise InputError(f"{len(lamps)} lamp spectra given: the image has {len(self.palette.lamps)} lamp groups")
        # MODEL §5, eq. (10)
        matrix = np.concatenate([response_matrix(self.palette.colours, lamp, response) for lamp in lamps], axis=1)
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused where it is written
            return (self.weights @ matrix.T.astype(np.float32)).astype(np.float32)

    @property
    def full_error(self) -> FullError | None:
        """How far a picture of mode full is off, by its walks; None of other pictures, and without walks."""
        return FullError.of(self.metadata)

    @property
    def lamp_names(self) -> tuple[str, ...]:
        """Names of the lamps, in the order of the scene; of the groups of lamps where the file does not name them."""
        groups = range(len(self.palette.lamps))
        return self.palette.lamp_names or tuple(f"lamp group {k + 1}" for k in groups)

    def with_lamps(self, strength: StrengthOfLamp | None = None, spectrum: SpectrumOfLamp | None = None) -> Image:
        """The image under changed lamps, without a new rendering: what `render` gives of the scene with them.

        strength: factor on the intensity of a lamp, 0 or more. spectrum: its spectrum in place of its own. Both by the
        name of a lamp, or its number from 0. Lamps that share weights can only be changed alike: `InputError` unless
        all of them are, and for a lamp that the image does not have. `Settings.separate_lamps` parts them.

        >>> matte = hg.Reflectance.matte(0.25, hg.Spectrum.constant(1.0))
        >>> camera = hg.Camera(9, 7, (20, 20), (4.5, 3.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
        >>> ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=matte)
        >>> lamps = hg.Lamp(to_lamp=(0, -1, 0), name="key"), hg.Lamp(to_lamp=(1, -1, 0), name="fill")
        >>> image = hg.render(hg.Scene(camera, lamps, surfaces=(ball,)), hg.Settings(separate_lamps=True))
        >>> dimmed = image.with_lamps(strength={"fill": 0.5}, spectrum={"key": hg.Spectrum.named("A")})
        >>> image.lamp_names, bool((dimmed.weights == image.weights * [1, 1, 0.5, 0.5]).all())
        (('key', 'fill'), True)
        """
        factors = self._of_groups(strength or {}, 1.0, "strength")
        for factor in factors:
            if not (isinstance(factor, (int, float)) and math.isfinite(factor) and factor >= 0.0):
                raise InputError(f"the strength of a lamp is {factor!r:.60}: give a factor of 0 or more")
        spectra = self._of_groups(spectrum or {}, None, "spectrum")
        lamps = tuple(old if new is None else new for old, new in zip(self.palette.lamps, spectra, strict=True))
        each = np.repeat(np.array(factors, np.float32), len(self.palette.colours))
        record = _with_lamps(self.metadata, self.palette, factors, spectra)
        palette = replace(self.palette, lamps=lamps)  # the variance is that under the lamps of before
        return replace(self, weights=self.weights * each, palette=palette, metadata=record, variance=None, sums=None)

    def _of_groups(self, of_lamps: Mapping[Any, Any], otherwise: Any, what: str) -> list[Any]:
        """A value for each group of lamps from those of single lamps."""
        names = self.lamp_names
        groups = self.palette.lamp_groups or tuple(range(len(names)))
        values: list[Any] = [otherwise] * len(names)
        for key, value in of_lamps.items():
            places = [k for k, name in enumerate(names) if key in (k, name)]
            if len(places) != 1:
                known = ", ".join(names)
                raise InputError(f"{what}: {len(places)} lamps are called {key!r}: the image has {known} (or 0, 1, …)")
            values[places[0]] = value
        for group in range(len(self.palette.lamps)):
            alike = [k for k, own in enumerate(groups) if own == group]
            if not all(_same(values[k], values[alike[0]]) for k in alike):
                shared = ", ".join(names[k] for k in alike)
                raise InputError(f"{what}: {shared} share weights: render with separate_lamps (--separate-lamps)")
        return [values[groups.index(group)] for group in range(len(self.palette.lamps))]

    def xyz(self, lamps: Sequence[Spectrum] | None = None) -> NDArray[np.float32]:
        """CIE XYZ, Y = 1 for a white diffuser seen under an irradiance of π of the first lamp's spectrum."""
        observer = Response.load("cie1931")
        whites = self.palette.lamps if lamps is None else tuple(lamps)
        scale = response_matrix([Spectrum.constant(1.0)], whites[0], observer)[1, 0]
        return self.expose(observer, lamps) / np.float32(scale)

    def linear_srgb(self, lamps: Sequence[Spectrum] | None = None) -> NDArray[np.float64]:
        """Linear sRGB (height, width, 3), balanced so that the first lamp's light is white; 1 is a white diffuser."""
        whites = self.palette.lamps if lamps is None else tuple(lamps)
        return srgb_from_xyz(self.xyz(lamps) * _balance(whites[0]))

    def display(self, exposure: float | None = None, lamps: Sequence[Spectrum] | None = None) -> NDArray[np.uint8]:
        """sRGB (height, width, 3) for people: balanced to the first lamp, exposed by `exposure` (default: KEY)."""
        rgb = self.linear_srgb(lamps)
        return srgb_encode(rgb * (auto_exposure(rgb, self.alpha) if exposure is None else exposure))

    def part(self, name: str) -> Image:
        """The image of a part of its light: of the first order ("first"), which is sent on by bodies ("body"),
        interfaces ("interface") or through elements ("through"), or of higher orders ("higher").

        >>> matte = hg.Reflectance(alpha=0.2, beta=0.5, gamma=0.2, n=1.5, body_colour=hg.Spectrum.constant(1.0))
        >>> camera = hg.Camera(9, 7, (20, 20), (4.5, 3.5)).look_at(eye=(0, -1, 0), target=(0, 0, 0))
        >>> ball = hg.Surface.sphere(centre=(0, 0, 0), radius=0.1, reflectance=matte)
        >>> image = hg.render(hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0)),), surfaces=(ball,)))
        >>> bool(np.allclose(image.weights, image.part("body").weights + image.part("interface").weights))
        True
        """
        palette = self.palette
        counts = {
            "body": len(palette.bodies), "interface": len(palette.interfaces),
            "through": len(palette.transmitted) + len(palette.twice), "higher": len(palette.bands),
        }  # fmt: skip
        if name != "first" and name not in counts:
            raise InputError(f"part of the light is {name!r}: give one of first, {', '.join(counts)}")
        kept = [
            key == name or (name == "first" and key != "higher") for key, count in counts.items() for _ in range(count)
        ]
        weights = self.weights * np.tile(np.array(kept, np.float32), len(palette.lamps))
        return replace(self, weights=weights, variance=None, sums=None)

    def save(
        self,
        path: str | Path,
        response: Response | None = None,
        force: bool = False,
        denoise: bool = False,
        display: str | DisplayView | None = None,
    ) -> list[Path]:
        """Write an EXR of R, G, B (through `response`, else linear sRGB), A and weights, a PNG beside it; their paths.

        Both are written or none, see `whole_files`. An image with layers has these and the parts of its light, too.
        denoise: of R, G, B and the PNG by Open Image Denoise, with the layers; weights stay as they are. display: how
        the PNG shows them, sRGB, Display P3, or a view of ACES such as "ACES 2.0 - SDR 100 nits (Rec.709)"; or a
        `DisplayView` of any configuration of OpenColorIO, and its exposure. What the EXR holds does not depend on it.
        `InputError` for a name that does not end in .exr, or a file that exists without `force`.
        """
        target = Path(path)
        if target.suffix.lower() != ".exr":
            raise InputError(f"{target} is no EXR name: an image is written as NAME.exr with NAME.png beside it")
        names = list(response.channels if response else "RGB")
        with np.errstate(over="ignore", invalid="ignore"):  # what is not finite is refused below
            shown = self.linear_srgb()
            rgb = self.expose(response) if response else shown
        header, way = {}, DisplayTransform(display)
        if denoise:
            from hagoromo.image.picture.denoise import denoised, name_of_denoiser  # an extra

            header["denoised"] = f"{', '.join(names)} by {name_of_denoiser()}; the weights are as they were rendered"
            shown, rgb = denoised(self.layers, shown), denoised(self.layers, rgb)
        channels = {name: rgb[..., k] for k, name in enumerate(names)} | {"A": self.alpha}
        for k, name in enumerate(self.channel_names()):
            channels[name] = self.weights[..., k]
        if self.variance is not None:
            channels[VARIANCE] = self.variance
        if self.sums is not None:
            channels |= channels_of_sums(self.sums)
        if self.layers is not None:
            channels |= dict(self.layers) | self._parts(response, names)
        header |= {
            "colour_space": f"camera {response.name}, rho of eq. (10)" if response else "linear sRGB",
            "hagoromo": finite_json(self.metadata | ({"sources": given} if (given := sources()) else {}), str(target)),
            "palette": finite_json(record_of_palette(self.palette), str(target)),
        }
        if self.sums is not None:
            header["unfinished"] = str(self.metadata.get("unfinished", ""))
        picture = target.with_suffix(".png")
        with whole_files((target, picture), force) as (exr, png):
            write_exr(exr, {k: np.ascontiguousarray(v, np.float32) for k, v in channels.items()}, header)
            stops = display.factor if isinstance(display, DisplayView) else 1.0
            way.save_png(png, way.numbers(shown * (auto_exposure(shown, self.alpha) * stops)))
        return [target, picture]

    def _parts(self, response: Response | None, names: Sequence[str]) -> dict[str, NDArray]:
        """Channels of the parts of the light, such as higher.R, if there are any; and of each of several groups
        of lamps, such as lamp0.R.
        """
        palette, channels = self.palette, {}
        there = {"through": palette.transmitted + palette.twice, "higher": palette.bands}
        for part in (name for name in PARTS if there.get(name, True)):
            channels |= _shown(self.part(part), part, response, names)
        if len(palette.lamps) > 1:
            for group in range(len(palette.lamps)):
                channels |= _shown(self._of_group(group), f"lamp{group}", response, names)
        return channels

    def _of_group(self, group: int) -> Image:
        """The image of one group of lamps: of one lamp, where they are kept apart."""
        kept = np.repeat(np.arange(len(self.palette.lamps)) == group, self.weights.shape[-1] // len(self.palette.lamps))
        return replace(self, weights=self.weights * kept.astype(np.float32), variance=None, sums=None)

    def channel_names(self) -> list[str]:
        """EXR channel names of the weights: lamp group, then body, interface or transmitted colour, or band of higher
        orders.
        """
        palette = self.palette
        colours = [f"body{j}" for j in range(len(palette.bodies))]
        colours += [f"interface{j}" for j in range(len(palette.interfaces))]
        colours += [f"transmitted{j}" for j in range(len(palette.transmitted))]
        colours += [f"twice{j}" for j in range(len(palette.twice))]
        colours += [f"band{j}" for j in range(len(palette.bands))]
        return [f"lamp{k}.{colour}" for k in range(len(palette.lamps)) for colour in colours]


def _shown(image: Image, layer: str, response: Response | None, names: Sequence[str]) -> dict[str, NDArray]:
    """Channels of a layer: an image through a response, else in linear sRGB."""
    rgb = image.expose(response) if response else image.linear_srgb()
    return {f"{layer}.{name}": rgb[..., k] for k, name in enumerate(names)}


VARIANCE = "variance.Y"  # channel of an EXR
PARTS = ("first", "body", "interface", "through", "higher")  # of the light
LAYERS = ("depth.Z", "normal.X", "normal.Y", "normal.Z", "albedo.R", "albedo.G", "albedo.B", "material.id")


def read_image(path: str | Path) -> Image:
    """The Image in an EXR that `Image.save` wrote; `InputError` for any other EXR (`read_exr` reads those)."""
    channels, header = read_exr(path)
    try:
        palette = palette_of_text(header["palette"], f"{path}: palette")
        metadata = dict(json_value(header["hagoromo"], f"{path}: hagoromo"))
        empty = np.zeros(channels["A"].shape, np.float32)
        names = Image(empty[..., None], empty, palette).channel_names()
        weights = np.stack([channels[name] for name in names], axis=-1)
        sums, layers = sums_of_channels(channels), {name: channels[name] for name in LAYERS if name in channels}
    except (KeyError, ValueError, TypeError, AttributeError, OverflowError) as error:
        raise InputError(f"{path} holds no weights of Hagoromo: render it again ({error})") from error
    return Image(weights, channels["A"], palette, metadata, channels.get(VARIANCE), sums, layers or None)


def lamp_names_in(palette: str, path: str | Path) -> tuple[str, ...]:
    """Names of the groups of lamps of an EXR of ours, from the text of its palette."""
    empty = np.zeros((1, 1, 1), np.float32)
    return Image(empty, empty[..., 0], palette_of_text(palette, f"{path}: palette")).lamp_names


def _same(one: Any, other: Any) -> bool:
    """Whether two strengths, or two spectra, are alike."""
    if isinstance(one, Spectrum) and isinstance(other, Spectrum):
        return one.equals(other)
    return one is other or one == other


def _with_lamps(
    metadata: dict[str, Any], palette: Palette, factors: Sequence[float], spectra: Sequence[Spectrum | None]
) -> dict[str, Any]:
    """The metadata, with the scene's record of changed lamps."""
    scene = metadata.get("scene", {})
    lamps = scene.get("lamps", [])
    if len(lamps) != len(palette.lamp_groups):
        return metadata
    changed = []
    for lamp, group in zip(lamps, palette.lamp_groups, strict=True):
        spectrum = spectra[group]
        colour = {} if spectrum is None else {"spectrum": spectrum.record()}
        changed.append(lamp | {"intensity": lamp["intensity"] * factors[group]} | colour)
    return metadata | {"scene": scene | {"lamps": changed}}


def auto_exposure(rgb: NDArray, alpha: NDArray) -> float:
    """Factor that brings the 99.5th percentile of the brightest channel where there is matter to KEY."""
    brightest = np.maximum.reduce(np.moveaxis(rgb, -1, 0))[alpha > 0.5]
    bright = float(np.percentile(brightest, 99.5)) if brightest.size else 0.0
    return KEY / bright if bright > 0 else 1.0


def _balance(lamp: Spectrum) -> NDArray[np.float32]:
    """Factors on X, Y, Z that show the lamp's colour as the display's white (D65)."""
    xyz = response_matrix([Spectrum.constant(1.0)], lamp, Response.load("cie1931"))[:, 0]
    return (np.array([0.95047, 1.0, 1.08883]) * xyz[1] / np.maximum(xyz, 1e-12)).astype(np.float32)
