"""Pictures: whether photographs moved or are blurred, and whether the mask ends where the object does.

Motion and blur are those that `measurement.stillness` finds. The mask is compared with the edges of the photographs.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.health.health import Check, doubtful, good, good_where_noticed, not_testable
from hagoromo.measurement.linearity import one_view
from hagoromo.measurement.stillness import TRIED_BLUR, TRIED_SHIFT, Stillness
from hagoromo.photograph.capture import Capture

TOO_FEW = "fewer than three photographs of one view that show something"
LISTED = 4  # photographs that are named
FAINT = 0.02  # share of the brightest below which the logarithm ends
REACH = 10  # px from the edge of the mask that are looked at
OFF_PX = 2.5  # a mask whose object ends farther from its edge is said
PROMINENT = 2.0  # times the median contrast, from which the object is seen to end somewhere
LEAST_CONTRAST = 0.1  # of ln light over a pixel
FEWEST_EDGE = 100  # pixels of the edge of a mask
Array = NDArray[Any]


def motion_check(found: Stillness | None) -> Check:
    """Whether a photograph is shifted against the others."""
    if found is None:
        return not_testable("motion", TOO_FEW)
    if found.shifts:
        listed = [f"{name} by ({x:.1f}, {y:.1f}) px" for name, (x, y) in found.shifts.items()]
        return doubtful("motion", f"shifted against the others: {_some(listed)}", "take them again, or leave them out")
    mistake, hidden = f"a shift of {TRIED_SHIFT:g} px", "the photographs have too little detail in common"
    said = "no photograph is shifted against the others"
    return good_where_noticed("motion", said, mistake, found.shift_trials, hidden)


def blur_check(found: Stillness | None) -> Check:
    """Whether edges of a photograph are less fine than those of the others."""
    if found is None:
        return not_testable("blur", f"{TOO_FEW}; blur of all alike is not seen")
    if found.blurs:
        listed = [f"{name} by {blur:.1f} px" for name, blur in found.blurs.items()]
        return doubtful("blur", f"less sharp than the others: {_some(listed)}", "take them again, or leave them out")
    mistake, hidden = f"a blur of {TRIED_BLUR:g} px", "the object has no fine edges that blur would take away"
    said = "no photograph is less sharp than the others; blur of all alike is not seen"
    return good_where_noticed("blur", said, mistake, found.blur_trials, hidden)


def _some(listed: Sequence[str]) -> str:
    return "; ".join(listed[:LISTED]) + (f"; and {len(listed) - LISTED} more" if len(listed) > LISTED else "")


def mask_check(capture: Capture) -> Check:
    """Whether the edge of the object lies at the edge of the mask, or some pixels inside or outside of it."""
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    shots = capture.photographs
    if not one_view(shots):
        return not_testable("mask", "photographs of several views")
    mask = np.sum([shot.mask for shot in shots], axis=0) >= 0.5 * len(shots)
    mask = _filled(mask)
    if not mask.any():
        return not_testable("mask", "no pixel is valid in half of the photographs")
    distance: Any = distance_transform_edt(mask)
    outside: Any = distance_transform_edt(~mask)
    signed = np.where(mask, distance - 0.5, 0.5 - outside)
    border = np.zeros_like(mask)
    border[REACH:-REACH, REACH:-REACH] = True
    if (border & (np.abs(signed) < 1.0)).sum() < FEWEST_EDGE:
        return not_testable("mask", "hardly any of its edge lies inside of the pictures")
    largest = np.max([np.nan_to_num(shot.values).mean(axis=2) for shot in shots], axis=0).astype(np.float64)
    light = np.log(largest + FAINT * max(float(np.quantile(largest[mask], 0.9)), 1e-30))
    down, across = np.gradient(gaussian_filter(light, 0.7))
    contrast = np.hypot(down, across)
    near = border & (np.abs(signed) <= REACH)
    if not (near & ~mask).any():
        return not_testable("mask", "the photographs have nothing outside of it")
    places = np.arange(-REACH, REACH + 1)
    bins = np.rint(signed[near]).astype(int)
    profile = np.array([np.median(contrast[near][bins == k]) if (bins == k).any() else 0.0 for k in places])
    if profile.max() < max(PROMINENT * np.median(profile), LEAST_CONTRAST):
        return not_testable("mask", "no edge of the object is seen near its end")
    off = int(places[np.argmax(profile)])
    if abs(off) <= OFF_PX:
        return good("mask", "it ends where the object does")
    size = "large" if off > 0 else "small"
    return doubtful(
        "mask", f"the object ends about {abs(off)} px {'inside' if off > 0 else 'outside'} of its edge: it is too "
        f"{size}", "give a mask of the object alone",
    )  # fmt: skip


def _filled(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without holes, as highlights are that are clipped."""
    from scipy.ndimage import binary_fill_holes

    return np.asarray(binary_fill_holes(mask), np.bool_)
