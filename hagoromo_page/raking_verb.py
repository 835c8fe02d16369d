"""The command `hagoromo raking`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote


@verb(verbs)
def raking(
    measured: Positional[Path],
    out: Out,
    elevation: Annotated[float, arg(help="of the lamp above the mean plane of the surface [°]")] = 15.0,
    frames: Annotated[int, arg(help="in a whole turn")] = 72,
    fps: Annotated[float, arg(help="frames a second")] = 12.0,
    longest: Annotated[int, arg(help="side of a frame, at most [px]")] = 1080,
    force: Force = False,
) -> None:
    """Measured object → a film in raking light: a lamp goes round it, just above its surface.

    NAME.mp4, NAME.webm (both need the extra film) or NAME.gif; any other name is a folder of frames as PNG, with a
    sheet of them. The lamp starts at the top of the picture and goes clockwise. Shadows are cast by the measured
    surface. All frames have one exposure.

    Args:
        measured: folder that `measure` wrote.
    """
    with progress_bar("raking") as progress:
        found = hg.raking(
            measured, out, elevation=elevation, frames=frames, rate=fps, longest=longest, force=force, progress=progress
        )
    say(str(found))
    wrote(out)
