"""`hagoromo calibrate lamps`: photographs of chrome balls, one lamp on in each → lamps.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.lamp_photographs import Photographs
from hagoromo.calibration.lamps import (
    Ball,
    LampPlace,
    LampReading,
    Strength,
    calibrate_lamps,
    check_spread,
    find_matte_ball,
    highlight_strength,
    locate_lamp,
    matte_card,
    reference_strength,
)
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_file

LAMP = ("name", "to_lamp", "position", "intensity")  # of a lamp in a capture's transforms.json
Progress = Callable[[float, str], None]
Found = LampReading | LampPlace


@dataclass(frozen=True)
class Balls:
    """masks of the chrome balls, or of one ball's places where it was `moved`; their radius [m]; the camera's file.

    mirror: reflectance of the balls, to read strength off their highlights; empty to leave that.
    """

    masks: Sequence[Path]
    moved: bool = False
    radius: float | None = None
    camera: Path | None = None
    mirror: tuple[float, ...] = ()


@dataclass(frozen=True)
class Matte:
    """mask of a matte reference, its reflectance, the normal of a card (None: it is a ball), a ball's radius [m]."""

    mask: Path | None = None
    reflectance: tuple[float, ...] = ()
    normal: tuple[float, float, float] | None = None
    radius: float | None = None


def calibrate_lamps_to(
    photographs: Sequence[Path],
    out: Path,
    balls: Balls,
    matte: Matte,
    transfer: Literal["linear", "srgb"] | None,
    force: bool,
    progress: Progress | None = None,
) -> list[str]:
    """Write lamps.json to `out`; gives what was found, in lines."""
    if bool(matte.mask) != bool(matte.reflectance):
        raise InputError("--reference, the mask, and --reflectance go together: give both")
    if not balls.masks:
        raise InputError("no --mask of a chrome ball is given: give one per ball")
    linear = bool(matte.mask or balls.mirror)
    with whole_file(out, force) as partial:
        camera = None if balls.camera is None else read_camera(balls.camera)
        seen = _read_sets(photographs, balls, transfer, linear)
        chrome, found = _found(seen, balls, camera, progress or (lambda share, step: None))
        first = seen[0]
        strengths = _strengths(first, found, chrome[0], balls, matte, camera)
        lines, records = [_of_ball(ball) for ball in chrome], []
        for lamp, strength in zip(found, strengths, strict=True):
            record = lamp.record()
            if strength is not None:
                record |= {"intensity": strength.intensity.tolist(), **strength.record()}
            records.append(record)
            lines.append(_of_lamp(lamp, strength))
        spread, said = _spread(found)
        lamps = [{key: record[key] for key in LAMP if key in record} for record in records]  # as a capture lists them
        shape = chrome[0].record()
        every = [ball.record() for ball in chrome]
        write_json(partial, {"lamps": lamps, "ball": shape, "balls": every, "spread": spread, "readings": records})
    return [*lines, said]


def _read_sets(
    paths: Sequence[Path], balls: Balls, transfer: Literal["linear", "srgb"] | None, linear: bool
) -> list[Mapping[str, NDArray]]:
    """The photographs for each mask: the same ones, or one set after the other where the ball was moved."""
    count = len(balls.masks)
    if not balls.moved:
        return [Photographs(paths, transfer, linear)] * count
    if count < 2 or len(paths) % count:
        raise InputError(
            f"a moved ball has a --mask for each place and as many photographs in each: given {count} masks and "
            f"{len(paths)} photographs"
        )
    each = len(paths) // count
    return [Photographs(paths[i * each : (i + 1) * each], transfer, linear) for i in range(count)]


def _found(
    seen: Sequence[Mapping[str, NDArray]], balls: Balls, camera: Camera | None, progress: Progress
) -> tuple[list[Ball], list[Found]]:
    """The balls, and the lamps: far ones from one ball, near ones from several."""
    several = len(balls.masks) > 1
    if several and (camera is None or balls.radius is None):
        raise InputError("several balls place near lamps: give their --radius [m] and a calibrated --camera")
    chrome, readings = [], []
    for i, (mask, photographs) in enumerate(zip(balls.masks, seen, strict=True)):

        def part(share: float, step: str, i: int = i) -> None:
            progress((i + share) / len(balls.masks), step)

        try:
            ball, lamps = calibrate_lamps(photographs, read_picture(mask), camera, part)
        except InputError as error:
            raise InputError(f"{mask.name}: {error}" if several else str(error)) from error
        chrome.append(ball)
        readings.append(lamps)
    for one, other in combinations(chrome, 2):
        apart = float(np.hypot(*np.subtract(one.centre, other.centre)))
        if apart < 0.5 * one.radius:
            raise InputError(f"two masks show one ball ({apart:.1f} px apart): give one --mask for each ball or place")
    if not several:
        return chrome, list(readings[0])
    assert balls.radius is not None
    return chrome, [locate_lamp(rays, balls.radius) for rays in zip(*readings, strict=True)]


def _strengths(
    photographs: Mapping[str, NDArray],
    found: Sequence[Found],
    ball: Ball,
    balls: Balls,
    matte: Matte,
    camera: Camera | None,
) -> list[Strength | None]:
    """Of each lamp: from the reference, else from the highlight, where one was asked for."""
    if matte.mask is not None:
        mask = read_picture(matte.mask)
        if matte.normal is None:
            reference = find_matte_ball(mask, camera, matte.reflectance, matte.radius)
        else:
            reference = matte_card(mask, matte.normal, matte.reflectance)
    strengths: list[Strength | None] = []
    for lamp, (name, light) in zip(found, photographs.items(), strict=True):
        near = lamp.position if isinstance(lamp, LampPlace) else None
        try:
            if matte.mask is not None:
                if mask.shape[:2] != light.shape[:2]:
                    raise InputError(f"it is {light.shape[:2]} pixels and {matte.mask.name} {mask.shape[:2]}")
                strengths.append(reference_strength(light, reference, lamp.to_lamp, near))
            elif balls.mirror:
                reading = lamp.readings[0] if isinstance(lamp, LampPlace) else lamp
                strengths.append(
                    highlight_strength(light, ball, reading.highlight, balls.mirror, _distance(lamp, balls.radius))
                )
            else:
                strengths.append(None)
        except InputError as error:
            raise InputError(f"{name}: {error}") from error
    return strengths


def _distance(lamp: Found, radius: float | None) -> float:
    """From a near lamp to its image on the first ball [m]; 1 for a far one."""
    if not isinstance(lamp, LampPlace) or lamp.position is None or radius is None:
        return 1.0
    ball, highlight = lamp.readings[0].ball, lamp.readings[0].highlight
    shown = ball.mirrored([highlight.centre])
    eye = np.zeros(3) if ball.camera is None else ball.camera.position
    return float(np.linalg.norm(lamp.position - eye - radius * (shown.centre + shown.normal[0])))


def _spread(found: Sequence[Found]) -> tuple[dict[str, float] | None, str]:
    """Condition of the directions, and in words; lamps that cannot tell normals are no error here, but said."""
    try:
        spread = check_spread([lamp.to_lamp for lamp in found])
    except InputError as error:
        return None, f"for normals: {error}"
    return spread._asdict(), f"{spread.lamps} lamps, condition number of their directions {spread.condition:.2f}"


def _of_ball(ball: Ball) -> str:
    x, y = ball.from_mask
    where = "the mask" if ball.source == "mask" else f"the photographs, ({x:.2f}, {y:.2f}) px from the mask's"
    return f"ball: centre ({ball.centre[0]:.2f}, {ball.centre[1]:.2f}), radius {ball.radius:.2f} px, outline by {where}"


def _of_lamp(lamp: Found, strength: Strength | None) -> str:
    x, y, z = lamp.to_lamp
    said = f"{lamp.name}: to_lamp ({x:.4f}, {y:.4f}, {z:.4f}), standard error {lamp.standard_error_deg:.2f}°"
    if isinstance(lamp, LampPlace):
        if lamp.position is None or lamp.standard_error is None:
            inverse = f"{lamp.inverse_distance:.3f} ± {lamp.inverse_distance_error:.3f}"
            said += f", far: the rays are parallel within errors (1/distance {inverse} per m)"
        else:
            place = ", ".join(f"{p:.4f} ± {e:.4f}" for p, e in zip(lamp.position, lamp.standard_error, strict=True))
            said = f"{lamp.name}: position ({place}) m"
    if strength is not None:
        shown = zip(strength.intensity, strength.standard_error, strict=True)
        said += f"; intensity {', '.join(f'{v:.4g} ± {e:.2g}' for v, e in shown)} by the {strength.source}"
        if strength.shading is not None:
            to_lamp, error = strength.shading
            off = np.degrees(np.arccos(np.clip(to_lamp @ lamp.to_lamp, -1.0, 1.0)))
            said += f", whose shading tells a direction {off:.2f}° from the ball's (± {error:.2f}°)"
    return said
