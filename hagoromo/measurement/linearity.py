"""Linearity: whether the photographs of a capture bear out the transfer that was stated or assumed for them."""

from __future__ import annotations

import numpy as np

from hagoromo.camera.response import camera_white
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.exponent import Exponent, exponent_of
from hagoromo.photograph.photograph import Photograph

NOT_TESTED = "not tested: that takes six far lamps or more, and one view"
MOST_SAMPLES = 20_000  # pixels that are read of each photograph


def linearity_of(capture: Capture) -> Exponent | None:
    """The exponent that the shading asks for; None where the capture cannot tell: near lamps, several views, too
    few.
    """
    shots = capture.photographs
    first = shots[0]
    if any(
        len(shot.lamps) != 1
        or shot.lamps[0].to_lamp is None
        or shot.values.shape != first.values.shape
        or not np.allclose(shot.camera.matrix, first.camera.matrix, rtol=1e-6)
        for shot in shots
    ):
        return None
    rows, columns = np.nonzero(np.sum([shot.mask for shot in shots], axis=0) >= 0.5 * len(shots))
    chosen = np.s_[:: max(-(-len(rows) // MOST_SAMPLES), 1)]
    values = np.stack([_grey(shot, rows[chosen], columns[chosen]) for shot in shots])
    return exponent_of(values, np.stack([np.asarray(shot.lamps[0].to_lamp) for shot in shots]))


def _grey(shot: Photograph, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(P,) mean over the channels of the value over the light of the lamp; NaN where it is invalid."""
    lamp, channels = shot.lamps[0], shot.values.shape[2]
    white = np.ones(channels) if shot.camera.response is None else camera_white(lamp.spectrum, shot.camera.response)
    light = np.broadcast_to(np.asarray(lamp.intensity, np.float64) * white, channels)
    grey = shot.values[rows, columns].astype(np.float64).sum(axis=1) / max(float(light.sum()), 1e-300)
    return np.where(shot.mask[rows, columns], grey, np.nan)
