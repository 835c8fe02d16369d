"""Mask offset: how far the outlines of masks stand from those that the photographs show, and what is mixed there.

Across the outline of an object a photograph changes more than beside it, before a dark background and before a textured
one. Where that change stands, on the mean of all photographs, the outline is. Masks that are made in one way are
wrong in one way, so one offset is found for all.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.measurement.surface.tile_store import means
from hagoromo_recovery.outline.hull import signed_distance
from hagoromo_recovery.outline.object_view import ObjectView

EXTENT = 400  # px of the object, about, in pictures that are looked at
REACH = 10  # px of those pictures, on both sides of the outline of a mask
AT_OUTLINE = 0.6  # px from it that pixels count as on it
SMOOTH = 1.5  # px by which distances are blurred: their slope is the way across the outline
BRIGHT, FAINT = 90, 0.03  # percentile of bright pixels; share of their value that a change must reach to count
STANDS_OUT = 2.0  # of the change at the outline, in that which is usual beside it
LEAST_OFFSET = 1.5  # px of those pictures from which masks are wrong: light that fades to the outline shifts it by 0.8
BEHIND, DARK = (2.0, 6.0), 0.05  # px from the outline that show what is behind; share of bright light that is dark
LEFT = 0.5  # px of those pictures, that an outline found so may be wrong by (standard deviation)


@dataclass(frozen=True)
class MaskOffset:
    """How far outlines stand outside those of the masks [px]; negative: inside. error: standard deviation [px].

    moved: whether masks were moved there.
    """

    pixels: float
    error: float
    moved: bool = False

    @property
    def said(self) -> str:
        """The remark."""
        size, beside = ("small", "outside") if self.pixels > 0.0 else ("large", "inside")
        done = "outlines were moved there" if self.moved else "--refine masks moves them there"
        return (
            f"masks look about {abs(self.pixels):.2g} px too {size}: photographs show the outline of the object so far "
            f"{beside} of them; {done}"
        )


def mask_offset(views: Sequence[ObjectView]) -> MaskOffset | None:
    """How far stated masks are off, on the mean; None where they are right, or photographs do not show it."""
    if not views[0].stated:
        return None
    step = max(1, round(float(np.median([_extent(view.silhouette) for view in views])) / EXTENT))
    changes = [change for view in views if (change := _change(view, step)) is not None]
    if not changes:
        return None
    change = np.mean(changes, axis=0)
    at = int(np.argmax(change))
    usual = float(np.median(change))
    if not 1 <= at < len(change) - 1 or change[at] < STANDS_OUT * usual:
        return None
    near = slice(at - 1, at + 2)
    weight = np.maximum(change[near] - usual, 0.0)
    offset = float((weight * _between()[near]).sum() / weight.sum())
    return MaskOffset(step * offset, step * LEFT) if abs(offset) >= LEAST_OFFSET else None


def with_masks_moved(views: Sequence[ObjectView], offset: MaskOffset) -> list[ObjectView]:
    """The views with outlines where photographs show them."""
    return [_moved(view, offset.pixels) for view in views]


def without_mixed_pixels(views: Sequence[ObjectView]) -> list[ObjectView]:
    """The views without the light of pixels at the outline, where they mix in a background that is not dark."""
    return [_without_mixed(view) if view.stated else view for view in views]


def _moved(view: ObjectView, pixels: float) -> ObjectView:
    """Light that a mask left out counts where it is darker than the brightest that is valid: it may be clipped."""
    share = np.clip(0.5 + pixels - signed_distance(view.silhouette), 0.0, 1.0)
    mask, photograph = share >= 0.5, view.photograph
    if not mask.any():
        return view
    measured = np.isfinite(photograph.values) & np.isfinite(photograph.variance) & (photograph.variance > 0.0)
    unclipped = photograph.values < photograph.values[photograph.mask].max(initial=0.0)
    valid = photograph.mask | (~view.silhouette & (measured & unclipped).all(axis=2))
    return replace(view, photograph=replace(photograph, silhouette=mask, mask=valid & mask), share=share)


def _without_mixed(view: ObjectView) -> ObjectView:
    mask, photograph = view.silhouette, view.photograph
    distance, light = signed_distance(mask), np.nan_to_num(photograph.values.mean(axis=2))
    around = (distance > BEHIND[0]) & (distance < BEHIND[1])
    if not (mask.any() and around.any()):
        return view
    if np.median(light[around]) < DARK * np.percentile(light[mask], BRIGHT):
        return view
    return replace(view, photograph=replace(photograph, mask=photograph.mask & (distance < -1.0)))


def _extent(mask: NDArray[np.bool_]) -> float:
    """Longest edge of what a mask holds [px]."""
    held = [np.flatnonzero(mask.any(axis=axis)) for axis in (0, 1)]
    return float(max(each[-1] - each[0] + 1 for each in held)) if mask.any() else 0.0


def _between() -> NDArray[np.float64]:
    """Middles of the pieces across an outline that changes are of [px]."""
    return np.arange(-REACH, REACH, dtype=np.float64) + 0.5


def _change(view: ObjectView, step: int) -> NDArray[np.float64] | None:
    """(2 REACH,) how much a photograph changes across the outline of its mask, as a mean over the outline.

    Each place of the outline has one vote, in proportion to the squares of what changes along its way: bright parts do
    not count more. None where the mask has no outline in the picture.
    """
    values, mask = np.nan_to_num(means(view.photograph.values, step)), means(view.share, step)[..., 0] >= 0.5
    if not mask.any() or mask.all():
        return None
    distance = signed_distance(mask)
    slope = np.stack(np.gradient(ndimage.gaussian_filter(distance, SMOOTH)))
    rows, columns = np.nonzero(np.abs(distance) < AT_OUTLINE)
    across = slope[:, rows, columns]
    across = across / np.maximum(np.linalg.norm(across, axis=0), 1e-9)
    along = np.arange(-REACH, REACH + 1.0)[:, None] - distance[rows, columns]
    at = np.stack([rows, columns])[:, None] + along * across[:, None]
    squares = np.zeros((2 * REACH, rows.size))
    for channel in np.moveaxis(values, 2, 0):
        squares += np.diff(ndimage.map_coordinates(channel, at, order=1, mode="nearest"), axis=0) ** 2
    bright = float(np.percentile(values[mask], BRIGHT))
    floor = values.shape[2] * 2 * REACH * (FAINT * bright) ** 2
    return np.asarray((squares / np.maximum(squares.sum(axis=0) + floor, 1e-30)).mean(axis=1))
