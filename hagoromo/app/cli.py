"""The command line `hagoromo COMMAND`: each command parses its arguments, calls the package and prints what it wrote.

Exit status: 0 success; 2 wrong use or wrong input, with one line on standard error; 130 Ctrl-C, 143 SIGTERM, 129
SIGHUP; 141 nobody reads the output any more; 1 a bug, or a machine that `doctor` finds unable to render.
Commands import modules when they run, so that `--help` is fast.
"""

from __future__ import annotations

import contextlib
import functools
import io
import json
import math
import re
import sys
from collections.abc import Callable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro
from tyro.conf import Positional

import hagoromo as hg
from hagoromo.app import batch_verb as batch_verb
from hagoromo.app import cache_verb as cache_verb
from hagoromo.app import capture_verb as capture_verb
from hagoromo.app import health_verb as health_verb
from hagoromo.app import inspection_verbs as inspection_verbs
from hagoromo.app import recipes_verb as recipes_verb
from hagoromo.app import spectra_verb as spectra_verb
from hagoromo.app.build_verb import build
from hagoromo.app.calibrations import calibrations
from hagoromo.app.everywhere import HELP, Everywhere, everywhere, give_up_streams, printable_streams, taken
from hagoromo.app.interrupt import exit_status, signals_as_interrupt, wait_for_kernels
from hagoromo.app.progress_bar import progress_bar
from hagoromo.app.render_verb import render
from hagoromo.app.shared_options import AS_ON_SRGB, AS_STATED, HERE, LookOfPicture, Scheduler, Sensor
from hagoromo.app.verb import (
    Force,
    Out,
    abouts,
    load_verbs,
    overview,
    picture_or_film,
    say,
    verb,
    verbs,
    with_picture,
    wrote,
)
from hagoromo.errors import InputError
from hagoromo.files.finite import finite_json
from hagoromo.files.memory import is_shortage, shortage
from hagoromo.files.names import printable
from hagoromo.files.whole import (
    names_written,
    replaceable_file,
    replaceable_files,
    whole_file,
    whole_folder,
)

DONE, CANNOT_RENDER, BAD_INPUT, NOT_READ = 0, 1, 2, 141
DESCRIPTION = f"From calibrated photographs to measured reflectance, volume boxes and rendered images. {HELP}"
PASSWORD = re.compile(r"[^\s=:/]*:[^\s]*@")  # a user, and a password, before the host of an address
ANSI = re.compile(r"\x1b\[[0-9;]*m")

abouts["calibrate"] = "Calibrate a camera, its response, lamps, or a rig of lamps."
verbs.command(calibrations, name="calibrate", help=abouts["calibrate"])
load_verbs()


def main(arguments: Sequence[str] | None = None, ends: bool = False) -> int:
    """Run the command in `arguments` (default: those of the process); returns the exit status.

    ends: the process ends with the command.
    """
    arguments = sys.argv[1:] if arguments is None else list(arguments)
    printable_streams()
    try:
        status = _run(arguments, ends)
        if sys.stdout is not None:
            sys.stdout.flush()
    except BrokenPipeError:  # as when | head has read enough
        give_up_streams()
        return NOT_READ
    except OSError as error:  # of a standard output that is a file on a full disk
        print(f"hagoromo: standard output: {printable(error)}", file=sys.stderr)
        give_up_streams()
        return BAD_INPUT
    return status


def _run(arguments: list[str], ends: bool) -> int:
    """Parse and run a command; returns the exit status."""
    if arguments == ["--version"]:
        print(f"hagoromo {hg.__version__}")
        return DONE

    def run() -> int | None:
        words, options = taken(arguments)
        if words in (["-h"], ["--help"]):
            print(overview(DESCRIPTION))
            return DONE
        _check_command(words)
        with everywhere(options), signals_as_interrupt():
            return parsed(words)()

    return _ended(run, ends)


def _check_command(words: Sequence[str]) -> None:
    """`InputError` where the first word is no command."""
    if not words:
        raise InputError("no command was given: `hagoromo --help` lists them")
    if words[0] not in abouts and not words[0].startswith("-"):
        import difflib

        near = "".join(f"give {name}, or " for name in difflib.get_close_matches(words[0], abouts, 1))
        given = PASSWORD.sub("…@", words[0])
        raise InputError(f"{given!r} is no command: {near}see `hagoromo --help`")


def carry_out(call: Callable[[], int | None]) -> int:
    """Run a command that `parsed` gave, without options of every command; returns the exit status as `main` does."""

    def run() -> int | None:
        with everywhere(Everywhere()), signals_as_interrupt():
            return call()

    return _ended(run, ends=False)


def _ended(run: Callable[[], int | None], ends: bool) -> int:
    """Run a command and say in one line what ended it; returns the exit status."""
    names_written.clear()
    try:
        return run() or DONE
    except BrokenPipeError:
        raise
    except (InputError, OSError) as error:
        print(f"hagoromo: {printable(error)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt as interrupt:
        written = f"{', '.join(map(str, names_written))} was written" if names_written else "nothing was written"
        print(f"hagoromo: interrupted: {printable(interrupt) or written}", file=sys.stderr)
        if not ends:
            wait_for_kernels()
        return exit_status()
    except Exception as error:
        if not is_shortage(error):
            raise
        print(f"hagoromo: {shortage(error)}", file=sys.stderr)
        return BAD_INPUT


def parsed(arguments: Sequence[str]) -> functools.partial[int | None]:
    """The command with its arguments, ready to run; `InputError` for wrong use."""
    found = _found(arguments)
    if isinstance(found, str):  # a box breaks a word over its rows: a password in it goes before, it is not found after
        hidden = [PASSWORD.sub("…@", word) for word in arguments]
        said = found if hidden == list(arguments) else _found(hidden)
        raise InputError(said if isinstance(said, str) else "wrong use of an address")
    return found


def _found(arguments: Sequence[str]) -> functools.partial[int | None] | str:
    """The command, ready to run, or what is wrong with it."""
    errors = io.StringIO()
    try:
        with contextlib.redirect_stderr(errors):
            return verbs.cli(
                prog="hagoromo", description=DESCRIPTION, args=arguments, config=(tyro.conf.FlagCreatePairsOff,)
            )
    except SystemExit as end:
        if not end.code:
            raise  # --help
        return _from_box(errors.getvalue())


def _from_box(text: str) -> str:
    """Tyro's error box as one line: rows are joined, horizontal rules (─ or -) become semicolons."""
    rows = [ANSI.sub("", row).strip("│|╭╮╰╯+ ") for row in text.splitlines()[1:-1]]
    clauses = " ".join("\n" if set(row) in ({"─"}, {"-"}) else row for row in rows).split("\n")
    return "; ".join(printable(clause) for clause in clauses if clause.strip())


@verb(verbs)
def simulate(scene: Positional[Path], out: Out, force: Force = False) -> None:
    """Scene → photographs as its camera would take them (noise, mosaic, bits), one per lamp, with the ground truth.

    Args:
        scene: scene TOML.
    """
    with whole_folder(out, force) as partial, progress_bar("simulate") as progress:
        hg.simulate(scene, name=scene.stem, progress=progress).save(partial)
    wrote(out)


@verb(verbs)
def develop(
    photographs: Positional[tuple[Path, ...]],
    out: Out,
    dark: tuple[Path, ...] = (),
    dark_exposures: tuple[float, ...] = (),
    flat: tuple[Path, ...] = (),
    demosaic: Literal["bilinear", "menon2007"] = "bilinear",
    undistort: Path | None = None,
    sensor: Sensor = AS_STATED,
    force: Force = False,
) -> None:
    """Exposures of one view (RAW, TIFF, PNG, JPEG, EXR) → EXR of linear camera colours with their variance.

    Args:
        photographs: one, or a bracket, which is merged.
        dark: frames without light, of the same exposure times.
        dark_exposures: exposure times of the dark frames [s], if their files do not state them.
        flat: frames of an evenly lit white field.
        demosaic: method of interpolating the mosaic.
        undistort: camera.json of `calibrate camera`, or OpenCV's YAML, whose lens distortion is removed.
    """
    from hagoromo.app.development_summary import development_summary
    from hagoromo.photograph.development.development import check_exr_name

    replaceable_file(check_exr_name(out), force)
    stated: dict[str, Any] = asdict(sensor)
    development = hg.develop(
        photographs, darks=dark, dark_exposures_s=dark_exposures, flats=flat, exposures_s=stated.pop("exposures"),
        demosaic=demosaic, undistort=undistort, **stated,
    )  # fmt: skip
    development.save(out, force)
    say(*development_summary(development))
    wrote(out)


@verb(verbs)
def measure(
    capture: Positional[Path],
    out: Out,
    n: float | None = None,
    distance: float | None = None,
    across: float | None = None,
    facets: Literal["auto", "gaussian", "student-t"] = "auto",
    interface: Literal["auto", "neutral", "coloured"] = "auto",
    own_light: Literal["report", "subtract"] = "report",
    estimate: tuple[str, ...] = (),
    rig: Path | None = None,
    scheduler: Scheduler = HERE,
    force: Force = False,
) -> None:
    """Capture → materials.json, normals.exr, labels.png, a picture of each photograph's residuals, report.html.

    Args:
        capture: folder with transforms.json, its lamps known; without its shape it needs four lamps or more.
        n: refractive index, where it is known.
        distance: from the camera to an object of unknown shape [m] (default: to the world's origin).
        across: what the longer side of the picture shows at the object [m], in place of the distance: it is the scale
            where no focal length is known.
        facets: Gaussian, with tails (student-t), or by evidence (auto).
        interface: in the colour of the lamp (neutral), coloured, or by evidence (auto).
        own_light: the light that an object of unknown shape sends to itself: report it, or subtract it and solve again.
        estimate: what else all photographs have in common, by name (a wrong one lists them), to estimate and take out.
        rig: rig.json of `calibrate rig`: strength and fall-off of the lamps, by which the photographs are divided.
    """
    with whole_folder(out, force) as home, progress_bar("measure") as progress:
        measurement = hg.measure(
            capture, n=n, distance=distance, across=across, facets=facets, interface=interface, own_light=own_light,
            estimate=estimate, rig=rig, scratch=home, progress=progress, scheduler=scheduler.chosen,
        )  # fmt: skip
        measurement.write_into(home)
        hg.write_measure_report(home / "report.html", measurement)
    if measurement.health is not None:
        say(*(check.sentence for check in measurement.health.checks))
    for material in measurement.materials:
        names = [name for name, identifiable in material.identifiable.items() if identifiable]
        tails = "" if math.isinf(material.nu) else f", facets with tails of nu = {material.nu:.3g}"
        tails += f", {1 + len(material.lobes)} lobes" if material.lobes else ""
        say(f"{material.name}: {material.pixels} pixels, identifiable: {', '.join(names) or 'no parameter'}{tails}")
    wrote(out / "report.html")


verb(verbs)(build)
verb(verbs, writes=picture_or_film)(render)


@verb(verbs, writes=with_picture)
def expose(
    image: Positional[Path],
    out: Out,
    strength: tuple[str, ...] = (),
    spectrum: tuple[str, ...] = (),
    response: str | None = None,
    look: LookOfPicture = AS_ON_SRGB,
    force: Force = False,
) -> None:
    """Rendered EXR → EXR and PNG under lamps of other strength or colour, or through another camera; no new rendering.

    Args:
        image: EXR of `render`; with `--separate-lamps`, each lamp can be changed by itself.
        strength: NAME=FACTOR on the intensity of a lamp, such as key=0.5.
        spectrum: NAME=SPECTRUM of a lamp: the name of an illuminant such as A or D65, or a CSV.
        response: response of the camera: a name or a CSV (default: linear sRGB).
    """
    replaceable_files(with_picture(out).files, force)
    factors = {name: _factor(value, name) for name, value in map(_named_value, strength)}
    exposed = hg.expose(image, factors, dict(map(_named_value, spectrum)))
    seen_by = None if response is None else hg.Response.load(response)
    wrote(*exposed.save(out, seen_by, force, display=look.chosen))


def _named_value(text: str) -> tuple[str, str]:
    """A lamp's name and the value for it."""
    name, equals, value = text.rpartition("=")
    if not (name and equals and value):
        raise InputError(f"{text!r} does not say which lamp: give NAME=VALUE, such as key=0.5")
    return name, value


def _factor(text: str, name: str) -> float:
    try:
        return float(text)
    except ValueError:
        raise InputError(f"the strength of lamp {name!r} is {text!r}: give a factor such as 0.5") from None


@verb(verbs)
def relight(
    capture: Positional[Path],
    out: Out,
    hold: tuple[str, ...] = (),
    against: Path | None = None,
    n: float | None = None,
    distance: float | None = None,
    rig: Path | None = None,
    force: Force = False,
) -> None:
    """Capture → its surface as volume boxes, rendered to predict photographs that were held out; report.html.

    Args:
        capture: folder with transforms.json, its lamps known; without its shape it needs four lamps or more.
        hold: names of the photographs that are held out, all at once (default: the last).
        against: another capture of the same object, in the same world: all its photographs are predicted, none held.
        n: refractive index, where it is known.
        distance: from the camera to an object of unknown shape [m] (default: to the world's origin).
        rig: rig.json of `calibrate rig`: strength and fall-off of the lamps, also of those that are held out.
    """
    with whole_folder(out, force) as home, progress_bar("relight") as progress:
        relighting = hg.relight(capture, hold=hold, against=against, n=n, distance=distance, rig=rig, progress=progress)
        relighting.write_into(home)
        hg.write_measure_report(home / "measured" / "report.html", relighting.measurement)
        hg.write_relight_report(home / "report.html", relighting)
    for prediction in relighting.predictions:
        figures = prediction.compared[prediction.of_boxes]
        say(
            f"{prediction.name}: volume boxes differ from the photograph by {100 * figures.relative_rmse:.1f} % "
            f"(relative rmse), ΔE00 {figures.delta_e_2000:.2f}"
            f"{f'; {prediction.forecast}' if prediction.forecast else ''}"
        )
    if relighting.advice is not None:
        say(relighting.advice)
    wrote(out / "report.html")


@verb(verbs)
def compare(
    a: Positional[Path],
    b: Positional[Path],
    mask: Path | None = None,
    peak: float | None = None,
    map: Path | None = None,
    force: Force = False,
) -> None:
    """Two images → JSON on standard output: psnr, ssim, delta_e_2000, relative_rmse; and a map of ΔE00.

    Args:
        a: image: PNG, JPEG, TIFF, EXR or HDR.
        b: its reference.
        mask: PNG that is not black where the images are compared.
        peak: value of white in EXR and HDR files (default: the largest of the reference; needed beside a PNG).
        map: PNG of ΔE00, pixel by pixel: black is 0, pale yellow 10 and more.
    """
    if map is not None:
        from hagoromo.image.picture.compare import map_picture

        with whole_file(map, force) as partial:
            hg.write_png(partial, map_picture(hg.delta_e_map(a, b, mask, peak)), srgb=True)
    print(finite_json(hg.compare(a, b, mask, peak).record(), "the comparison"))


@verb(verbs)
def info(file: Positional[Path], decode: bool = False) -> None:
    """Print the contents of a file or folder. Of pictures and volumes only the headers are read.

    Args:
        file: capture, box.zarr, EXR, PNG, JPEG, scene or matter TOML, materials.json, spectrum CSV, cameras (JSON,
            YAML, _par.txt, COLMAP).
        decode: decode the pixels or voxels, too: prints their range, of camera RAW the mosaic and its levels.
    """
    for key, value in hg.info(file, decode).items():
        say(f"{key}: {value if isinstance(value, str) else finite_json(value, key)}")


@verb(verbs)
def schema(kind: Positional[str | None] = None, out: Path | None = None) -> None:
    """JSON Schemas of the files: for editors, and for programs that write them.

    Args:
        kind: file type, such as scene, materials or recipe-cloth, whose schema is printed (default: list all types).
        out: folder to which the schemas of all types are written instead.
    """
    from hagoromo.app.schemas import json_schema, schema_names, write_schemas

    if out is not None:
        wrote(*write_schemas(out))
    elif kind is None:
        print(*schema_names(), sep="\n")
    else:
        print(json.dumps(json_schema(kind), indent=1, ensure_ascii=False))


@verb(verbs)
def doctor(as_json: Annotated[bool, tyro.conf.arg(name="json")] = False) -> int:
    """This machine on one page: backends, GPU, threads, memory, versions, and whether a small kernel is right.

    Exit status 1 if it cannot render; the last line then says what to do. Paste the page into a report of a fault: it
    holds neither the names of user and machine nor the path of the home folder.

    Args:
        as_json: as JSON, for programs.
    """
    from hagoromo.app.doctor import doctor_page

    facts = hg.doctor()
    print(json.dumps(facts, indent=1, ensure_ascii=False) if as_json else doctor_page(facts))
    return DONE if facts["can_render"] else CANNOT_RENDER
