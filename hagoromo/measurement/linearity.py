"""Linearity: whether the photographs of a capture bear out the transfer that was stated or assumed for them."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import camera_white
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.exponent import FEWEST_LAMPS, Exponent, exponent_of
from hagoromo.photograph.photograph import Photograph

MOST_SAMPLES = 20_000  # pixels that are read of each photograph


def linearity_of(capture: Capture) -> Exponent | None:
    """The exponent that the shading asks for; None where the capture cannot tell, for `why_not_tested`.

    Near lamps are tested where the capture has points, at which their direction and distance are taken.
    """
    if _unfit(capture):
        return None
    shots = capture.photographs
    rows, columns = np.nonzero(np.sum([shot.mask for shot in shots], axis=0) >= 0.5 * len(shots))
    points = None
    if any(shot.lamps[0].to_lamp is None for shot in shots):
        assert capture.points is not None
        known = np.isfinite(capture.points[rows, columns]).all(axis=1)
        rows, columns = rows[known], columns[known]
    chosen = np.s_[:: max(-(-len(rows) // MOST_SAMPLES), 1)]
    rows, columns = rows[chosen], columns[chosen]
    if capture.points is not None:
        points = np.nan_to_num(np.asarray(capture.points[rows, columns], np.float64))
    lit = [_towards(shot, points) for shot in shots]
    values = [_grey(shot, rows, columns) / falloff for shot, (_, falloff) in zip(shots, lit, strict=True)]
    to_lamp = [np.broadcast_to(towards, (len(rows), 3)) for towards, _ in lit]
    return exponent_of(np.stack(values), np.stack(to_lamp))


def why_not_tested(capture: Capture) -> str:
    """Why `linearity_of` gave nothing, in words."""
    return f"not tested: {_unfit(capture) or 'too few pixels that five lamps light'}"


def _unfit(capture: Capture) -> str:
    """What of the capture keeps its shading from telling; "" where nothing does."""
    shots = capture.photographs
    first = shots[0]
    if len(shots) < FEWEST_LAMPS:
        return f"{len(shots)} photographs, and the shading tells from {FEWEST_LAMPS} on"
    if any(len(shot.lamps) != 1 for shot in shots):
        return "photographs under several lamps, or none"
    if any(
        shot.values.shape != first.values.shape or not np.allclose(shot.camera.matrix, first.camera.matrix, rtol=1e-6)
        for shot in shots
    ):
        return "photographs of several views"
    if capture.points is None and any(shot.lamps[0].to_lamp is None for shot in shots):
        return "near lamps, and no points of the surface"
    return ""


def _towards(shot: Photograph, points: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
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
    lamp, channels = shot.lamps[0], shot.values.shape[2]
    white = np.ones(channels) if shot.camera.response is None else camera_white(lamp.spectrum, shot.camera.response)
    light = np.broadcast_to(np.asarray(lamp.intensity, np.float64) * white, channels)
    grey = shot.values[rows, columns].astype(np.float64).sum(axis=1) / max(float(light.sum()), 1e-300)
    return np.where(shot.mask[rows, columns], grey, np.nan)
