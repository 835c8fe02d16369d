"""Chart: readings of a ColorChecker of 24 patches in a linear photograph, detected by OpenCV or by four given corners.

Patches are in reading order, from dark skin to black. A corner of the chart is an image point (x, y) [px].
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.calibration.opencv_threads import one_thread
from hagoromo.errors import InputError
from hagoromo.files.table import read_table
from hagoromo.light.colour import srgb_encode
from hagoromo.light.spectrum import WAVELENGTH_COLUMNS, Spectrum

PATCHES = 24
# Width [px] and brightness of the copies that are searched: OpenCV detects a chart in some of them only.
DETECTION_COPIES = tuple((width, bright) for width in (1000, 700, 1400, 500, 2000) for bright in (1.0, 0.7, 1.6))
MOST_ENLARGED = 3.0  # largest magnification of such a copy
ENOUGH_DETECTIONS = 3  # copies with a chart, after which no more are searched: their corners differ by a few pixels
WHITE_PERCENTILE = 99.5  # percentile of the photograph's values that is white in the copies
CHART_CORRELATION = 0.9  # least correlation of the patches' brightness with that of the known chart
FEWEST_PATCH_PIXELS = 25  # least number of pixels of a patch
LEAST_CHANNEL = 0.05  # light of a channel relative to the brightest, from which patches differ in it
USABLE_PATCH_SHARE = 0.98  # least share of valid, unclipped pixels of a patch; clipping biases the mean
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class ChartReading:
    """Readings of a chart in one photograph.

    values: (24, 3), in the photograph's unit; NaN where a patch is clipped or invalid. standard_error: (24, 3), of the
    means. corners: (4, 2) [px], clockwise from the outer corner of the first patch.
    """

    values: Array
    standard_error: Array
    corners: Array


def chart_spectra(source: str | Path = "BabelColor Average") -> tuple[Spectrum, ...]:
    """Reflectances of the 24 patches of a colour chart, in reading order from dark skin to black: 24 Spectra, 0…1.

    source: a chart of colour-science by name, or a CSV with a wavelength column [nm] and one column per patch.
    `InputError` for an unknown name, or another number of patches.
    """
    columns, wavelengths = _columns(source)
    if len(columns) != PATCHES:
        raise InputError(f"chart {source} has {len(columns)} spectra: a chart of {PATCHES} patches is needed")
    return tuple(Spectrum(wavelengths, column) for column in columns)


def read_chart(photograph: NDArray[Any], expected: ArrayLike, corners: ArrayLike | None = None) -> ChartReading:
    """Mean values of the central areas of the patches of a chart in the linear `photograph` (h, w, 3).

    photograph: NaN where invalid. expected: brightness of the patches, which determines the orientation of the chart:
    (24,) mean reflectance, or (24, 3) under the lamp, in R, G and B.
    corners: (4, 2) [px], clockwise from that of the first patch; detected by OpenCV if not given.
    `InputError` if no chart is detected, its brightness is not as expected, or its patches are too small.
    """
    if photograph.ndim != 3 or photograph.shape[2] != 3 or photograph.dtype == np.uint8:
        description = f"{photograph.dtype} of shape {photograph.shape}"
        raise InputError(
            f"a chart is read in a linear photograph of 16 bits or more, three channels: given {description}"
        )
    known = np.asarray(expected, np.float64)
    if corners is None:
        readings = [_upright(photograph, box, known) for box in _find(photograph)]
    else:
        readings = [_read(photograph, _given(corners, photograph))]
    correlations = [_correlation(reading.values, known) for reading in readings]
    if max(correlations) < CHART_CORRELATION:
        raise InputError(
            "the brightness of the patches does not match the chart's reflectances (correlation "
            f"{max(correlations):.2f}): check which chart it is, and give its corners clockwise from the dark skin "
            "patch"
        )
    matching = (of for of, found in zip(readings, correlations, strict=True) if found >= CHART_CORRELATION)
    return min(matching, key=_unevenness)


def _columns(source: str | Path) -> tuple[list[Any], Any]:
    if str(source).lower().endswith(".csv"):
        table = read_table(source)
        key = next((name for name in WAVELENGTH_COLUMNS if name in table), next(iter(table)))
        wavelengths = table.pop(key)
        return list(table.values()), wavelengths
    import colour

    charts: Mapping[str, Any] = colour.SDS_COLOURCHECKERS
    if source not in charts:
        raise InputError(f"no chart is called {str(source)!r}: give a CSV or one of {', '.join(charts)}")
    curves = list(charts[str(source)].values())
    return [curve.values for curve in curves], curves[0].wavelengths


def _find(photograph: NDArray[Any]) -> list[Array]:
    """Corners of the chart, (4, 2) [px], as OpenCV detects it in up to ENOUGH_DETECTIONS copies of the photograph.

    The detector's clusters begin at random numbers of each thread. With one thread, the same photograph gives the same
    corners.
    """
    import cv2

    shown = np.nan_to_num(photograph.astype(np.float32))
    top = float(np.percentile(shown, WHITE_PERCENTILE))
    if not top > 0.0:
        raise InputError("the photograph is black: give a photograph of the chart")
    shown /= top
    boxes: list[Array] = []
    with one_thread():
        for width, bright in DETECTION_COPIES:
            scale = width / photograph.shape[1]
            if scale > MOST_ENLARGED:
                continue
            copy = cv2.resize(shown, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
            cv2.setRNGSeed(0)
            detector = cv2.mcc.CCheckerDetector.create()
            if detector.process(np.ascontiguousarray(srgb_encode(bright * copy)[..., ::-1]), 1):
                boxes.append(np.array(detector.getBestColorChecker().getBox(), np.float64) / scale)
                if len(boxes) == ENOUGH_DETECTIONS:
                    break
    if not boxes:
        raise InputError(
            "no chart is detected in the photograph: fill more of it with the chart, or give its four corners"
        )
    return boxes


def _given(corners: ArrayLike, photograph: NDArray[Any]) -> Array:
    box = np.asarray(corners, np.float64)
    height, width = photograph.shape[:2]
    if box.shape != (4, 2) or not np.isfinite(box).all():
        raise InputError(f"a chart has four corners x, y: {box.size} numbers are given, give 8")
    if (box < 0).any() or (box > (width, height)).any():
        raise InputError(f"a corner lies outside the photograph of {width}x{height} px: {box.tolist()}")
    return box


def _read(photograph: NDArray[Any], box: Array) -> ChartReading:
    import cv2

    checker = cv2.mcc.CChecker.create()
    checker.setTarget(cv2.mcc.MCC24)
    checker.setBox([(float(x), float(y)) for x, y in box])
    middles = np.asarray(checker.getColorCharts(), np.float64).reshape(PATCHES, 4, 2)
    clipped = np.iinfo(photograph.dtype).max if np.issubdtype(photograph.dtype, np.integer) else np.inf
    values, errors = np.full((PATCHES, 3), np.nan), np.full((PATCHES, 3), np.nan)
    for patch, middle in enumerate(middles):
        x, y, width, height = cv2.boundingRect(np.rint(middle).astype(np.int32))
        corner = np.maximum((x, y), 0)
        around = photograph[corner[1] : max(y + height, 0), corner[0] : max(x + width, 0)]
        mask = np.zeros(around.shape[:2], np.uint8)
        cv2.fillConvexPoly(mask, np.rint(middle).astype(np.int32) - corner, 1)
        pixels = around[mask > 0].astype(np.float64)
        if len(pixels) < FEWEST_PATCH_PIXELS:
            raise InputError(f"the chart's patches have {len(pixels)} pixels only: photograph it from closer")
        for channel, of in enumerate(pixels.T):
            usable = of[(of < clipped) & (of != 0.0)]  # also excludes NaN; exactly 0: cut off in the dark
            if len(usable) >= USABLE_PATCH_SHARE * len(of):
                values[patch, channel] = usable.mean()
                errors[patch, channel] = usable.std(ddof=1) / np.sqrt(len(usable))
    return ChartReading(values, errors, box)


def _upright(photograph: NDArray[Any], box: Array, known: Array) -> ChartReading:
    """The reading of the chart as detected or turned by half a turn, whichever is nearer to its known brightness."""
    readings = [_read(photograph, turned) for turned in (box, box[[2, 3, 0, 1]])]
    return max(readings, key=lambda reading: _correlation(reading.values, known))


def _unevenness(reading: ChartReading) -> float:
    """Median relative standard error of the patches: least where the corners are right, so no patch has a border."""
    return float(np.nanmedian(reading.standard_error / np.abs(reading.values)))


def _correlation(values: Array, known: Array) -> float:
    """Correlation of the patches' brightness with `known`; each channel is normalised, so the lamp's colour cancels.

    Channels in which half of the patches are clipped, or which the lamp does not light, are left out.
    """
    fine = np.isfinite(values)
    lit = fine.sum(axis=0) >= PATCHES / 2
    if known.ndim == 2:
        lit &= known.max(axis=0) > LEAST_CHANNEL * known.max()
    usable = fine[:, lit].all(axis=1) if lit.any() else np.zeros(PATCHES, np.bool_)
    if usable.sum() < PATCHES / 2:
        raise InputError(f"{PATCHES - usable.sum()} of {PATCHES} patches are clipped or invalid: expose less")
    brightness = (values[usable][:, lit] / values[usable][:, lit].max(axis=0)).mean(axis=1)
    light = known[usable] if known.ndim == 1 else (known[:, lit] / known[:, lit].max(axis=0))[usable].mean(axis=1)
    return float(np.corrcoef(brightness, light)[0, 1])
