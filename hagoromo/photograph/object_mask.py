"""Object mask: which pixels show the object, found in photographs under all lamps, or drawn by hand.

The edge of the picture is taken for background. A pixel whose mean and largest light over the lamps differ from the
background's is object; OpenCV's GrabCut (Rother, Kolmogorov and Blake 2004) then draws the outline.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo.files.png import read_png
from hagoromo.least_squares.loss import ROBUST_SCALE

AUTO = "auto"
SIDE = 512  # [px] of the pictures in which the object is looked for
RIM = 0.03  # share of the shorter side at each edge that is taken for background
CUTS = 6  # iterations of GrabCut
SECOND = 0.2  # of the area of the largest part: another of more is perhaps a second object
LEAST, MOST = 0.002, 0.95  # share of the picture that an object has
AT_THE_RIM = 0.5  # share of the rim that an object covers at most
CERTAIN = 85, 170  # grey levels of a correction: below background, above object, between left to the photographs


@dataclass(frozen=True, eq=False)
class ObjectMask:
    """mask: (height, width) true on the object. remarks: what a person should look at."""

    mask: NDArray[np.bool_]
    remarks: tuple[str, ...] = ()

    @staticmethod
    def by_hand(mask: NDArray[np.bool_], path: Path) -> ObjectMask:
        """A mask drawn by hand; `InputError` where it is black everywhere."""
        if not mask.any():
            raise InputError(f"{path} is black everywhere: make it white on the object")
        return ObjectMask(mask, _parts_remark(mask, path.name))


@dataclass(eq=False)
class Thumbnails:
    """Small copies of the photographs, in which an object is found: their sum, largest light and count."""

    total: NDArray[np.float32] | None = None
    largest: NDArray[np.float32] | None = None
    count: int = 0
    shape: tuple[int, int] = field(default=(0, 0))

    def add(self, values: NDArray[np.float32], valid: NDArray[np.bool_]) -> None:
        """Add a photograph (height, width, C); each counts alike, whatever its exposure."""
        import cv2

        height, width = values.shape[:2]
        scale = min(SIDE / max(height, width), 1.0)
        size = max(round(width * scale), 1), max(round(height * scale), 1)
        colour = values if values.shape[2] == 3 else np.repeat(values.mean(axis=2, keepdims=True), 3, axis=2)
        small = np.asarray(cv2.resize(np.nan_to_num(colour), size, interpolation=cv2.INTER_AREA), np.float32)
        white = max(float(np.percentile(small, 99.0)), 1e-30)
        small = np.clip(small / white, 0.0, 1.0)
        if self.total is None or self.largest is None:
            self.total, self.largest, self.shape = np.zeros_like(small), np.zeros_like(small), (height, width)
        self.total += small
        self.largest = np.maximum(self.largest, small)
        self.count += 1


def object_mask(
    seen: Thumbnails,
    shape: tuple[int, int],
    correction: Path | None = None,
    excluded: NDArray[np.bool_] | None = None,
) -> ObjectMask:
    """The object in photographs of `shape` (height, width), in full size.

    correction: a PNG of that size, white where there is object, black where there is none, grey elsewhere.
    excluded: (height, width) true where there is something else. `InputError`
    where no object stands out from the edge of the picture.
    """
    import cv2

    if seen.total is None or seen.largest is None:
        raise InputError("no photograph shows the object: give at least one")
    features = np.concatenate([seen.total / seen.count, seen.largest], axis=2) ** (1.0 / 2.2)
    known = None if correction is None else _correction(correction, shape, features.shape[:2])
    if excluded is not None:
        other = cv2.resize(excluded.astype(np.uint8), features.shape[1::-1], interpolation=cv2.INTER_NEAREST)
        other = np.asarray(cv2.dilate(other, np.ones((5, 5), np.uint8))) > 0  # the ball's edge and its glow
        known = np.where(other, -1, 0 if known is None else known).astype(np.int8)
    small = _cut(features, known)
    size = shape[1], shape[0]
    soft = cv2.resize(small.astype(np.float32), size, interpolation=cv2.INTER_LINEAR)
    mask = np.asarray(soft) > 0.5
    if correction is not None:
        by_hand = _correction(correction, shape, shape)
        mask = (mask | (by_hand > 0)) & ~(by_hand < 0)
    if excluded is not None:
        mask &= ~excluded
    if not LEAST < mask.mean() < MOST or _rim(small).mean() > AT_THE_RIM:
        raise InputError(
            f"the object does not stand out from the edge of the picture (found: {100.0 * mask.mean():.1f} %): give a "
            "mask drawn by hand (--mask)"
        )
    return ObjectMask(mask, _parts_remark(mask, "the mask that was found"))


def _cut(features: NDArray[np.float32], known: NDArray[np.int8] | None) -> NDArray[np.bool_]:
    """GrabCut of the features (h, w, 6): mean and largest colour; known: (h, w) 1 object, −1 background, 0 unknown."""
    import cv2
    from scipy.ndimage import binary_fill_holes
    from skimage.filters import threshold_otsu

    rim = np.ones(features.shape[:2], np.bool_)
    width = max(round(RIM * min(rim.shape)), 1)
    rim[width:-width, width:-width] = False
    background = features[rim]
    middle = np.median(background, axis=0)
    spread = ROBUST_SCALE * np.median(np.abs(background - middle), axis=0) + 0.02
    apart = np.sqrt((((features - middle) / spread) ** 2).mean(axis=2))
    level = max(float(threshold_otsu(np.log1p(apart))), float(np.log1p(2.0)))
    likely = np.log1p(apart) > level
    label = np.where(likely, cv2.GC_PR_FGD, cv2.GC_PR_BGD).astype(np.uint8)
    label[rim & ~likely] = cv2.GC_BGD
    if known is not None:
        label[known > 0], label[known < 0] = cv2.GC_FGD, cv2.GC_BGD
    if not ((label == cv2.GC_PR_FGD) | (label == cv2.GC_FGD)).any():
        return np.zeros(rim.shape, np.bool_)
    # GrabCut takes three channels: mean light, largest light, and colour over the mean
    grey = features[..., :3].mean(axis=2)
    hue = features[..., 0] - features[..., 2]
    picture = np.stack([grey, features[..., 3:].mean(axis=2), 0.5 + 0.5 * hue], axis=2)
    cv2.setRNGSeed(1)
    models = np.zeros((1, 65)), np.zeros((1, 65))
    cv2.grabCut(
        np.rint(255.0 * np.clip(picture, 0.0, 1.0)).astype(np.uint8),
        label,
        (0, 0, 0, 0),
        *models,
        CUTS,
        cv2.GC_INIT_WITH_MASK,
    )
    found = (label == cv2.GC_FGD) | (label == cv2.GC_PR_FGD)
    return np.asarray(binary_fill_holes(_large_parts(found)), np.bool_)


def _large_parts(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """The mask without parts that are small beside the largest, specks of the background."""
    from skimage.measure import label

    parts = np.asarray(label(mask))
    area = np.bincount(parts.ravel())
    area[0] = 0
    return np.asarray((area >= SECOND * max(int(area.max()), 1))[parts] & mask)


def _correction(path: Path, shape: tuple[int, int], size: tuple[int, int]) -> NDArray[np.int8]:
    """(h, w) of `size`: 1 where the correction is white, −1 where it is black, else 0."""
    import cv2

    picture = read_png(path)
    grey = picture[..., :3].mean(axis=2) if picture.ndim == 3 else picture
    if grey.shape != shape:
        raise InputError(f"{path} has shape {grey.shape} and its photograph {shape}: resize the mask")
    level = np.asarray(grey, np.float32) * (255.0 / np.iinfo(picture.dtype).max)
    level = np.asarray(cv2.resize(level, (size[1], size[0]), interpolation=cv2.INTER_NEAREST))
    return (level > CERTAIN[1]).astype(np.int8) - (level < CERTAIN[0]).astype(np.int8)


def _rim(mask: NDArray[np.bool_]) -> NDArray[np.bool_]:
    return np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])


def _parts_remark(mask: NDArray[np.bool_], name: str) -> tuple[str, ...]:
    from skimage.measure import label

    area = np.sort(np.bincount(np.asarray(label(mask)).ravel())[1:])[::-1]
    if len(area) < 2 or area[1] < SECOND * area[0]:
        return ()
    parts = int((area >= SECOND * area[0]).sum())
    return (
        f"{name} has {parts} parts of similar size: if these are several objects, make a capture of each with its mask",
    )
