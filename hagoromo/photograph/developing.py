"""Developing: what a person states about the files of a session where these do not state it themselves."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.photograph.development.exposure import StatedExposure
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.transfer import Transfer

ESTIMATE = "estimate"  # the transfer curve is found in the photographs


@dataclass(frozen=True, eq=False)
class Developing:
    """How undeveloped files are read; None: as the file states.

    black, white: levels [DN]. mosaic: of files with one channel, such as "RGGB", or "none". transfer: of 8-bit files:
    "linear", "srgb", a CSV, a curve, or "estimate": from bracket, or else one of linear and srgb by the shading of the
    object. gain [e⁻/DN] and read_noise [e⁻] of the sensor: both or neither, by default estimated from the photographs,
    together with noise_from: further frames of this camera at this ISO, of any scenes.
    exposures_s: one for all, or one each [s]. iso: of all. darks: frames without light; dark_exposures_s: their times,
    if their files do not state them [s]. flats: frames of an evenly lit white field. bracket: three or more exposures
    of one scene, which measure the transfer curve; bracket_exposures_s: their times [s].
    """

    black: float | None = None
    white: float | None = None
    mosaic: str | None = None
    transfer: str | Path | Transfer | None = None
    gain: float | None = None
    read_noise: float | None = None
    noise_from: Sequence[str | Path] = ()
    exposures_s: Sequence[float] = ()
    iso: float | None = None
    darks: Sequence[str | Path] = ()
    dark_exposures_s: Sequence[float] = ()
    flats: Sequence[str | Path] = ()
    bracket: Sequence[str | Path] = ()
    bracket_exposures_s: Sequence[float] = ()

    def __post_init__(self) -> None:
        """Check what goes together."""
        if (self.gain is None) != (self.read_noise is None):
            raise InputError("gain and read_noise (--gain, --read-noise) go together: give both or none")
        if self.noise_from and self.gain is not None:
            raise InputError("gain (--gain) states the noise: omit noise_from (--noise-from), or gain and read_noise")
        for what, times, files in (
            ("dark", self.dark_exposures_s, self.darks),
            ("bracket", self.bracket_exposures_s, self.bracket),
        ):
            if times and len(times) != len(files):
                raise InputError(f"{len(times)} exposure times for {len(files)} {what} frames: give one each")
        if self.bracket and self.transfer != ESTIMATE:
            raise InputError("a bracket measures the transfer curve: state transfer estimate (--transfer), or omit it")

    @property
    def stated(self) -> StatedExposure:
        """The levels and the transfer."""
        return StatedExposure(self.black, self.white, self.mosaic, self.transfer, None, self.iso)

    @property
    def noise(self) -> Noise | None:
        """The noise, where it is stated."""
        return None if self.gain is None or self.read_noise is None else Noise(self.gain, self.read_noise)


AS_IN_THE_FILES = Developing()
