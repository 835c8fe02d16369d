"""Options of commands that may run on many processes or machines, declared once for all of them."""

from __future__ import annotations

from dataclasses import dataclass
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
        from hagoromo.cluster.scheduler_address import TrustedScheduler

        if not self.trust_scheduler:
            return self.scheduler
        if self.scheduler is None or "://" not in self.scheduler:
            raise InputError("--trust-scheduler is for an address: give --scheduler tcp://host:8786, or leave it out")
        return TrustedScheduler(self.scheduler)


Scheduler = Annotated[SchedulerOptions, arg(name="")]
HERE = SchedulerOptions()
