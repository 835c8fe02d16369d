"""Readings with the faults that real ones have, and how well a response is still calibrated from them.

Lights are 115 single ones; charts are a ColorChecker under lamps. Faults are drawn for each camera anew, but alike in
cases that differ only in what the fit knows.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.calibration.response.calibrate_response import overlap_matrix, solve_response
from hagoromo.calibration.response.chart_falloff import ChartReadings, falloff, share_of_light
from studies.response_bench import (
    CURVE_WAVELENGTHS,
    LEAST_PEAK_SHARE,
    READING_NOISE,
    Array,
    chart_under,
    correlation,
    known_lights,
    priors_without,
    summary,
)

LAMPS = ("D65", "A", "FL11", "FL2")  # of the chart
MANY_LAMPS, MANY_PAIRS, FINE_WAVELENGTHS = 25, 598, 101  # of the large set; 24 patches under each lamp
SHARED_ERROR = 0.05  # standard deviation of the factor that the readings of a lamp share in a channel
LARGE_NOISE = 0.03  # of a reading, relative
POWER, BLACK = 0.8, 0.05  # of readings over light; left in the readings, of their mean
LAMP_DISTANCE = 4.65  # of the lamp over a corner of the chart, in halves of its width: light falls to 0.71
CLIPPED_SHARE = 0.1  # of the readings of a channel, the brightest
REPEATED = (7, 31, 55, 79)  # pairs that hold the readings of those before them


class KnownSpectra(NamedTuple):
    """Known spectra: matrix (pairs, wavelengths) of the readings, and the lamp of each pair (pairs,)."""

    matrix: Array
    lamps: NDArray[np.intp]


Spoil = Callable[[Array, KnownSpectra, np.random.Generator], Array]  # readings (3, pairs) → those with a fault


class FaultyReadings(NamedTuple):
    """Readings with a fault, and what the fit knows: which lamp lit them, that the light may fall off."""

    name: str
    layout: KnownSpectra
    spoil: Spoil
    lamps_known: bool = False
    falloff_fitted: bool = False
    noise: float = READING_NOISE


def fault_cases() -> dict[str, list[FaultyReadings]]:
    """What was read → the cases of it."""
    lights, chart, many = single_lights(), chart_layout(LAMPS), many_pairs(CURVE_WAVELENGTHS)
    shared = f"errors of {100 * SHARED_ERROR:g} % shared by the readings of a lamp"
    noisy = f"noise of {100 * LARGE_NOISE:g} %"
    bent, black = f"light to the power {POWER:g}", f"a black of {100 * BLACK:g} % of the mean reading"
    return {
        f"{len(lights.lamps)} lights, each of mean 1": [
            FaultyReadings("no fault", lights, unspoilt),
            FaultyReadings(bent, lights, follow_power),
            FaultyReadings(black, lights, leave_black),
        ],
        f"Chart under {', '.join(LAMPS[:-1])} and {LAMPS[-1]}": [
            FaultyReadings("no fault", chart, unspoilt),
            FaultyReadings(f"{shared}, lamps not known", chart, share_errors),
            FaultyReadings(f"{shared}, lamps known", chart, share_errors, lamps_known=True),
            FaultyReadings(f"{noisy}, lamps not known", chart, unspoilt, noise=LARGE_NOISE),
            FaultyReadings(f"{noisy}, lamps known", chart, unspoilt, lamps_known=True, noise=LARGE_NOISE),
            FaultyReadings(bent, chart, follow_power),
            FaultyReadings(black, chart, leave_black),
            FaultyReadings("light falls off over each chart, not fitted", chart, fall_off),
            FaultyReadings(
                "light falls off over each chart, fitted", chart, fall_off, lamps_known=True, falloff_fitted=True
            ),
            FaultyReadings(f"the brightest {100 * CLIPPED_SHARE:g} % are clipped", chart, clip),
            FaultyReadings(f"{len(REPEATED)} pairs repeat the one before", chart, repeat),
        ],
        f"{MANY_PAIRS} pairs, a chart under {MANY_LAMPS} lamps": [
            FaultyReadings("no fault", many, unspoilt),
            FaultyReadings(f"{shared}, lamps not known", many, share_errors),
            FaultyReadings(f"{shared}, lamps known", many, share_errors, lamps_known=True),
        ],
    }  # fmt: skip


def single_lights() -> KnownSpectra:
    """115 lights, each by itself."""
    matrix = known_lights() @ overlap_matrix(CURVE_WAVELENGTHS)
    return KnownSpectra(matrix, np.arange(len(matrix)))


def chart_layout(lamps: tuple[str, ...]) -> KnownSpectra:
    """A ColorChecker under `lamps`, each of mean 1."""
    return KnownSpectra(chart_under(lamps), np.repeat(np.arange(len(lamps)), 24))


def many_pairs(wavelengths: Array) -> KnownSpectra:
    """A ColorChecker under 25 of the lights, tabulated at `wavelengths`; under the last one, without two patches."""
    lights = known_lights()
    lights = lights[:: len(lights) // MANY_LAMPS][:MANY_LAMPS]
    patches = np.array([patch.at(wavelengths) for patch in hg.chart_spectra()])
    spectra = np.concatenate([patches * np.interp(wavelengths, CURVE_WAVELENGTHS, light) for light in lights])
    lamps = np.repeat(np.arange(len(lights)), len(patches))
    return KnownSpectra((spectra @ overlap_matrix(wavelengths))[:MANY_PAIRS], lamps[:MANY_PAIRS])


def unspoilt(readings: Array, layout: KnownSpectra, random: np.random.Generator) -> Array:
    """As they are."""
    return readings


def share_errors(readings: Array, layout: KnownSpectra, random: np.random.Generator) -> Array:
    """A wrong factor of each lamp in each channel."""
    factor = 1.0 + SHARED_ERROR * random.standard_normal((len(readings), int(layout.lamps.max()) + 1))
    return readings * factor[:, layout.lamps]


def follow_power(readings: Array, layout: KnownSpectra, random: np.random.Generator) -> Array:
    """A transfer that is not linear, around the mean reading."""
    mean = readings.mean(axis=1, keepdims=True)
    return mean * (readings / mean) ** POWER


def leave_black(readings: Array, layout: KnownSpectra, random: np.random.Generator) -> Array:
    """A black level that was not subtracted."""
    return readings + BLACK * readings.mean(axis=1, keepdims=True)


def fall_off(readings: Array, layout: KnownSpectra, random: np.random.Generator) -> Array:
    """A lamp that faces each chart from above one of its corners: I ∝ (1 + s²/d²)^(−3/2), s from the corner."""
    row, column = np.divmod(np.arange(24), 6)
    x, y = (column - 2.5) / 2.5, (row - 1.5) / 2.5
    corner = random.choice((-1.0, 1.0), size=(int(layout.lamps.max()) + 1, 2)) * (x.max(), y.max())
    square = (x - corner[:, :1]) ** 2 + (y - corner[:, 1:]) ** 2  # (lamps, 24)
    return readings * ((1.0 + square / LAMP_DISTANCE**2) ** -1.5).ravel()


def clip(readings: Array, layout: KnownSpectra, random: np.random.Generator) -> Array:
    """The brightest readings of each channel, cut to one value."""
    return np.minimum(readings, np.quantile(readings, 1.0 - CLIPPED_SHARE, axis=1, keepdims=True))


def repeat(readings: Array, layout: KnownSpectra, random: np.random.Generator) -> Array:
    """Some pairs hold the readings of those before them."""
    spoilt = readings.copy()
    spoilt[:, list(REPEATED)] = readings[:, np.array(REPEATED) - 1]
    return spoilt


def fault_score(case: FaultyReadings, cameras: Mapping[str, hg.Response], seed: int = 0) -> dict[str, Any]:
    """How well the curves of `cameras` are known from the readings of a case.

    correlation: channel → median and 10th percentile. coverage, and coverage_above_5_percent, of the curve's peak: of
    the 95 % intervals, in the unit in which the fitted curve is nearest to the true one. remarked: share of the
    calibrations that remark on a fault.
    """
    random = np.random.default_rng(seed)
    correlations, inside, bright, remarked = [], [], [], []
    for camera in cameras.values():
        true = np.array([camera.curve(channel).at(CURVE_WAVELENGTHS) for channel in range(3)])
        exact = true @ case.layout.matrix.T
        noisy = exact * (1.0 + case.noise * random.standard_normal(exact.shape))
        found = calibrated(case, case.spoil(noisy, case.layout, random), camera)
        values, bounds = found.response.values.T, np.moveaxis(found.interval_95, 1, 0)
        unit = ((values * true).sum(axis=1) / (values**2).sum(axis=1))[:, None]
        held = (true >= unit * bounds[..., 0]) & (true <= unit * bounds[..., 1])
        correlations.append([correlation(*pair) for pair in zip(values, true, strict=True)])
        inside.append(held.mean())
        bright.append(held[true > LEAST_PEAK_SHARE * true.max(axis=1, keepdims=True)].mean())
        remarked.append(bool(found.remarks()))
    return {
        "correlation": summary(np.array(correlations)),
        "coverage": float(np.mean(inside)),
        "coverage_above_5_percent": float(np.mean(bright)),
        "remarked": float(np.mean(remarked)),
    }


def calibrated(case: FaultyReadings, readings: Array, camera: hg.Response) -> hg.ResponseCalibration:
    """The calibration from readings (3, pairs), `camera` left out of the mean of published cameras."""
    matrix, lamps = case.layout
    given: dict[str, Array] = dict(zip(("R", "G", "B"), readings, strict=True))
    priors = partial(priors_without, camera)
    said: tuple[str, ...] = ()
    if case.falloff_fitted:
        chart = ChartReadings(CURVE_WAVELENGTHS, matrix, given, lamps, np.arange(len(lamps)) % 24)
        uneven = falloff(chart, {channel: priors(channel, CURVE_WAVELENGTHS) for channel in given})
        share = share_of_light(chart, uneven)
        given = chart.divided(share).readings
        said = ("the light falls off",) if np.ptp(share) > 0.0 else ()
    found = solve_response(CURVE_WAVELENGTHS, matrix, given, priors, lamps if case.lamps_known else None)
    return replace(found, findings=said)


def time_of_many(camera: hg.Response, seed: int = 0) -> dict[str, float]:
    """CPU time [s] of a calibration from 598 pairs of 101 wavelengths, with and without a fault."""
    wavelengths = np.linspace(CURVE_WAVELENGTHS[0], CURVE_WAVELENGTHS[-1], FINE_WAVELENGTHS)
    layout, random = many_pairs(wavelengths), np.random.default_rng(seed)
    exact = np.array([camera.curve(channel).at(wavelengths) for channel in range(3)]) @ layout.matrix.T
    noisy = exact * (1.0 + READING_NOISE * random.standard_normal(exact.shape))
    wrong = share_errors(noisy, layout, random)
    tasks = {
        "no fault": (noisy, None), "light to a power": (follow_power(noisy, layout, random), None),
        "errors shared by lamps, not known": (wrong, None), "errors shared by lamps, known": (wrong, layout.lamps),
    }  # fmt: skip
    times = {}
    for name, (readings, lamps) in tasks.items():
        start = time.process_time()
        solve_response(wavelengths, layout.matrix, dict(zip("RGB", readings, strict=True)), lamps=lamps)
        times[name] = time.process_time() - start
    return times
