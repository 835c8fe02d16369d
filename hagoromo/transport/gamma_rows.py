"""Rows of several γ: tables of materials whose half width of facets differs from place to place of a surface.

What is tabled of a material holds for one γ. A surface with a texture of γ therefore has rows of a few γ, from the
least to the largest of its texture, and a place takes what lies between two of them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Float, UInt, arrays, lookup
from hagoromo.reflectance.reflectance import Reflectance

STEP = 1.15  # between the γ of two rows, at most


class GammaRows:
    """The rows of all materials: first one each, by their own γ, then those of materials whose γ differs.

    A plain object: loops do not take its table into their state.
    """

    def __init__(
        self, reflectances: Sequence[Reflectance], further: Mapping[int, Sequence[tuple[Reflectance, float]]]
    ) -> None:
        """further: by the numbers of the materials whose γ differs, theirs from the least γ to the largest in equal
        steps of log γ, each with the factor by which its β, and those of its lobes, are lower than the material's.
        """
        self.reflectances, table = list(reflectances), []
        self.factors = [1.0] * len(self.reflectances)
        for number, one in enumerate(reflectances):
            first, own = number, [one]
            if number in further:
                first, own = len(self.reflectances), [each for each, _ in further[number]]
                self.reflectances += own
                self.factors += [factor for _, factor in further[number]]
            gammas = [each.gamma for each in own]
            span = math.log(gammas[-1] / gammas[0]) / (len(gammas) - 1) if len(gammas) > 1 else 1.0
            table.append((first, len(gammas) - 1, math.log(gammas[0]), span))
        self.table = lookup(arrays().Float, np.array(table, np.float32))
        dr.eval(self.table)

    def at(self, material: UInt, gamma: Float) -> tuple[UInt, UInt, Float]:
        """The two rows beside γ [rad] of a material, and the share of the second.

        Between them what is tabled is straight in γ², by which the light of narrow facets grows.
        """
        jit = arrays()
        first, last, low, span = dr.gather(jit.Array4f, self.table, material)
        place = dr.fmin(dr.fmax((dr.log(gamma) - low) / span, 0.0), last)
        below = dr.floor(dr.fmin(place, dr.fmax(last - 1.0, 0.0)))
        share = (dr.exp(2.0 * span * (place - below)) - 1.0) / (dr.exp(2.0 * span) - 1.0)
        row = jit.UInt(first + below)
        return row, row + dr.select(last > 0.0, 1, jit.UInt(0)), share


def gammas_between(least: float, largest: float, step: float = STEP) -> list[float]:
    """γ [rad] from the least to the largest, each `step` times the one before at most; one, where they are the same."""
    steps = math.ceil(math.log(largest / least) / math.log(step))
    return np.geomspace(least, largest, steps + 1).tolist() if steps else [least]
