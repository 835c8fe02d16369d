"""The command `hagoromo change`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from tyro.conf import Positional, arg

import hagoromo as hg
from hagoromo.app.inspection_verbs import Line
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.verb import Force, Out, say, verb, verbs, wrote
from hagoromo.files.whole import whole_folder

REPORT = "report.html"


@verb(verbs)
def change(
    before: Positional[Path],
    after: Positional[Path],
    out: Out,
    lamp: tuple[str, ...] = (),
    rate: Annotated[float, arg(help="rate of false discoveries: share of marked places that did not change")] = 0.05,
    doubted: bool = False,
    line: Line | None = None,
    force: Force = False,
) -> None:
    """Two measurements of one object, at two dates → what has changed significantly: maps, table and report.html.

    Camera and lamps may differ: the surfaces are registered in 3-D. Colour (ΔE00), gloss (%), shape (µm, or px where
    the scale is unknown) and normals (°) are compared, each with the error that both measurements state.

    Args:
        before: folder that `measure` wrote of the first date; its pixels are those of all maps.
        after: folder that `measure` wrote of the second date.
        lamp: illuminants under which colours are compared, such as D65 A LED-B3 (default: D65, or the channels as
            photographed where the response of the cameras is not known).
        doubted: compare also where more of the object has changed than has stayed the same.
        line: X0 Y0 X1 Y1, ends of a cross-section in BEFORE's picture [px]: heights of both dates along it, and where
            they differ, as section.csv and on the page.
    """
    with whole_folder(out, force) as home, progress_bar("change") as progress:
        found = hg.change(before, after, lamps=lamp, rate=rate, doubted=doubted, line=line or (), progress=progress)
        found.write_into(home)
        hg.write_change_report(home / REPORT, found)
    say(f"registered to {found.registration.error_px:.2g} px", *found.remarks, found.sentence)
    for region in found.regions:
        lamp_of = f" under {region.lamp}" if region.lamp else ""
        say(
            f"{region.quantity} {region.number}{lamp_of}: {region.area:.3g} {region.area_unit} at ({region.x_px:.0f}, "
            f"{region.y_px:.0f}) px: {region.mean:.3g} {region.unit}, {region.low:.3g} to {region.high:.3g}"
        )
    if found.section is not None:
        say(found.section.sentence)
    wrote(out / REPORT)
