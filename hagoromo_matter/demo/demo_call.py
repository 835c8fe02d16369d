"""Demo: the paper end to end, in one call."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Literal

from hagoromo.progress import Progress, silent


def demo(
    out: str | Path,
    size: Literal["small", "full"] = "small",
    force: bool = False,
    progress: Progress = silent,
    scheduler: str | int | None = None,
    opened: Callable[[Path], object] = lambda page: None,
) -> Path:
    """Simulated photographs → measurement → volume boxes → figures 6–8 of the paper, in the folder `out`.

    size: small takes minutes on two cores, full draws larger pictures of finer boxes; the same size gives the same
    numbers. scheduler: its workers draw the figures, see `render`. opened: is called with the path of report.html when
    the measurement is there; the page grows with every figure. What was made before comes from a cache. Gives the path
    of report.html. `InputError` for another size, or for a folder that exists without `force`.
    """
    from hagoromo_matter.demo.demo import demo as run

    return run(out, size, force, progress, scheduler, opened)
