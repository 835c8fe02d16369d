"""Depth pull: how far near lamps' photographs want each pixel's depth to move, normal and body colour free.

Moving a point along its line of sight turns it to the lamps and changes what arrives from each. The pull is that of
Gauss–Newton on the residuals of `pixel_fit`; it is weak for one pixel and firm over a thousand.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import arrays
from hagoromo.least_squares import CAUCHY_SCALE
from hagoromo.measurement.normals.pixel_fit import WEAKEST, Light, PixelData, frame
from hagoromo.measurement.normals.views import UNLIT, Array, Views

STRIDE = 1e-3  # of the distance to the eye, of the differences that slopes are taken from


class DepthPull(NamedTuple):
    """change: (P,) of ln distance that each pixel asks for; precision: (P,) inverse of its variance, 0 where none."""

    change: Array
    precision: Array


def depth_pull(seen: Views, light: Light, normals: Array, body: Array) -> DepthPull:
    """What the residuals at `normals` (P, 3) and `body` (C, P) say of the distance from the eye."""
    towards, brighter = _farther(seen)
    data = PixelData(seen, light)
    normal, colour = data.vectors(normals), [data.floats(channel) for channel in body]
    at = data.equations(normal, colour)
    sums = _sums(data, normal, colour, data.floats(towards), data.floats(brighter))
    own, a_depth, b_depth, pull, *by_body = sums
    aa, ab, bb = at.aa + WEAKEST, at.ab, at.bb + WEAKEST
    pull_a, pull_b = at.pull_a, at.pull_b
    for c, h in enumerate(at.body):
        h = h + 1e-12
        a, b, d, left = at.a_body[c], at.b_body[c], by_body[c], at.pull_body[c]
        aa, ab, bb = aa - a * a / h, ab - a * b / h, bb - b * b / h
        a_depth, b_depth, own = a_depth - a * d / h, b_depth - b * d / h, own - d * d / h
        pull_a, pull_b, pull = pull_a - a * left / h, pull_b - b * left / h, pull - d * left / h
    determinant = dr.fmax(aa * bb - ab * ab, 1e-12)
    turn_a, turn_b = (bb * a_depth - ab * b_depth) / determinant, (aa * b_depth - ab * a_depth) / determinant
    precision = dr.fmax(own - a_depth * turn_a - b_depth * turn_b, 0.0).numpy().astype(np.float64)
    wanted = (pull - pull_a * turn_a - pull_b * turn_b).numpy().astype(np.float64)
    known = precision > 0.0
    return DepthPull(np.where(known, wanted / np.where(known, precision, 1.0), 0.0), precision)


def _farther(seen: Views) -> tuple[Array, Array]:
    """Directions to the lamps (K, P, 3) and ratio of their light (K, P), a STRIDE farther from the eye."""
    points = seen.farther(1.0 + STRIDE)
    towards, ratios = [], []
    for lamp in seen.lamps:
        before = lamp.direction_and_irradiance(seen.points)[1].reshape(len(points), -1).sum(axis=1)
        direction, after = lamp.direction_and_irradiance(points)
        after, least = after.reshape(len(points), -1).sum(axis=1), UNLIT * before.max()
        towards.append(direction)
        ratios.append(np.maximum(after, least) / np.maximum(before, least))
    return np.stack(towards), np.stack(ratios)


def _sums(data: PixelData, normal: Any, body: list[Any], towards: Any, brighter: Any) -> list[Any]:
    """Per pixel: depth × depth, turns × depth (two), pull on depth, and body × depth of each channel."""
    jit, c = arrays(), data.channels
    pixel, turns = dr.arange(jit.UInt, data.pixels), frame(normal)
    start = [dr.zeros(jit.Float, data.pixels) for _ in range(4 + c)]

    def add(lamp: Any, *sums: Any) -> tuple[Any, ...]:
        at = lamp * data.width + pixel
        scale, more = dr.gather(jit.Float, data.evenness, at), dr.gather(jit.Float, brighter, at)
        here, turned = data.shade(normal, dr.gather(jit.Array3f, data.to_lamp, at), turns)
        there, _ = data.shade(normal, dr.gather(jit.Array3f, towards, at), turns)
        new = list(sums)
        for i in range(c):
            place = (lamp * c + i) * data.width + pixel
            model = scale * (body[i] * here[0] + here[1])
            slope = (more * scale * (body[i] * there[0] + there[1]) - model) * (1.0 / STRIDE)
            deviation = dr.gather(jit.Float, data.values, place) - model
            precision = dr.gather(jit.Float, data.precision, place)
            weight = precision / (1.0 + deviation * deviation * precision * (1.0 / CAUCHY_SCALE**2))
            a, b = (scale * (body[i] * by[0] + by[1]) for by in turned)
            for j, by in enumerate((slope, a, b, deviation)):
                new[j] += weight * slope * by
            new[4 + i] += weight * slope * scale * here[0]
        return lamp + 1, *new

    _, *sums = dr.while_loop((dr.zeros(jit.UInt, data.pixels), *start), lambda lamp, *_: lamp < data.lamps, add)
    dr.eval(*sums)
    return sums
