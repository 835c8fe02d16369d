"""Calibration of lamps from photographs of chrome balls, one lamp on in each: direction or position, and strength."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Ball, ball_of_circle, is_circle
from hagoromo.calibration.lamps.ball_search import search_balls
from hagoromo.calibration.lamps.lamp_calibration import LampCalibration
from hagoromo.calibration.lamps.lamp_photographs import Transfer8, lamp_photographs
from hagoromo.calibration.lamps.lamps_from_ball import lamps_from_ball
from hagoromo.calibration.lamps.place import LampPlace, locate_lamp
from hagoromo.calibration.lamps.reading import LampReading, Strength, highlight_strength
from hagoromo.calibration.lamps.reference import find_matte_ball, matte_card, reference_strength
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.light.lamp_spread import LampSpread, check_spread
from hagoromo.progress import Progress, part_of, silent

Reading = LampReading | LampPlace
Picture = str | Path | NDArray
AUTO = "auto"  # in place of masks: the balls are found in the photographs
SEARCH = 0.3  # share of the time that finding them takes
DISAGREE_DEG, SIGNIFICANT = 3.0, 4.0  # median angle between balls, and in standard errors, above which lamps are near


@dataclass(frozen=True, eq=False)
class MatteReference:
    """A matte ball or card in the photographs, by which the strength of a lamp is measured.

    mask: a picture that is white on it, or an array (height, width). reflectance: below 1, one number or one per
    channel. normal: (3,) direction that a card faces; None for a ball. radius: of a ball [m], where lamps are near.
    """

    mask: Picture
    reflectance: Sequence[float]
    normal: tuple[float, float, float] | None = None
    radius: float | None = None


def calibrate_lamps(
    photographs: Sequence[str | Path] | Mapping[str, NDArray],
    masks: Picture | Sequence[Picture],
    *,
    moved: bool = False,
    radius: float | None = None,
    camera: Camera | str | Path | None = None,
    reference: MatteReference | None = None,
    mirror: Sequence[float] = (),
    transfer: Transfer8 | None = None,
    progress: Progress = silent,
) -> LampCalibration:
    """One lamp per photograph, from its mirror images on chrome balls.

    One ball measures directions (far lamps); several balls, or one ball in several places, measure positions (near
    lamps), with the balls' `radius` [m] and a calibrated `camera`, and without these the mean of their directions.

    photographs: files, or name → (height, width[, channels]). masks: a picture or array that is white on a ball, one
    per ball, or its circle "x,y,radius" [px]; or "auto": the balls are found in the photographs. moved: one ball in
    several places, a mask each: the photographs of the first place, then as many of the second in the same order of
    lamps, and so on. camera: a `Camera` or its file; directions are then in its axes (x right, y down, z forward), else
    in x right, y up, z to the camera, of an orthographic view. reference: measures strengths. mirror: reflectance of
    the balls, to measure strengths by highlights that are not clipped. transfer: of 8-bit files, where strengths are
    asked for.

    `InputError` for a mask that shows no disc, a photograph without a highlight, and balls that contradict each other.
    """
    shapes: list[Picture | Ball] = list([masks] if isinstance(masks, (str, Path, np.ndarray)) else masks)
    if not shapes:
        raise InputError("no mask (--mask) of a chrome ball is given: give one per ball, or auto")
    lens = camera if isinstance(camera, Camera) or camera is None else read_camera(camera)
    linear = bool(reference or len(mirror))
    if any(str(shape) == AUTO for shape in shapes if isinstance(shape, (str, Path))):
        if len(shapes) > 1 or moved:
            raise InputError("auto finds all balls of one set of photographs: give it alone, without moved (--moved)")
        seen = lamp_photographs(photographs, transfer, linear)
        shapes = [*search_balls(seen, lens, part_of(progress, 0.0, SEARCH))]
        progress = part_of(progress, SEARCH, 1.0 - SEARCH)
    shapes = [ball_of_circle(str(one), lens) if _is_circle(one) else one for one in shapes]
    sets = _photograph_sets(photographs, len(shapes), moved, transfer, linear)
    balls, readings = _readings(sets, shapes, radius, lens, progress)
    if reference is not None:
        strengths = _by_reference(sets[0], readings, reference, lens)
    elif len(mirror):
        strengths = _by_highlight(sets[0], readings, balls[0], mirror, radius)
    else:
        strengths = (None,) * len(readings)
    spread, remark = _spread(readings)
    stated = {"moved": moved, "radius_m": radius, "mirror": [float(share) for share in mirror], "transfer": transfer}
    if reference is not None:
        stated |= {
            "reference_reflectance": np.ravel(reference.reflectance).tolist(),
            "reference_normal": None if reference.normal is None else list(reference.normal),
            "reference_radius_m": reference.radius,
        }
    return LampCalibration(tuple(readings), tuple(strengths), tuple(balls), spread, remark, stated)


def _photograph_sets(
    photographs: Sequence[str | Path] | Mapping[str, NDArray],
    masks: int,
    moved: bool,
    transfer: Transfer8 | None,
    linear: bool,
) -> list[Mapping[str, NDArray]]:
    """The photographs for each mask: the same ones, or one set after the other where the ball was moved."""
    if not moved:
        return [lamp_photographs(photographs, transfer, linear)] * masks
    if masks < 2 or len(photographs) % masks:
        raise InputError(
            f"a moved ball has a mask (--mask) for each place and as many photographs in each: given {masks} masks and "
            f"{len(photographs)} photographs"
        )
    each = len(photographs) // masks
    slices = [slice(i * each, (i + 1) * each) for i in range(masks)]
    if isinstance(photographs, Mapping):
        entries = list(photographs.items())
        return [dict(entries[part]) for part in slices]
    return [lamp_photographs(photographs[part], transfer, linear) for part in slices]


def _readings(
    sets: Sequence[Mapping[str, NDArray]],
    masks: Sequence[Picture | Ball],
    radius: float | None,
    camera: Camera | None,
    progress: Progress,
) -> tuple[list[Ball], list[Reading]]:
    """The balls, and the lamps: near ones from several balls of known radius, else far ones."""
    several = len(masks) > 1
    balls, readings = [], []
    for i, (mask, photographs) in enumerate(zip(masks, sets, strict=True)):
        of_ball = part_of(progress, i / len(masks), 1.0 / len(masks))
        try:
            ball, lamps = lamps_from_ball(
                photographs, mask if isinstance(mask, Ball) else _picture(mask), camera, of_ball
            )
        except InputError as error:
            raise InputError(f"{_name(mask, i)}: {error}" if several else str(error)) from error
        balls.append(ball)
        readings.append(lamps)
    for one, other in combinations(balls, 2):
        apart = float(np.hypot(*np.subtract(one.centre, other.centre)))
        if apart < 0.5 * one.radius:
            raise InputError(
                f"two masks show one ball ({apart:.1f} px apart): give one mask (--mask) for each ball or place"
            )
    if not several:
        return balls, list(readings[0])
    together = list(zip(*readings, strict=True))
    if camera is None or radius is None:
        return balls, [*far_lamps_of_balls(together)]
    return balls, [locate_lamp(rays, radius) for rays in together]


def _by_reference(
    photographs: Mapping[str, NDArray], readings: Sequence[Reading], matte: MatteReference, camera: Camera | None
) -> list[Strength]:
    mask = _picture(matte.mask)
    if matte.normal is None:
        reference = find_matte_ball(mask, camera, matte.reflectance, matte.radius)
    else:
        reference = matte_card(mask, matte.normal, matte.reflectance)
    strengths = []
    for lamp, (name, light) in zip(readings, photographs.items(), strict=True):
        if mask.shape[:2] != light.shape[:2]:
            label = _name(matte.mask, 0)
            raise InputError(f"{name}: it is {light.shape[:2]} pixels and {label} {mask.shape[:2]}")
        position = lamp.position if isinstance(lamp, LampPlace) else None
        try:
            strengths.append(reference_strength(light, reference, lamp.to_lamp, position))
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    return strengths


def _by_highlight(
    photographs: Mapping[str, NDArray],
    readings: Sequence[Reading],
    ball: Ball,
    mirror: Sequence[float],
    radius: float | None,
) -> list[Strength]:
    strengths = []
    for lamp, (name, light) in zip(readings, photographs.items(), strict=True):
        reading = lamp.readings[0] if isinstance(lamp, LampPlace) else lamp
        try:
            strengths.append(highlight_strength(light, ball, reading.highlight, mirror, _distance(lamp, radius)))
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    return strengths


def _distance(lamp: Reading, radius: float | None) -> float:
    """From a near lamp to its image on the first ball [m]; 1 for a far one."""
    if not isinstance(lamp, LampPlace) or lamp.position is None or radius is None:
        return 1.0
    ball, highlight = lamp.readings[0].ball, lamp.readings[0].highlight
    shown = ball.mirrored([highlight.centre])
    eye = np.zeros(3) if ball.camera is None else ball.camera.position
    return float(np.linalg.norm(lamp.position - eye - radius * (shown.centre + shown.normal[0])))


def _spread(readings: Sequence[Reading]) -> tuple[LampSpread | None, str]:
    """How the directions are spread; None for lamps from which normals cannot be solved, and why."""
    try:
        return check_spread([lamp.to_lamp for lamp in readings]), ""
    except InputError as error:
        return None, str(error)


def _is_circle(mask: Picture | Ball) -> bool:
    return isinstance(mask, (str, Path)) and is_circle(str(mask))


def _picture(mask: Picture) -> NDArray:
    return read_picture(mask) if isinstance(mask, (str, Path)) else np.asarray(mask)


def _name(mask: Picture | Ball, number: int) -> str:
    if isinstance(mask, Ball):
        return f"the ball at ({mask.centre[0]:.0f}, {mask.centre[1]:.0f})"
    return Path(mask).name if isinstance(mask, (str, Path)) else f"mask {number + 1}"


def far_lamps_of_balls(together: Sequence[Sequence[LampReading]]) -> list[LampReading]:
    """One reading per lamp from those of all balls: the mean direction by their errors, on the first ball.

    Its standard error holds half of what the balls differ by. `InputError` where they differ as near lamps do.
    """
    found, apart, expected = [], [], []
    for readings in together:
        weight = np.array([1.0 / one.standard_error_deg**2 for one in readings])
        mean = np.asarray(weight @ np.stack([one.to_lamp for one in readings]))
        mean = mean / np.linalg.norm(mean)
        off = [_degrees(mean, one.to_lamp) for one in readings]
        apart.append(max(_degrees(one.to_lamp, other.to_lamp) for one in readings for other in readings))
        expected.append(float(np.hypot.reduce([one.standard_error_deg for one in readings])))
        scatter = float(np.sqrt(np.mean(np.square(off)) / max(len(off) - 1, 1)))
        error = max(float(weight.sum() ** -0.5), scatter)
        found.append(replace(readings[0], to_lamp=mean, standard_error_deg=error))
    middle = float(np.median(apart))
    if middle > DISAGREE_DEG and middle > SIGNIFICANT * float(np.median(expected)):
        raise InputError(
            f"the balls disagree about the lamps by {middle:.1f}° (median), as they do about near lamps: give their "
            "radius (--radius) [m] and a calibrated camera (--camera), or one ball beside the object"
        )
    return found


def _degrees(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.degrees(np.arccos(np.clip(one @ other, -1.0, 1.0))))
