"""Whole sums: sums that many lanes add to, with the same bits in any order, as whole numbers of a small unit."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr

from hagoromo.backend import Bool, Float, UInt, arrays

UNITS = float(1 << 38)  # of the largest single addend: 2^25 of those fit


class WholeSums:
    """`count` sums, 0 at the begin. A plain object: loops do not take it into their state.

    most: no addend is larger [unit of the sums].
    """

    def __init__(self, count: int, most: float) -> None:
        jit = arrays()
        self.sums = dr.zeros(jit.Int64, max(count, 2))
        dr.make_opaque(self.sums)
        unit = most / UNITS if most > 0.0 else 1.0
        self.unit, self.per_unit = dr.opaque(jit.Float64, unit), dr.opaque(jit.Float64, 1.0 / unit)

    def add(self, place: UInt, values: Sequence[Float], active: Bool) -> None:
        """Add values to the sums at `place` and behind it."""
        jit = arrays()
        for k, value in enumerate(values):
            whole = jit.Int64(dr.round(jit.Float64(value) * self.per_unit))
            dr.scatter_add(self.sums, whole, place + k, active)

    def at(self, place: UInt) -> Float:
        """A sum."""
        jit = arrays()
        return jit.Float(jit.Float64(dr.gather(jit.Int64, self.sums, place)) * self.unit)
