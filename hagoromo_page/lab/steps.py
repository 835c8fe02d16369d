"""Steps: one table of what the window can do. Each step is a command, from which buttons and shown text derive.

A command runs in the chosen folder, so its paths are those that a person sees there.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from hagoromo.errors import InputError
from hagoromo.photograph.photograph_folder import JPEGS, suffix_of
from hagoromo_page.lab.folder import CIRCLES_FROM, MASK, ON_BALL, PROFILE, Folder
from hagoromo_page.lab.step import LabStep, Option, as_words

CAPTURE, HEALTH, MEASURED, RELIT = "lab/capture", "lab/health.json", "lab/measured", "lab/relit"
CHART, RESPONSE = "lab/chart.exr", "lab/response.csv"
PAGE, EXPORTED, BAG = "lab/page.html", "lab/export", "lab/bag"
CAMERAS = (".json", ".yml", ".yaml")
NO_CAMERAS = ("lamps.json", "health.json")


def _chart_given(folder: Folder) -> list[str]:
    """The chart for `develop`, by what is stated of the photographs."""
    transfer = CAPTURE_STEP.value("transfer", folder)
    facts = [word for option in FACTS for word in option.words("capture", folder)]
    return [*as_words([folder.chart]), *(["--transfer", transfer] if transfer in ("srgb", "linear") else []), *facts]


def _response_given(folder: Folder) -> list[str]:
    corners = [f"{value:.6g}" for corner in folder.record.corners for value in corner]
    linear = folder.chart if folder.chart.lower().endswith(".exr") else CHART
    return [linear, *(["--corners", *corners] if len(corners) == 8 else [])]


def _charts(folder: Folder) -> dict[str, str]:
    return {"": "none", **{name: name for name in folder.charts}}


def _spectra(folder: Folder) -> dict[str, str]:
    files = [one for one in folder.beside if Path(one).suffix.lower() == ".csv" and not one.startswith("-")]
    return {**{name: name for name in ("D65", "D50", "A")}, **{one: one for one in files}}


def _circles(folder: Folder) -> list[str]:
    return [",".join(f"{value:.6g}" for value in circle) for circle in folder.record.circles] or ["auto"]


def _lamps_given(folder: Folder) -> list[str]:
    return [*as_words(folder.ball_photographs), *(word for one in _circles(folder) for word in ("--mask", one))]


def _capture_given(folder: Folder) -> list[str]:
    words = as_words(folder.photographs)
    if folder.lamps_from == ON_BALL:
        words += ["--ball", *_circles(folder)]
    else:
        words += ["--lamps", *as_words([folder.lamp_file])]
    mask = [MASK] if (folder.home / MASK).exists() else []
    chosen = CAPTURE_STEP.value("mask", folder)
    if folder.chart:
        words += ["--response", RESPONSE, "--spectrum", RESPONSE_STEP.value("lamp", folder)]
    return [*words, *{"auto": ["--mask", "auto", *mask], "by hand": ["--mask", *mask] if mask else []}.get(chosen, [])]


def _capture_reads(folder: Folder) -> list[str]:
    lamps = [] if folder.lamps_from == ON_BALL else [folder.lamp_file]
    return [*folder.photographs, *lamps, MASK, *filter(None, [CAPTURE_STEP.value("camera", folder)])]


def _masks(folder: Folder) -> dict[str, str]:
    return {"auto": "found and painted", "by hand": "painted alone", "none": "none"}


def _curves(folder: Folder) -> dict[str, str]:
    return {
        "": "linear, as in RAW", "srgb": "sRGB, as most JPEG", "linear": "linear, 8 bits too",
        "estimate": "found by the shading",
    }  # fmt: skip


def _curve(folder: Folder) -> str:
    """Likeliest by the first file: 8 bits are seldom linear, and what is no JPEG of a camera may be either."""
    if suffix_of(folder.photographs[0]) in JPEGS:
        return "srgb"
    return "estimate" if folder.eight_bits else ""


def _called_like(word: str) -> Callable[[Folder], dict[str, str]]:
    """Choices of the JSON files beside the photographs that have the word in their name."""

    def files(folder: Folder) -> dict[str, str]:
        found = [one for one in folder.beside if Path(one).suffix == ".json" and word in Path(one).stem.lower()]
        return {"": "none", **{one: one for one in found if not one.startswith("-")}}

    return files


_rigs, _notes = _called_like("rig"), _called_like("notes")


def _cameras(folder: Folder) -> dict[str, str]:
    files = [one for one in folder.beside if Path(one).suffix.lower() in CAMERAS and not one.startswith("-")]
    others = {*NO_CAMERAS, *_rigs(folder), *_notes(folder)}
    files = [one for one in files if not others & {one, Path(one).name}]
    return {"": "from the EXIF", "orthographic": "orthographic", **{one: one for one in files}}


def _sources(folder: Folder) -> dict[str, str]:
    def said(source: str) -> str:
        if source == ON_BALL:
            return "a chrome ball in the photographs"
        return source if Path(source).suffix else f"photographs of a chrome ball in {source}/"

    return {source: said(source) for source in folder.lamp_sources}


def _held(folder: Folder) -> dict[str, str]:
    return {Path(name).stem: name for name in folder.photographs if not name.startswith("-")}


def _called(folder: Folder) -> str:
    return "" if folder.home.name.startswith("-") else folder.home.name


def _published(folder: Folder) -> list[str]:
    """The page says what the archive does, where it is filled in."""
    try:
        profile = folder.profile
    except InputError:  # which the window says beside it
        profile = {}
    inventory = ARCHIVE_STEP.value("inventory", folder).strip()
    facts = {"Inventory number": inventory} | {label: profile.get(key, "") for key, label in FACTS_OF_PAGE.items()}
    stated = [word for label, said in facts.items() if said for word in ("--fact", f"{label}={said}")]
    return [MEASURED, "--capture", CAPTURE, *stated]


def _archived(folder: Folder) -> list[str]:
    results = [name for name in (MEASURED, PAGE, RELIT) if (folder.home / name).exists()]
    profile = ["--profile", PROFILE] if (folder.home / PROFILE).exists() else []
    return [*(results or [MEASURED]), "--originals", *as_words(folder.photographs), *profile]


FACTS_OF_PAGE = {"creator": "Made by", "institution": "Institution", "licence": "Licence", "place": "Place"}
FORMATS = {
    "png": "maps, PNG", "tiff": "maps, TIFF", "exr": "maps, EXR", "glb": "mesh, GLB", "ply": "mesh, PLY", "ptm": "PTM",
    "hsh": "HSH (.rti)", "relight": "Relight (OpenLIME)", "csv": "spectra, CSV", "materialx": "MaterialX",
    "openpbr": "OpenPBR (MaterialX)", "rgl": "tables for Mitsuba",
    "openmaterial": "ASAM OpenMATERIAL 3D",
}  # fmt: skip
FACTS = (  # that files of photographs may lack
    Option("exposure", "Exposure [s]", "--exposures", hint="of each", aside=True),
    Option("iso", "ISO", "--iso", aside=True), Option("black", "Black level", "--black", aside=True),
    Option("white", "White level", "--white", aside=True),
    Option("mosaic", "Mosaic", "--mosaic", hint="such as RGGB, or none", aside=True),
)  # fmt: skip
LAMPS_STEP = LabStep(
    "lamps", "Find the lamps", "Each chrome ball shows where the lamp of each photograph is.",
    ("calibrate", "lamps"), _lamps_given, CIRCLES_FROM,
    options=(Option("from", "Lamps from", "", _sources, lambda folder: folder.lamp_sources[0]),),
    reads=lambda folder: folder.ball_photographs,
    applies=lambda folder: not folder.has_lamp_file,
    stands_for={"--mask": "the tool Ball"},
)  # fmt: skip
DEVELOP_STEP = LabStep(
    "develop", "Develop the chart", "The chart's photograph becomes linear in light.",
    ("develop",), _chart_given, CHART,
    reads=lambda folder: (folder.chart,),
    applies=lambda folder: bool(folder.chart) and not folder.chart.lower().endswith(".exr"),
)  # fmt: skip
RESPONSE_STEP = LabStep(
    "response", "Read the chart", "24 known colours show how the camera responds to light.",
    ("calibrate", "response"), _response_given, RESPONSE,
    options=(
        Option("chart", "Colour chart", "", _charts),
        Option("lamp", "Spectrum of lamp", "--lamp", _spectra, lambda folder: "D65"),
    ),
    reads=lambda folder: (folder.chart, RESPONSE_STEP.value("lamp", folder)),
    after=(DEVELOP_STEP,), applies=lambda folder: bool(folder.chart),
)  # fmt: skip
CAPTURE_STEP = LabStep(
    "capture", "Put together", "Photographs, lamps, camera and mask become one folder to measure.",
    ("capture",), _capture_given, CAPTURE,
    options=(
        Option("mask", "Mask", "", _masks, lambda folder: "auto"),
        Option("transfer", "Transfer", "--transfer", _curves, _curve),
        Option("camera", "Camera", "--camera", _cameras), *FACTS,
    ),
    reads=_capture_reads, after=(LAMPS_STEP, RESPONSE_STEP),
    stands_for={"--ball": "the tool Ball", "--mask": "Mask", "--lamps": "Lamps from"},
)  # fmt: skip
HEALTH_STEP = LabStep(
    "health", "Check the photographs", "Order, lamps, strengths, transfer, motion, blur, mask, calibration.",
    ("health",), lambda folder: [CAPTURE], HEALTH, after=(CAPTURE_STEP,),
)  # fmt: skip
MEASURE_STEP = LabStep(
    "measure", "Measure", "Normals, colour, gloss and shape of every pixel, with their errors.",
    ("measure",), lambda folder: [CAPTURE], MEASURED,
    options=(
        Option("distance", "Distance [m]", "--distance", hint="camera to object: for mm"),
        Option("across", "or width [m]", "--across", hint="that the longer side shows"),
        Option("rig", "Rig", "--rig", _rigs),
        Option("n", "Refractive index", "--n", hint="leave empty if you do not know it"),
        Option(
            "own_light", "Light between its parts", "--own-light",
            lambda folder: {"": "report it", "subtract": "subtract it"},
        ),
    ),
    after=(CAPTURE_STEP,), opens=("report.html",),
)  # fmt: skip
RELIGHT_STEP = LabStep(
    "relight", "Compare with a photograph kept aside",
    "Measures without one photograph, predicts it, and shows both side by side.",
    ("relight",), lambda folder: [CAPTURE], RELIT,
    options=(
        Option("hold", "Kept aside", "--hold", _held, lambda folder: next(reversed(_held(folder)), "")),
    ),
    after=(CAPTURE_STEP,), opens=("report.html",),
)  # fmt: skip
PUBLISH_STEP = LabStep(
    "publish", "Publish", "One page to send round: anybody relights the object, without a server.",
    ("publish",), _published, PAGE,
    options=(
        Option("title", "Title", "--title", default=_called, hint="what the object is called"),
        Option("notes", "Notes", "--notes", _notes),
    ),
    after=(MEASURE_STEP,), opens=("",),
)  # fmt: skip
EXPORT_STEP = LabStep(
    "export", "Export", "Files for other programs; export.json says what each of them loses.",
    ("export",), lambda folder: [MEASURED], EXPORTED,
    options=(Option("to", "Formats", "--to", lambda folder: FORMATS, lambda folder: "png glb", many=True),),
    after=(MEASURE_STEP,),
)  # fmt: skip
ARCHIVE_STEP = LabStep(
    "archive", "Archive", "A bag (BagIt) with the digest of every file, for the museum.",
    ("archive",), _archived, BAG,
    options=(
        Option("inventory", "Inventory number", "--inventory", hint="needed"),
        Option("title", "Title", "--title", default=_called),
        Option("date", "Date", "--date", hint="of the photographs, such as 2026-11-27"),
        Option("notes", "Notes", "--notes", _notes),
    ),
    reads=lambda folder: (PROFILE, PAGE, RELIT), after=(MEASURE_STEP,),
    lacks=lambda folder: () if ARCHIVE_STEP.value("inventory", folder).strip() else ("Inventory number",),
)  # fmt: skip
TABLE = (
    LAMPS_STEP,
    DEVELOP_STEP,
    RESPONSE_STEP,
    CAPTURE_STEP,
    HEALTH_STEP,
    MEASURE_STEP,
    RELIGHT_STEP,
    PUBLISH_STEP,
    EXPORT_STEP,
    ARCHIVE_STEP,
)
STEPS = {step.name: step for step in TABLE}
