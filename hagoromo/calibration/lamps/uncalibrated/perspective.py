"""Perspective: diverging rays determine tilt and relief as well, so all of C is estimated together.

The cost is that of the bas-relief parameters plus the robust residual of integrability, with its effective number of
independent rows. A hollow surface has another cost in perspective, so the start must have the right sign.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from hagoromo.calibration.lamps.uncalibrated.bas_relief import Family, ObjectPrior
from hagoromo.calibration.lamps.uncalibrated.integrability import CLIP, IntegrabilityRows
from hagoromo.calibration.lamps.uncalibrated.low_rank import Array
from hagoromo.least_squares.fit_status import FitStatus, scipy_status
from hagoromo.least_squares.loss import robust_scale

INDEPENDENT_ROWS = 200.0  # effective number of rows with independent residuals
SAMPLES = 2000  # rows that are evaluated


def resolve_in_perspective(
    family_of: Callable[[Array], Family],
    lines: IntegrabilityRows,
    first: Array,
    figures: Array,
    prior: ObjectPrior,
    sweeps: int,
) -> tuple[Array, Array, FitStatus]:
    """c₁ and c₂ (2, 3) and the bas-relief parameters, starting from those of an orthographic view, by Powell's method,
    and how that ended.

    family_of: c₁ and c₂ → the surfaces and lamps that they leave possible.
    """
    from scipy.optimize import minimize

    count = len(lines.along)
    some = np.random.default_rng(0).choice(count, min(SAMPLES, count), replace=False)
    along, beyond, start = lines.along[some], lines.beyond[some], first.ravel()
    scale = CLIP * robust_scale(along @ start)
    free = np.linalg.svd(start[None])[2][1:]  # of unit length: five degrees of freedom

    def rows_at(moved: Array) -> Array:
        unit = start + moved[:5] @ free
        return (unit / np.linalg.norm(unit)).reshape(2, 3)

    def cost(moved: Array) -> float:
        pair = rows_at(moved)
        family = family_of(pair)
        third = family.third(moved[5:]) @ np.stack([*pair, np.cross(pair[0], pair[1])])
        off = along @ pair.ravel() + beyond @ third
        return INDEPENDENT_ROWS * float(np.log(np.mean(np.log1p((off / scale) ** 2)))) + family.cost(moved[5:], prior)

    options = {"maxiter": sweeps, "xtol": 1e-3, "ftol": 1e-5}
    best = minimize(cost, np.r_[np.zeros(5), figures], method="Powell", options=options)
    return rows_at(best.x), best.x[5:], scipy_status(best)
