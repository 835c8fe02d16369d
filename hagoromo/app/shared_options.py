"""Options that several commands have, declared once: where the work is done, and what a camera does not state."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from tyro.conf import arg

from hagoromo.errors import InputError

if TYPE_CHECKING:
    from hagoromo.image.picture.shown import DisplayView


@dataclass(frozen=True)
class SchedulerOptions:
    """Where the work is done. A recipe of a batch may not state them: a scheduler can run programs on this machine."""

    scheduler: Annotated[
        str | None,
        arg(
            help="run on Dask's workers: a number of processes here, local (one a core), or the address of a scheduler "
            "that runs: tls://host:8786, or tcp://host:8786 with --trust-scheduler."
        ),
    ] = None

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

    transfer: Annotated[
        str | None,
        arg(
            help="transfer curve of 8-bit photographs: linear, srgb, estimate (develop: from the exposures of its "
            "bracket; capture: from --bracket, or one of linear and srgb by the shading of the object), or a CSV with "
            "the columns number and light (or R, G, B)."
        ),
    ] = None

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


@dataclass(frozen=True)
class LookOptions:
    """How the PNG shows the picture; the EXR stays linear."""

    display: Annotated[
        str | None,
        arg(
            help='what the PNG is made for: sRGB (default), Display P3, or a view of ACES, such as "ACES 2.0 - SDR 100 '
            'nits (Rec.709)"; with --view or --ocio a display of that configuration (default: its own).'
        ),
    ] = None

    view: str | None = None
    """view of the display, in the configuration of --ocio (default: the display's own); a wrong one lists all."""

    ocio: Annotated[
        str | None,
        arg(
            help="configuration of OpenColorIO: a file (.ocio, .ocioz), or one of its own, such as "
            "ocio://cg-config-latest (default: ACES 2.0; pip install 'hagoromo[display]')."
        ),
    ] = None

    exposure: float = 0.0
    """stops by which the PNG is brighter than of itself, when its brightest half percent is near white."""

    @property
    def chosen(self) -> DisplayView:
        """What calls take as `display`."""
        from hagoromo.image.picture.shown import DisplayView

        return DisplayView(self.display, self.view, self.ocio, self.exposure)


LookOfPicture = Annotated[LookOptions, arg(name="")]
AS_ON_SRGB = LookOptions()
