"""`hagoromo develop`: exposures of one view → one EXR of linear camera colours with their variance."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.sensor import Demosaic
from hagoromo.errors import InputError
from hagoromo.files.exif import read_exif
from hagoromo.files.exr import write_exr
from hagoromo.files.picture import read_picture
from hagoromo.files.whole import whole_file
from hagoromo.photograph.development.develop import Calibration, Development, develop
from hagoromo.photograph.development.exposure import Given, read_exposure
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.transfer import Transfer, estimate_transfer
from hagoromo.photograph.development.undistort import undistorted
from hagoromo.photograph.pixels import ALPHA, NATIVE, VARIANCE, default_channels


@dataclass(frozen=True)
class Frames:
    """Paths: photographs of one view, dark frames, flat fields."""

    photographs: Sequence[Path]
    darks: Sequence[Path] = ()
    flats: Sequence[Path] = ()


def develop_to(
    frames: Frames,
    out: Path,
    given: Given,
    exposures_s: Sequence[float],
    noise: Noise | None,
    demosaic: Demosaic,
    force: bool,
    undistort: Path | None = None,
) -> Development:
    """Write the EXR `out`: R, G, B, their `variance.`, `native.` where interpolated, A (1 where valid).

    exposures_s: of the photographs in their order, where their files do not tell. undistort: file of the camera whose
    distortion is taken out.
    """
    if exposures_s and len(exposures_s) != len(frames.photographs):
        raise InputError(f"{len(exposures_s)} exposures for {len(frames.photographs)} photographs: give one each")
    if out.suffix.lower() != ".exr":
        raise InputError(f"{out} must be an EXR: give a name that ends in .exr")
    if given.transfer == "estimate":
        given = given._replace(transfer=_estimated(frames.photographs, exposures_s))
    times = list(exposures_s) or [None] * len(frames.photographs)
    with whole_file(out, force) as partial:
        shots = [read_exposure(p, given._replace(exposure_s=t)) for p, t in zip(frames.photographs, times, strict=True)]
        calibration = Calibration(
            [read_exposure(path, given) for path in frames.darks],
            [read_exposure(path, given) for path in frames.flats],
            noise,
        )
        found = develop(shots, calibration, demosaic)
        if undistort is not None:
            found = undistorted(found, read_camera(undistort))
        _write(partial, found, shots[0].exif.focal_px(found.values.shape[1]))
    return found


def summary(found: Development) -> list[str]:
    """What was found, in lines."""
    noise, record = found.noise, found.record()
    lines = [
        f"gain {noise.gain:.4g} ± {noise.gain_error:.2g} e⁻/DN, read noise {noise.read_noise:.3g} ± "
        f"{noise.read_error:.2g} e⁻, from {noise.source}",
        f"linearity {record['linearity']}; clipped {100 * found.clipped:.2g} %, hot {100 * found.hot:.2g} % of samples",
    ]
    for name, (x, y) in found.shifts.items():
        lines.append(f"{name}: exposed {found.exposures[name]:.6g} s, moved by ({x:.2f}, {y:.2f}) px")
    return lines


def _estimated(paths: Sequence[Path], exposures_s: Sequence[float]) -> Transfer:
    times = list(exposures_s) or [read_exif(path).exposure_s for path in paths]
    told = [time for time in times if time is not None]
    if len(told) < len(times):
        raise InputError("the exposures of the bracket are not in its files: state --exposures")
    pictures = [read_picture(path) for path in paths]
    return estimate_transfer(pictures, told)


def _write(path: Path, found: Development, focal_px: float | None) -> None:
    names = default_channels(found.values.shape[2])
    layers = {"": found.values, VARIANCE: found.variance}
    if found.native is not None:
        layers[NATIVE] = found.native.astype(np.float32)
    channels = {prefix + name: layer[..., i] for prefix, layer in layers.items() for i, name in enumerate(names)}
    known = {key: json.dumps(value, ensure_ascii=False) for key, value in found.record().items()}
    known["colourSpace"] = "camera, linear, light per second at ISO 100, white level 1"
    if focal_px is not None:
        known["focal_px"] = f"{focal_px:.6g}"
    write_exr(path, {**channels, ALPHA: found.valid.astype(np.float32)}, known)
