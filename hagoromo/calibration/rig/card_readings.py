"""Lamps beside one another as a flat matte card shows them, which fills the mask of the photographs.

    ln value_kc(p) = ln body_c(p) + ln E stated + ln max(n · l_k, 0) + ln e_kc + a_k · p

The body of each place of the card is free: it may be stained. The normal of the card must be known, as a tilt looks
like lamps of other strengths.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.rig.lamp_readings import LampReadings
from hagoromo.errors import InputError
from hagoromo.measurement.normals.views import check_lamps
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.rig import Array

BLOCKS, PARTS = 32, 4  # the picture's width in blocks, whose means are fitted, and in parts, taken as independent
FEWEST_BLOCKS = 12
LEAST_INCIDENCE = 0.1  # cosine: a lamp that grazes the card does not tell its strength
NORMAL_ERROR = np.radians(1.0)  # of the stated normal of the card


def card_readings(capture: Capture, normal: Array | None = None) -> LampReadings:
    """The lamps of `capture`, photographs of a card that faces `normal` (3,) (default: the camera)."""
    photographs = capture.photographs
    check_lamps(photographs, fewest=2)
    camera = photographs[0].camera
    normal = -camera.camera_to_world[:3, 2] if normal is None else np.asarray(normal, np.float64)
    normal = normal / np.linalg.norm(normal)
    height, width = photographs[0].values.shape[:2]
    mask = np.all([one.mask & (one.values > 0.0).all(axis=2) for one in photographs], axis=0)
    points = _points(capture, normal, mask)
    rows, columns = np.nonzero(mask)
    p = np.column_stack([columns + 0.5 - width / 2, rows + 0.5 - height / 2]) / (width / 2)
    block = np.unique(np.floor((p + 1.0) * BLOCKS / 2).astype(int) @ np.array([1, 4 * BLOCKS]), return_inverse=True)[1]
    if not len(p) or block.max() + 1 < FEWEST_BLOCKS:
        raise InputError(
            f"capture {capture.name!r} shows no card that is valid in all photographs: mask the card, and expose it "
            "below white"
        )
    count = np.bincount(block)
    means = np.stack([np.bincount(block, one) / count for one in p.T], axis=1)
    logs, incidence = zip(*(_log(one, mask, points, normal, block) for one in photographs), strict=True)
    values = np.stack(logs) - np.mean(logs, axis=0)  # (K, C, blocks)
    place = means.mean(axis=0)
    level, variance = _plane(values.mean(axis=1), means - place)
    variance[:, 0] += (NORMAL_ERROR * np.sqrt(np.maximum(np.array(incidence) ** -2.0 - 1.0, 0.0))) ** 2
    colour = np.median(values, axis=2)
    lamps = tuple(one.lamps[0] for one in photographs)
    none = np.zeros((len(lamps), 3))
    colour = colour - colour.mean(axis=1, keepdims=True)
    return LampReadings(capture.name, (width, height), lamps, place, level, variance, colour, none, none[:, 0])


def _log(
    photograph: Photograph, mask: NDArray[np.bool_], points: Array, normal: Array, block: NDArray[np.intp]
) -> tuple[Array, float]:
    """(C, blocks) means of ln of the values over what an even lamp would give, and the mean cosine of incidence."""
    lamp = photograph.lamps[0]
    to_lamp, irradiance = lamp.direction_and_irradiance(points)
    cosine = to_lamp @ normal
    if cosine.min() < LEAST_INCIDENCE:
        raise InputError(
            f"lamp {lamp.name!r} does not light the card from its front: turn the card, or state its normal (--normal)"
        )
    even = irradiance.reshape(len(points), -1) * cosine[:, None]
    logs = np.log(photograph.values[mask] / even)
    return np.stack([np.bincount(block, one) / np.bincount(block) for one in logs.T]), float(cosine.mean())


def _plane(values: Array, place: Array) -> tuple[Array, Array]:
    """Level and slope (K, 3) of values (K, blocks) at `place` (blocks, 2), and their variances.

    Blocks of one part of the picture count as one: errors of the model are the same there.
    """
    columns = np.column_stack([np.ones(len(place)), place])
    inverse = np.linalg.inv(columns.T @ columns + 1e-12 * np.eye(3))
    level = values @ columns @ inverse
    part = np.unique(np.floor((place + 1.0) * PARTS / 2).astype(int) @ np.array([1, 4 * PARTS]), return_inverse=True)[1]
    variance = np.empty(level.shape)
    for k, left in enumerate(values - level @ columns.T):
        score = np.stack([np.bincount(part, left * one) for one in columns.T], axis=1)
        variance[k] = np.diag(inverse @ (score.T @ score) @ inverse)
    return level, variance


def _points(capture: Capture, normal: Array, mask: NDArray[np.bool_]) -> Array:
    """(P, 3) points of the card: of the capture, else of the plane through the world's origin."""
    if capture.points is not None:
        return capture.points[mask].astype(np.float64)
    camera, rays = capture.photographs[0].camera, capture.photographs[0].camera.pixel_directions()[mask]
    near = any(lamp.position is not None for one in capture.photographs for lamp in one.lamps)
    away = float(camera.position @ normal)
    if near and abs(away) < 1e-9:
        raise InputError("near lamps need to know where the card is: put the world's origin on it")
    return camera.position - rays * (away / (rays @ normal))[:, None]
