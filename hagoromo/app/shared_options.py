"""Options that several commands have, declared once: where the work is done, and what a camera does not state."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import arg

from hagoromo.errors import InputError


@dataclass(frozen=True)
class SchedulerOptions:
    """Where the work is done. A recipe of a batch may not state them: a scheduler can run programs on this machine."""

    scheduler: str | None = None
    """run on Dask's workers: a number of processes here, local (one a core), or the address of a scheduler that runs:
    tls://host:8786, or tcp://host:8786 with --trust-scheduler."""

    trust_scheduler: bool = False
    """whoever answers at the address tcp://… may run programs on this machine: only where nobody else can answer."""

    @property
    def chosen(self) -> str | None:
        """What calls take as `scheduler`."""
        from hagoromo.cluster.connection import TrustedScheduler

        if not self.trust_scheduler:
            return self.scheduler
        if self.scheduler is None or "://" not in self.scheduler:
            raise InputError("--trust-scheduler is for an address: give --scheduler tcp://host:8786, or leave it out")
        return TrustedScheduler(self.scheduler)


Scheduler = Annotated[SchedulerOptions, arg(name="")]
HERE = SchedulerOptions()


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
