"""The command that publishes: measured object → a page that can be sent round."""

from __future__ import annotations

from pathlib import Path

from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, wrote


def publish(measured: Positional[Path], out: Out, capture: Path | None = None, force: Force = False) -> None:
    """Measured object → a page that relights it in any browser, without server or network.

    NAME.html is one file of 5 MB at most; any other name is a folder with index.html and tiles at full resolution.

    Args:
        measured: folder that `measure` wrote.
        capture: folder that was measured: photographs to compare with.
    """
    with progress_bar("publish") as progress:
        published = hg.publish(measured, out, capture=capture, force=force, progress=progress)
    say(str(published))
    wrote(out if out.suffix.lower() in (".html", ".htm") else out / "index.html")
