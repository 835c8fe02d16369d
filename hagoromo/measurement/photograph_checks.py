"""Checks of photographs before they are measured: whether their numbers follow light, and whether anything moved.

Stillness: detect that camera or object moved between photographs of one view under different lamps.

Lamps change the shading but not the position of edges and texture. So the Laplacian of the logarithm, normalised by its
local strength, is compared by phase correlation (scikit-image). On the University of Washington's set (eight objects
including a chrome ball, twelve lamps) no estimated shift exceeds 0.3 px.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import white_of
from hagoromo.measurement.squares import square_means
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.exponent import FEWEST_LAMPS, Exponent, exponent_of
from hagoromo.photograph.photograph import Photograph

MOST_SAMPLES = 20_000  # pixels that are read of each photograph
MOVED_PX = 0.35  # [px of the compared picture] a larger shift means that the photograph moved
COMPARED_PIXELS = 500_000  # largest number of pixels that are compared; larger photographs are binned
EDGE_SCALE_PX, STRENGTH_SCALE_PX = 1.0, 8.0  # [px] scales of the compared edges, and of their local strength
FAINT_EDGE = 0.02  # strength (of the logarithm) below which edges are attributed to noise
STEPS_PER_PIXEL = 10  # resolution of an estimated shift
LEAST_SIGNAL = 5.0  # standard deviations of a compared pixel's noise from which it shows the scene
SHOWN_BY = 4  # lamps under which a place must be above its noise, to be one of the object
LEAST_SHOWN = 0.01  # share of the pixels that must show the scene; a photograph nearly black says nothing of its shift
CERTAIN_SHIFT = 4.0  # standard errors (of Fisher's z) by which the shift must raise the correlation
INDEPENDENT = 1.0 / (4.0 * np.pi * EDGE_SCALE_PX**2)  # independent values per pixel of the compared edges
ALIKE_PX, ALIKE_QUARTERS = 0.35, 3  # quarters of the picture that must be shifted as the whole, and how closely
LEAST_CORRELATION = 0.2  # least correlation with the other photographs, after alignment, for a reliable shift


def linearity_of(capture: Capture) -> Exponent | None:
    """The exponent that the shading asks for; None where the capture cannot tell, for `why_not_tested`.

    Direction and distance of near lamps are those at `points_at`.
    """
    if unfit(capture):
        return None
    shots = capture.photographs
    rows, columns = np.nonzero(np.sum([shot.mask for shot in shots], axis=0) >= 0.5 * len(shots))
    chosen = np.s_[:: max(-(-len(rows) // MOST_SAMPLES), 1)]
    rows, columns = rows[chosen], columns[chosen]
    points = None
    if near(capture):
        points = points_at(capture, np.stack([columns, rows], axis=1) + 0.5)
        known = np.isfinite(points).all(axis=1)
        rows, columns, points = rows[known], columns[known], points[known]
    lit = [towards(shot, points) for shot in shots]
    greys = [_grey(shot, rows, columns) for shot in shots]
    values = [grey / falloff for grey, (_, falloff) in zip(greys, lit, strict=True)]
    to_lamp = [np.broadcast_to(to, (len(rows), 3)) for to, _ in lit]
    errors = [np.sqrt(shot.variance[rows, columns].astype(np.float64).sum(axis=1)) / lamp_light(shot) for shot in shots]
    seen = shows(np.stack(greys), np.stack(errors))
    to_eye = -shots[0].camera.unproject(np.stack([columns, rows], axis=1) + 0.5)
    return exponent_of(np.stack(values)[:, seen], np.stack(to_lamp)[:, seen], to_eye[seen])


def shows(values: NDArray[np.floating], errors: NDArray[np.floating]) -> NDArray[np.bool_]:
    """(P,) whether places show something: readings (K, P) under some lamps stand out of their standard errors (K, P).

    What does not is a dark background without a mask.
    """
    with np.errstate(invalid="ignore"):
        return np.asarray((values > LEAST_SIGNAL * errors).sum(axis=0) >= SHOWN_BY, np.bool_)


def why_not_tested(capture: Capture) -> str:
    """Why `linearity_of` gave nothing, in words."""
    return f"not tested: {unfit(capture) or 'too few pixels that five lamps light'}"


def unfit(capture: Capture) -> str:
    """What of the capture keeps its shading from telling; "" where nothing does."""
    shots = capture.photographs
    first = shots[0]
    if len(shots) < FEWEST_LAMPS:
        return f"{len(shots)} photographs, and the shading tells from {FEWEST_LAMPS} on"
    if any(len(shot.lamps) != 1 for shot in shots):
        return "photographs under several lamps, or none"
    if any(
        shot.values.shape != first.values.shape or not np.allclose(shot.camera.matrix, first.camera.matrix, rtol=1e-6)
        for shot in shots
    ):
        return "photographs of several views"
    if capture.points is None and near(capture) and not _plane_is_known(first):
        return "near lamps, and neither points of the surface nor its distance"
    return ""


def near(capture: Capture) -> bool:
    """Whether the light of a lamp differs over the object by where the lamp stands."""
    return any(shot.lamps[0].near for shot in capture.photographs)


def _plane_is_known(shot: Photograph) -> bool:
    return not shot.camera.orthographic and bool(np.linalg.norm(shot.camera.position) > 0.0)


def points_at(capture: Capture, pixels: NDArray[np.floating]) -> NDArray[np.float64]:
    """(P, 3) [m] world: what the capture shows at `pixels` (P, 2) (x, y), NaN where that is not known.

    Without points of its surface those of the plane across the view through the world's origin, where an object stands
    whose distance nobody stated.
    """
    camera = capture.photographs[0].camera
    if capture.points is not None:
        columns, rows = np.floor(pixels).astype(int).T
        found = np.asarray(capture.points[rows, columns], np.float64)
        return np.where(np.linalg.norm(found, axis=1, keepdims=True) > 0.0, found, np.nan)
    ray = camera.unproject(pixels)
    away = np.linalg.norm(camera.position) / (ray @ camera.camera_to_world[:3, 2])
    return np.asarray(camera.position + ray * away[:, None], np.float64)


def towards(shot: Photograph, points: NDArray[np.float64] | None) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Unit vectors to the lamp (3,) or (P, 3), and what its light falls off by, () or (P,)."""
    lamp = shot.lamps[0]
    if lamp.to_lamp is not None:
        return np.asarray(lamp.to_lamp, np.float64), np.ones(())
    assert points is not None
    towards, irradiance = lamp.direction_and_irradiance(points)
    light = np.asarray(irradiance, np.float64).reshape(len(points), -1).mean(axis=1)
    return np.asarray(towards, np.float64), light / max(float(np.mean(lamp.intensity)), 1e-300)


def _grey(shot: Photograph, rows: np.ndarray, columns: np.ndarray) -> np.ndarray:
    """(P,) mean over the channels of the value over the light of the lamp; NaN where it is invalid."""
    grey = shot.values[rows, columns].astype(np.float64).sum(axis=1) / lamp_light(shot)
    return np.where(shot.mask[rows, columns], grey, np.nan)


def lamp_light(shot: Photograph) -> float:
    """Sum over the channels of what a white reads of the light of its lamp."""
    lamp, channels = shot.lamps[0], shot.values.shape[2]
    white = white_of(lamp.spectrum, shot.camera.response, channels)
    light = np.broadcast_to(np.asarray(lamp.intensity, np.float64) * white, channels)
    return max(float(light.sum()), 1e-300)


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
        if not (own.any() and others.any()):
            continue
        rows, columns = phase_cross_correlation(others * window, own * window, upsample_factor=STEPS_PER_PIXEL)[0]
        back = shift(own, (rows, columns), order=3, mode="nearest")
        still, shifted = (_correlation(others, p) for p in (own, back))
        gain = np.arctanh(min(shifted, 1.0 - 1e-9)) - np.arctanh(min(still, 1.0 - 1e-9))
        certain = gain * np.sqrt(INDEPENDENT * own.size) > CERTAIN_SHIFT
        far = np.hypot(rows, columns) > MOVED_PX and shifted > LEAST_CORRELATION and certain
        if far and _moves_as_a_whole(others, own, np.array([rows, columns])):
            shifts[photograph.name] = (-k * float(columns), -k * float(rows))
    return shifts


def _moves_as_a_whole(others: NDArray, own: NDArray, moved_by: NDArray) -> bool:
    """Whether three quarters of the picture or more are shifted alike. Shading that ends elsewhere is at one side."""
    from skimage.registration import phase_cross_correlation

    alike, (height, width) = 0, (n // 2 for n in own.shape)
    window = np.outer(*(np.hanning(n + 2)[1:-1] for n in (height, width)))
    for top, left in ((0, 0), (0, width), (height, 0), (height, width)):
        part = np.s_[top : top + height, left : left + width]
        found = phase_cross_correlation(others[part] * window, own[part] * window, upsample_factor=STEPS_PER_PIXEL)[0]
        alike += bool(np.linalg.norm(found - moved_by) < ALIKE_PX)
    return alike >= ALIKE_QUARTERS


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
    grey = square_means(values, k)
    floor = FAINT_EDGE * max(float(np.quantile(grey, 0.99)), 1e-30)
    edges = gaussian_laplace(np.log(np.maximum(grey, 0.0) + floor), EDGE_SCALE_PX)
    marks = edges / (np.sqrt(gaussian_filter(edges**2, STRENGTH_SCALE_PX)) + FAINT_EDGE)
    return marks - marks.mean()
