"""Pictures: whether photographs moved or are blurred, and whether the mask ends where the object does.

All three look at edges. Lamps change the shading but not the place of edges, nor how fine they are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import ROBUST_SCALE
from hagoromo.measurement.health.health import Check, doubtful, good, not_testable
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

SIDE = 400  # px, at most, of the part of the photographs that is looked at
FINE_PX, COARSE_PX = 0.8, 2.5  # scales of edges
FAINT = 0.02  # share of the brightest below which the logarithm ends
FEWEST = 4  # photographs
BLURRED, CERTAIN = 0.35, 5.0  # fall of ln fineness below the median: at least so much, and so many deviations
TRIED_PX = 2.0  # blur that must show
LEAST_DEVIATION = 0.03  # of ln fineness between photographs
REACH = 10  # px from the edge of the mask that are looked at
OFF_PX = 2.5  # a mask whose object ends farther from its edge is said
PROMINENT = 2.0  # times the median contrast, from which the object is seen to end somewhere
LEAST_CONTRAST = 0.1  # of ln light over a pixel
FEWEST_EDGE = 100  # pixels of the edge of a mask
Array = NDArray[Any]


def motion_check(capture: Capture, shifts: Mapping[str, tuple[float, float]]) -> Check:
    """Whether a photograph is shifted against the others. shifts: by `moved`."""
    shots = capture.photographs
    if len(shots) < 3 or not _one_view(shots):
        return not_testable("motion", "fewer than three photographs of one view")
    if not shifts:
        return good("motion", "no photograph is shifted against the others")
    listed = "; ".join(f"{name} by ({x:.1f}, {y:.1f}) px" for name, (x, y) in list(shifts.items())[:3])
    more = f"; and {len(shifts) - 3} more" if len(shifts) > 3 else ""
    return doubtful("motion", f"shifted against the others: {listed}{more}", "take them again, or leave them out")


def blur_check(capture: Capture) -> Check:
    """Whether edges of a photograph are less fine than those of the others."""
    from scipy.ndimage import gaussian_filter

    shots = capture.photographs
    if len(shots) < FEWEST or not _one_view(shots):
        return not_testable("blur", f"fewer than {FEWEST} photographs of one view; blur of all alike is not seen")
    part = _window(np.any([shot.mask for shot in shots], axis=0))
    inside = np.all([shot.mask[part] for shot in shots], axis=0)
    if inside.sum() < FEWEST_EDGE:
        return not_testable("blur", "fewer than 100 pixels are valid in all photographs")
    greys = [np.nan_to_num(shot.values[part].astype(np.float64).mean(axis=2)) for shot in shots]
    fineness = [_fineness(grey, inside) for grey in greys]
    off = np.median(fineness) - np.array(fineness)
    spread = max(ROBUST_SCALE * float(np.median(np.abs(off))), LEAST_DEVIATION)
    limit = max(BLURRED, CERTAIN * spread)
    soft = [shots[k].name for k in np.flatnonzero(off > limit)]
    usual = int(np.argsort(fineness)[len(fineness) // 2])
    if not soft and fineness[usual] - _fineness(gaussian_filter(greys[usual], TRIED_PX), inside) < limit:
        return not_testable("blur", "the object has no fine edges that blur would take away")
    if not soft:
        return good("blur", "no photograph is less sharp than the others; blur of all alike is not seen")
    return doubtful("blur", f"less sharp than the others: {', '.join(soft[:4])}", "take them again, or leave them out")


def _fineness(grey: Array, inside: NDArray[np.bool_]) -> float:
    """Logarithm of the strength of fine edges over that of coarse ones."""
    from scipy.ndimage import gaussian_laplace

    light = np.log(np.maximum(grey, 0.0) + FAINT * max(float(np.quantile(grey, 0.99)), 1e-30))
    fine, coarse = (np.quantile(np.abs(gaussian_laplace(light, s))[inside], 0.9) for s in (FINE_PX, COARSE_PX))
    return float(np.log(max(fine, 1e-9) / max(coarse, 1e-9)))


def mask_check(capture: Capture) -> Check:
    """Whether the edge of the object lies at the edge of the mask, or some pixels inside or outside of it."""
    from scipy.ndimage import distance_transform_edt, gaussian_filter

    shots = capture.photographs
    if not _one_view(shots):
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


def _one_view(shots: Sequence[Photograph]) -> bool:
    first = shots[0]
    return all(
        shot.values.shape == first.values.shape and np.allclose(shot.camera.matrix, first.camera.matrix, rtol=1e-6)
        for shot in shots
    )


def _window(mask: NDArray[np.bool_]) -> tuple[slice, slice]:
    """The middle of the object, at most SIDE px wide and high."""
    parts = []
    for axis in (1, 0):
        some = np.flatnonzero(mask.any(axis=axis))
        if not len(some):
            return np.s_[:1, :1]
        middle = (some[0] + some[-1]) // 2
        parts.append(slice(max(some[0], middle - SIDE // 2), min(some[-1] + 1, middle + SIDE // 2)))
    return parts[0], parts[1]


def _filled(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Without holes, as highlights are that are clipped."""
    from scipy.ndimage import binary_fill_holes

    return np.asarray(binary_fill_holes(mask), np.bool_)
