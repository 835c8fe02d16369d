"""Demo: the paper end to end: simulated photographs → measurement → volume boxes → figures 6–8 → report.html."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hagoromo import __version__, backend
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_folder
from hagoromo.image.image import Image, read_image
from hagoromo.image.render import render
from hagoromo.image.settings import Settings
from hagoromo.image.simulate import simulate, visible_shape
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.photograph.capture import load_capture, save_capture
from hagoromo.progress import Progress, part_of, silent
from hagoromo_figures.demo.figures import PAPER_FIGURES, Cast
from hagoromo_figures.demo.measurement import coverage, named, rightly_labelled, rows
from hagoromo_figures.demo.relit import relit
from hagoromo_figures.demo.report import Report, write_report
from hagoromo_figures.demo.samples import FOCAL_MM, LAMP_SPECTRUM, PRESET, bench, bench_camera, true_reflectances

LAMPS_MEASURED = 3  # number of lamps for the measurement; the photograph under the last is held out
PACKAGES = ("drjit", "mitsuba", "numpy", "scipy", "colour-science", "scikit-image", "matplotlib")


@dataclass(frozen=True)
class Size:
    """Size of the demo: binning and rays per pixel of capture and figures; resolution and names of the figures.

    without: parts that no figure has.
    """

    capture_binning: int
    capture_samples: int
    figure_binning: int
    figure_samples: int
    resolution: float
    figures: tuple[str, ...] = tuple(PAPER_FIGURES)
    seed: int = 1
    without: tuple[str, ...] = ()


SIZES = {
    "tiny": Size(
        capture_binning=8,
        capture_samples=1,
        figure_binning=16,
        figure_samples=1,
        resolution=0.4,
        figures=("figure_7_skin",),
        without=("habit", "linen", "veil"),  # to drape and weave them takes most of the time
    ),
    "small": Size(capture_binning=2, capture_samples=4, figure_binning=4, figure_samples=4, resolution=0.5),
    "full": Size(capture_binning=2, capture_samples=4, figure_binning=2, figure_samples=4, resolution=1.0),
}
SHARES = {"capture": 0.1, "measurement": 0.15, "relit view": 0.05, "figures": 0.68, "report": 0.02}  # of the time


@dataclass
class Stages:
    """Report progress by stage, and record the duration of each stage [s]."""

    progress: Progress
    seconds: dict[str, float] = field(default_factory=dict)
    done: float = 0.0

    @contextmanager
    def stage(self, name: str) -> Iterator[Progress]:
        """Progress of the stage called `name`."""
        start, share = time.perf_counter(), SHARES[name]
        self.progress(self.done, name)
        yield part_of(self.progress, self.done, share, name)
        self.done += share
        self.seconds[name] = time.perf_counter() - start


def demo(out: str | Path, size: str = "small", force: bool = False, progress: Progress = silent) -> Path:
    """Run the demo into the folder `out`, completely or not at all; returns the path of its report.html.

    size: small (minutes on two cores) or full (larger pictures, finer boxes). The same size gives the same numbers.
    `InputError` for an unknown size or an existing folder without `force`.
    """
    if size not in SIZES:
        raise InputError(f"size is {size!r}: give one of small, full")
    stages = Stages(progress)
    with whole_folder(out, force) as home:
        _run(home, size, SIZES[size], stages)
    stages.progress(1.0, "")
    return Path(out) / "report.html"


def _run(home: Path, name: str, size: Size, stages: Stages) -> None:
    camera = bench_camera(size.capture_binning)
    response, lamp = camera.response, Spectrum.named(LAMP_SPECTRUM)
    assert response is not None
    truth = true_reflectances(camera)
    samples = bench(truth, camera)
    settings = Settings(samples=size.capture_samples, seed=size.seed)
    with stages.stage("capture") as progress:
        save_capture(simulate(samples, settings, "samples", progress, percentile=100.0), home / "capture")
        surface = visible_shape(samples).surface
    with stages.stage("measurement") as progress:
        capture = load_capture(home / "capture", frames=slice(0, LAMPS_MEASURED))
        measurement = named(measure_known_shape(capture, progress=progress), surface, list(truth))
        (home / "measure").mkdir()
        measurement.write_into(home / "measure")
        table = rows(measurement.materials, truth, response, lamp)
        reflectances = {material.name: material.reflectance(response, lamp) for material in measurement.materials}
    with stages.stage("relit view"):
        aside = load_capture(home / "capture", frames=slice(LAMPS_MEASURED, None)).photographs[0]
        view = relit(samples, reflectances, aside, surface >= 0, settings)
        view.write(home / "relit")
    with stages.stage("figures") as progress:
        figures = _figures(home, reflectances, size, progress)
    with stages.stage("report"):
        record = {
            "hagoromo": __version__,
            "backend": backend.name(),
            "versions": {package: version(package) for package in PACKAGES},
            "size": {"name": name, **asdict(size)},
            "table": [row.record() for row in table],
            "coverage": coverage(table),
            "rightly_labelled": rightly_labelled(measurement, surface, list(truth)),
            "relit": {"measured": view.measured, "ideal": view.ideal},
            "seconds": {key: round(value, 2) for key, value in stages.seconds.items()},
        }
        write_json(home / "results.json", record)
        report = Report(record, capture, aside, measurement, table, truth, reflectances, view, figures)
        write_report(home / "report.html", report)


def _figures(home: Path, reflectances: dict[str, Any], size: Size, progress: Progress) -> dict[str, Image]:
    """Render every figure to EXR and PNG; returns the images as read from their files."""
    camera = Camera.preset(PRESET, FOCAL_MM, size.figure_binning)
    (home / "figures").mkdir()
    cast = Cast(reflectances, size.resolution, size.seed, size.without)
    for k, figure in enumerate(size.figures):
        of_figure = part_of(progress, k / len(size.figures), 1.0 / len(size.figures), figure.replace("_", " "))
        scene = cast.scene(figure, camera, part_of(of_figure, 0.0, 0.5, "boxes"))
        settings = Settings(samples=size.figure_samples, seed=size.seed)
        image = render(scene, settings, part_of(of_figure, 0.5, 0.5, "rays"))
        image.save(home / "figures" / f"{figure}.exr", camera.response)
    return {figure: read_image(home / "figures" / f"{figure}.exr") for figure in size.figures}
