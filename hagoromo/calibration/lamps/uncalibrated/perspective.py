"""Perspective: rays that spread tell tilt and relief as well, so all of C is sought together.

The cost is that of the bas-relief's figures and, for so many independent rows of integrability, their robust residual.
In perspective a hollow surface is another one, so the start must be on the right side.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hagoromo.calibration.lamps.uncalibrated.bas_relief import Belief, Family
from hagoromo.calibration.lamps.uncalibrated.integrability import CLIP, Rows
from hagoromo.calibration.lamps.uncalibrated.low_rank import Array
from hagoromo.least_squares import FitStatus, robust_scale, scipy_status

ALONE = 200.0  # rows whose residuals are independent
SAMPLES = 2000


def resolve_in_perspective(
    family_of: Callable[[Array], Family], lines: Rows, first: Array, figures: Array, belief: Belief, sweeps: int
) -> tuple[Array, Array, FitStatus]:
    """c₁ and c₂ (2, 3) and the figures of the bas-relief, from those of a view from afar, by Powell's directions, and
    how they ended.

    family_of: c₁ and c₂ → what they leave possible.
    """
    from scipy.optimize import minimize

    count = len(lines.along)
    some = np.random.default_rng(0).choice(count, min(SAMPLES, count), replace=False)
    along, beyond, start = lines.along[some], lines.beyond[some], first.ravel()
    scale = CLIP * robust_scale(along @ start)
    free = np.linalg.svd(start[None])[2][1:]  # of unit length: five ways to move

    def rows_at(moved: Array) -> Array:
        unit = start + moved[:5] @ free
        return (unit / np.linalg.norm(unit)).reshape(2, 3)

    def cost(moved: Array) -> float:
        pair = rows_at(moved)
        family = family_of(pair)
        third = family.third(moved[5:]) @ np.stack([*pair, np.cross(pair[0], pair[1])])
        off = along @ pair.ravel() + beyond @ third
        return ALONE * float(np.log(np.mean(np.log1p((off / scale) ** 2)))) + family.cost(moved[5:], belief)

    options = {"maxiter": sweeps, "xtol": 1e-3, "ftol": 1e-5}
    best = minimize(cost, np.r_[np.zeros(5), figures], method="Powell", options=options)
    return rows_at(best.x), best.x[5:], scipy_status(best)
