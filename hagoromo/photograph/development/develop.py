"""Develop: files of photographs of one view → linear camera colours with their variance."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.sensor import Demosaic
from hagoromo.errors import InputError
from hagoromo.files.exif import read_exif
from hagoromo.files.picture import read_picture
from hagoromo.files.tiff import read_tiff
from hagoromo.photograph.development.develop_exposures import develop_exposures
from hagoromo.photograph.development.development import CalibrationFrames, Development
from hagoromo.photograph.development.exposure import TIFFS, Exposure, StatedExposure, read_exposure
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.transfer import Transfer, estimate_transfer
from hagoromo.photograph.development.undistort import undistorted
from hagoromo.photograph.one_exposure import middles_of

Paths = Sequence[str | Path]


def develop(
    photographs: str | Path | Paths,
    *,
    darks: Paths = (),
    dark_exposures_s: Sequence[float] = (),
    flats: Paths = (),
    transfer: str | Path | Transfer | None = None,
    exposures_s: Sequence[float] = (),
    iso: float | None = None,
    black: float | None = None,
    white: float | None = None,
    mosaic: str | None = None,
    gain: float | None = None,
    read_noise: float | None = None,
    noise_from: Paths = (),
    demosaic: Demosaic = "bilinear",
    undistort: str | Path | Camera | None = None,
) -> Development:
    """One photograph from the file of one exposure, or from a bracket of exposures of one view, which is merged.

    Values are light per second at ISO 100, with the white level as 1. Arguments override what the files state (RAW
    files state all of it):

    photographs: RAW, TIFF, PNG, JPEG or EXR. darks: frames without light, of the same exposure times.
    dark_exposures_s: their exposure times, in their order, if their files do not state them [s]. flats: frames of
    an evenly lit white field. transfer: of 8-bit files: "linear", "srgb", "estimate" (from the bracket), a CSV, or a
    curve. exposures_s: exposure times of the photographs, in their order [s]. black, white: levels [DN]. mosaic: of
    files with one channel, such as "RGGB", or "none". gain [e⁻/DN] and read_noise [e⁻]: both or neither;
    without them they are estimated from the frames, together with noise_from: further frames of this camera at this
    ISO, of any scenes. undistort: camera whose lens distortion is removed.

    `InputError` for files that cannot be developed together; see `develop_exposures`.
    """
    paths = [Path(path) for path in ([photographs] if isinstance(photographs, (str, Path)) else photographs)]
    if exposures_s and len(exposures_s) != len(paths):
        raise InputError(f"{len(exposures_s)} exposures for {len(paths)} photographs: give one each")
    if (gain is None) != (read_noise is None):
        raise InputError("gain and read_noise (--gain, --read-noise) go together: give both or none")
    if gain is not None and noise_from:
        raise InputError("gain (--gain) states the noise: omit noise_from (--noise-from), or gain and read_noise")
    noise = None if gain is None or read_noise is None else Noise(gain, read_noise)
    if transfer == "estimate":
        transfer = estimated_from_files(paths, exposures_s)
    stated = StatedExposure(black, white, mosaic, transfer, None, iso)
    times = list(exposures_s) or [None] * len(paths)
    exposures = [read_exposure(p, stated._replace(exposure_s=t)) for p, t in zip(paths, times, strict=True)]
    further = [Path(path) for path in noise_from if Path(path) not in paths]
    frames = CalibrationFrames(
        _darks(darks, dark_exposures_s, stated, exposures),
        [read_exposure(path, stated) for path in flats],
        noise,
        middles_of(further, stated, exposures[0].exif.iso),
    )
    development = develop_exposures(exposures, frames, demosaic)
    if undistort is not None:
        camera = undistort if isinstance(undistort, Camera) else read_camera(undistort)
        development = undistorted(development, camera)
    return replace(development, focal_px=exposures[0].exif.focal_px(development.values.shape[1]))


def _darks(
    paths: Paths, times: Sequence[float], stated: StatedExposure, exposures: Sequence[Exposure]
) -> list[Exposure]:
    """The dark frames with their own exposure times; where none is known, that of the photographs, if they have one."""
    if times and len(times) != len(paths):
        raise InputError(f"{len(times)} exposure times for {len(paths)} dark frames: give one each")
    each = list(times) or [None] * len(paths)
    darks = [read_exposure(path, stated._replace(exposure_s=t)) for path, t in zip(paths, each, strict=True)]
    known = {exposure.seconds for exposure in exposures}
    unknown = next((dark for dark in darks if dark.exif.exposure_s is None), None)
    if unknown is not None and len(known) > 1:
        raise InputError(
            f"{unknown.name} does not state its exposure time: state dark_exposures_s (--dark-exposures), one each"
        )
    return [
        dark if dark.exif.exposure_s is not None else replace(dark, exif=replace(dark.exif, exposure_s=min(known)))
        for dark in darks
    ]


def estimated_from_files(paths: Sequence[Path], exposures_s: Sequence[float]) -> Transfer:
    """The transfer curve estimated from a bracket; `InputError` if its exposure times are unknown."""
    times = list(exposures_s) or [read_exif(path).exposure_s for path in paths]
    known = [time for time in times if time is not None]
    if len(known) < len(times):
        raise InputError("the files of the bracket do not state their exposure times: state exposures_s (--exposures)")
    pictures = [(read_tiff if path.suffix.lower() in TIFFS else read_picture)(path) for path in paths]
    return estimate_transfer([picture[..., :3] if picture.ndim == 3 else picture for picture in pictures], known)
