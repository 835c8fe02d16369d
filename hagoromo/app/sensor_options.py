"""Options of `develop` and `capture` that say what the files of a camera do not state themselves."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg


@dataclass(frozen=True)
class SensorOptions:
    """Facts that the files of the photographs do not state."""

    transfer: str | None = None
    """transfer curve of 8-bit photographs: linear, srgb, estimate (develop: from the exposures of its bracket; capture:
    from --bracket, or one of linear and srgb by the shading of the object), or a CSV with the columns number and light
    (or R, G, B)."""

    exposures: tuple[float, ...] = ()
    """exposure times of the photographs [s], if their files do not state them; capture takes one for all, too."""

    iso: float | None = None
    """ISO speed of all, if the files do not state it."""

    black: float | None = None
    """black level [DN], if the files do not state it."""

    white: float | None = None
    """saturation level [DN]."""

    mosaic: str | None = None
    """mosaic of one-channel files, such as RGGB, or none."""

    gain: float | None = None
    """gain of the sensor [electrons per DN], with read_noise; by default both are estimated from the photographs."""

    read_noise: float | None = None
    """read noise of the sensor [electrons]."""

    noise_from: tuple[Path, ...] = ()
    """further frames of this camera at this ISO, of any scenes: gain and read noise are estimated from all together."""


Sensor = Annotated[SensorOptions, arg(name="")]
AS_STATED = SensorOptions()
