"""Explained: how well an object explains each photograph that it was recovered from, and what is said of odd ones.

A photograph whose exposure, lamp or pose is stated wrong loses weight in the descent, but it spoils places and stated
errors all the same. It shows itself when all is done, as the others agree.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from scipy import ndimage

from hagoromo.errors import listed
from hagoromo.least_squares.loss import ROBUST_SCALE
from hagoromo.measurement.surface.tile_store import binned, means
from hagoromo_recovery.outline.object_view import LEAST_VALID
from hagoromo_recovery.outline.silhouettes import bright_of

if TYPE_CHECKING:
    from hagoromo.camera.camera import Camera
    from hagoromo.photograph.photograph import Photograph
    from hagoromo_recovery.recovered import Recovered

WIDTH = 160  # px, of the pictures that are compared, about
OPAQUE = 0.5  # opacity of a pixel that shows the object
BRIGHT, LEAST_SHARE = 90, 0.3  # percentile of predicted light that is bright; share of it from which pixels count
LEAST_PIXELS = 20
ODD_FACTOR, ODD_SPREADS = 0.1, 5.0  # ln of an odd brightness at least, and in robust standard deviations
MENDED = 0.75  # share of the residual that is left after a factor, where it is the brightness that is odd
LEAST_LIGHT = 0.1  # of the usual light: darker photographs are not judged by their own
ODD_REST, LEAST_REST = 3.0, 0.1  # residual of an odd photograph, in usual ones; and least share of its light
CURVE = 0.25 * np.pi  # length of a curve over what it goes along two axes, as a mean over all directions
# Share of the light that is unexplained in the median photograph, from which that is said: a lattice that is too coarse
# for an object leaves 0.13.
LEFT = 0.2
MISSING = 0.1  # share of a mask that is not covered, from which that is said


class Explained(NamedTuple):
    """How well a photograph is explained. light: root of the mean squared light in the silhouette. rest: that of its
    difference from the prediction; scaled: after the best factor on it. factor: light over prediction, the median of
    bright pixels. missing: share of the stated mask that the object does not cover; without a mask, of what is bright
    before the dark background. beyond: how far the outline of the
    object stands outside that of the stated mask, on the mean [m]; negative: inside. NaN where there are too few
    pixels, or no mask.
    """

    name: str
    light: float = np.nan
    rest: float = np.nan
    scaled: float = np.nan
    factor: float = np.nan
    missing: float = np.nan
    beyond: float = np.nan


def explained(recovered: Recovered, photograph: Photograph) -> Explained:
    """How well an object explains a photograph."""
    step = max(1, photograph.camera.width // WIDTH)
    small = binned(photograph, step, LEAST_VALID) if step > 1 else photograph
    light, opacity = recovered.picture(small)
    values, predicted = small.values.mean(axis=2), light[..., : small.values.shape[2]].mean(axis=2)
    there, missing, beyond = small.mask & (opacity > OPAQUE) & np.isfinite(values), np.nan, np.nan
    stated = photograph.silhouette
    share = means(bright_of(photograph) if stated is None else stated, step)[..., 0]
    inner = ndimage.binary_erosion(share > OPAQUE)
    missing = float((opacity[inner] < OPAQUE).mean()) if inner.any() else np.nan
    if stated is not None:
        beyond = _beyond(recovered, small.camera, opacity, share)
    if there.sum() < LEAST_PIXELS:
        return Explained(photograph.name, missing=missing, beyond=beyond)
    bright = there & (predicted > LEAST_SHARE * np.percentile(predicted[there], BRIGHT))
    factor = float(np.median(values[bright] / predicted[bright])) if bright.sum() >= LEAST_PIXELS else np.nan
    rest, scaled = (_rms((values - by * predicted)[there]) for by in (1.0, factor))
    return Explained(photograph.name, _rms(values[there]), rest, scaled, factor, missing, beyond)


def _beyond(recovered: Recovered, camera: Camera, opacity: np.ndarray, share: np.ndarray) -> float:
    """How far an outline stands outside that of a mask [m]: the area between both over the length of the outline."""
    outline = CURVE * float(sum(np.abs(np.diff(share, axis=axis)).sum() for axis in (0, 1)))
    pixel = float(np.linalg.norm(camera.position - recovered.lattice.middle)) / min(camera.focal)
    return pixel * float((opacity - share).sum()) / outline if outline else np.nan


def said_of(all_of: Sequence[Explained], stated: bool = True) -> list[str]:
    """What is said of photographs that are odd among all that an object was recovered from. stated: by masks."""
    names, count = np.array([each.name for each in all_of]), len(all_of)
    light, rest, scaled, factor, missing, _ = np.array([each[1:] for each in all_of], float).reshape(-1, 6).T
    if not np.isfinite(light).any():
        return []
    lit = light > LEAST_LIGHT * np.nanmedian(light)
    odd = lit & _far(np.log(np.maximum(factor, 1e-6))) & (scaled < MENDED * rest)
    share = rest / np.maximum(light, LEAST_LIGHT * np.nanmedian(light))
    worse = ~odd & (share > ODD_REST * np.nanmedian(share)) & (share > LEAST_REST)
    said = []
    if odd.any():
        each = [f"{name} by {100.0 * (by - 1.0):+.0f} %" for name, by in zip(names[odd], factor[odd], strict=True)]
        said.append(
            f"{odd.sum()} of {count} photographs are brighter or darker than the others say: {listed(each)}; check "
            "their exposures and lamps, or estimate them (--refine exposure)"
        )
    if worse.any():
        said.append(
            f"the light of {worse.sum()} of {count} photographs is explained {ODD_REST:g} times worse than is usual: "
            f"{listed(list(names[worse]))}; check their lamps and poses; or they look into a hollow that was not found"
        )
    usual = float(np.nanmedian(share))
    if usual > LEFT:
        said.append(
            f"{100.0 * usual:.0f} % of the light of photographs is unexplained in the median: form and colours are not "
            "those of the object; check lamps and poses, give masks, or photographs of more views"
        )
    lacking = missing > MISSING
    if lacking.any():
        worst = int(np.nanargmax(missing))
        many, worse = f"{lacking.sum()} of {count}", f"{names[worst]} by {100.0 * missing[worst]:.0f} %"
        said.append(
            f"{many} masks are not covered by the object, that of {worse}: parts about as thin as a voxel are lost; "
            "give more nodes (--side)"
            if stated
            else f"what is bright in {many} photographs is not covered by the object, in {worse}: parts that lie in "
            "shadow in other photographs, or about as thin as a voxel, are lost; give masks, or more nodes (--side)"
        )
    return said


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _far(values: np.ndarray) -> np.ndarray:
    """Values that are far from their median, by what is usual among them."""
    away = np.abs(values - np.nanmedian(values))
    return away > max(ODD_FACTOR, ODD_SPREADS * ROBUST_SCALE * float(np.nanmedian(away)))
