"""Shot: one photograph of a session as it was read, developed EXR or a camera's file; dark and flat frames, means."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.exif import read_exif
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.developing import Developing
from hagoromo.photograph.development.exposure import Exposure
from hagoromo.photograph.development.master import Dark, Flat, dark_of, flat_of, nearest_times
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.noise_estimate import estimated_noise
from hagoromo.photograph.development.transfer import Transfer
from hagoromo.photograph.development.undistort import Straightener
from hagoromo.photograph.one_exposure import light_of, middles_of, read_frame
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import READERS, read_pixels
from hagoromo.photograph.session_exif import SessionExif
from hagoromo.photograph.transforms import ImageSettings
from hagoromo.photograph.variance_model import VarianceModel

NO_CAMERA = Camera(1, 1, (1.0, 1.0), (0.5, 0.5))  # of a shot until the size of the photographs is known
NOISE_FRAMES = 3  # photographs whose middles estimate the noise, of each ISO
SAME_ISO = 1e-3  # largest relative difference of equal ISO speeds


class Shot(NamedTuple):
    """One photograph of a session as it was read: stored values, what they are divided by, and their noise.

    values: (height, width, C) float32. scale: seconds times ISO/100, by which values are divided. valid: (height,
    width) without the mask. variance: of the values, or its model.
    """

    name: str
    path: Path
    values: NDArray[np.float32]
    scale: tuple[float, float]
    valid: NDArray[np.bool_]
    native: NDArray[np.bool_] | None
    variance: NDArray[np.float32] | VarianceModel
    camera: Camera
    lamps: tuple[Lamp, ...]

    def photograph(self, valid: NDArray[np.bool_]) -> Photograph:
        """The photograph, light per second at ISO 100."""
        over = np.float32(self.scale[0] * self.scale[1] / 100.0)
        variance, native = self.variance, self.native
        if isinstance(variance, VarianceModel):
            native = variance.native(*self.values.shape[:2]) if native is None else native
            variance = variance.of(self.values)
        return Photograph(self.values / over, variance / over**2, valid, self.camera, self.lamps, self.name, native)

    def straightened(self, by: Straightener) -> Shot:
        """Without lens distortion; its variance is that of a measured sample everywhere, an upper bound."""
        model, native = self.variance, self.native
        if isinstance(model, VarianceModel):
            native, model = model.native(*self.valid.shape), replace(model, mosaic="")
        return self._replace(
            values=by.values(self.values),
            valid=by.valid(self.valid),
            native=None if native is None else by.native(native),
            variance=model,
        )


@dataclass(eq=False)
class ShotReader:
    """Reads the files of a session one at a time.

    channels: names of the channels of EXR. assumptions: of the session; reading adds what is taken for given.
    curve: what is said about the transfer, where it was estimated.
    """

    paths: Sequence[Path]
    exif: SessionExif
    developing: Developing
    channels: Sequence[str]
    assumptions: dict[str, str]
    curve: str = ""
    masters: SessionMasters = field(init=False)
    noises: dict[float, Noise] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Dark and flat frames are those of `developing`."""
        self.masters = SessionMasters(self.developing)

    def read(self, number: int, lamps: tuple[Lamp, ...]) -> Shot:
        """The photograph of this number, without its camera."""
        path = self.paths[number]
        return (self._developed if path.suffix.lower() == ".exr" else self._undeveloped)(number, path, lamps)

    def _developed(self, _number: int, path: Path, lamps: tuple[Lamp, ...]) -> Shot:
        if self.masters.given:
            raise InputError(f"{path} is developed: dark and flat frames (--dark, --flat) belong to `hagoromo develop`")
        pixels = read_pixels(path, ImageSettings(), self.channels, "bilinear", path.name)
        self.assumptions.setdefault("values", "developed EXR files, linear in light")
        return Shot(
            path.stem, path, pixels.values, (1.0, 100.0), pixels.valid, pixels.native, pixels.variance, NO_CAMERA, lamps
        )

    def _undeveloped(self, number: int, path: Path, lamps: tuple[Lamp, ...]) -> Shot:
        """A file as the camera left it."""
        seconds, iso = self.exif.seconds[number], self.exif.iso[number]
        noise = self._noise(iso)
        frame = read_frame(path, self.developing.stated)
        if not self.exif.stated and frame.exposure.exif.exposure_s is not None:  # RAW that is no TIFF states its own
            seconds, iso = frame.exposure.exif.exposure_s, frame.exposure.exif.iso or iso
        known = seconds if self.exif.stated or frame.exposure.exif.exposure_s is not None else None
        light = light_of(frame, noise, *self.masters.of(frame.exposure, known, iso, noise))
        self._note_transfer(path)
        self.assumptions.update(self.masters.said())
        if not light.valid.any():
            raise InputError(f"{path} is clipped everywhere: expose it less")
        shot = light.values, (seconds, iso), light.valid, None, light.variance
        return Shot(path.stem, path, *shot, NO_CAMERA, lamps)

    def _noise(self, iso: float) -> Noise:
        """The noise at an ISO: as stated, or estimated from photographs of that ISO."""
        if iso not in self.noises:
            self.noises[iso] = self.developing.noise or self._estimated_noise(iso)
            self.assumptions["noise"] = _said_of(self.noises)
        return self.noises[iso]

    def _estimated_noise(self, iso: float) -> Noise:
        pairs = zip(self.paths, self.exif.iso, strict=True)
        same = [path for path, own in pairs if own == iso and path.suffix.lower() != ".exr"]
        chosen = same[:: max(len(same) // NOISE_FRAMES, 1)][:NOISE_FRAMES]
        further = [Path(path) for path in self.developing.noise_from]
        own = middles_of(chosen, self.developing.stated)
        return estimated_noise([], [*own, *middles_of(further, self.developing.stated, iso)])[0]

    def _note_transfer(self, path: Path) -> None:
        if path.suffix.lower() in READERS:
            stated = self.developing.transfer
            name = "a curve" if isinstance(stated, Transfer) else f"{stated}"
            said = "linear: assumed of 16 bits and floats" if stated is None else f"{name}, as stated"
            self.assumptions["transfer"] = self.curve or said
        else:
            self.assumptions.setdefault("transfer", "linear: camera RAW")
        times = sorted(set(self.exif.seconds))
        if not self.exif.stated:
            self.assumptions["exposure"] = "the same for all: no file states its exposure time"
        elif len(times) > 1:
            self.assumptions["exposure"] = f"{times[0]:g} to {times[-1]:g} s, as stated: values are per second"
        else:
            self.assumptions["exposure"] = f"{times[0]:g} s, as stated"


def _said_of(noises: Mapping[float, Noise]) -> str:
    return "; ".join(
        f"ISO {iso:g}: gain {noise.gain:.4g} e⁻/DN, read noise {noise.read_noise:.3g} e⁻, from {noise.source}"
        for iso, noise in noises.items()
    )


class SessionMasters:
    """Dark and flat frames of a session; each mean is computed when the first photograph needs it, and kept."""

    def __init__(self, developing: Developing) -> None:
        """Of the frames that `developing` names."""
        self.developing = developing
        self.darks = [Path(path) for path in developing.darks]
        self.flats = [Path(path) for path in developing.flats]
        stated = developing.dark_exposures_s
        self.times = list(stated) or [read_exif(path).exposure_s for path in self.darks]
        self._dark: dict[float, Dark] = {}
        self._assumed: float | None = None  # time of dark frames that state none: that of the photographs
        self._flat: Flat | None = None

    @property
    def given(self) -> bool:
        """Whether there are any."""
        return bool(self.darks or self.flats)

    def of(
        self, photograph: Exposure, seconds: float | None, iso: float, noise: Noise
    ) -> tuple[Dark | None, Flat | None]:
        """The dark frame and the flat field for a photograph of this exposure time (None: unknown) and ISO.

        `InputError` for frames of another size, mosaic or ISO, and dark frames whose times are not known.
        """
        dark = self._dark_of(photograph, seconds, iso, noise) if self.darks else None
        if self.flats and self._flat is None:
            self._flat = self._flat_field(photograph, seconds, iso, noise)
        return dark, self._flat

    def said(self) -> dict[str, str]:
        """What is taken for given about them."""
        said = {}
        if self.darks:
            times = sorted(self._dark)
            said["dark"] = (
                f"{len(self.darks)} dark frames, for {', '.join(f'{time:g}' for time in times)} s, subtracted"
            )
        if self.flats:
            said["flat"] = f"{len(self.flats)} frames of a flat field, divided by"
        return said

    def _dark_of(self, photograph: Exposure, seconds: float | None, iso: float, noise: Noise) -> Dark:
        unknown = next((path for path, time in zip(self.darks, self.times, strict=True) if time is None), None)
        known = [time for time in self.times if time is not None]
        if known and seconds is None:
            raise InputError(
                "dark frames have exposure times and the photographs none: state exposures_s (--exposures)"
            )
        if unknown is not None and (known or self._assumed not in (None, seconds)):
            raise InputError(
                f"{unknown.name} does not state its exposure time: state dark_exposures_s (--dark-exposures), one each"
            )
        self._assumed = seconds
        time = 1.0 if seconds is None else seconds
        if time not in self._dark:
            names = [path.name for path in self.darks]
            chosen = nearest_times(known, time, names) if known else range(len(self.darks))
            mean, count, _ = self._mean([self.darks[k] for k in chosen], photograph, iso, "dark frame")
            self._dark[time] = dark_of(mean, count, photograph, noise)
        return self._dark[time]

    def _flat_field(self, photograph: Exposure, seconds: float | None, iso: float, noise: Noise) -> Flat:
        mean, count, full = self._mean(self.flats, photograph, iso, "flat field")
        if self.darks:
            mean = mean - self._dark_of(photograph, read_exif(self.flats[0]).exposure_s or seconds, iso, noise).signal
        return flat_of(mean, count, full, photograph, noise, self.flats[0].name)

    def _mean(
        self, paths: Iterable[Path], photograph: Exposure, iso: float, what: str
    ) -> tuple[NDArray[np.float32], int, NDArray[np.bool_]]:
        """The mean signal of frames [DN], how many, and where any is clipped."""
        total, full, count = np.zeros_like(photograph.signal), np.zeros(photograph.signal.shape, np.bool_), 0
        for path in paths:
            own = read_exif(path).iso
            if own is not None and abs(own / iso - 1.0) > SAME_ISO:
                raise InputError(f"{path.name} has ISO {own:g} and the photographs {iso:g}: take both at one ISO")
            frame = read_frame(path, self.developing.stated).exposure
            if frame.signal.shape != total.shape or frame.mosaic != photograph.mosaic:
                raise InputError(
                    f"the {what} {path.name} is {frame.signal.shape} {frame.mosaic} and {photograph.name} "
                    f"{total.shape} {photograph.mosaic}: give frames of one camera and format"
                )
            total, full, count = total + frame.signal, full | frame.full, count + 1
        return total / np.float32(count), count, full
