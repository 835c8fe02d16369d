"""The command that runs the paper end to end."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Literal

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.shared_options import HERE, Scheduler
from hagoromo.app.verb import Force, Out, say, show_in_browser, verb, verbs, wrote
from hagoromo.files.whole import replaceable_folder


@verb(verbs)
def demo(
    out: Out,
    size: Literal["small", "full"] = "small",
    open_page: bool = False,
    scheduler: Scheduler = HERE,
    force: Force = False,
) -> None:
    """The paper end to end: simulated photographs, measurement, volume boxes, figures 6–8, report.html.

    The page is there after the measurement and grows with every figure. A second run takes what it can from the cache.

    Args:
        size: small takes minutes on two cores; full makes larger pictures.
        open_page: show the page in the browser as soon as it is there, where there is a screen.
    """
    replaceable_folder(out, force)  # before all that draws is imported

    def opened(page: Path) -> None:
        address = page.resolve().as_uri()
        say(f"the page is there and grows: {address}")
        if sys.stdout is not None:  # it is not, where no console is
            sys.stdout.flush()
        if open_page:
            show_in_browser(address)

    with progress_bar("demo", by_step=True) as progress:
        report = hg.demo(out, size=size, force=force, progress=progress, scheduler=scheduler.chosen, opened=opened)
    wrote(report)
