"""Dark and flat frames of a session: their means, with memory for one frame, and for each exposure time that occurs."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.exif import read_exif
from hagoromo.photograph.developing import Developing
from hagoromo.photograph.development.exposure import Exposure
from hagoromo.photograph.development.master import Dark, Flat, dark_of, flat_of, nearest_times
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.one_exposure import read_frame

SAME_ISO = 1e-3  # largest relative difference of equal ISO speeds


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
