"""Corner choice: which windows of the sub-pixel search suit the photographs of a board.

The windows of `corner_windows` hold no other edges; blur wider than them hides the corner from them. So corners are
sought in other windows, too. Whole sets of windows are compared by photographs that were left out of the fit, and the
photographs that fit worst take the windows with the least residual.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.camera.board import OWN_WINDOWS, Corners

FOLDS = 4  # groups of photographs that are left out, one after the other
FEWEST_TO_LEAVE_OUT = 8  # photographs; of fewer, the residuals of the fit itself are compared
FEWEST_TO_FIT = 3  # photographs that determine a lens
BETTER = 0.98  # least gain of other windows over our own: rms of the photographs left out
Lens = tuple[NDArray[np.float64], NDArray[np.float64]]  # matrix and distortion
Fit = Callable[[Sequence[Corners]], Lens]
Named = Mapping[str, Mapping[str, Corners]]  # windows → photograph → corners


class Chosen(NamedTuple):
    """corners: photograph → corners. windows: what they were sought in. left_out: rms [px] by each set of windows."""

    corners: dict[str, Corners]
    windows: str
    left_out: dict[str, float]


def chosen_corners(found: Named, fit: Fit, outliers: Callable[[Mapping[str, Corners]], Sequence[str]]) -> Chosen:
    """The corners with the least residuals in photographs that were left out of the fit.

    fit: corners of photographs → lens. outliers: names of the photographs that fit much worse than the others.
    """
    scores = {name: _left_out(list(corners.values()), fit) for name, corners in found.items()}
    best = min(scores, key=lambda name: scores[name])
    best = best if scores[best] < BETTER * scores[OWN_WINDOWS] else OWN_WINDOWS
    corners = dict(found[best])
    odd = outliers(corners)
    if odd:
        kept = [one for name, one in corners.items() if name not in odd]
        lens = fit(kept if len(kept) >= FEWEST_TO_FIT else list(corners.values()))
        mixed = corners | {
            name: min((others[name] for others in found.values()), key=lambda one: residual(one, lens)) for name in odd
        }
        scores["mixed"] = _left_out(list(mixed.values()), fit)
        if scores["mixed"] < scores[best]:
            return Chosen(mixed, f"{best}; of {', '.join(odd)} those with the least residual", scores)
    return Chosen(corners, best, scores)


def residual(corners: Corners, lens: Lens) -> float:
    """Root mean square length [px] of the residuals of one photograph, its pose fitted."""
    import cv2

    solved, turn, shift = cv2.solvePnP(corners.points, corners.image, *lens)
    if not solved:
        return np.inf
    predicted = cv2.projectPoints(corners.points, turn, shift, *lens)[0].reshape(-1, 2)
    return float(np.sqrt(np.mean(np.sum((corners.image - predicted) ** 2, axis=1))))


def _left_out(corners: Sequence[Corners], fit: Fit) -> float:
    """Root mean square residual [px] of photographs by lenses that were fitted without them."""
    if len(corners) < FEWEST_TO_LEAVE_OUT:
        lens = fit(corners)
        return float(np.sqrt(np.mean([residual(one, lens) ** 2 for one in corners])))
    squares = []
    for fold in range(FOLDS):
        lens = fit([one for k, one in enumerate(corners) if k % FOLDS != fold])
        squares += [residual(one, lens) ** 2 for one in corners[fold::FOLDS]]
    return float(np.sqrt(np.mean(squares)))
