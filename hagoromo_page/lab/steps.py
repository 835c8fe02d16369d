"""Steps: one table of what the window can do. Each step is a command, from which buttons and shown text derive.

A command runs in the chosen folder, so its paths are those that a person sees there.
"""

from __future__ import annotations

import re
import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from hagoromo_page.lab.folder import CIRCLES_FROM, MASK, ON_BALL, Folder, Made

PROGRAM = "hagoromo"
CAPTURE, HEALTH, MEASURED, RELIT = "lab/capture", "lab/health.json", "lab/measured", "lab/relit"
CHART, RESPONSE = "lab/chart.exr", "lab/response.csv"
PAGE, EXPORTED, BAG, PROFILE = "lab/page.html", "lab/export", "lab/bag", "lab/archive.toml"
JPEGS = (".jpg", ".jpeg")
CAMERAS = (".json", ".yml", ".yaml")
NO_CAMERAS = ("lamps.json", "health.json")
State = Literal["to do", "done", "out of date"]


@dataclass(frozen=True)
class Option:
    """A choice that becomes words of a command.

    flag: of the command; "": the step's own words say it. choices: value → what people read; none: free text.
    many: whether the value is words, each chosen by itself. default, choices: of a folder. aside: seldom needed.
    """

    name: str
    label: str
    flag: str
    choices: Callable[[Folder], dict[str, str]] | None = None
    default: Callable[[Folder], str] = lambda folder: ""
    many: bool = False
    hint: str = ""
    aside: bool = False

    def value(self, step: str, folder: Folder) -> str:
        """What was chosen in a folder; the default where that is not offered, or would be an option."""
        chosen, default = folder.option(step, self.name, self.default(folder)), self.default(folder)
        known = None if self.choices is None else self.choices(folder)
        offered = not chosen.startswith("-") if known is None else set(self._parts(chosen)) <= set(known)
        return chosen if offered else default

    def words(self, step: str, folder: Folder) -> list[str]:
        """Its words in a command."""
        parts = [part for part in self._parts(self.value(step, folder)) if part]
        return [self.flag, *parts] if self.flag and parts else []

    def _parts(self, value: str) -> list[str]:
        return value.split() if self.many else [value]


@dataclass(frozen=True)
class Step:
    """A command of the window.

    verb: its first words. given: the words that follow. reads: files it depends on, beside results of the steps in
    `after`, which are run before it. makes: what it writes, in the folder. applies: whether there is anything to do.
    """

    name: str
    title: str
    does: str
    verb: tuple[str, ...]
    given: Callable[[Folder], list[str]]
    makes: str
    options: tuple[Option, ...] = ()
    reads: Callable[[Folder], Sequence[str]] = lambda folder: ()
    after: tuple[str, ...] = ()
    applies: Callable[[Folder], bool] = lambda folder: True
    opens: tuple[str, ...] = field(default=())

    def value(self, option: str, folder: Folder) -> str:
        """What was chosen for an option in a folder."""
        return next(one for one in self.options if one.name == option).value(self.name, folder)

    def plain_words(self, folder: Folder) -> list[str]:
        """The words of its command in a folder, without --force."""
        chosen = [word for option in self.options for word in option.words(self.name, folder)]
        return [*self.verb, *self.given(folder), *chosen, "--out", self.makes]

    def words(self, folder: Folder) -> list[str]:
        """The words of its command as it is to be run now: --force where its result is there already."""
        return [*self.plain_words(folder), *(["--force"] if (folder.home / self.makes).exists() else [])]

    def shown(self, folder: Folder) -> str:
        """The command as people copy it into a terminal: all photographs of a folder are *.jpg there, if it is safe."""
        text = f" {shlex.join([PROGRAM, *self.words(folder)])} "
        for names in {folder.photographs, folder.ball_photographs}:
            pattern, listed = _pattern(folder, names), f" {shlex.join(_paths(names))} "
            text = text.replace(listed, f" {pattern} ") if pattern else text
        return text.strip()

    def made(self, folder: Folder) -> Made:
        """What its result would be made of now."""
        needed = [STEPS[name].makes for name in self.after if STEPS[name].applies(folder)]
        return Made(self.plain_words(folder), folder.read_digest([*self.reads(folder), *needed]))

    def state(self, folder: Folder) -> State:
        """Whether its result is there, and still what the command would give.

        A result that was made outside of the window is taken as it is.
        """
        if not (folder.home / self.makes).exists():
            return "to do"
        before = [STEPS[name] for name in self.after if STEPS[name].applies(folder)]
        kept = folder.record.made.get(self.name)
        stale = any(one.state(folder) != "done" for one in before) or kept not in (None, self.made(folder))
        return "out of date" if stale else "done"

    def chain(self, folder: Folder) -> list[Step]:
        """The steps to run for its result: those before it that are not done, and itself."""
        chained: list[Step] = []
        for name in self.after:
            one = STEPS[name]
            if one.applies(folder) and one.state(folder) != "done":
                chained += [each for each in one.chain(folder) if each not in chained]
        return [*chained, self]


def _pattern(folder: Folder, names: Sequence[str]) -> str:
    """What a shell expands to `names`, in their order; "" where another shell might have another order, or other files.

    Names are of one length, of letters, digits, _ and -, and in the order of their characters.
    """
    home, suffix = (Path(names[0]).parent, Path(names[0]).suffix) if len(names) > 1 else (Path(), "")
    plain = rf"[A-Za-z0-9_][\w-]*{re.escape(suffix)}"
    stems = [Path(name).name for name in names]
    alike = len({len(stem) for stem in stems}) == 1 and all(re.fullmatch(plain, stem, re.ASCII) for stem in stems)
    there = sorted(one.name for one in folder.file(str(home)).glob(f"*{suffix}") if not one.name.startswith("."))
    whole = (
        suffix
        and alike
        and stems == there
        and stems == sorted(stems, key=str.lower)
        and shlex.quote(str(home)) == str(home)
    )
    return str(home / f"*{suffix}") if whole else ""


def _chart_given(folder: Folder) -> list[str]:
    """The chart for `develop`, by what is stated of the photographs."""
    transfer = STEPS["capture"].value("transfer", folder)
    facts = [word for option in FACTS for word in option.words("capture", folder)]
    return [*_paths([folder.chart]), *(["--transfer", transfer] if transfer in ("srgb", "linear") else []), *facts]


def _response_given(folder: Folder) -> list[str]:
    corners = [f"{value:.6g}" for corner in folder.record.corners for value in corner]
    linear = folder.chart if folder.chart.lower().endswith(".exr") else CHART
    return [linear, *(["--corners", *corners] if len(corners) == 8 else [])]


def _charts(folder: Folder) -> dict[str, str]:
    return {"": "none", **{name: name for name in folder.charts}}


def _spectra(folder: Folder) -> dict[str, str]:
    files = [one for one in folder.beside if Path(one).suffix.lower() == ".csv" and not one.startswith("-")]
    return {**{name: name for name in ("D65", "D50", "A")}, **{one: one for one in files}}


def _paths(names: Sequence[str]) -> list[str]:
    """Names as a command takes them: one that begins with - is no option."""
    return [f"./{name}" if name.startswith("-") else name for name in names]


def _circles(folder: Folder) -> list[str]:
    return [",".join(f"{value:.6g}" for value in circle) for circle in folder.record.circles] or ["auto"]


def _lamps_given(folder: Folder) -> list[str]:
    return [*_paths(folder.ball_photographs), *(word for one in _circles(folder) for word in ("--mask", one))]


def _capture_given(folder: Folder) -> list[str]:
    words = _paths(folder.photographs)
    if folder.lamps_from == ON_BALL:
        words += ["--ball", *_circles(folder)]
    else:
        words += ["--lamps", *_paths([folder.lamp_file])]
    mask = [MASK] if (folder.home / MASK).exists() else []
    chosen = STEPS["capture"].value("mask", folder)
    if folder.chart:
        words += ["--response", RESPONSE, "--spectrum", STEPS["response"].value("lamp", folder)]
    return [*words, *{"auto": ["--mask", "auto", *mask], "by hand": ["--mask", *mask] if mask else []}.get(chosen, [])]


def _capture_reads(folder: Folder) -> list[str]:
    lamps = [] if folder.lamps_from == ON_BALL else [folder.lamp_file]
    return [*folder.photographs, *lamps, MASK, *filter(None, [STEPS["capture"].value("camera", folder)])]


def _masks(folder: Folder) -> dict[str, str]:
    return {"auto": "found and painted", "by hand": "painted alone", "none": "none"}


def _curves(folder: Folder) -> dict[str, str]:
    return {
        "": "linear, as in RAW", "srgb": "sRGB, as most JPEG", "linear": "linear, 8 bits too",
        "estimate": "found by the shading",
    }  # fmt: skip


def _cameras(folder: Folder) -> dict[str, str]:
    files = [one for one in folder.beside if Path(one).suffix.lower() in CAMERAS and not one.startswith("-")]
    files = [one for one in files if Path(one).name not in NO_CAMERAS]
    return {"": "from the EXIF", "orthographic": "orthographic", **{one: one for one in files}}


def _sources(folder: Folder) -> dict[str, str]:
    def said(source: str) -> str:
        if source == ON_BALL:
            return "a chrome ball in the photographs"
        return source if Path(source).suffix else f"photographs of a chrome ball in {source}/"

    return {source: said(source) for source in folder.lamp_sources}


def _held(folder: Folder) -> dict[str, str]:
    return {Path(name).stem: name for name in folder.photographs if not name.startswith("-")}


def _archived(folder: Folder) -> list[str]:
    results = [name for name in (MEASURED, PAGE, RELIT) if (folder.home / name).exists()]
    profile = ["--profile", PROFILE] if (folder.home / PROFILE).exists() else []
    return [*(results or [MEASURED]), "--originals", *_paths(folder.photographs), *profile]


FORMATS = {
    "png": "maps, PNG", "tiff": "maps, TIFF", "exr": "maps, EXR", "glb": "mesh, GLB", "ply": "mesh, PLY", "ptm": "PTM",
    "hsh": "HSH (.rti)", "relight": "Relight (OpenLIME)", "csv": "spectra, CSV", "materialx": "MaterialX",
}  # fmt: skip
FACTS = (  # that files of photographs may lack
    Option("exposure", "Exposure [s]", "--exposures", hint="of each", aside=True),
    Option("iso", "ISO", "--iso", aside=True), Option("black", "Black level", "--black", aside=True),
    Option("white", "White level", "--white", aside=True),
    Option("mosaic", "Mosaic", "--mosaic", hint="such as RGGB, or none", aside=True),
)  # fmt: skip
TABLE = (
    Step(
        "lamps", "Find the lamps", "Each chrome ball shows where the lamp of each photograph is.",
        ("calibrate", "lamps"), _lamps_given, CIRCLES_FROM,
        options=(Option("from", "Lamps from", "", _sources, lambda folder: folder.lamp_sources[0]),),
        reads=lambda folder: folder.ball_photographs,
        applies=lambda folder: not folder.has_lamp_file,
    ),
    Step(
        "develop", "Develop the chart", "The chart's photograph becomes linear in light.",
        ("develop",), _chart_given, CHART,
        reads=lambda folder: (folder.chart,),
        applies=lambda folder: bool(folder.chart) and not folder.chart.lower().endswith(".exr"),
    ),
    Step(
        "response", "Read the chart", "24 known colours show how the camera responds to light.",
        ("calibrate", "response"), _response_given, RESPONSE,
        options=(
            Option("chart", "Colour chart", "", _charts),
            Option("lamp", "Spectrum of lamp", "--lamp", _spectra, lambda folder: "D65"),
        ),
        reads=lambda folder: (folder.chart, STEPS["response"].value("lamp", folder)),
        after=("develop",), applies=lambda folder: bool(folder.chart),
    ),
    Step(
        "capture", "Put together", "Photographs, lamps, camera and mask become one folder to measure.",
        ("capture",), _capture_given, CAPTURE,
        options=(
            Option("mask", "Mask", "", _masks, lambda folder: "auto"),
            Option(
                "transfer", "Transfer", "--transfer", _curves,
                lambda folder: "srgb" if Path(folder.photographs[0]).suffix.lower() in JPEGS else "",
            ),
            Option("camera", "Camera", "--camera", _cameras), *FACTS,
        ),
        reads=_capture_reads, after=("lamps", "response"),
    ),
    Step(
        "health", "Check the photographs", "Order, lamps, strengths, transfer, motion, blur, mask, calibration.",
        ("health",), lambda folder: [CAPTURE], HEALTH, after=("capture",),
    ),
    Step(
        "measure", "Measure", "Normals, colour, gloss and shape of every pixel, with their errors.",
        ("measure",), lambda folder: [CAPTURE], MEASURED,
        options=(
            Option("n", "Refractive index", "--n", hint="leave empty if you do not know it"),
            Option(
                "own_light", "Light between its parts", "--own-light",
                lambda folder: {"": "report it", "subtract": "subtract it"},
            ),
        ),
        after=("capture",), opens=("report.html",),
    ),
    Step(
        "relight", "Compare with a photograph kept aside",
        "Measures without one photograph, predicts it, and shows both side by side.",
        ("relight",), lambda folder: [CAPTURE], RELIT,
        options=(
            Option("hold", "Kept aside", "--hold", _held, lambda folder: next(reversed(_held(folder)), "")),
        ),
        after=("capture",), opens=("report.html",),
    ),
    Step(
        "publish", "Publish", "One page to send round: anybody relights the object, without a server.",
        ("publish",), lambda folder: [MEASURED, "--capture", CAPTURE], PAGE,
        options=(Option("title", "Title", "--title", hint="what the object is called"),),
        after=("measure",), opens=("",),
    ),
    Step(
        "export", "Export", "Files for other programs; export.json says what each of them loses.",
        ("export",), lambda folder: [MEASURED], EXPORTED,
        options=(Option("to", "Formats", "--to", lambda folder: FORMATS, lambda folder: "png glb", many=True),),
        after=("measure",),
    ),
    Step(
        "archive", "Archive", "A bag (BagIt) with the digest of every file, for the museum.",
        ("archive",), _archived, BAG,
        options=(
            Option("inventory", "Inventory number", "--inventory"), Option("title", "Title", "--title"),
            Option("date", "Photographed on", "--date", hint="such as 2026-11-27"),
        ),
        reads=lambda folder: (PROFILE, PAGE, RELIT), after=("measure",),
    ),
)  # fmt: skip
STEPS = {step.name: step for step in TABLE}
