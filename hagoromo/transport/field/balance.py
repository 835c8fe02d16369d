"""Balance: what cells send, what of it leaves them all and what matter intercepts again, for every channel.

A sweep gathers light at cells, which loses or gains a little of what was sent. Over many orders in white matter that
would grow: so the light of a sweep is scaled to what was sent, less what leaves.
"""

from __future__ import annotations

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, UInt, arrays
from hagoromo.transport.field.second_order import second_order

LARGEST = 2.0  # change of the light of a sweep, either way


class Balance:
    """Sums over cells and directions. A plain object: loops do not take it into their state."""

    def __init__(self, sent: list[list[Float]]) -> None:
        self.sent = sent
        self.stays, self.intercepted, self.scales = np.zeros(len(sent)), np.zeros(len(sent)), np.ones(len(sent))

    def add(self, cell: UInt, towards: Array3f, weight: Float, sigma: Float, light: list[Float], leaves: Float) -> None:
        """Of some cells and directions: σ [1/m], the light that arrives, and the share of light that leaves."""
        kind = arrays().Float
        for k, numbers in enumerate(self.sent):
            along = second_order([dr.gather(kind, n, cell) for n in numbers]).at(towards)
            self.stays[k] += _total(weight * along * (1.0 - leaves))
            self.intercepted[k] += _total(weight * sigma * light[k])

    def scaled(self, incident: list[list[Float]]) -> list[list[Float]]:
        """The incident light that matter meets as much of as stays."""
        factors = np.where(self.intercepted > 0.0, self.stays / np.maximum(self.intercepted, 1e-30), 1.0)
        self.scales = factors.clip(1.0 / LARGEST, LARGEST)
        factors = [dr.opaque(arrays().Float, float(f)) for f in self.scales]
        return [[number * factor for number in numbers] for numbers, factor in zip(incident, factors, strict=True)]


def _total(values: Float) -> float:
    """The sum, with the same bits always."""
    return float(np.sum(np.array(values), dtype=np.float64))
