"""Development: exposures of one view → linear camera colours with their variance (MODEL §7.1).

Black level and dark frames are subtracted, exposures are merged by their variance, the flat field is divided out,
clipped and hot samples are masked, and the mosaic is interpolated. Values are light per second at ISO 100 with the
white level as 1, as in a capture (EXR and float TIFF keep their own unit); they are not divided by the aperture.
"""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.sensor import Demosaic, demosaiced, native_of
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.finite import finite_json
from hagoromo.files.memory import require
from hagoromo.files.record import ForeignRecord, Pair, Positive, about, decode, json_value
from hagoromo.files.whole import whole_file
from hagoromo.photograph.development.bracket import BracketExposure, Merged, merge
from hagoromo.photograph.development.exposure import LINEAR_ROUNDING, Exposure, alike, planes
from hagoromo.photograph.development.linearity import Ratio, common_black, measured_seconds
from hagoromo.photograph.development.master import dark_master, flat_master, odd_samples
from hagoromo.photograph.development.movement import shift_between
from hagoromo.photograph.development.noise import Noise, noise_from_frames, noise_from_pairs
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import ALPHA, NATIVE, VALID, VARIANCE, default_channels
from hagoromo.photograph.transforms import ASSUMED_FULL_WELL, ASSUMED_READ_NOISE

BLOOM_PX = 3  # [px] clipped samples flood neighbours up to this distance: these are treated as clipped
STILL_PX = 0.25  # [px] largest shift between exposures of a bracket; a larger one blurs edges
BYTES_PER_SAMPLE = 40.0  # memory per sample of each exposure during the merge
RECORD = (
    "gain", "read_noise", "gain_standard_error", "read_noise_standard_error", "noise_from", "exposures_s", "ratios",
    "shifts_px", "clipped", "hot",
)  # fmt: skip
SAME_SETTING = 1e-3  # largest relative difference of equal apertures or ISO speeds


class DevelopmentRecord(ForeignRecord, frozen=True, kw_only=True):
    """The texts of an EXR of `develop`."""

    gain: Annotated[Positive, about("electrons per digital number [e⁻/DN]")]
    read_noise: Annotated[float, about("standard deviation of the read noise [e⁻]")]
    gain_standard_error: Annotated[float, about("of the gain [e⁻/DN]")]
    read_noise_standard_error: Annotated[float, about("of the read noise [e⁻]")]
    noise_from: Annotated[str, about("where both are from")]
    exposures_s: Annotated[dict[str, float], about("name of each exposure, and its time [s]")]
    ratios: Annotated[list[dict[str, float]], about("ratio of the signals of each two exposures, error and bend")]
    shifts_px: Annotated[dict[str, Pair], about("name of each exposure, and its shift [px]")]
    clipped: Annotated[float, about("share of samples that are clipped in all exposures")]
    hot: Annotated[float, about("share of hot samples")]


@dataclass(frozen=True, eq=False)
class CalibrationFrames:
    """Frames that calibrate the sensor: darks, flats (evenly lit white field); noise, if it is known."""

    darks: Sequence[Exposure] = ()
    flats: Sequence[Exposure] = ()
    noise: Noise | None = None


@dataclass(frozen=True, eq=False)
class Development:
    """A developed photograph.

    values, variance: (height, width, channels) float32; valid: (height, width); native: as `Photograph`. noise: of the
    sensor. exposures: name → measured exposure time [s]. ratios: of successive exposures. shifts: name → (x, y) [px]
    relative to the first. clipped: share of samples that are clipped in all exposures; hot: share of hot samples.
    focal_px: focal length [px], if the files state it. undistorted: whether the lens distortion has been removed.
    valid_channels: (height, width, channels), where each colour by itself is valid. black_offset: common black that was
    found in the signals and removed [DN].
    """

    values: NDArray[np.float32]
    variance: NDArray[np.float32]
    valid: NDArray[np.bool_]
    native: NDArray[np.bool_] | None
    noise: Noise
    exposures: dict[str, float]
    ratios: list[Ratio]
    shifts: dict[str, tuple[float, float]]
    clipped: float
    hot: float
    focal_px: float | None = None
    undistorted: bool = False
    valid_channels: NDArray[np.bool_] | None = None
    black_offset: float = 0.0

    def __repr__(self) -> str:
        """The size and the exposures."""
        height, width, channels = self.values.shape
        return f"Development({width} × {height} px, {channels} channels, {len(self.exposures)} exposures)"

    def photograph(self, camera: Camera, name: str = "") -> Photograph:
        """The photograph, taken by `camera`."""
        return Photograph(self.values, self.variance, self.valid, camera, (), name, self.native)

    def record(self) -> dict[str, Any]:
        """Plain values of all results except the pixels."""
        return {
            "gain": self.noise.gain,
            "gain_standard_error": self.noise.gain_error,
            "read_noise": self.noise.read_noise,
            "read_noise_standard_error": self.noise.read_error,
            "noise_from": self.noise.source,
            "exposures_s": self.exposures,
            "ratios": [ratio._asdict() for ratio in self.ratios],
            "linearity": "tested" if self.ratios else "not tested: one exposure, or too few samples shared by two",
            "shifts_px": {name: list(shift) for name, shift in self.shifts.items()},
            "clipped": self.clipped,
            "hot": self.hot,
            "black_offset": self.black_offset,
        }

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write an EXR and return its path: R, G, B, their `variance.`, `native.` after interpolation, A (valid).

        Where some colours of a pixel are valid and others are not, it also has `valid.` of each.

        `InputError` for a name that does not end in .exr, or an existing file without `force`.
        """
        names = default_channels(self.values.shape[2])
        layers = {"": self.values, VARIANCE: self.variance}
        if self.native is not None:
            layers[NATIVE] = self.native.astype(np.float32)
        if self.valid_channels is not None and (self.valid_channels != self.valid[..., None]).any():
            layers[VALID] = self.valid_channels.astype(np.float32)
        channels = {prefix + name: layer[..., i] for prefix, layer in layers.items() for i, name in enumerate(names)}
        header = {key: finite_json(value, str(path)) for key, value in self.record().items()}
        header["colourSpace"] = "camera, linear, light per second at ISO 100, white level 1"
        if self.focal_px is not None:
            header["focal_px"] = f"{self.focal_px:.6g}"
        if self.undistorted:
            header["undistorted"] = "true"
        with whole_file(check_exr_name(path), force) as partial:
            write_exr(partial, {**channels, ALPHA: self.valid.astype(np.float32)}, header)
        return Path(path)

    @staticmethod
    def load(path: str | Path) -> Development:
        """The development in an EXR that `save` wrote; `InputError` for any other file."""
        layers, header = read_exr(path)
        try:
            names = default_channels(sum(name.startswith(VARIANCE) for name in layers))
            values, variance = (np.stack([layers[kind + name] for name in names], axis=2) for kind in ("", VARIANCE))
            native, fine = (
                np.stack([layers[kind + name] > 0.5 for name in names], 2) if kind + names[0] in layers else None
                for kind in (NATIVE, VALID)
            )
            record = {key: json_value(header[key], f"{path}: {key}") for key in RECORD}
            decode(record, DevelopmentRecord, str(path))
            valid, focal = layers[ALPHA] == 1.0, header.get("focal_px")
            return Development(
                values, variance, np.asarray(valid, np.bool_), native,
                Noise(*(record[key] for key in RECORD[:5])), record["exposures_s"],
                [Ratio(**ratio) for ratio in record["ratios"]],
                {name: (x, y) for name, (x, y) in record["shifts_px"].items()}, record["clipped"], record["hot"],
                None if focal is None else float(focal), "undistorted" in header, fine,
                float(header.get("black_offset", 0.0)),
            )  # fmt: skip
        except (KeyError, ValueError, IndexError, TypeError, AttributeError) as error:
            raise InputError(f"{path} is not a developed photograph: develop one first ({error})") from error


def check_exr_name(path: str | Path) -> Path:
    """`path`; `InputError` if its suffix is not .exr."""
    if Path(path).suffix.lower() != ".exr":
        raise InputError(f"{path} is not the name of an EXR: give a name that ends in .exr")
    return Path(path)


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
    usual = Noise(ASSUMED_FULL_WELL / exposures[0].white, ASSUMED_READ_NOISE, source="a usual sensor: assumed")
    shots = _shots(exposures, calibration, calibration.noise or usual)[0]
    shifts = {names[i]: shift_between(shots[0], shots[i], usual, mosaic) for i in range(1, len(shots))}
    _check_still(shifts, names[0])
    # of the shortest, the neighbours in other colours are kept: no exposure shows them better
    exposures = [_without_bloom(one, across=i > 0) for i, one in enumerate(exposures)]
    exposures, black = _without_black(exposures, calibration, calibration.noise or usual)
    shots = _shots(exposures, calibration, calibration.noise or usual)[0]
    measured_seconds(shots, names, calibration.noise or usual, mosaic)  # else the noise would be biased as well
    noise = calibration.noise or _noise(exposures, calibration, usual)
    shots, dark_hot = _shots(exposures, calibration, noise)
    seconds, ratios = measured_seconds(shots, names, noise, mosaic)
    merged = merge([s._replace(seconds=t) for s, t in zip(shots, seconds, strict=True)], noise, mosaic)
    hot = odd_samples(merged.rate, merged.variance, merged.valid, mosaic)
    hot |= dark_hot
    merged = merged._replace(valid=merged.valid & ~hot)
    if calibration.flats:
        merged = _flattened(merged, calibration, noise)
    values, variance, fine, native = _filled(merged, mosaic, demosaic)
    valid = np.all(fine, axis=2)
    _check_left(fine, clipped)
    unit = (exposures[0].unit or exposures[0].white) * exposures[0].iso / 100.0
    return Development(
        (values / unit).astype(np.float32),
        (variance / unit**2).astype(np.float32),
        valid,
        native,
        noise,
        dict(zip(names, seconds, strict=True)),
        ratios,
        shifts,
        clipped,
        float(hot.mean()),
        valid_channels=fine,
        black_offset=black,
    )


def _without_bloom(one: Exposure, across: bool) -> Exposure:
    """With the neighbours of clipped samples marked as clipped; across: those of other colours of a mosaic, too."""
    from scipy.ndimage import binary_dilation

    full = np.array(one.full, np.bool_)
    if full.any():
        if one.mosaic and across:
            full |= np.asarray(binary_dilation(one.full, np.ones((2 * BLOOM_PX + 1,) * 2)), np.bool_)
        reach = -(-BLOOM_PX // 2) if one.mosaic else BLOOM_PX
        for plane, grown in zip(planes(one.full, one.mosaic), planes(full, one.mosaic), strict=True):
            grown |= np.asarray(binary_dilation(plane, np.ones((2 * reach + 1,) * 2)), np.bool_)
    return replace(one, full=full)


def _without_black(
    exposures: Sequence[Exposure], calibration: CalibrationFrames, noise: Noise
) -> tuple[list[Exposure], float]:
    """The exposures plus their common black [DN], which makes them proportional; 0 with darks, which measure it."""
    exact = all(
        np.isclose(np.median(one.rounding), LINEAR_ROUNDING, rtol=1e-3) for one in exposures
    )  # whole linear numbers
    if calibration.darks or not exact:
        return list(exposures), 0.0
    black = common_black(_shots(exposures, calibration, noise)[0], noise, exposures[0].mosaic)
    if black == 0.0:
        return list(exposures), 0.0
    return [replace(one, signal=one.signal + np.float32(black), white=one.white + black) for one in exposures], black


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


def _noise(exposures: Sequence[Exposure], calibration: CalibrationFrames, usual: Noise) -> Noise:
    """Noise from pairs of flats, of the bracket and of darks, each frame used once; without pairs, from single frames.

    If it cannot be estimated, as from JPEGs that the camera smoothed, `usual` with a warning.
    """
    lit = [*_pairs(calibration.flats), *_pairs(exposures)]
    dark = [(one, other) for one, other in _pairs(calibration.darks) if one.seconds == other.seconds]
    try:
        return noise_from_pairs([*lit, *dark]) if lit else noise_from_frames([*calibration.flats, *exposures])
    except InputError as error:
        warnings.warn(f"{error}; the noise of a typical sensor is assumed", stacklevel=3)
        return usual


def _pairs(frames: Sequence[Exposure]) -> list[tuple[Exposure, Exposure]]:
    ordered = sorted(frames, key=lambda one: one.seconds)
    return list(zip(ordered[::2], ordered[1::2], strict=False))


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
