"""Features: where both campaigns show the same detail of paint or relief, and the similarity that most of it agrees on.

Enters: two campaigns. Leaves: starts of the registration, the likeliest first.

Lowe 2004, "Distinctive image features from scale-invariant keypoints"; Fischler and Bolles 1981, "Random sample
consensus".
"""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter

from hagoromo_campaigns.campaign import Campaign
from hagoromo_campaigns.sampled import sampled
from hagoromo_campaigns.similarity import Similarity, nearest_similarities

Array = NDArray[np.float64]
ALONG_X: Any = (0, 1)  # orders of the derivatives of a smoothed map
ALONG_Y: Any = (1, 0)
SIDE_PX = 640  # about, of the longer side of the pictures in which detail is looked for
LOWE = 0.85  # largest distance of the nearest description over that of the second nearest
DRAWS = 3000  # of three matches
NEAR_PX = 2.5  # of the pixels of AFTER, within which a match agrees
FEWEST = 6  # matches that must agree
SCALES = (0.5, 2.0)  # of the ratio of the stated sizes of one object


def starts(before: Campaign, after: Campaign, seed: int) -> list[Similarity]:
    """Similarities from BEFORE's world to AFTER's to start from.

    By features; as the two cameras have it, as for a camera that never moved; and as the worlds have it.
    """
    found = _by_features(before, after, seed)
    camera = after.camera.camera_to_world @ before.camera.world_to_camera
    ratio = _depth(after) / _depth(before)
    centre = before.camera.position
    as_cameras = Similarity(
        ratio, camera[:3, :3], camera[:3, :3] @ centre + camera[:3, 3] - ratio * (camera[:3, :3] @ centre)
    )
    plain = [as_cameras, Similarity(1.0, np.eye(3), np.zeros(3))]
    return plain if found is None else [found, *plain]


def _depth(one: Campaign) -> float:
    return one.pitch * float(np.mean(one.camera.focal))


def _by_features(before: Campaign, after: Campaign, seed: int) -> Similarity | None:
    """The similarity that most matches of features agree on; None where fewer than FEWEST do."""
    pairs = [_matches(a, b) for a, b in zip(_pictures(before), _pictures(after), strict=True)]
    own, other = (np.concatenate([pair[side] for pair in pairs]) for side in range(2))
    places, there = (sampled(one.points, at) for one, at in ((before, own), (after, other)))
    good = np.isfinite(places).all(axis=1) & np.isfinite(there).all(axis=1)
    places, there, other = places[good], there[good], other[good]
    if len(places) < FEWEST:
        return None
    random = np.random.default_rng(seed)
    drawn = np.argsort(random.random((DRAWS, len(places))), axis=1)[:, :3]
    tried = nearest_similarities(places[drawn], there[drawn])
    agree = np.stack(
        [_agreeing(Similarity(float(s), r, t), places, other, after) for s, r, t in zip(*tried, strict=True)]
    )
    best = agree[np.argmax(agree.sum(axis=1))]
    found = None
    for _ in range(3):
        if best.sum() < FEWEST:
            return None
        scale, rotation, shift = nearest_similarities(places[best][None], there[best][None])
        found = Similarity(float(scale[0]), rotation[0], shift[0])
        best = _agreeing(found, places, other, after)
    return found


def _agreeing(tried: Similarity, places: Array, image: Array, after: Campaign) -> NDArray[np.bool_]:
    """Which places fall within NEAR_PX of their matches."""
    if not SCALES[0] < tried.scale < SCALES[1]:
        return np.zeros(len(places), bool)
    with np.errstate(invalid="ignore"):
        return np.linalg.norm(after.camera.project(tried.points(places)) - image, axis=1) < NEAR_PX


def _pictures(one: Campaign) -> list[tuple[NDArray[np.uint8], NDArray[np.uint8], float]]:
    """Pictures of paint and of curvature, which look the same from everywhere, their mask, and how much larger."""
    import cv2

    factor = SIDE_PX / max(one.known.shape)
    size = (round(one.known.shape[1] * factor), round(one.known.shape[0] * factor))
    local = one.normals @ one.camera.world_to_camera[:3, :3].T
    slope = [np.where(one.known, local[..., i] / np.minimum(local[..., 2], -0.1), 0.0) for i in range(2)]
    curvature = gaussian_filter(slope[0], 1.0, order=ALONG_X) + gaussian_filter(slope[1], 1.0, order=ALONG_Y)
    found = []
    for layer in (np.log(np.where(one.known[..., None], one.body, 1.0)).mean(axis=2), curvature):
        low, high = np.percentile(layer[one.known], (1, 99))
        grey = np.where(one.known, 255.0 * np.clip((layer - low) / max(high - low, 1e-12), 0.0, 1.0), 128.0)
        found.append(cv2.resize(grey.astype(np.float32), size, interpolation=cv2.INTER_CUBIC))
    mask = cv2.resize(one.known.astype(np.uint8), size, interpolation=cv2.INTER_NEAREST)
    return [(np.clip(picture, 0, 255).astype(np.uint8), np.asarray(mask, np.uint8), factor) for picture in found]


def _matches(
    a: tuple[NDArray[np.uint8], NDArray[np.uint8], float], b: tuple[NDArray[np.uint8], NDArray[np.uint8], float]
) -> tuple[Array, Array]:
    """Image points (m, 2) [px] of features in one picture, and of those in the other that look the same."""
    import cv2

    detector = cv2.SIFT_create(contrastThreshold=0.02)  # pyrefly: ignore[missing-attribute]
    points, descriptions = [], []
    for picture, mask, factor in (a, b):
        keys, described = detector.detectAndCompute(picture, mask)
        points.append(np.array([key.pt for key in keys], np.float64).reshape(-1, 2) / factor)
        descriptions.append(described)
    if min(len(one) for one in points) < 2:
        return np.zeros((0, 2)), np.zeros((0, 2))
    pairs = [
        (first.queryIdx, first.trainIdx)
        for first, second in cv2.BFMatcher().knnMatch(*descriptions, k=2)
        if first.distance < LOWE * second.distance
    ]
    index = np.array(pairs, int).reshape(-1, 2)
    return points[0][index[:, 0]], points[1][index[:, 1]]
