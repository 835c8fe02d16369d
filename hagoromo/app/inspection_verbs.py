"""The commands that look closely at a measured surface: `hagoromo profile`, `hagoromo maps`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal

from tyro.conf import Positional, arg

import hagoromo as hg
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, verb, verbs, with_picture, wrote
from hagoromo.files.whole import replaceable_files, whole_folder

Line = Annotated[
    tuple[float, float, float, float],
    arg(help="its ends in the picture, from the upper left corner [px]", metavar="X0 Y0 X1 Y1"),
]


@verb(verbs, writes=with_picture)
def profile(measured: Positional[Path], out: Out, line: Line, force: Force = False) -> None:
    """Measured object → heights along a line, in mm with their 95 % band: a table NAME.csv and its plot NAME.png.

    Heights are over the chord, the straight line in space between both ends. The band holds the errors of normals that
    the measurement states, followed through the integration. Without a scale lengths are in pixels.

    Args:
        measured: folder that `measure` wrote.
    """
    from hagoromo.measurement.inspection.profile_files import check_table_name

    replaceable_files(with_picture(check_table_name(out)).files, force)
    found = hg.profile(measured, line[:2], line[2:])
    found.save(out, force)
    say(found.sentence, *found.remarks)
    wrote(*with_picture(out).files)


@verb(verbs)
def maps(
    measured: Positional[Path],
    out: Out,
    width: Annotated[float, arg(help="of the Gaussian under which normals are differentiated [px]")] = 1.0,
    stretch: Literal["correlation", "covariance"] = "correlation",
    force: Force = False,
) -> None:
    """Measured object → maps of curvature, occlusion and stretched colours: EXR with the values, PNG to look at.

    Curvature is the mean curvature in 1/mm, with its standard error: grooves below 0, ridges above. Occlusion is the
    share of the sky that the surface around each pixel leaves open. The decorrelation stretch makes faint differences
    of the body colours as strong as the others. Without a scale lengths are in pixels.

    Args:
        measured: folder that `measure` wrote.
        stretch: whether the channels count alike (correlation) or as they vary (covariance).
    """
    with whole_folder(out, force) as home, progress_bar("maps") as progress:
        found = hg.inspection_maps(measured, width=width, by=stretch, progress=progress)
        found.write_into(home)
    say(*found.sentences, *found.remarks)
    wrote(out)
