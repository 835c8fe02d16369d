"""Demo: the paper end to end: simulated photographs → measurement → volume boxes → figures 6–8 → report.html.

The page is there as soon as the materials are measured, and grows with every figure. Photographs with their
measurement, volume boxes and figures come from the cache where they were made before.
"""

from __future__ import annotations

import shutil
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import asdict, dataclass, field
from importlib.metadata import version
from pathlib import Path
from typing import Any

from hagoromo import __version__, backend
from hagoromo.cluster.cluster import workers_of
from hagoromo.errors import InputError
from hagoromo.files.cache import cache
from hagoromo.files.record import read_json, write_json
from hagoromo.files.whole import whole_folder, write_bytes
from hagoromo.progress import Progress, part_of, silent
from hagoromo.reflectance.material.materials_file import read_materials
from hagoromo_matter.demo.beside import beside
from hagoromo_matter.demo.drawn import Files, draw_all, drawn, is_drawn
from hagoromo_matter.demo.figures import people
from hagoromo_matter.demo.measured import measured, reflectances_of
from hagoromo_matter.demo.report import Report, write_growing, write_report
from hagoromo_matter.demo.size import SIZES, Size
from hagoromo_matter.figure.wardrobe import WARDROBE, draped

PACKAGES = ("drjit", "mitsuba", "numpy", "scipy", "colour-science", "scikit-image", "matplotlib")
MEASURED, DRAWN = 0.15, 0.98  # of the time, when the materials are measured, and when the figures are there
NOTE = "results.json"


@dataclass
class Steps:
    """Tells of the progress by steps, and records how long each took [s]."""

    progress: Progress
    seconds: dict[str, float] = field(default_factory=dict)

    @contextmanager
    def step(self, name: str, begin: float, end: float) -> Iterator[Progress]:
        """Progress of the step called `name`, from share `begin` to `end` of the whole."""
        start = time.perf_counter()
        self.progress(begin, name)
        yield part_of(self.progress, begin, end - begin, name)
        self.seconds[name] = time.perf_counter() - start


def demo(
    out: str | Path,
    size: str = "small",
    force: bool = False,
    progress: Progress = silent,
    scheduler: str | int | None = None,
    opened: Callable[[Path], object] = lambda page: None,
) -> Path:
    """Run the demo into the folder `out`; returns the path of its report.html.

    size: small (minutes on two cores) or full (larger pictures, finer boxes). The same size gives the same numbers.
    scheduler: see `render`; its workers draw the figures. opened: is called with the page once it is there, before the
    figures: it shows what was measured, and each figure once it is drawn.

    The folder appears with that page, whole; a run that ends before the last figure leaves it so, and the same command
    begins anew. `InputError` for an unknown size or an existing folder without `force`.
    """
    if size not in SIZES:
        raise InputError(f"size is {size!r}: give one of small, full")
    steps, target = Steps(progress), Path(out)
    with _draping(SIZES[size], wanted=scheduler is None) as clothes_are_there:
        with whole_folder(target, force or _is_unfinished(target)) as home:
            report = _begun(home, size, SIZES[size], steps)
        opened(target / "report.html")
        try:
            for name, files in _figures(target, SIZES[size], steps, scheduler, clothes_are_there):
                for suffix, data in files.items():
                    write_bytes(target / "figures" / f"{name}{suffix}", data)
                report.figures.append(name)
                write_growing(target, report, steps.seconds)
        except KeyboardInterrupt as interrupt:
            there = f"{target} has the measurement and {len(report.figures)} of {len(SIZES[size].figures)} figures"
            raise KeyboardInterrupt(f"{there}; the same command goes on") from interrupt
    with steps.step("report", DRAWN, 1.0):
        record = {**report.record, "seconds": {key: round(value, 2) for key, value in steps.seconds.items()}}
        write_report(target, Report(record, report.part, report.figures))
        write_growing(target, report, steps.seconds)
        write_json(target / NOTE, record | {"finished": True})
    progress(1.0, "")
    return target / "report.html"


def _begun(home: Path, name: str, size: Size, steps: Steps) -> Report:
    """All but the figures, in `home`."""
    with steps.step("measurement", 0.0, MEASURED) as progress:
        part = cache().kept(
            _measured_key(size),
            lambda folder: _copied(folder, home),
            lambda: measured(home, size, progress),
            lambda part, folder: _keep(part, folder, home),
        )
        (home / "figures").mkdir()
        record = {
            "hagoromo": __version__,
            "backend": backend.name(),
            "versions": {package: version(package) for package in PACKAGES},
            "size": {"name": name, **asdict(size)},
            **part["record"],
        }
        report = Report(record, part, [])
    write_report(home, report)
    write_growing(home, report, steps.seconds)
    write_json(home / NOTE, record | {"finished": False})
    return report


def _measured_key(size: Size) -> list[Any]:
    """What the measurement depends on, for the cache."""
    return ["measured", size.of_capture(), len(size.figures)]


def _draping(size: Size, wanted: bool) -> AbstractContextManager[Callable[[], None]]:
    """Drape the clothes of the person of the first figures in another process, while the samples are measured."""
    own, _ = _shared_out(size)
    person = people(own[0])[0] if own else ""
    worn = set(WARDROBE.get(person, ())) - set(size.without)
    wanted = wanted and bool(worn) and cache().used and not cache().has(_measured_key(size))
    return beside(draped, person, size.resolution, size.seed, wanted=wanted)


def _keep(part: dict[str, Any], folder: Path, home: Path) -> None:
    shutil.copytree(home, folder / "files")
    write_json(folder / "part.json", part)


def _copied(folder: Path, home: Path) -> dict[str, Any]:
    """A part of the cache, whose files are copied to `home`."""
    part = read_json(folder / "part.json")
    shutil.copytree(folder / "files", home, dirs_exist_ok=True)
    return part


def _figures(
    home: Path, size: Size, steps: Steps, scheduler: str | int | None, clothes_are_there: Callable[[], None]
) -> Iterator[tuple[str, Files]]:
    """Every figure once it is drawn, here or on the workers of `scheduler`; here after `clothes_are_there` returns."""
    found = reflectances_of(read_materials(home / "measure" / "materials.json"), size)
    materials = {name: reflectance.record() for name, reflectance in found.items()}
    shares = [MEASURED + (DRAWN - MEASURED) * k / len(size.figures) for k in range(len(size.figures) + 1)]
    if scheduler is None:
        own, others = _shared_out(size)
        missing = [name for name in others if not is_drawn(name, materials, size)]
        with beside(draw_all, missing, materials, size, wanted=bool(missing) and cache().used) as wait:
            for name, begin, end in zip((*own, *others, *_last(size)), shares[:-1], shares[1:], strict=True):
                with steps.step(name.replace("_", " "), begin, end) as progress:
                    clothes_are_there()
                    if name not in own and not is_drawn(name, materials, size):
                        wait()
                    files = drawn(name, materials, size, progress)
                yield name, files
        return
    start = time.perf_counter()
    with workers_of(scheduler) as cluster:
        for done, (number, files) in enumerate(cluster.results(drawn, ((n, materials, size) for n in size.figures))):
            name = size.figures[number].replace("_", " ")
            steps.progress(shares[done + 1], name)
            steps.seconds[name], start = time.perf_counter() - start, time.perf_counter()
            yield size.figures[number], files


def _shared_out(size: Size) -> tuple[list[str], list[str]]:
    """Figures that this process draws, and meanwhile another: those of the first person, and those of one other.

    What shows several persons, which `_last` gives, comes afterwards: it needs the boxes of all.
    """
    alone = [name for name in size.figures if len(people(name)) == 1]
    first = people(alone[0]) if alone else ()
    own = [name for name in alone if people(name) == first]
    return own, [name for name in alone if name not in own]


def _last(size: Size) -> list[str]:
    return [name for name in size.figures if len(people(name)) > 1]


def _is_unfinished(target: Path) -> bool:
    """Whether a folder is that of a demo that ended before its last figure."""
    try:
        note = read_json(target / NOTE)
    except (InputError, OSError):
        return False
    return isinstance(note, dict) and note.get("finished") is False
