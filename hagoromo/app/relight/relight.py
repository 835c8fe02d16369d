"""The verb relight: photographs are kept aside, the others measured, the surface built as volume boxes and rendered.

Everything is done the user's way and stays in the folder: `measured` is what `measure` writes, relief.toml
is a recipe for `build`, scene_NN.toml are scenes for `render`, predicted_NN.exr and photograph_NN.exr
are for `compare`.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from hagoromo.app.measure_capture import Known, fill_measured
from hagoromo.app.relight.relight_page import write_relight_page
from hagoromo.app.relight.relit import Relit, relit
from hagoromo.app.relight.stage import fill_stage
from hagoromo.errors import InputError
from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_folder
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.progress import Progress, part_of, silent

MEASURING_SHARE = 0.3  # share of the work, about


def relight_capture(
    folder: str | Path,
    out: str | Path,
    hold: Sequence[str] = (),
    against: str | Path | None = None,
    known: Known | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> tuple[Relit, ...]:
    """Predict photographs from the others of the capture in `folder`, and write all of it to the folder `out`.

    hold: names of those that are kept aside, all at once (default: the last). against: another capture of the same
    object in the same world, under other lamps, spectra or cameras; all its photographs are predicted, none is held.
    `InputError` for names that are not in the capture, both of hold and against, or too few photographs left.
    """
    with whole_folder(out, force) as home:
        rest, aside = _split(load_capture(folder), hold, against)
        (home / "measured").mkdir()
        fill_measured(rest, home / "measured", known or Known(), part_of(progress, 0.0, MEASURING_SHARE))
        stage = fill_stage(rest, home)
        results = []
        for number, photograph in enumerate(aside):
            progress(MEASURING_SHARE + (1.0 - MEASURING_SHARE) * number / len(aside), photograph.name)
            results.append(relit(stage, photograph, number))
        write_json(home / "relit.json", [one.record() for one in results])
        write_relight_page(home / "report.html", rest.name, len(rest.photographs), results)
        progress(1.0, "")
    return tuple(results)


def _split(capture: Capture, hold: Sequence[str], against: str | Path | None) -> tuple[Capture, tuple[Photograph, ...]]:
    """The capture to measure, and the photographs to predict."""
    if against is not None:
        if hold:
            raise InputError("--hold and --against contradict each other: give one of them")
        return capture, load_capture(against).photographs
    names = [photograph.name for photograph in capture.photographs]
    held = tuple(hold) or tuple(names[-1:])
    unknown = [name for name in held if name not in names]
    if unknown:
        raise InputError(f"no photograph is called {unknown[0]!r}: the capture has {', '.join(names)}")
    rest = tuple(photograph for photograph in capture.photographs if photograph.name not in held)
    if not rest:
        raise InputError("every photograph is kept aside: leave some to measure")
    return replace(capture, photographs=rest), tuple(p for p in capture.photographs if p.name in held)
