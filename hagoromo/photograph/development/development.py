"""Development: linear camera colours of one view with their variance, and what was found while they were made.

Values are light per second at ISO 100 with the white level as 1, as in a capture (EXR and float TIFF keep their own
unit); they are not divided by the aperture.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.finite import finite_json
from hagoromo.files.record import ForeignRecord, Pair, Positive, about, decode, json_value
from hagoromo.files.whole import whole_file
from hagoromo.photograph.development.exposure import Exposure
from hagoromo.photograph.development.linearity import Ratio
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import ALPHA, NATIVE, VALID, VARIANCE, default_channels

RECORD = (
    "gain", "read_noise", "gain_standard_error", "read_noise_standard_error", "noise_from", "exposures_s", "ratios",
    "shifts_px", "clipped", "hot",
)  # fmt: skip


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
    blacks: Annotated[dict[str, float], about("name of each exposure, and what was added to its signals [DN]")]
    black_errors: Annotated[dict[str, float], about("name of each exposure, and the standard error of that [DN]")]


@dataclass(frozen=True, eq=False)
class CalibrationFrames:
    """Frames that calibrate the sensor: darks, flats (evenly lit white field); noise, if it is known.

    others: further frames of this camera at this ISO, of any scene, whose noise is estimated together with that of the
    photographs; a part of each will do.
    """

    darks: Sequence[Exposure] = ()
    flats: Sequence[Exposure] = ()
    noise: Noise | None = None
    others: Sequence[Exposure] = ()


@dataclass(frozen=True, eq=False)
class Development:
    """A developed photograph.

    values, variance: (height, width, channels) float32; valid: (height, width); native: as `Photograph`. noise: of the
    sensor. exposures: name → measured exposure time [s]. ratios: of successive exposures. shifts: name → (x, y) [px]
    relative to the first. clipped: share of samples that are clipped in all exposures; hot: share of hot samples.
    focal_px: focal length [px], if the files state it. undistorted: whether the lens distortion has been removed.
    valid_channels: (height, width, channels), where each colour by itself is valid. blacks: name → offset that was
    found in the signals of a frame and added to them [DN]; empty where none was. black_errors: their standard errors.
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
    blacks: dict[str, float] = field(default_factory=dict)
    black_errors: dict[str, float] = field(default_factory=dict)

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
            "gain_interval_95": list(self.noise.gain_interval),
            "read_noise": self.noise.read_noise,
            "read_noise_standard_error": self.noise.read_error,
            "noise_from": self.noise.source,
            "exposures_s": self.exposures,
            "ratios": [ratio._asdict() for ratio in self.ratios],
            "linearity": "tested" if self.ratios else "not tested: one exposure, or too few samples shared by two",
            "shifts_px": {name: list(shift) for name, shift in self.shifts.items()},
            "clipped": self.clipped,
            "hot": self.hot,
            "blacks": self.blacks,
            "black_errors": self.black_errors,
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
            blacks = {key: json_value(header.get(key, "{}"), f"{path}: {key}") for key in ("blacks", "black_errors")}
            decode({**record, **blacks}, DevelopmentRecord, str(path))
            valid, focal = layers[ALPHA] == 1.0, header.get("focal_px")
            return Development(
                values, variance, np.asarray(valid, np.bool_), native,
                Noise(*(record[key] for key in RECORD[:5])), record["exposures_s"],
                [Ratio(**ratio) for ratio in record["ratios"]],
                {name: (x, y) for name, (x, y) in record["shifts_px"].items()}, record["clipped"], record["hot"],
                None if focal is None else float(focal), "undistorted" in header, fine,
                **blacks,
            )  # fmt: skip
        except (KeyError, ValueError, IndexError, TypeError, AttributeError) as error:
            raise InputError(f"{path} is not a developed photograph: develop one first ({error})") from error


def check_exr_name(path: str | Path) -> Path:
    """`path`; `InputError` if its suffix is not .exr."""
    if Path(path).suffix.lower() != ".exr":
        raise InputError(f"{path} is not the name of an EXR: give a name that ends in .exr")
    return Path(path)
