"""Develop exposures: exposures of one view → linear camera colours with their variance (MODEL §7.1).

Black level and dark frames are subtracted, exposures are merged by their variance, the flat field is divided out,
clipped and hot samples are masked, and the mosaic is interpolated.

Black: what a camera subtracted too much from each frame of a bracket, found by the frames' proportion.

Cameras measure their black level anew for each frame, on covered samples, and are off by −0.2 to 1 DN. With the black δ
of both frames added, signals l and h of a pair are proportional at every level: h + δ_j = ρ (l + δ_i). This leaves one
number open, a δ in proportion to the exposure, as constant light has it. It is bounded by the darkest level, which has
no light below 0, and else by what is usual: the frames of one camera have similar blacks.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from hagoromo.camera.sensor import Demosaic, demosaiced, native_of
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.photograph.development.bracket import BracketExposure, Merged, merge, shift_between
from hagoromo.photograph.development.development import CalibrationFrames, Development
from hagoromo.photograph.development.exposure import LINEAR_ROUNDING, Exposure, alike
from hagoromo.photograph.development.linearity import Array, SignalLevels, levels_of, measured_seconds
from hagoromo.photograph.development.master import dark_master, flat_master, odd_samples
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.noise_estimate import estimated_noise, usual_noise, without_bloom
from hagoromo.photograph.pixels import default_channels

STILL_PX = 0.25  # [px] largest shift between exposures of a bracket; a larger one blurs edges
BYTES_PER_SAMPLE = 40.0  # memory per sample of each exposure during the merge
SAME_SETTING = 1e-3  # largest relative difference of equal apertures or ISO speeds
BLACK_RANGE = (-0.2, 1.0)  # [DN] cameras over-subtract by up to 1 DN; more is a wrong level, not this
COMMON_SPREAD, FRAME_SPREAD = 0.5, 0.35  # [DN] expected: of the mean of all frames about 0, of a frame about the mean
LEAST_LIGHT = 2.0  # [DN] of the brightest level of a frame that has light: more than a black
CHANCE = 6e-5  # largest probability that frames without an offset have one: four standard errors


def develop_exposures(
    exposures: Sequence[Exposure], calibration: CalibrationFrames | None = None, demosaic: Demosaic = "bilinear"
) -> Development:
    """One photograph from one or more exposures of one view.

    `InputError` for exposures of different type, aperture or ISO, a bracket without exposure times, a non-linear
    response, or frames that moved.
    """
    calibration = calibration or CalibrationFrames()
    if not exposures:
        raise InputError("no photograph is given: give at least one")
    exposures = sorted(exposures, key=lambda one: one.seconds)
    alike([*exposures, *calibration.darks, *calibration.flats], "photographs and frames")
    _check_settings(exposures, calibration)
    require(BYTES_PER_SAMPLE * exposures[0].signal.size * len(exposures), f"a bracket of {len(exposures)}")
    mosaic, names = exposures[0].mosaic, [one.name for one in exposures]
    clipped = float(np.all([one.full for one in exposures], axis=0).mean())
    usual = usual_noise(exposures[0])
    shots = _shots(exposures, calibration, calibration.noise or usual)[0]
    shifts = {names[i]: shift_between(shots[0], shots[i], usual, mosaic) for i in range(1, len(shots))}
    _check_still(shifts, names[0])
    # of the shortest, the neighbours in other colours are kept: no exposure shows them better
    exposures = [without_bloom(one, across=i > 0) for i, one in enumerate(exposures)]
    rough = calibration.noise or _noise(exposures, calibration)[0]
    exposures, blacks = _without_black(exposures, calibration, rough)
    shots = _shots(exposures, calibration, rough)[0]
    measured_seconds(shots, names, rough, mosaic)  # a response that is not linear is no noise: it is said first
    noise = calibration.noise or _said(*_noise(exposures, calibration))
    shots, dark_hot = _shots(exposures, calibration, noise)
    seconds, ratios = measured_seconds(shots, names, noise, mosaic)
    merged = merge([s._replace(seconds=t) for s, t in zip(shots, seconds, strict=True)], noise, mosaic)
    hot = odd_samples(merged.rate, merged.variance, merged.valid, mosaic)
    hot |= dark_hot
    merged = merged._replace(valid=merged.valid & ~hot)
    if calibration.flats:
        merged = _flattened(merged, calibration, noise)
    values, variance, fine, native = _filled(merged, mosaic, demosaic)
    _check_left(fine, clipped)
    unit = (exposures[0].unit or exposures[0].white) * exposures[0].iso / 100.0
    return Development(
        (values / unit).astype(np.float32),
        (variance / unit**2).astype(np.float32),
        np.all(fine, axis=2),
        native,
        noise,
        dict(zip(names, seconds, strict=True)),
        ratios,
        shifts,
        clipped,
        float(hot.mean()),
        valid_channels=fine,
        blacks=dict(zip(names, blacks.offsets, strict=True)) if any(blacks.offsets) else {},
        black_errors=dict(zip(names, blacks.errors, strict=True)) if any(blacks.offsets) else {},
    )


def _without_black(
    exposures: Sequence[Exposure], calibration: CalibrationFrames, noise: Noise
) -> tuple[list[Exposure], Blacks]:
    """The exposures plus the black of each [DN], by which they are proportional; 0 with darks, which measure it."""
    exact = all(
        np.isclose(np.median(one.rounding), LINEAR_ROUNDING, rtol=1e-3) for one in exposures
    )  # whole linear numbers
    if calibration.darks or not exact:
        return list(exposures), no_blacks(len(exposures))
    blacks = frame_blacks(_shots(exposures, calibration, noise)[0], noise, exposures[0].mosaic)
    return [
        replace(one, signal=one.signal + np.float32(black), white=one.white + black) if black else one
        for one, black in zip(exposures, blacks.offsets, strict=True)
    ], blacks


def _noise(exposures: Sequence[Exposure], calibration: CalibrationFrames) -> tuple[Noise, str]:
    """The noise by all frames, and why it is not known, if it is not."""
    return estimated_noise([calibration.flats, exposures], calibration.others, calibration.darks)


def _said(noise: Noise, why: str) -> Noise:
    """The noise, with a warning where it is not known."""
    if why:
        warnings.warn(why, stacklevel=4)
    return noise


def _check_left(fine: NDArray[np.bool_], clipped: float) -> None:
    """`InputError` if no value of any colour is valid; a warning if some colours have no valid value."""
    if not fine.any():
        raise InputError(f"no pixel is left ({100 * clipped:.0f} % of the samples are clipped): add a shorter exposure")
    names = default_channels(fine.shape[2])
    lost = [name for name, layer in zip(names, np.moveaxis(fine, 2, 0), strict=True) if not layer.any()]
    if lost:
        kept = ", ".join(name for name in names if name not in lost)
        warnings.warn(
            f"{', '.join(lost)} is clipped everywhere and {kept} is not: add a shorter exposure, or use {kept} only",
            stacklevel=3,
        )


def _check_settings(exposures: Sequence[Exposure], calibration: CalibrationFrames) -> None:
    frames = [*calibration.darks, *calibration.flats]
    odd = next((one for one in frames if abs(one.iso / exposures[0].iso - 1.0) > SAME_SETTING), None)
    if odd is not None:
        raise InputError(
            f"{odd.name} has ISO {odd.iso:g} and the photographs {exposures[0].iso:g}: take both at one ISO"
        )
    if len(exposures) > 1 and any(one.exif.exposure_s is None for one in exposures):
        raise InputError("the files of the bracket do not state their exposure times: state exposures_s (--exposures)")
    for what, key in (("ISO", "iso"), ("apertures", "f_number")):
        figures = [figure for one in exposures if (figure := getattr(one.exif, key)) is not None]
        if figures and max(figures) > (1.0 + SAME_SETTING) * min(figures):
            raise InputError(
                f"the bracket has different {what} ({min(figures):g} and {max(figures):g}): vary the exposure time only"
            )


def _check_still(shifts: dict[str, tuple[float, float]], first: str) -> None:
    for name, (x, y) in shifts.items():
        if np.hypot(x, y) > STILL_PX:
            raise InputError(
                f"{name} has moved by ({x:.2f}, {y:.2f}) px relative to {first}: fix camera and object, or leave it out"
            )


def _shots(
    exposures: Sequence[Exposure], calibration: CalibrationFrames, noise: Noise
) -> tuple[list[BracketExposure], NDArray[np.bool_]]:
    """The exposures minus their dark frames, and the hot samples of these."""
    hot = np.zeros(exposures[0].signal.shape, np.bool_)
    shots = []
    for one in exposures:
        signal, dark, variance = one.signal, 0.0, 0.0
        if calibration.darks:
            master = dark_master(calibration.darks, one.seconds, noise)
            hot |= master.hot
            signal, dark, variance = one.signal - master.signal, master.signal, master.variance
        shots.append(BracketExposure(signal, dark, variance, one.rounding, one.full, one.white, one.seconds, one.curve))
    return shots, hot


def _flattened(merged: Merged, calibration: CalibrationFrames, noise: Noise) -> Merged:
    flat = flat_master(calibration.flats, calibration.darks, noise)
    share = np.where(flat.usable, flat.share, 1.0)
    rate = merged.rate / share
    variance = merged.variance / share**2 + rate**2 * flat.variance / share**2
    return Merged(rate.astype(np.float32), variance.astype(np.float32), merged.valid & flat.usable)


def _filled(
    merged: Merged, mosaic: str, demosaic: Demosaic
) -> tuple[NDArray, NDArray, NDArray, NDArray[np.bool_] | None]:
    """Values, variance, valid and native (height, width, channels), with or without a mosaic."""
    if not mosaic:
        return merged.rate, merged.variance, merged.valid, None
    rate, variance = merged.rate.astype(np.float64), merged.variance.astype(np.float64)
    values, spread, spoilt = demosaiced(rate, variance, ~merged.valid, mosaic, demosaic)
    native = native_of(mosaic, *rate.shape)
    if demosaic != "bilinear":  # which interpolates each colour from all
        return values, spread, np.repeat(~spoilt[..., None], 3, axis=2), native
    from scipy.ndimage import binary_dilation

    lost = [binary_dilation(np.logical_not(merged.valid) & native[..., k], np.ones((3, 3))) for k in range(3)]
    return values, spread, np.logical_not(np.stack(lost, axis=2)), native


class Blacks(NamedTuple):
    """Offsets to add to the signals of each frame, and their standard errors [DN]; 0 where none is evident."""

    offsets: list[float]
    errors: list[float]


def no_blacks(frames: int) -> Blacks:
    """Of so many frames without an offset."""
    return Blacks([0.0] * frames, [0.0] * frames)


def frame_blacks(shots: Sequence[BracketExposure], noise: Noise, mosaic: str) -> Blacks:
    """Offset [DN] to add to the signals of each of the `shots`, from the shortest on, so that they are proportional.

    ρ is free for each colour of each pair of successive exposures; the black is that of all colours of a frame, within
    `BLACK_RANGE`. All are 0 unless the misfit without them is significant.
    """
    from scipy.optimize import least_squares

    pairs = [
        (number, other.seconds / one.seconds, levels)
        for number, (one, other) in enumerate(pairwise(shots))
        for levels in _lit(levels_of(one, other, noise, mosaic))
    ]
    nothing = np.zeros(len(shots) + 1)  # the blacks, and their mean
    if not pairs:
        return no_blacks(len(shots))

    def off(at: Array) -> Array:
        return np.concatenate([_off(levels, stated, at[n], at[n + 1]) for n, stated, levels in pairs])

    def usual(at: Array) -> Array:
        return np.r_[(at[:-1] - at[-1]) / FRAME_SPREAD, at[-1] / COMMON_SPREAD]

    solved = least_squares(lambda at: np.r_[off(at), usual(at)], nothing, bounds=BLACK_RANGE, x_scale=0.1)
    left, without = (float(np.sum(off(at) ** 2)) for at in (solved.x, nothing))
    misfit = max(left / max(sum(len(levels.low) - 1 for *_, levels in pairs) - len(shots), 1), 1.0)
    if without - left <= float(chi2.isf(CHANCE, len(shots))) * misfit:
        return no_blacks(len(shots))
    errors = np.sqrt(misfit * np.diag(np.linalg.inv(solved.jac.T @ solved.jac)))
    return Blacks(solved.x[:-1].tolist(), errors[:-1].tolist())


def _lit(colours: list[SignalLevels]) -> list[SignalLevels]:
    """The levels of a pair if any colour has light in both frames: with none, a black is all that they would show."""
    return colours if max((float(of.low.max()) for of in colours), default=0.0) > LEAST_LIGHT else []


def _off(levels: SignalLevels, stated: float, first: float, second: float) -> Array:
    """Misfit in standard errors of one colour of a pair with the blacks added: of its ratio, fitted, and light below 0.

    stated: ratio of the exposure times, for the weights.
    """
    low, high = levels.low + first, levels.high + second
    weight = 1.0 / (levels.high_variance + stated**2 * levels.low_variance)
    ratio = (weight * high * low).sum() / (weight * low**2).sum()
    below = np.minimum(low, 0.0) / np.sqrt(levels.low_variance), np.minimum(high, 0.0) / np.sqrt(levels.high_variance)
    return np.concatenate([np.sqrt(weight) * (high - ratio * low), *below])
