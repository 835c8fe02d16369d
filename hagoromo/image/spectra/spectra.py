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
from hagoromo.calibration.response.chart import chart_spectra
from hagoromo.camera.response import Response, camera_white
from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.image.spectra.chart_correction import ChartCorrection, chart_correction
from hagoromo.image.spectra.photographed_white import White, read_linear, white_from_chart, white_from_patch
from hagoromo.least_squares.loss import ROBUST_SCALE
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.measurement_files import read_surface
from hagoromo.reflectance.spectra.reflectance_prior import PRIORS, ReflectancePrior
from hagoromo.reflectance.spectra.spectrum_estimate import SpectrumEstimate, estimate_spectrum, reading_matrix
from hagoromo.reflectance.spectra.spectrum_map import SpectrumMap, estimate_spectra

ILLUMINATION = 0.01  # relative standard deviation of the light on a region, against that on the white
Array = NDArray[Any]
DOUBTFUL_SCATTER = 0.05  # relative error of the patches of a chart, from which it is reported
LEAST_UNCLIPPED = 0.5  # share of a region's pixels
UNKNOWN = 10.0  # standard deviation of a reading that is left out, over white
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
    what was taken for granted, a line each. remarks: what was found to be wrong with the photographs and, where it says
    so, corrected. lamps: of the photographs, in their order.
    """

    estimates: Mapping[str, SpectrumEstimate]
    pixels: Mapping[str, int]
    lamps: tuple[Spectrum, ...]
    response: Response
    whites: tuple[White, ...]
    assumptions: tuple[str, ...] = ()
    image: SpectrumMap | None = None
    masks: Masks = field(default_factory=dict)
    remarks: tuple[str, ...] = ()


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
    if marks.white is None:
        lit = _by_chart(pictures, light, marks, response, charts, chart)
    elif response is None:
        raise InputError("a white patch does not calibrate the camera: give its --response, or photographs of a chart")
    else:
        lit = _by_patch(pictures, light, marks, masks, response)
    regions = {name: mask for name, mask in masks.items() if name != marks.white}
    if not regions:
        raise InputError(f"{marks.white!r}, the white patch, is the only region: mark what is to be measured")
    chosen = [ReflectancePrior.load(name) for name in PRIORS] if priors is None else list(priors)
    matrix = np.concatenate([reading_matrix(lamp, lit.response) for lamp in lit.lamps])
    found, remarks = {}, list(lit.remarks)
    for name, mask in regions.items():
        values, covariance, said = _reading(lit, mask, illumination, name)
        found[name] = estimate_spectrum(matrix, values, covariance, chosen, upper)
        remarks += said
    image = _image(lit.pictures, lit.whites, matrix, chosen, upper) if whole_image else None
    assumed = [
        *lit.assumptions,
        f"the light on a region is that on the white to {100 * illumination:g} %",
        f"priors {', '.join(f'{prior.name} ({prior.odds:.2g})' for prior in chosen)}: odds before the readings",
        f"spectra lie within 0 and {upper:g} of a perfect white",
    ]
    counts = {name: int(mask.sum()) for name, mask in regions.items()}
    return RegionSpectra(
        found, counts, lit.lamps, lit.response, tuple(lit.whites), tuple(assumed), image, regions, tuple(remarks)
    )


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


@dataclass(frozen=True, eq=False)
class _Lit:
    """The camera and the lamps, what a perfect white reads in each of the `pictures`, which are linear and evenly lit,
    what is assumed by that, and what was found to be wrong; corrections: of each picture, by a chart.
    """

    response: Response
    lamps: tuple[Spectrum, ...]
    whites: list[White]
    pictures: list[Array]
    assumptions: list[str]
    remarks: list[str] = field(default_factory=list)
    corrections: Sequence[ChartCorrection] = ()

    def spread(self, number: int, mask: NDArray[np.bool_]) -> float:
        """Relative standard deviation of the light on a region by what lies between it and the chart."""
        return self.corrections[number].spread(mask) if self.corrections else 0.0


def _by_patch(pictures: list[Array], lamps: tuple[Spectrum, ...], marks: Marks, masks: Masks, camera: Response) -> _Lit:
    """By a white patch in each photograph."""
    if marks.white not in masks:
        raise InputError(f"no region is called {marks.white!r}: the regions are {', '.join(masks)}")
    means = [np.nanmean(picture[masks[marks.white]], axis=0) for picture in pictures]
    whites = [white_from_patch(mean, marks.reflectance) for mean in means]
    lines = [
        f"the patch {marks.white} is neutral and reflects {marks.reflectance:g} at every wavelength",
        "one patch does not show whether values are linear in light, free of glare and evenly lit: a chart does",
    ]
    return _Lit(camera, lamps, whites, pictures, lines)


def _by_chart(
    pictures: list[Array],
    lamps: tuple[Spectrum, ...],
    marks: Marks,
    response: Response | None,
    charts: Sequence[str | Path | NDArray],
    chart: str | Path,
) -> _Lit:
    """By a chart in each photograph, or beside it in `charts`: photographs are corrected by what it shows of each."""
    shown = [read_linear(one) if isinstance(one, (str, Path)) else np.asarray(one) for one in charts] or list(pictures)
    patches = chart_spectra(chart)
    names = [f"photograph {k + 1}" for k in range(len(shown))]
    corners = marks.corners or [None] * len(shown)
    corrections = [
        chart_correction(picture, lamp, patches, at, name)
        for picture, lamp, at, name in zip(shown, lamps, corners, names, strict=True)
    ]
    even = [one.applied(picture) for one, picture in zip(corrections, shown, strict=True)]
    places = [one.corners for one in corrections]
    remarks = [
        line if line.startswith(name) else f"{name}: {line}"
        for one, name in zip(corrections, names, strict=True)
        for line in one.remarks()
    ]
    assumed = [f"patches of the chart as {chart}; the chart faces the light as the regions do"]
    if response is None:
        response, lamps, more = _calibrated(even, lamps, patches, places, corrections[0].calibration.response)
        remarks += more
        assumed.append("the response was calibrated from the chart: the errors of its patches are in the bands")
    whites = [
        white_from_chart(picture, lamp, response, patches, at)
        for picture, lamp, at in zip(even, lamps, places, strict=True)
    ]
    remarks += [
        f"{name}: lamp and response explain the patches of the chart only to {100 * white.scatter.max():.0f} %: check "
        "the spectra of the lamp, of the patches and of the response"
        for name, white in zip(names, whites, strict=True)
        if white.scatter.max() > DOUBTFUL_SCATTER
    ]
    if charts:
        even = [one.applied(picture) for one, picture in zip(corrections, pictures, strict=True)]
    return _Lit(response, lamps, whites, even, assumed, remarks, corrections)


def _calibrated(
    shown: Sequence[Array],
    lamps: tuple[Spectrum, ...],
    patches: Sequence[Spectrum],
    places: Sequence[Array],
    first: Response,
) -> tuple[Response, tuple[Spectrum, ...], list[str]]:
    """The response from the chart under all lamps, whose strengths and exposures need not be alike; the lamps, and what
    was found. first: response by the first photograph alone, which gives each photograph's factor.

    Lamps that were given in the wrong order are exchanged.
    """
    if len(shown) == 1:
        return first, lamps, []
    charted = list(zip(shown, lamps, places, strict=True))
    whites = [white_from_chart(one, lamp, first, patches, at) for one, lamp, at in charted]
    expected = [camera_white(lamp, first) for lamp in lamps]
    factors = [float(np.exp(np.mean(np.log(e / w.reading)))) for e, w in zip(expected, whites, strict=True)]
    scaled = [picture * factor for picture, factor in zip(shown, factors, strict=True)]
    found, _ = read_response(scaled, lamps, patches, places)
    if found.exchanged is None:
        return found.response, lamps, found.remarks()
    a, b = found.exchanged.pair
    order = list(range(len(lamps)))
    order[a], order[b] = b, a
    said = found.exchanged.finding([f"photograph {k + 1}" for k in range(len(lamps))])
    right = tuple(lamps[k] for k in order)
    alone, _ = read_response(shown[:1], right[:1], patches, places[:1])
    response, right, more = _calibrated(shown, right, patches, places, alone.response)
    return response, right, [f"{said}; they were used so", *more]


def _reading(lit: _Lit, mask: NDArray[np.bool_], illumination: float, name: str) -> tuple[Array, Array, list[str]]:
    """Readings of a region relative to white (photographs × channels,), their covariance, and what is wrong with them.

    Noise of the mean, the scatter of the chart's patches per channel, and the light, common to a photograph's channels.
    A channel that is clipped there has no weight.
    """
    values, blocks, said = [], [], []
    for number, (picture, white) in enumerate(zip(lit.pictures, lit.whites, strict=True)):
        pixels = picture[mask]
        clipped = np.isfinite(pixels).mean(axis=0) < LEAST_UNCLIPPED
        if clipped.all():
            raise InputError(
                f"region {name!r} is clipped or invalid in photograph {number + 1}: expose less, or move it"
            )
        for channel in np.flatnonzero(clipped):
            which = lit.response.channels[channel]
            said.append(f"{name}: channel {which} is clipped in photograph {number + 1} and left out: expose less")
        pixels = np.where(clipped, white.reading, pixels)
        pixels = pixels[np.isfinite(pixels).all(axis=1)]
        mean = pixels.mean(axis=0) / white.reading
        noise = pixels.std(axis=0, ddof=1) / white.reading / np.sqrt(len(pixels))
        between = lit.spread(number, mask)
        if between > illumination:
            said.append(
                f"{name}: it lies beside the chart, where the uneven light of photograph {number + 1} is known to "
                f"{100 * between:.0f} %: put the chart where the region is"
            )
        own = noise**2 + (white.scatter * mean) ** 2 + (FINEST * mean.mean()) ** 2
        block = np.diag(np.where(clipped, UNKNOWN**2, own))
        values.append(mean)
        blocks.append(block + (illumination**2 + between**2) * np.outer(mean, mean))
    count = len(values[0])
    covariance = np.zeros((count * len(blocks),) * 2)
    for number, block in enumerate(blocks):
        covariance[number * count : (number + 1) * count, number * count : (number + 1) * count] = block
    return np.concatenate(values), covariance, said


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
    noise = ROBUST_SCALE * np.nanmedian(steps, axis=(0, 1))
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
