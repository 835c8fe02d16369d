"""Lamp shift: directions and irradiance when the lamps, or the surface, differ slightly from the stated ones.

A shift is an angle: it is added to a far lamp's direction, and times the mean distance to a near lamp's position.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hagoromo.light.lamp import Lamp
from hagoromo.measurement.normals.shading import tangents
from hagoromo.measurement.normals.views import UNLIT, Array, Views

STRIDE = 1e-5  # [rad], and of ln distance: step of the finite differences


class Shifted(NamedTuple):
    """K shifted lamps at P points.

    to_lamp (K, P, 3) and ln of the irradiance over the stated lamps' (K, P); slopes by the shift and by the ln distance
    of the points from the eye: turns (K, P, 2, 4) of the direction towards `tangents(to_lamp)`, and by_light (K, P, 4).
    """

    to_lamp: Array
    light: Array
    turns: Array
    by_light: Array


def shifted_lamps(views: Views, shift: Array) -> tuple[Lamp, ...]:
    """The lamps of `views`, shifted (K, 3)."""
    middle = views.points.mean(axis=0)
    return tuple(_moved(lamp, by, middle) for lamp, by in zip(views.lamps, shift, strict=True))


def shifted(views: Views, shift: Array, depth: float) -> Shifted:
    """The lamps of `views` shifted (K, 3), its points exp(depth) times as far, with slopes."""
    if all(lamp.position is None for lamp in views.lamps):
        return _far(views, shift)
    places = views.points, views.farther(np.exp(depth)), views.farther(np.exp(depth + STRIDE))
    parts = [_one(lamp, by, places) for lamp, by in zip(views.lamps, shift, strict=True)]
    return Shifted(*(np.stack(part) for part in zip(*parts, strict=True)))


def _far(views: Views, shift: Array) -> Shifted:
    """Far lamps: one direction for all points, whose light does not depend on it; read-only where points are alike."""
    stated = np.stack([np.asarray(lamp.to_lamp, np.float64) for lamp in views.lamps]) + shift
    length = np.linalg.norm(stated, axis=1)
    to_lamp, (lamps, points) = stated / length[:, None], (len(stated), len(views.points))
    turns = np.zeros((lamps, 1, 2, 4))
    turns[:, 0, :, :3] = np.stack(tangents(to_lamp), axis=1) / length[:, None, None]
    return Shifted(
        np.broadcast_to(to_lamp[:, None], (lamps, points, 3)),
        np.zeros((lamps, points)),
        np.broadcast_to(turns, (lamps, points, 2, 4)),
        np.broadcast_to(0.0, (lamps, points, 4)),
    )


def _one(lamp: Lamp, shift: Array, places: tuple[Array, Array, Array]) -> tuple[Array, Array, Array, Array]:
    """Of one lamp: `places` are the stated points, the fitted points, and those one stride farther."""
    before, points, beyond = places
    middle = before.mean(axis=0)
    stated, moved = _log_light(lamp, before)[1], _moved(lamp, shift, middle)
    to_lamp, light = _log_light(moved, points)
    first, second = tangents(to_lamp)
    strides = [_log_light(_moved(lamp, shift + step, middle), points) for step in STRIDE * np.eye(3)]
    turns, by_light = np.zeros((len(points), 2, 4)), np.zeros((len(points), 4))
    for j, (there, more) in enumerate([*strides, _log_light(moved, beyond)]):
        change = (there - to_lamp) / STRIDE
        turns[:, 0, j], turns[:, 1, j] = np.sum(change * first, axis=1), np.sum(change * second, axis=1)
        by_light[:, j] = (more - light) / STRIDE
    return to_lamp, light - stated, turns, by_light


def _moved(lamp: Lamp, shift: Array, middle: Array) -> Lamp:
    if lamp.position is None:
        return lamp.shifted(shift)
    return lamp.shifted(shift * np.linalg.norm(lamp.position - middle))


def _log_light(lamp: Lamp, points: Array) -> tuple[Array, Array]:
    """Directions (P, 3) and ln irradiance (P,) of all channels."""
    to_lamp, irradiance = lamp.direction_and_irradiance(points)
    total = irradiance.reshape(len(points), -1).sum(axis=1)
    return to_lamp, np.log(np.maximum(total, UNLIT * total.max()))
