"""Walked: what walks through pixels brought, on the device, and its sums.

Sums are in double precision and in the order of the walks of a pixel, so that they have the same bits however the walks
are launched. They are made where the walks are: only the sums leave the device.
"""

from __future__ import annotations

from dataclasses import dataclass

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, lookup


@dataclass(frozen=True)
class Walked:
    """Walks, pixel after pixel. light: the channels of a walk side by side. covered: 1 of a walk that met matter, else
    0.
    """

    light: Float
    covered: Float

    @classmethod
    def of(cls, values: NDArray[np.float32]) -> Walked:
        """From (…, channels + 1), coverage last."""
        kind = arrays().Float
        return cls(lookup(kind, values[..., :-1]), lookup(kind, values[..., -1]))

    def added(
        self, sums: NDArray[np.float64], luminance: NDArray[np.float64], counts: NDArray[np.int64]
    ) -> NDArray[np.float64]:
        """Sums (pixels, channels + 2), of channels, coverage and the square of Y, with those of the walks, `counts` of
        each pixel.

        luminance: (channels,) of one unit of each.
        """
        channels = len(luminance)
        squares = squares_of_y(Values(self.light), luminance, int(counts.sum()))
        columns = [sums[:, :channels], sums[:, channels:-1], sums[:, -1:]]
        spans = Spans(counts)
        added = [
            in_order(lookup(arrays().Float64, old), Values(new), old.size, spans, old.shape[1])
            for old, new in zip(columns, (self.light, self.covered, squares), strict=True)
        ]
        dr.eval(added)
        return np.concatenate([np.array(new).reshape(old.shape) for new, old in zip(added, columns, strict=True)], 1)


class Spans:
    """Walks, pixel after pixel, `counts` of each: which pixel a walk is of, and which walk of a pixel."""

    def __init__(self, counts: NDArray[np.int64]) -> None:
        jit, self.walks = arrays(), int(counts.sum())
        self.each = int(counts[0]) if (counts == counts[0]).all() else 0
        self.first = lookup(jit.UInt, (np.cumsum(counts) - counts).astype(np.uint32))
        self.counts = lookup(jit.UInt, counts.astype(np.uint32))

    def of(self, pixel: UInt) -> tuple[UInt, UInt]:
        """The first walk of a pixel, and how many it has."""
        if self.each:
            each = dr.opaque(arrays().UInt, self.each)
            return pixel * each, each
        return dr.gather(arrays().UInt, self.first, pixel), dr.gather(arrays().UInt, self.counts, pixel)

    def pixels(self) -> tuple[UInt, UInt]:
        """Of all walks: the number of the pixel, and that of the walk."""
        jit = arrays()
        lane = dr.arange(jit.UInt, self.walks)
        if self.each:
            each = dr.opaque(jit.UInt, self.each)
            return lane // each, lane % each
        begins = dr.zeros(jit.UInt, self.walks)
        dr.scatter(begins, jit.UInt(1), self.first)
        pixel = dr.cumsum(begins) - 1
        return pixel, lane - dr.gather(jit.UInt, self.first, pixel)


class Values:
    """An array that loops do not take into their state."""

    def __init__(self, values: Float) -> None:
        self.values = values

    def at(self, place: UInt) -> Float:
        """A value in double precision."""
        jit = arrays()
        return jit.Float64(dr.gather(jit.Float, self.values, place))


def squares_of_y(light: Values, luminance: NDArray[np.float64], walks: int) -> Float:
    """The square of Y of walks, in single precision."""
    jit, channels = arrays(), len(luminance)
    table, lane, y = lookup(jit.Float64, luminance), dr.arange(jit.UInt, walks), jit.Float64(0.0)
    for k in range(channels):
        y = y + light.at(lane * channels + k) * dr.gather(jit.Float64, table, jit.UInt(k))
    squares = dr.square(jit.Float(y))
    dr.eval(squares)
    return squares


@dr.syntax
def in_order(sums: Float, values: Values, count: int, spans: Spans, width: int) -> Float:
    """The first `count` sums, `width` of each pixel, with as many values of each of its walks, one walk after the
    other.
    """
    jit = arrays()
    lane, k = dr.arange(jit.UInt, count), jit.UInt(0)
    total, across = dr.gather(jit.Float64, sums, lane), dr.opaque(jit.UInt, width)
    begin, last = spans.of(lane // across)
    first = begin * across + lane % across
    while k < last:
        total += values.at(first + k * across)
        k += 1
    return total
