"""What calibrations print and draw: balls, lamps and rigs with errors; residuals of a camera, curves of a response."""

from __future__ import annotations

import io

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.camera.calibrate_camera import CameraCalibration
from hagoromo.calibration.lamps.ball import Ball
from hagoromo.calibration.lamps.highlight import DISPUTES
from hagoromo.calibration.lamps.lamp_calibration import LampCalibration, lamps_on_balls
from hagoromo.calibration.lamps.mask_check import CONFIRMED
from hagoromo.calibration.lamps.place import LampPlace
from hagoromo.calibration.lamps.reading import LampReading, Strength
from hagoromo.calibration.lamps.uncalibrated.far_lamps import MIRRORED, SelfCalibration
from hagoromo.calibration.response.response_calibration import ResponseCalibration
from hagoromo.files.names import plot_label
from hagoromo.files.plot import CHANNEL_COLOURS, panels
from hagoromo.light.colour import srgb_encode
from hagoromo.photograph.rig import Rig, RigLampRecord

OUTLIER_COLOUR, POINT_COLOUR = "#b5341d", "#2f5d9b"
ARROW_SHARE = 0.05  # of the image's width: how long the arrow of a residual of three rms is drawn
SIDE = 1600  # [px] of the longer side
OUTLINE, LAMP, DISPUTED = (0, 220, 90), (255, 60, 40), (255, 210, 0)  # colours
SAID = "yellow: may be the lamp, too; the stated error holds both"
BRIGHT = 99.0  # percentile of the photograph that becomes white


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


def residual_plot(calibration: CameraCalibration) -> bytes:
    """PNG: residual arrows over the image, residuals of x against y, rms per photograph with the outliers marked."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(13.0, 4.4), layout="constrained", dpi=110)
    over_image, together, by_photograph = figure.subplots(1, 3)
    corners, residual = (np.concatenate(list(table.values())) for table in (calibration.corners, calibration.residuals))
    scale = ARROW_SHARE * calibration.camera.width / (3.0 * max(calibration.rms, 1e-9))
    arrows = {"angles": "xy", "scale_units": "xy", "scale": 1.0, "width": 0.002, "color": POINT_COLOUR}
    over_image.quiver(*corners.T, *(scale * residual).T, **arrows)
    over_image.set(xlim=(0, calibration.camera.width), ylim=(calibration.camera.height, 0), aspect="equal")
    over_image.set(xlabel="x [px]", ylabel="y [px]", title=f"measured − predicted, drawn × {scale:.0f}")
    together.plot(*residual.T, ".", markersize=3, color=POINT_COLOUR)
    reach = 1.1 * max(np.abs(residual).max(), 1e-9)
    together.set(xlim=(-reach, reach), ylim=(reach, -reach), aspect="equal")
    together.set(xlabel="residual in x [px]", ylabel="residual in y [px]", title=f"{len(corners)} corners")
    names = list(calibration.boards)
    colours = [OUTLIER_COLOUR if name in calibration.outliers else POINT_COLOUR for name in names]
    by_photograph.barh([plot_label(name) for name in names], list(calibration.boards.values()), color=colours)
    by_photograph.axvline(calibration.rms, color="#555", linewidth=0.8)
    by_photograph.invert_yaxis()
    by_photograph.tick_params(labelsize=7)
    by_photograph.set(xlabel="rms [px]", ylabel="photograph", title=f"rms {calibration.rms:.3f} px (outliers in red)")
    picture = io.BytesIO()
    figure.savefig(picture, format="png", metadata={"Software": None})
    return picture.getvalue()


def response_plot(calibration: ResponseCalibration) -> bytes:
    """PNG of the curves, relative to the greatest value."""
    figure, (axis,) = panels(1, 6.4, 3.6)
    response = calibration.response
    top = response.values.max()
    for channel, name in enumerate(response.channels):
        colour = CHANNEL_COLOURS.get(name, f"C{channel}")
        low, high = calibration.interval_95[:, channel].T / top
        axis.fill_between(response.wavelengths, low, high, color=colour, alpha=0.25, linewidth=0)
        axis.plot(response.wavelengths, response.values[:, channel] / top, color=colour, label=plot_label(name))
    axis.set_xlabel("wavelength [nm]", fontsize=9)
    axis.set_ylabel("response [of the greatest], 95 % interval", fontsize=9)
    axis.set_ylim(0.0, 1.3)
    axis.legend(fontsize=8, frameon=False)
    data = io.BytesIO()
    figure.savefig(data, format="png", dpi=120, metadata={"Software": None})
    return data.getvalue()


def ball_picture(photograph: NDArray, found: LampCalibration) -> NDArray[np.uint8]:
    """(height, width, 3) for display: outlines, lamps, and in yellow other places that may be the lamps'.

    photograph: (height, width[, channels]) integers, or light as floats.
    """
    import cv2

    scale = min(SIDE / max(photograph.shape[:2]), 1.0)
    size = max(round(photograph.shape[1] * scale), 1), max(round(photograph.shape[0] * scale), 1)
    values = np.nan_to_num(photograph.astype(np.float32), posinf=0.0)
    small = np.asarray(cv2.resize(values if values.ndim == 2 else values[..., :3], size, interpolation=cv2.INTER_AREA))
    shown = small / max(float(np.percentile(small, BRIGHT)), 1e-30)
    shown = srgb_encode(shown) if photograph.dtype != np.uint8 else np.rint(255.0 * np.clip(shown, 0.0, 1.0))
    picture = np.ascontiguousarray(shown if shown.ndim == 3 and shown.shape[2] == 3 else _grey(shown), np.uint8)
    for ball in found.balls:
        outline = np.rint(ball.outline(180) * scale - 0.5).astype(np.int32)
        cv2.polylines(picture, [outline], True, OUTLINE, max(round(size[0] / 800), 1), cv2.LINE_AA)
    disputed = [_draw_lamp(picture, one, scale) for one in lamps_on_balls(found.readings)]
    if any(disputed):
        size_of_text = max(picture.shape[1] / 1400.0, 0.35)
        at = round(10 * size_of_text), picture.shape[0] - round(14 * size_of_text)
        cv2.putText(picture, SAID, at, cv2.FONT_HERSHEY_SIMPLEX, size_of_text, DISPUTED, 1, cv2.LINE_AA)
    return picture


def _draw_lamp(picture: NDArray[np.uint8], reading: LampReading, scale: float) -> bool:
    """A cross on the lamp's image; a line from there to another place that may be it, if there is one."""
    import cv2

    arm = max(round(picture.shape[1] / 80), 3)
    lamp, other = reading.highlight.centre, reading.highlight.disputed
    x, y = np.rint(np.array(lamp) * scale - 0.5).astype(int).tolist()
    if other is not None:
        u, v = np.rint(np.array(other) * scale - 0.5).astype(int).tolist()
        cv2.line(picture, (x, y), (u, v), DISPUTED, 1, cv2.LINE_AA)
        cv2.drawMarker(picture, (u, v), DISPUTED, cv2.MARKER_TILTED_CROSS, arm, 1, cv2.LINE_AA)
    cv2.drawMarker(picture, (x, y), LAMP, cv2.MARKER_CROSS, arm, 1, cv2.LINE_AA)
    return other is not None


def _grey(shown: NDArray) -> NDArray:
    return np.repeat(shown.reshape(*shown.shape[:2], -1).mean(axis=2)[..., None], 3, axis=2)
