"""Relight: hold photographs out, measure the others, and predict those held out by volume boxes.

Enters: a capture, in memory or in its folder. Leaves: a Relighting.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.whole import scratch_folder
from hagoromo.image.relight.learnt import Learnt, learn
from hagoromo.image.relight.prediction import Prediction, passed_by_boxes, predict
from hagoromo.image.relight.relighting import MEASURED_FOLDER, Relighting
from hagoromo.image.relight.stage import Stage, in_three_channels, make_stage
from hagoromo.image.relight.yardstick import Yardstick, yardstick_of
from hagoromo.measurement.measure import measure
from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.rig import Rig
from hagoromo.progress import Progress, part_of, silent

MEASURING_SHARE = 0.3  # approximate share of the time


def relight(
    capture: Capture | str | Path,
    *,
    hold: Sequence[str] = (),
    against: Capture | str | Path | None = None,
    n: float | None = None,
    distance: float | None = None,
    rig: Rig | str | Path | None = None,
    progress: Progress = silent,
) -> Relighting:
    """Predict photographs of an object from the other photographs of `capture`: a Capture, or the path of its folder.

    The others are measured (`measure`), and the surface is built as volume boxes. The boxes are rendered under the lamp
    and in the camera of each photograph to predict, and compared with it: every pixel of the object in the measured
    view, every one that they cover in another; clipped ones cut off at white. Where the shape is solved, further
    predictions are compared: the boxes, and the reflectance on the normals, with shadows and misfit learnt from the
    photographs measured; and least-squares Lambert.

    hold: names of the photographs that are held out, all at once (default: the last). against: another capture of the
    same object in the same world, under other lamps, spectra or cameras; all its photographs are predicted, and none is
    held out. n, distance [m], rig: as in `measure`; predictions are then times the strength and fall-off that the rig
    has for the lamp, and Lambert is given without and with it. progress: called with the share of the work done (0 … 1)
    and the name of the step. The volume boxes are made from files in a temporary folder; `Relighting.save` writes the
    same files.

    Raises `InputError` for names that are not in the capture, for both hold and against, for too few photographs left,
    and as `measure` does.
    """
    rest, held_out = _split(_loaded(capture), hold, against)
    shown = part_of(progress, 0.0, MEASURING_SHARE)
    measurement = measure(rest, n=n, distance=distance, rig=rig, progress=shown)
    used, even = measurement.rig, rest if measurement.rig is None else measurement.rig.evened_capture(rest)
    with scratch_folder() as home:
        (home / MEASURED_FOLDER).mkdir()
        measurement.write_into(home / MEASURED_FOLDER)
        stage = make_stage(even, home / MEASURED_FOLDER, measurement.normal_map is not None)
        stage.write_into(home)
        same_view = any(stage.was_measured_in(photograph.camera) for photograph in held_out)
        predictions, learnt = [], _learnt(measurement, stage, home) if same_view else {}
        yardsticks: dict[str, tuple[Yardstick | None, Rig | None]] = {
            "lambert": (yardstick_of(rest, measurement), None)
        }
        if used is not None:
            yardsticks["lambert_rig"] = (yardstick_of(even, measurement), used)
        for number, photograph in enumerate(held_out):
            progress(MEASURING_SHARE + (1.0 - MEASURING_SHARE) * number / len(held_out), photograph.name)
            field, corrected = (None, photograph) if used is None else _under(used, stage, photograph)
            by_lambert = _of_yardsticks(yardsticks, stage, photograph)
            found = predict(stage, corrected, number, home, by_lambert, learnt, field)
            predictions.append(_with_forecast(found, measurement, learnt.get("boxes_learnt")))
    progress(1.0, "")
    left_out = learnt["boxes_learnt"].error if learnt else None
    return Relighting(measurement, stage, tuple(predictions), left_out)


def _with_forecast(prediction: Prediction, measurement: Measurement, learnt: Learnt | None) -> Prediction:
    """The prediction with the error that was to be expected of it, in the measured view and with what was learnt."""
    departure = measurement.lamp_departure
    shown = prediction.shown
    if learnt is None or departure is None or shown is None:
        return prediction
    middle = learnt.solved.views.points.mean(axis=0)
    lamps = [lamp.direction_and_irradiance(middle[None])[0][0] for lamp in prediction.source.lamps]
    expected = max(learnt.forecast.expected(to_lamp, shown, departure.photographs) for to_lamp in lamps)
    return replace(prediction, expected=expected, outside=max(map(learnt.outside, lamps)))


def _under(rig: Rig, stage: Stage, photograph: Photograph) -> tuple[NDArray[np.float32], Photograph]:
    """The field of the rig in `photograph`, and the photograph with its lamp where the rig has it."""
    if not stage.was_measured_in(photograph.camera):
        raise InputError(
            f"photograph {photograph.name!r} is of another view than the rig: leave the rig (--rig) out, or predict "
            "photographs of the measured view"
        )
    return rig.field(photograph), rig.corrected(photograph)


def _of_yardsticks(
    yardsticks: Mapping[str, tuple[Yardstick | None, Rig | None]], stage: Stage, photograph: Photograph
) -> dict[str, NDArray[np.float64]]:
    """Values (h, w, C) of the yardsticks, each with its rig, in the measured view."""
    if not stage.was_measured_in(photograph.camera):
        return {}
    return {
        key: yardstick.values(photograph)
        if rig is None
        else rig.field(photograph) * yardstick.values(rig.corrected(photograph))
        for key, (yardstick, rig) in yardsticks.items()
        if yardstick is not None
    }


def _learnt(measurement: Measurement, stage: Stage, home: Path) -> dict[str, Learnt]:
    """Corrections learnt from the photographs, beyond the fit and the boxes of `stage`, if the shape was solved."""
    capture, solved = measurement.capture, measurement.normal_map
    if capture is None or solved is None:
        return {}
    of_fit = learn(capture, solved)
    if of_fit is None:
        return {}
    passed = passed_by_boxes(stage, capture.photographs, solved.views, home)
    of_boxes = learn(capture, solved, passed=passed)
    assert of_boxes is not None  # of the same photographs
    return {"boxes_learnt": of_boxes, "learnt": of_fit}


def _loaded(capture: Capture | str | Path) -> Capture:
    return in_three_channels(capture if isinstance(capture, Capture) else load_capture(capture))


def _split(
    capture: Capture, hold: Sequence[str], against: Capture | str | Path | None
) -> tuple[Capture, tuple[Photograph, ...]]:
    """The capture to measure, and the photographs to predict."""
    if against is not None:
        if hold:
            raise InputError("hold and against contradict each other: give one of them")
        return capture, _loaded(against).photographs
    names = [photograph.name for photograph in capture.photographs]
    held = tuple(hold) or tuple(names[-1:])
    unknown = [name for name in held if name not in names]
    if unknown:
        raise InputError(f"no photograph is called {unknown[0]!r}: the capture has {', '.join(names)}")
    rest = tuple(photograph for photograph in capture.photographs if photograph.name not in held)
    if not rest:
        raise InputError("every photograph is held out: leave some to measure")
    return replace(capture, photographs=rest), tuple(p for p in capture.photographs if p.name in held)
