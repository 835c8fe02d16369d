"""Develop exposures: exposures of one view → linear camera colours with their variance (MODEL §7.1).

Black level and dark frames are subtracted, exposures are merged by their variance, the flat field is divided out,
clipped and hot samples are masked, and the mosaic is interpolated.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.sensor import Demosaic, demosaiced, native_of
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.photograph.development.black import Blacks, frame_blacks, no_blacks
from hagoromo.photograph.development.bloom import without_bloom
from hagoromo.photograph.development.bracket import BracketExposure, Merged, merge
from hagoromo.photograph.development.development import CalibrationFrames, Development
from hagoromo.photograph.development.exposure import LINEAR_ROUNDING, Exposure, alike
from hagoromo.photograph.development.linearity import measured_seconds
from hagoromo.photograph.development.master import dark_master, flat_master, odd_samples
from hagoromo.photograph.development.movement import shift_between
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.noise_estimate import estimated_noise, usual_noise
from hagoromo.photograph.pixels import default_channels

STILL_PX = 0.25  # [px] largest shift between exposures of a bracket; a larger one blurs edges
BYTES_PER_SAMPLE = 40.0  # memory per sample of each exposure during the merge
SAME_SETTING = 1e-3  # largest relative difference of equal apertures or ISO speeds


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
