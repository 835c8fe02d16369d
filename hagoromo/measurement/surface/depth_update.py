"""Depth update: the change of each pixel's depth for which photographs under near lamps fit best.

Moving a point along its line of sight changes the directions to the lamps and the irradiance of each. The change is a
Gauss–Newton step on the residuals of `pixel_fit`, with normal and body colour free; a single pixel determines it
poorly, a thousand well.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import arrays
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.pixel_fit import PixelConditions, PixelData, frame
from hagoromo.measurement.normals.views import UNLIT, Array, Views

STRIDE = 1e-3  # of the distance to the eye: step of the finite differences


class DepthUpdate(NamedTuple):
    """change: (P,) best change of ln distance of each pixel; precision: (P,) inverse of its variance, 0 if unknown."""

    change: Array
    precision: Array


def depth_update(views: Views, light: PixelConditions, normals: Array, body: Array) -> DepthUpdate:
    """The best change of the distance from the eye, by the residuals at `normals` (P, 3) and `body` (C, P)."""
    towards, brighter = _farther(views)
    data = PixelData(views, light)
    normal, colour = data.vectors(normals), [data.floats(channel) for channel in body]
    equations = data.equations(normal, colour)
    sums = _sums(data, normal, colour, data.floats(towards), data.floats(brighter))
    own, a_depth, b_depth, rhs, *by_body = sums
    turns = equations.reduced(0.0)
    for c, h in enumerate(turns.bodies):
        a, b, d, left = equations.a_body[c], equations.b_body[c], by_body[c], equations.rhs_body[c]
        a_depth, b_depth, own = a_depth - a * d / h, b_depth - b * d / h, own - d * d / h
        rhs = rhs - d * left / h
    turn_a = (turns.bb * a_depth - turns.ab * b_depth) / turns.determinant
    turn_b = (turns.aa * b_depth - turns.ab * a_depth) / turns.determinant
    precision = dr.fmax(own - a_depth * turn_a - b_depth * turn_b, 0.0).numpy().astype(np.float64)
    wanted = (rhs - turns.rhs_a * turn_a - turns.rhs_b * turn_b).numpy().astype(np.float64)
    known = precision > 0.0
    return DepthUpdate(np.where(known, wanted / np.where(known, precision, 1.0), 0.0), precision)


def _farther(views: Views) -> tuple[Array, Array]:
    """Directions to the lamps (K, P, 3) and ratio of their irradiance (K, P), at points a STRIDE farther away."""
    points = views.farther(1.0 + STRIDE)
    towards, ratios = [], []
    for lamp in views.lamps:
        before = lamp.direction_and_irradiance(views.points)[1].reshape(len(points), -1).sum(axis=1)
        direction, after = lamp.direction_and_irradiance(points)
        after, least = after.reshape(len(points), -1).sum(axis=1), UNLIT * before.max()
        towards.append(direction)
        ratios.append(np.maximum(after, least) / np.maximum(before, least))
    return np.stack(towards), np.stack(ratios)


def _sums(data: PixelData, normal: Any, body: list[Any], towards: Any, brighter: Any) -> list[Any]:
    """Per pixel: depth × depth, turns × depth (two), right-hand side of depth, and body × depth of each channel."""
    jit, c = arrays(), data.channels
    pixel, turns = dr.arange(jit.UInt, data.pixels), frame(normal)
    start = [dr.zeros(jit.Float, data.pixels) for _ in range(4 + c)]

    def add(lamp: Any, *sums: Any) -> tuple[Any, ...]:
        index = lamp * data.width + pixel
        scale, more = dr.gather(jit.Float, data.evenness, index), dr.gather(jit.Float, brighter, index)
        shade, turned = data.shade(normal, dr.gather(jit.Array3f, data.to_lamp, index), turns)
        farther, _ = data.shade(normal, dr.gather(jit.Array3f, towards, index), turns)
        new = list(sums)
        for i in range(c):
            sample = (lamp * c + i) * data.width + pixel
            model = scale * data.value(body, i, shade)
            slope = (more * scale * data.value(body, i, farther) - model) * (1.0 / STRIDE)
            deviation = dr.gather(jit.Float, data.values, sample) - model
            precision = dr.gather(jit.Float, data.precision, sample)
            weight = precision / (1.0 + deviation * deviation * precision * (1.0 / CAUCHY_SCALE**2))
            a, b = (scale * data.value(body, i, by) for by in turned)
            for j, by in enumerate((slope, a, b, deviation)):
                new[j] += weight * slope * by
            new[4 + i] += weight * slope * scale * shade[0]
        return lamp + 1, *new

    _, *sums = dr.while_loop((dr.zeros(jit.UInt, data.pixels), *start), lambda lamp, *_: lamp < data.lamps, add)
    dr.eval(*sums)
    return sums
