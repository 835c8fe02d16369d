"""Linearity: whether the numbers of photographs follow light, and what lamps and places that is judged by."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import white_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.exponent import FEWEST_LAMPS, Exponent, exponent_of
from hagoromo.photograph.photograph import Photograph

MOST_SAMPLES = 20_000  # pixels that are read of each photograph
LEAST_SIGNAL = 5.0  # standard deviations of a compared pixel's noise from which it shows the scene
SHOWN_BY = 4  # lamps under which a place must be above its noise, to be one of the object


def linearity_of(capture: Capture) -> Exponent | None:
    """The exponent that the shading asks for; None where the capture does not show it, for `why_not_tested`.

    Direction and distance of near lamps are those at `points_at`.
    """
    if unfit(capture):
        return None
    shots = capture.photographs
    rows, columns = np.nonzero(np.sum([shot.mask for shot in shots], axis=0) >= 0.5 * len(shots))
    chosen = np.s_[:: max(-(-len(rows) // MOST_SAMPLES), 1)]
    rows, columns = rows[chosen], columns[chosen]
    points = None
    if near(capture):
        points = points_at(capture, np.stack([columns, rows], axis=1) + 0.5)
        known = np.isfinite(points).all(axis=1)
        rows, columns, points = rows[known], columns[known], points[known]
    lit = [towards(shot, points) for shot in shots]
    greys = [_grey(shot, rows, columns) for shot in shots]
    values = [grey / falloff for grey, (_, falloff) in zip(greys, lit, strict=True)]
    to_lamp = [np.broadcast_to(to, (len(rows), 3)) for to, _ in lit]
    errors = [np.sqrt(shot.variance[rows, columns].astype(np.float64).sum(axis=1)) / lamp_light(shot) for shot in shots]
    seen = shows(np.stack(greys), np.stack(errors))
    to_eye = -shots[0].camera.unproject(np.stack([columns, rows], axis=1) + 0.5)
    return exponent_of(np.stack(values)[:, seen], np.stack(to_lamp)[:, seen], to_eye[seen])


def shows(values: NDArray[np.floating], errors: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(P,) whether places show something: readings (K, P) under some lamps stand out of their standard errors (K, P).

    What does not is a dark background without a mask.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray((values > LEAST_SIGNAL * errors).sum(axis=0) >= SHOWN_BY, np.bool_)


def why_not_tested(capture: Capture) -> str:
    """Why `linearity_of` gave nothing, in words."""
    return f"not tested: {unfit(capture) or 'too few pixels that five lamps light'}"


def unfit(capture: Capture) -> str:
    """What of the capture keeps its shading from telling; "" where nothing does."""
    shots = capture.photographs
    first = shots[0]
    if len(shots) < FEWEST_LAMPS:
        return f"{len(shots)} photographs, and the shading shows it from {FEWEST_LAMPS} on"
    if any(len(shot.lamps) != 1 for shot in shots):
        return "photographs under several lamps, or none"
    if not one_view(shots):
        return "photographs of several views"
    if capture.points is None and near(capture) and not _plane_is_known(first):
        return "near lamps, and neither points of the surface nor its distance"
    return ""


def one_view(photographs: Sequence[Photograph]) -> bool:
    """Whether all photographs are of one camera at one place."""
    first = photographs[0]
    return all(
        shot.values.shape == first.values.shape and np.allclose(shot.camera.matrix, first.camera.matrix, rtol=1e-6)
        for shot in photographs
    )


def near(capture: Capture) -> bool:
    """Whether the light of a lamp differs over the object by where the lamp stands."""
    return any(shot.lamps[0].near for shot in capture.photographs)


def _plane_is_known(shot: Photograph) -> bool:
    return not shot.camera.orthographic and bool(np.linalg.norm(shot.camera.position) > 0.0)


def points_at(capture: Capture, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """(P, 3) [m] world: what the capture shows at `pixels` (P, 2) (x, y), NaN where that is not known.

    Without points of its surface those of the plane across the view through the world's origin, where an object stands
    whose distance nobody stated.
    """
    camera = capture.photographs[0].camera
    if capture.points is not None:
        columns, rows = np.floor(pixels).astype(int).T
        found = np.asarray(capture.points[rows, columns], np.float64)
        return np.where(np.linalg.norm(found, axis=1, keepdims=True) > 0.0, found, np.nan)
    ray = camera.unproject(pixels)
    away = np.linalg.norm(camera.position) / (ray @ camera.camera_to_world[:3, 2])
    return np.asarray(camera.position + ray * away[:, None], np.float64)


def towards(shot: Photograph, points: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors to the lamp (3,) or (P, 3), and what its light falls off by, () or (P,)."""
    lamp = shot.lamps[0]
    if lamp.to_lamp is not None:
        return np.asarray(lamp.to_lamp, np.float64), np.ones(())
    assert points is not None
    towards, irradiance = lamp.direction_and_irradiance(points)
    light = np.asarray(irradiance, np.float64).reshape(len(points), -1).mean(axis=1)
    return np.asarray(towards, np.float64), light / max(float(np.mean(lamp.intensity)), 1e-300)


def _grey(shot: Photograph, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(P,) mean over the channels of the value over the light of the lamp; NaN where it is invalid."""
    grey = shot.values[rows, columns].astype(np.float64).sum(axis=1) / lamp_light(shot)
    return np.where(shot.mask[rows, columns], grey, np.nan)


def lamp_light(shot: Photograph) -> float:
    """Sum over the channels of what a white reads of the light of its lamp."""
    lamp, channels = shot.lamps[0], shot.values.shape[2]
    white = white_of(lamp.spectrum, shot.camera.response, channels)
    light = np.broadcast_to(np.asarray(lamp.intensity, np.float64) * white, channels)
    return max(float(light.sum()), 1e-300)
