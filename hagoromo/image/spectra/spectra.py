"""Reflectance spectra of marked regions, from photographs with a chart or a white patch: the verb `spectra`."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.response.calibrate_response import read_response
from hagoromo.calibration.response.chart import chart_spectra, read_chart
from hagoromo.camera.response import Response, camera_white
from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.image.spectra.photographed_white import White, read_linear, white_from_chart, white_from_patch
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.measurement_files import read_surface
from hagoromo.reflectance.spectra.reflectance_prior import PRIORS, ReflectancePrior
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate, estimate_spectrum, reading_matrix
from hagoromo.reflectance.spectra.spectrum_map import SpectrumMap, estimate_spectra

ILLUMINATION = 0.01  # relative standard deviation of the light on a region, against that on the white
Array = NDArray[Any]
FINEST = 1e-4  # least relative standard error of a reading
RECTANGLE = re.compile(r"(.+)=(\d+),(\d+),(\d+),(\d+)")
FEWEST_PIXELS = 4
Masks = dict[str, NDArray[np.bool_]]


@dataclass(frozen=True)
class Marks:
    """Where regions are: see `marked_regions`.

    white: name of the region that is a white patch; reflectance: its own. corners: of the chart in each photograph
    (4, 2) [px], clockwise from the dark skin patch; None: detected.
    """

    rectangles: Sequence[str] = ()
    labels: Path | None = None
    measured: Path | None = None
    white: str | None = None
    reflectance: float = 0.99
    corners: Sequence[NDArray] | None = None


@dataclass(frozen=True, eq=False)
class RegionSpectra:
    """Spectra of regions. estimates, pixels: by name. image: spectra of all pixels, or None.

    response: as given, or calibrated from the chart. whites: reading of a perfect white per photograph. assumptions:
    what was taken for granted, a line each.
    """

    estimates: Mapping[str, SpectrumEstimate]
    pixels: Mapping[str, int]
    lamps: tuple[Spectrum, ...]
    response: Response
    whites: tuple[White, ...]
    assumptions: tuple[str, ...] = ()
    image: SpectrumMap | None = None
    masks: Masks = field(default_factory=dict)


def spectra(
    photographs: Sequence[str | Path | NDArray],
    lamps: Sequence[str | Path | Spectrum],
    marks: Marks,
    response: Response | None = None,
    charts: Sequence[str | Path | NDArray] = (),
    chart: str | Path = "BabelColor Average",
    priors: Sequence[ReflectancePrior] | None = None,
    upper: float = 1.0,
    illumination: float = ILLUMINATION,
    whole_image: bool = False,
) -> RegionSpectra:
    """Reflectance spectra with covariance of the marked regions of `photographs`, all of one view, one per lamp.

    photographs: developed EXR or 16-bit files, or arrays (h, w, 3), NaN where invalid. lamps: spectrum of each, a name
    or CSV. response: of the camera; None: calibrated from the charts. charts: photographs of the chart, one per lamp,
    in the exposure of the photographs; empty: the chart is in the photographs themselves. priors: None for all of
    `PRIORS`, weighed by evidence. upper: bound of the spectra. illumination: relative standard deviation between the
    light on a region and that on the white. whole_image: also spectra of every pixel.
    `InputError` where the photographs, lamps, charts and regions do not go together.
    """
    pictures = [
        read_linear(one) if isinstance(one, (str, Path)) else np.asarray(one, np.float64) for one in photographs
    ]
    light = tuple(Spectrum.load(str(lamp) if isinstance(lamp, Path) else lamp) for lamp in lamps)
    _check(pictures, light, charts)
    masks = marked_regions(pictures[0].shape[:2], marks.rectangles, marks.labels, marks.measured)
    camera, whites, assumed = _whites(pictures, light, marks, masks, response, charts, chart)
    regions = {name: mask for name, mask in masks.items() if name != marks.white}
    if not regions:
        raise InputError(f"{marks.white!r}, the white patch, is the only region: mark what is to be measured")
    chosen = [ReflectancePrior.load(name) for name in PRIORS] if priors is None else list(priors)
    matrix = np.concatenate([reading_matrix(lamp, camera) for lamp in light])
    found = {
        name: estimate_spectrum(matrix, *_reading(pictures, whites, mask, illumination, name), chosen, upper)
        for name, mask in regions.items()
    }
    image = _image(pictures, whites, matrix, chosen, upper) if whole_image else None
    assumed += [
        f"the light on a region is that on the white to {100 * illumination:g} %",
        f"priors {', '.join(f'{prior.name} ({prior.odds:.2g})' for prior in chosen)}: odds before the readings",
        f"spectra lie within 0 and {upper:g} of a perfect white",
    ]
    counts = {name: int(mask.sum()) for name, mask in regions.items()}
    return RegionSpectra(found, counts, light, camera, tuple(whites), tuple(assumed), image, regions)


def _check(pictures: Sequence[NDArray], lamps: Sequence[Spectrum], charts: Sequence[object]) -> None:
    if not pictures or len(lamps) != len(pictures):
        raise InputError(f"{len(pictures)} photographs and {len(lamps)} lamps are given: give one lamp for each")
    if len({picture.shape for picture in pictures}) != 1:
        sizes = ", ".join(sorted({f"{p.shape[1]}x{p.shape[0]}" for p in pictures}))
        raise InputError(f"photographs of one view have one size: given {sizes} px")
    if charts and len(charts) != len(pictures):
        raise InputError(
            f"{len(charts)} photographs of the chart for {len(pictures)} lamps: give one for each, or none"
        )


def _whites(
    pictures: Sequence[NDArray],
    lamps: Sequence[Spectrum],
    marks: Marks,
    masks: Masks,
    response: Response | None,
    charts: Sequence[str | Path | NDArray],
    chart: str | Path,
) -> tuple[Response, list[White], list[str]]:
    """The response, what a perfect white reads under each lamp, and what is assumed by that."""
    if marks.white is not None:
        if response is None:
            raise InputError(
                "a white patch does not calibrate the camera: give its --response, or photographs of a chart"
            )
        if marks.white not in masks:
            raise InputError(f"no region is called {marks.white!r}: the regions are {', '.join(masks)}")
        means = [np.nanmean(picture[masks[marks.white]], axis=0) for picture in pictures]
        line = f"the patch {marks.white} is neutral and reflects {marks.reflectance:g} at every wavelength"
        return response, [white_from_patch(mean, marks.reflectance) for mean in means], [line]
    shown = [read_linear(one) if isinstance(one, (str, Path)) else np.asarray(one) for one in charts] or list(pictures)
    patches = chart_spectra(chart)
    line = f"patches of the chart as {chart}; the chart faces the light as the regions do"
    if response is not None:
        return (
            response,
            [white_from_chart(p, lamp, response, patches) for p, lamp in zip(shown, lamps, strict=True)],
            [line],
        )
    found, whites = _calibrated(shown, lamps, patches, marks.corners)
    return (
        found,
        whites,
        [line, "the response was calibrated from the chart: the errors of its patches are in the bands"],
    )


def _calibrated(
    shown: Sequence[NDArray], lamps: Sequence[Spectrum], patches: Sequence[Spectrum], corners: Sequence[NDArray] | None
) -> tuple[Response, list[White]]:
    """The response from the chart under all lamps, whose strengths and exposures need not be alike.

    It is calibrated under the first lamp, which gives each photograph's factor, and then under all together.
    """
    first, readings = read_response(shown[:1], lamps[:1], patches, None if corners is None else corners[:1])
    camera, places = first.response, [readings[0].corners]
    for number in range(1, len(shown)):
        at = None if corners is None else corners[number]
        places.append(read_chart(shown[number], [patch.mean() for patch in patches], at).corners)
    charted = list(zip(shown, lamps, places, strict=True))
    if len(shown) > 1:
        whites = [white_from_chart(one, lamp, camera, patches, at) for one, lamp, at in charted]
        expected = [camera_white(lamp, camera) for lamp in lamps]
        factors = [float(np.exp(np.mean(np.log(e / w.reading)))) for e, w in zip(expected, whites, strict=True)]
        scaled = [picture * factor for picture, factor in zip(shown, factors, strict=True)]
        camera = read_response(scaled, lamps, patches, places)[0].response
    return camera, [white_from_chart(one, lamp, camera, patches, at) for one, lamp, at in charted]


def _reading(
    pictures: Sequence[NDArray], whites: Sequence[White], mask: NDArray[np.bool_], illumination: float, name: str
) -> tuple[Array, Array]:
    """Readings of a region relative to white (photographs × channels,), and their covariance.

    Noise of the mean, the scatter of the chart's patches per channel, and the light, common to a photograph's channels.
    """
    values, blocks = [], []
    for number, (picture, white) in enumerate(zip(pictures, whites, strict=True)):
        pixels = picture[mask]
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        if len(pixels) < 0.5 * mask.sum():
            raise InputError(
                f"region {name!r} is clipped or invalid in photograph {number + 1}: expose less, or move it"
            )
        mean = pixels.mean(axis=0) / white.reading
        noise = pixels.std(axis=0, ddof=1) / white.reading / np.sqrt(len(pixels))
        block = np.diag(noise**2 + (white.scatter * mean) ** 2 + (FINEST * mean.mean()) ** 2)
        values.append(mean)
        blocks.append(block + illumination**2 * np.outer(mean, mean))
    count = len(values[0])
    covariance = np.zeros((count * len(blocks),) * 2)
    for number, block in enumerate(blocks):
        covariance[number * count : (number + 1) * count, number * count : (number + 1) * count] = block
    return np.concatenate(values), covariance


def _image(
    pictures: Sequence[NDArray],
    whites: Sequence[White],
    matrix: Array,
    priors: Sequence[ReflectancePrior],
    upper: float,
) -> SpectrumMap:
    """Spectra of every pixel; its noise is that of neighbouring pixels of like value, by differences along rows."""
    values = np.concatenate([p / w.reading for p, w in zip(pictures, whites, strict=True)], axis=2)
    scatter = np.concatenate([white.scatter for white in whites])
    steps = np.abs(np.diff(values, axis=1)) / np.sqrt(2.0)
    noise = 1.4826 * np.nanmedian(steps, axis=(0, 1))
    errors = np.sqrt(noise**2 + (scatter * values) ** 2 + (FINEST * np.nanmean(values)) ** 2)
    return estimate_spectra(matrix, values, errors, priors, upper)


def marked_regions(
    shape: tuple[int, int], rectangles: Sequence[str] = (), labels: Path | None = None, measured: Path | None = None
) -> Masks:
    """Name → (h, w) mask. rectangles: "NAME=x,y,width,height" [px]. labels: PNG, 0 unmarked, each other value a region.

    measured: folder of `measure`, whose labels.png marks the materials. `InputError` for a region outside `shape`, or
    of too few pixels, and where nothing is marked.
    """
    masks: Masks = {}
    for text in rectangles:
        match = RECTANGLE.fullmatch(text)
        if match is None:
            raise InputError(f"--region is {text!r}: give NAME=x,y,width,height in pixels, such as cheek=120,80,40,40")
        name, (x, y, width, height) = match[1], map(int, match.groups()[1:])
        if x + width > shape[1] or y + height > shape[0]:
            raise InputError(f"region {name!r} leaves the photograph of {shape[1]}x{shape[0]} px: {text}")
        masks[name] = np.zeros(shape, np.bool_)
        masks[name][y : y + height, x : x + width] = True
    for names, picture in _pictures(labels, measured):
        if picture.shape[:2] != shape:
            raise InputError(f"labels of {picture.shape[:2]} do not fit the photograph of {shape}: give one size")
        masks |= {names.get(int(k), f"region {k}"): picture == k for k in np.unique(picture[picture > 0])}
    if not masks:
        raise InputError("no region is marked: give --region, --labels or --measured")
    for name, mask in masks.items():
        if mask.sum() < FEWEST_PIXELS:
            raise InputError(f"region {name!r} has {int(mask.sum())} pixels: give {FEWEST_PIXELS} or more")
    return masks


def _pictures(labels: Path | None, measured: Path | None) -> list[tuple[dict[int, str], NDArray]]:
    pictures: list[tuple[dict[int, str], NDArray]] = []
    if labels is not None:
        picture = read_png(labels)
        if picture.ndim != 2:
            raise InputError(f"{labels} has {picture.shape[2]} channels: give a picture of one channel, 0 unmarked")
        pictures.append(({}, picture))
    if measured is not None:
        surface = read_surface(measured)
        pictures.append(({k + 1: m.name for k, m in enumerate(surface.materials)}, surface.labels + 1))
    return pictures
