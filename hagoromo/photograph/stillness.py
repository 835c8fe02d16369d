"""Stillness: detect that camera or object moved between photographs of one view under different lamps.

Lamps change the shading but not the position of edges and texture. So the Laplacian of the logarithm, normalised by its
local strength, is compared by phase correlation (scikit-image). On the University of Washington's set (eight objects
including a chrome ball, twelve lamps) no estimated shift exceeds 0.3 px.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.photograph.photograph import Photograph

MOVED_PX = 0.75  # [px of the compared picture] a larger shift means that the photograph moved
COMPARED_PIXELS = 500_000  # largest number of pixels that are compared; larger photographs are binned
EDGE_SCALE_PX, STRENGTH_SCALE_PX = 1.5, 8.0  # [px] scales of the compared edges, and of their local strength
FAINT_EDGE = 0.02  # strength (of the logarithm) below which edges are attributed to noise
STEPS_PER_PIXEL = 10  # resolution of an estimated shift
LEAST_SIGNAL = 5.0  # standard deviations of a compared pixel's noise from which it shows the scene
LEAST_SHOWN = 0.01  # share of the pixels that must show the scene; a photograph nearly black says nothing of its shift
CERTAIN_SHIFT = 6.0  # standard errors (of Fisher's z) by which the shift must raise the correlation
INDEPENDENT = 1.0 / (4.0 * np.pi * EDGE_SCALE_PX**2)  # independent values per pixel of the compared edges
LEAST_CORRELATION = 0.2  # least correlation with the other photographs, after alignment, for a reliable shift


def moved(photographs: Sequence[Photograph]) -> dict[str, tuple[float, float]]:
    """Photographs that are shifted relative to the mean of the others: name → (x, y) [px].

    Empty for fewer than three photographs, or photographs of different views.
    """
    from scipy.ndimage import shift
    from skimage.registration import phase_cross_correlation

    first = photographs[0].camera
    if len(photographs) < 3 or not all(np.allclose(p.camera.matrix, first.matrix, rtol=1e-6) for p in photographs):
        return {}
    if len({p.values.shape[:2] for p in photographs}) > 1:
        return {}
    k = int(np.ceil(np.sqrt(first.width * first.height / COMPARED_PIXELS)))
    photographs = [photograph for photograph in photographs if _shows_scene(photograph, k)]
    if len(photographs) < 3:
        return {}
    marks = [_marks(photograph, k) for photograph in photographs]
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in marks[0].shape))
    total, shifts = np.sum(marks, axis=0), {}
    for photograph, own in zip(photographs, marks, strict=True):
        others = (total - own) / (len(marks) - 1)
        rows, columns = phase_cross_correlation(others * window, own * window, upsample_factor=STEPS_PER_PIXEL)[0]
        back = shift(own, (rows, columns), order=1, mode="nearest")
        still, shifted = (_correlation(others, p) for p in (own, back))
        gain = np.arctanh(min(shifted, 1.0 - 1e-9)) - np.arctanh(min(still, 1.0 - 1e-9))
        certain = gain * np.sqrt(INDEPENDENT * own.size) > CERTAIN_SHIFT
        if np.hypot(rows, columns) > MOVED_PX and shifted > LEAST_CORRELATION and certain:
            shifts[photograph.name] = (-k * float(columns), -k * float(rows))
    return shifts


def _shows_scene(photograph: Photograph, k: int) -> bool:
    """Whether enough pixels, binned by `k`, exceed the noise of the mean of the colours."""
    height, width = (n // k * k for n in photograph.values.shape[:2])
    signal, variance = (
        np.nan_to_num(layer[:height, :width].astype(np.float64).sum(axis=2), posinf=0.0)
        .reshape(height // k, k, width // k, k)
        .sum(axis=(1, 3))
        for layer in (photograph.values, photograph.variance)
    )
    shown = signal > LEAST_SIGNAL * np.sqrt(np.maximum(variance, 0.0))
    return bool(shown.mean() > LEAST_SHOWN)


def _correlation(one: NDArray, other: NDArray) -> float:
    """Pearson's correlation of two pictures; 0 where one is even."""
    if np.ptp(one) == 0.0 or np.ptp(other) == 0.0:
        return 0.0
    return float(np.corrcoef(one.ravel(), other.ravel())[0, 1])


def _marks(photograph: Photograph, k: int) -> NDArray[np.float64]:
    """Edges and texture of a photograph, binned by `k`, normalised by their local strength, with mean 0."""
    from scipy.ndimage import gaussian_filter, gaussian_laplace

    values = np.nan_to_num(photograph.values.astype(np.float64).mean(axis=2))
    height, width = (n // k * k for n in values.shape)
    grey = values[:height, :width].reshape(height // k, k, width // k, k).mean(axis=(1, 3))
    floor = FAINT_EDGE * max(float(np.quantile(grey, 0.99)), 1e-30)
    edges = gaussian_laplace(np.log(np.maximum(grey, 0.0) + floor), EDGE_SCALE_PX)
    marks = edges / (np.sqrt(gaussian_filter(edges**2, STRENGTH_SCALE_PX)) + FAINT_EDGE)
    return marks - marks.mean()
