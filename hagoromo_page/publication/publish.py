"""Publish: a measured object → one page that can be sent round, or a folder of a page and its tiles.

Enters: a Measurement or its folder. Leaves: HTML that needs neither server nor network.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.files.whole import whole_file, whole_folder
from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.photographed import photographed
from hagoromo.measurement.scale import has_scale
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.progress import Progress, silent
from hagoromo.reflectance.parameters import losses
from hagoromo_page.publication.closely import close_look
from hagoromo_page.publication.document import document
from hagoromo_page.publication.notes import read_notes
from hagoromo_page.publication.object_page import PageSource, single_page, tiled_page
from hagoromo_page.publication.page_lamps import chosen
from hagoromo_page.publication.surface_maps import surface_maps

LIMIT_BYTES = 5_000_000  # of a page that is one file
MOST_PHOTOGRAPHS = 8  # of a page
UNNAMED = "Measured object"


@dataclass(frozen=True)
class Published:
    """path: of the page. size: of the file, or of all files [bytes]. width, height: of the picture [px]. reduced: how
    many pixels of the photographs one of the picture is wide. photographs: number of them on the page. lost: what the
    page leaves out of the reflectances, a line for each material.
    """

    path: Path
    size: int
    width: int
    height: int
    reduced: float
    photographs: int
    lost: tuple[str, ...] = ()

    def __str__(self) -> str:
        """One line."""
        reduction = f", reduced {self.reduced:.3g}-fold to fit" if self.reduced > 1.001 else ", full resolution"
        compared = f"{self.photographs} photographs to compare" if self.photographs else "no photographs to compare"
        return f"{self.width} × {self.height} px{reduction}, {self.size / 1e6:.2f} MB, {compared}"


def publish(
    measured: Measurement | str | Path,
    out: str | Path,
    *,
    capture: Capture | str | Path | None = None,
    title: str = "",
    facts: Mapping[str, str] | None = None,
    notes: str | Path | None = None,
    limit: int = LIMIT_BYTES,
    force: bool = False,
    progress: Progress = silent,
) -> Published:
    """A page on which the measured object is lit by its own measured reflectance, in any browser from 2023 on.

    measured: a `Measurement`, or its folder. out: NAME.html, one file of at most `limit` bytes, for which the picture
    is reduced where it must be; any other name is a folder with index.html and tiles at full resolution. capture: that
    was measured, or its folder: photographs to compare with; a `Measurement` that was just made has its own. title: of
    the page, which is the object's name; without one the name that the capture states (`name` of transforms.json).
    facts: what else the page says of the object, by name: an inventory number, an institution, a licence. notes: file
    of notes on places of the photographs (W3C Web Annotation), as a page saves them.

    `InputError` for a measurement of version 0.2 without its capture, or one that does not fit to it.
    """
    target = Path(out)
    source = measured if isinstance(measured, Measurement) else Measurement.load(measured)
    shots = capture if isinstance(capture, Capture) or capture is None else load_capture(capture)
    found = replace(page_source(source, shots, title, True, notes), facts=tuple((facts or {}).items()))
    progress(0.3, "maps")
    if target.suffix.lower() in (".html", ".htm"):
        page = single_page(found, limit)
        text = document(page.viewer)
        with whole_file(target, force) as partial:
            partial.write_text(text, encoding="utf-8", newline="\n")
        size = len(text.encode())
    else:
        with whole_folder(target, force) as home:
            page = tiled_page(found, home)
            (home / "index.html").write_text(document(page.viewer), encoding="utf-8", newline="\n")
            size = sum(one.stat().st_size for one in home.rglob("*") if one.is_file())
    progress(1.0, "")
    width, height = page.size
    lost = tuple(losses("page", found.maps.materials))
    return Published(target, size, width, height, page.reduced, len(page.viewer.photographs), lost)


def page_source(
    measurement: Measurement,
    capture: Capture | None,
    name: str = "",
    closely: bool = False,
    notes: str | Path | None = None,
) -> PageSource:
    """What a page of `measurement` is made of; see `publish`. name: of the object; "": that of the capture.

    closely: whether with maps and errors to look closely, which take some seconds.
    """
    shots = capture or measurement.capture
    height, width = (measurement if measurement.fine is None else measurement.fine).labels.shape
    if capture is not None and capture.photographs[0].values.shape[:2] != (height, width):
        own = capture.photographs[0].camera
        raise InputError(
            f"the measurement is {width} × {height} px and the photographs of the capture {own.width} × {own.height}: "
            "give the capture that was measured"
        )
    written = () if notes is None else read_notes(notes, (width, height))
    taken = measurement.photographed_with if shots is None else photographed(shots, (width, height))
    if taken is None:
        raise InputError(
            "the measurement does not say which camera and lamps it was made with: give its capture (--capture)"
        )
    camera = taken.camera
    known = measurement.photographed_with  # of the measurement, also where the capture given has no name
    stated = taken.name or ("" if known is None else known.name)
    look = close_look(measurement, taken) if closely else None
    maps = surface_maps(measurement, camera, name or stated or UNNAMED, has_scale(measurement, taken), look)
    fitting = [] if shots is None else [one for one in shots.photographs if one.values.shape[:2] == (height, width)]
    assumed = measurement.assumptions.items()
    assumptions = tuple(f"{what.capitalize()}: {said.removesuffix('.')}." for what, said in assumed)
    if measurement.health is not None:
        assumptions += tuple(f"Doubtful: {one.name}: {one.said}." for one in measurement.health.doubtful)
    return PageSource(maps, taken, tuple(chosen(fitting, MOST_PHOTOGRAPHS)), assumptions, look, notes=written)
