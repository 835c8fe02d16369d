"""Report of the demo: one self-contained HTML page, and a small one inside it while figures are being drawn."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from markupsafe import Markup

from hagoromo.camera.response import Response, srgb_from_camera
from hagoromo.files.png import read_png
from hagoromo.image.picture.image import read_image
from hagoromo.light.spectrum import Spectrum
from hagoromo_matter.demo.figures import PAPER_FIGURES
from hagoromo_matter.demo.report_measured import PACKAGE
from hagoromo_matter.demo.samples import bench_camera
from hagoromo_page.report.display import exposure, shown
from hagoromo_page.report.page import page_picture, write_page

OTHER_CAMERA, OTHER_LAMP = "Nikon 5100 (NPL)", "A"
GROWING = "figures.html"  # the small page


@dataclass(frozen=True, eq=False)
class Report:
    """record: results.json. part: HTML of what was measured, see `measured_parts`. figures: those that are drawn."""

    record: Mapping[str, Any]
    part: Mapping[str, Any]
    figures: list[str]

    @property
    def missing(self) -> list[str]:
        """Figures that are not drawn yet."""
        return [name for name in self.record["size"]["figures"] if name not in self.figures]


def write_report(home: Path, report: Report) -> None:
    """Write report.html into the folder of the demo; while figures are missing it shows the small page."""
    done = not report.missing
    write_page(
        home / "report.html",
        "demo.html.j2",
        PACKAGE,
        record=report.record,
        head=Markup(report.part["head"]) if done else _with_frame(report.part["head"]),
        samples=Markup(report.part["samples"]),
        found=Markup(report.part["found"]),
        details=Markup(report.part["details"]),
        tables=report.part["details"].count("<b>Table"),
        growing="" if done else GROWING,
        figures=[_figure(home, name) for name in report.record["size"]["figures"]] if done else [],
        other=_other_light(home, report) if done else None,
        settings=_settings(report.record),
        times=_times(report.record) if done else [],
    )


def write_growing(home: Path, report: Report, seconds: Mapping[str, float]) -> None:
    """Write the small page: the figures that are drawn, with their times; it loads itself again until all are."""
    figures = [_figure(home, name) | {"seconds": seconds.get(name.replace("_", " "), 0.0)} for name in report.figures]
    wanted = len(report.record["size"]["figures"])
    write_page(home / GROWING, "growing.html.j2", PACKAGE, figures=figures[::-1], wanted=wanted)


def _with_frame(head: str) -> Markup:
    """The head of the page, whose content security policy then allows the small page beside it."""
    return Markup(head.replace("default-src 'none'", "default-src 'none'; frame-src 'self' file:", 1))


def _figure(home: Path, name: str) -> dict[str, Any]:
    shot = PAPER_FIGURES[name]
    picture = read_png(home / "figures" / f"{name}.png").astype(np.uint8)
    height, width = picture.shape[:2]
    return {
        "picture": page_picture(picture[..., :3], shot.caption),
        "caption": shot.caption,
        "number": name.split("_")[1],
        "width": width,
        "height": height,
    }


def _other_light(home: Path, report: Report) -> dict[str, Any]:
    name = report.record["size"]["figures"][-1]
    whole = read_image(home / "figures" / f"{name}.exr")
    daylight, warm = whole.palette.lamps, [Spectrum.named(OTHER_LAMP)] * len(whole.palette.lamps)
    canon, nikon = bench_camera(report.record["size"]["capture_binning"]).response, Response.load(OTHER_CAMERA)
    assert canon is not None
    views = [
        ("Canon, daylight", canon, daylight, daylight),
        ("Canon set to daylight, incandescent light", canon, warm, daylight),
        ("Nikon set to incandescent light, incandescent light", nikon, warm, warm),
    ]
    pictures = []
    for title, response, lamps, balance in views:
        matrix, values = srgb_from_camera(response, balance[0]), whole.expose(response, lamps)
        pictures.append(page_picture(shown(values, matrix, exposure(values @ matrix.T, whole.alpha)), title, title))
    return {"name": name, "pictures": pictures}


def _settings(record: Mapping[str, Any]) -> list[list[str]]:
    rows = [["size", record["size"]["name"]], ["seed", str(record["size"]["seed"])], ["backend", record["backend"]]]
    versions = [[name, number] for name, number in record["versions"].items()]
    return [*rows, ["hagoromo", record["hagoromo"]], *versions]


def _times(record: Mapping[str, Any]) -> list[list[str]]:
    times = [[name, f"{value:.1f}"] for name, value in record["seconds"].items()]
    return [*times, ["sum", f"{sum(record['seconds'].values()):.1f}"]]
