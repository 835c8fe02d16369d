"""Summaries that calibrations print: balls and lamps with standard errors, spread of directions, and rigs."""

from __future__ import annotations

import numpy as np

from hagoromo.calibration.lamps.ball import Ball
from hagoromo.calibration.lamps.highlight import DISPUTES
from hagoromo.calibration.lamps.lamp_calibration import LampCalibration, lamps_on_balls
from hagoromo.calibration.lamps.mask_check import CONFIRMED
from hagoromo.calibration.lamps.place import LampPlace
from hagoromo.calibration.lamps.reading import LampReading
from hagoromo.calibration.lamps.strength import Strength
from hagoromo.calibration.lamps.uncalibrated.far_lamps import MIRRORED, SelfCalibration
from hagoromo.photograph.rig import Rig, RigLampRecord


def lamp_summary(calibration: LampCalibration) -> list[str]:
    """Lines of text."""
    lines = [_of_ball(ball) for ball in calibration.balls]
    lines += [_of_lamp(*pair) for pair in zip(calibration.readings, calibration.strengths, strict=True)]
    spread = calibration.spread
    if spread is None:
        return [*lines, f"for normals: {calibration.remark}"]
    return [*lines, f"{spread.lamps} lamps, condition number of their directions {spread.condition:.2f}"]


def object_summary(calibration: SelfCalibration) -> list[str]:
    """Lines of text on lamps that were calibrated from the object itself."""
    entries = zip(calibration.names, calibration.to_lamp, calibration.standard_error_deg, strict=True)
    lines = [
        f"{name}: to_lamp ({x:.4f}, {y:.4f}, {z:.4f}), standard error {error:.1f}°"
        for name, (x, y, z), error in entries
    ]
    convex = f"the object is assumed convex: {100 * calibration.convex:.0f} % of its outline turns away from the camera"
    count = f"{len(lines)} lamps, condition number of their directions {calibration.condition:.2f}"
    convex = convex if calibration.perspective else f"{convex}; {MIRRORED}"
    return [*lines, convex, count, *calibration.remarks()]


def _of_ball(ball: Ball) -> str:
    x, y = ball.from_mask
    where = "the mask" if ball.source == "mask" else "the photographs"
    if x or y:
        where += f", ({x:.2f}, {y:.2f}) px from the mask's"
    if ball.edge_share is not None and ball.edge_share < CONFIRMED:
        where += f", of which {100 * ball.edge_share:.0f} % is an edge in the photographs: is it on the ball?"
    return f"ball: centre ({ball.centre[0]:.2f}, {ball.centre[1]:.2f}), radius {ball.radius:.2f} px, outline by {where}"


def _dispute(reading: LampReading) -> str:
    """What has the lamp elsewhere, and where."""
    highlight, said = reading.highlight, DISPUTES[reading.highlight.dispute]
    if highlight.disputed is not None:
        apart = float(np.hypot(*np.subtract(highlight.disputed, highlight.centre)))
        return f"{said}, {apart:.1f} px off,"
    return said if reading.from_shading_deg is None else f"{said}, {reading.from_shading_deg:.1f}° off,"


def _of_lamp(lamp: LampReading | LampPlace, strength: Strength | None) -> str:
    x, y, z = lamp.to_lamp
    text = f"{lamp.name}: to_lamp ({x:.4f}, {y:.4f}, {z:.4f}), standard error {lamp.standard_error_deg:.2f}°"
    if isinstance(lamp, LampPlace):
        if lamp.position is None or lamp.standard_error is None:
            inverse = f"{lamp.inverse_distance:.3f} ± {lamp.inverse_distance_error:.3f}"
            text += f", far: the rays are parallel within errors (1/distance {inverse} per m)"
        else:
            place = ", ".join(f"{p:.4f} ± {e:.4f}" for p, e in zip(lamp.position, lamp.standard_error, strict=True))
            text = f"{lamp.name}: position ({place}) m"
    for reading in lamps_on_balls([lamp]):
        if reading.highlight.dispute:
            text += f"; {_dispute(reading)} has it elsewhere: the error holds both"
    if strength is not None:
        shown = zip(strength.intensity, strength.standard_error, strict=True)
        text += f"; intensity {', '.join(f'{v:.4g} ± {e:.2g}' for v, e in shown)} by the {strength.source}"
        text = "; ".join([text, *strength.remarks()])
        if strength.shading is not None:
            to_lamp, error = strength.shading
            off = np.degrees(np.arccos(np.clip(to_lamp @ lamp.to_lamp, -1.0, 1.0)))
            text += f", whose shading gives a direction {off:.2f}° from that by the ball (± {error:.2f}°)"
    return text


def rig_summary(rig: Rig) -> list[str]:
    """Lines of text."""
    lines = [_of_rig_lamp(lamp, number) for number, lamp in enumerate(rig.lamps)]
    if len(rig.sources) == 1:
        lines.append("measured on one capture: what differs from capture to capture is not in these errors")
    return lines


def _of_rig_lamp(lamp: RigLampRecord, number: int) -> str:
    strength, error = float(np.mean(lamp.strength)), 100.0 * np.sqrt(np.diag(lamp.covariance))
    (across, down), name = (100.0 * one for one in lamp.slope), lamp.name or f"lamp {number}"
    return (
        f"{name}: strength {strength:.3f} ± {strength * error[0] / 100.0:.3f}, changes by {across:+.1f} ± "
        f"{error[1]:.1f} % to the right and {down:+.1f} ± {error[2]:.1f} % downwards, over half of the picture's width"
    )
