"""Examine: the checks of a capture, by its own photographs, in seconds."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np

from hagoromo.light.lamp import Lamp
from hagoromo.measurement.health.health import NAMES, Check, Health, Name, doubtful, good, not_testable
from hagoromo.measurement.health.lamps import (
    CLEARLY,
    POWERS,
    FittedLamps,
    fitted_lamps,
    lamps_check,
    strengths_check,
)
from hagoromo.measurement.health.order import order_check
from hagoromo.measurement.health.pictures import blur_check, mask_check, motion_check
from hagoromo.measurement.health.shading import ShadingSample, shading_of
from hagoromo.measurement.linearity import linearity_of, why_not_tested
from hagoromo.measurement.stillness import Stillness, stillness
from hagoromo.measurement.surface.solved_surface import coarse_or_whole
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.exponent import Exponent, exponent_of

FAULTS = ("did not converge", "doubtful")  # words in what a capture says of its calibrations
CALIBRATED = ("camera", "lamps", "rig", "response")
FLAT = np.radians(15.0)  # of normals from their mean (rms): below, strengths explain any transfer to some 3 %
PLANE = np.radians(8.0)  # of most normals from the usual one: below, nearly all that is seen is one plane
LEAST_TAKEN = 0.2  # standard deviation of ln strength, from which strengths nobody stated are fitted
CURVE = "the transfer is to be mended first"
CONFOUNDED = (
    "the surface is so flat that lamps of uneven strength and values that are not linear look alike: state the "
    "strengths, or measure a rig on other objects (hagoromo calibrate rig) and give --rig"
)
NEEDED = 0.5  # misfit of a curve over that of linear values with strengths, from which that curve is said without them
MOST_MISFIT = 4.5  # that strengths leave; six real objects have up to 2.5, right captures of glossy cubes up to 4.4
UNEXPLAINED = "gloss and shadows are so strong that Lambert's law explains the photographs too little"
FLAT_LAMPS = "the surface is so flat that its shading says little of where a lamp is"
FIRST = "the order of the photographs is to be mended first"


@dataclass(frozen=True, eq=False)
class Examined:
    """health: the checks. exponent: that the shading asks for, None where it is not tested. lamps: as the photographs
    show them; None where they do not.
    """

    health: Health
    exponent: Exponent | None
    lamps: FittedLamps | None

    def with_strengths(self, capture: Capture) -> Capture:
        """The capture with the strengths of lamps that nobody stated, where its photographs show large differences."""
        stated = [np.asarray(shot.lamps[0].intensity, np.float64) for shot in capture.photographs if shot.lamps]
        alike = len({one.tobytes() for one in stated}) == 1
        lamps = self.lamps
        if lamps is None or lamps.power != 1.0 or not (alike and lamps.uneven and lamps.spread > LEAST_TAKEN):
            return capture
        said = f"nobody stated them: fitted to the photographs, which differ by {100 * lamps.spread:.0f} %"
        taken = with_strengths(capture, lamps)
        return replace(taken, assumptions={**capture.assumptions, "strengths": said})


def check_photographs(capture: Capture | str | Path) -> Health:
    """The checks of a capture, or of that of a folder: whether its photographs are in order, sharp, unmoved, and lit as
    is stated. `measure` makes them, too. Photographs that are too large to be solved as one are checked reduced.
    """
    return examine(capture if isinstance(capture, Capture) else coarse_or_whole(capture)).health


def examine(capture: Capture, still: Stillness | None = None) -> Examined:
    """The checks of `capture`. still: which of its photographs moved or are blurred, where that is known.

    Strengths of the lamps that the photographs show are taken out before the transfer is tested.
    """
    still = stillness(capture.photographs) if still is None else still
    found: dict[Name, Check] = {
        "motion": motion_check(still), "blur": blur_check(still), "mask": mask_check(capture),
        "calibration": _calibration(capture),
    }  # fmt: skip
    shading = shading_of(capture)
    if isinstance(shading, str):
        found |= {name: not_testable(name, shading) for name in ("order", "strengths", "lamps")}
        lamps, exponent, why = None, linearity_of(capture), ""
    else:
        found["order"] = order_check(shading)
        ordered = found["order"].state != "doubtful"
        shading, lamps, exponent, why = _lit(shading, capture) if ordered else JudgedLamps(shading, None, None, FIRST)
        found |= _of_lamps(shading, capture, lamps, why)
        if exponent is not None and exponent.contradicted and exponent.misfit > MOST_MISFIT:
            exponent, why = None, UNEXPLAINED
    found["transfer"] = _transfer(capture, exponent, why)
    return Examined(Health(checks=tuple(found[name] for name in NAMES)), exponent, lamps)


class JudgedLamps(NamedTuple):
    """shading: the sample by which lamps are judged, without gloss where that explains the photographs. lamps: as
    fitted. exponent: see `Examined`. why: there is none of them.
    """

    shading: ShadingSample
    lamps: FittedLamps | None
    exponent: Exponent | None
    why: str = ""


def _lit(shading: ShadingSample, capture: Capture) -> JudgedLamps:
    """The lamps, and the exponent with their strengths taken out; that of linear values unless it contradicts them.

    Linear values under lamps as they are stated need no other explanation, nor do linear values of a glossy surface.
    On a flat surface each transfer has strengths that explain it. A curve, with the strengths that go with it, has to
    explain the photographs better than linear values with theirs, and clearly so without them.
    """
    linear, stated = fitted_lamps(shading, (1.0,)), linearity_of(capture)
    if not linear.uneven and stated is not None and stated.finding == "linear":
        return JudgedLamps(shading, linear, stated)
    few = shading.few()
    flat = few.relief < FLAT or few.usual_relief < PLANE
    matte, bent = few.without_gloss(), fitted_lamps(shading, POWERS)
    if bent.power != 1.0 and min(bent.misfit) < CLEARLY * min(few.misfit(), matte.misfit()):
        if bent.uneven and flat:
            return JudgedLamps(shading, None, None, CONFOUNDED)
        curved, plain = (linearity_of(with_strengths(capture, lamps)) for lamps in (bent, linear))
        exponent = curved if bent.uneven else stated
        explains = curved is not None and (plain is None or curved.misfit < plain.linear_misfit)
        if exponent is not None and exponent.contradicted and explains:
            return JudgedLamps(shading, bent, exponent)
    if matte is not few:
        return JudgedLamps(matte, fitted_lamps(matte, (1.0,)), exponent_of(matte.lit, matte.to_lamp, matte.to_eye))
    if linear.uneven and flat:
        return JudgedLamps(shading, linear, None, CONFOUNDED)
    if not linear.uneven and (stated is None or not stated.contradicted):
        return JudgedLamps(shading, linear, stated)
    plain = linearity_of(with_strengths(capture, linear))
    needed = stated is not None and plain is not None and stated.misfit < NEEDED * plain.linear_misfit
    return JudgedLamps(shading, linear, stated if needed and not linear.uneven else plain)


def _of_lamps(shading: ShadingSample, capture: Capture, lamps: FittedLamps | None, why: str) -> dict[Name, Check]:
    if lamps is None or lamps.power != 1.0:
        return {name: not_testable(name, why or CURVE) for name in ("strengths", "lamps")}
    if min(lamps.misfit) > MOST_MISFIT:
        return {name: not_testable(name, UNEXPLAINED) for name in ("strengths", "lamps")}
    to_world = capture.photographs[0].camera.camera_to_world[:3, :3]
    flat = shading.few().relief < FLAT
    lamps_said = not_testable("lamps", FLAT_LAMPS) if flat else lamps_check(shading, lamps, to_world)
    return {"strengths": strengths_check(shading, lamps), "lamps": lamps_said}


def with_strengths(capture: Capture, lamps: FittedLamps) -> Capture:
    """The capture whose lamps have the strengths that its photographs show."""
    shots = [
        replace(shot, lamps=(_stronger(shot.lamps[0], float(factor)),))
        for shot, factor in zip(capture.photographs, lamps.strength, strict=True)
    ]
    return replace(capture, photographs=tuple(shots))


def _stronger(lamp: Lamp, factor: float) -> Lamp:
    stated = lamp.intensity
    return replace(lamp, intensity=tuple(v * factor for v in stated) if isinstance(stated, tuple) else stated * factor)


def _transfer(capture: Capture, exponent: Exponent | None, why: str) -> Check:
    if why:
        return not_testable("transfer", why)
    if exponent is None:
        return not_testable("transfer", why_not_tested(capture).removeprefix("not tested: "))
    if exponent.contradicted:
        return doubtful("transfer", exponent.sentence, exponent.advice)
    return (not_testable if exponent.uncertain else good)("transfer", exponent.sentence)


def _calibration(capture: Capture) -> Check:
    """What the capture says of the calibrations that it was made with."""
    stated = {key: text for key in CALIBRATED if (text := capture.assumptions.get(key))}
    if not stated:
        return not_testable("calibration", "the capture does not say how camera and lamps were calibrated")
    said = "; ".join(f"{key}: {text}" for key, text in stated.items())
    if any(word in said for word in FAULTS):
        return doubtful("calibration", said, "calibrate again, see the remarks of that calibration")
    return good("calibration", said)
