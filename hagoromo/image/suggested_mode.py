"""Suggested mode: whether a picture of mode march lacks much light of higher orders, by a few walks through its pixels.

Enters: a scene, and its picture by march. Leaves: the share that light of higher orders would have, and a line where it
is more than MUCH. The picture stays as it is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from hagoromo.errors import InputError
from hagoromo.image.full.walks import walks_here
from hagoromo.image.path.picture import batches_and_bands
from hagoromo.image.path.walk_sums import luminance
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import palette_of_scene
from hagoromo.image.scene.settings import Settings

MUCH = 0.1  # share of all light
FIRST_WALKS, MOST_WALKS = 1 << 8, 1 << 12  # of the test
MOST_ORDERS = 64  # of its walks: what is scattered more often is left out
FEWEST_PIXELS = 1 << 14  # of a picture that is worth the test: smaller ones are quick looks
SURE = 2.0  # standard errors of what is stated
TEST_SEED = 0x0DE5


@dataclass(frozen=True)
class HigherShare:
    """Share of Y of all light that is of higher orders, where the picture shows matter, and its standard error."""

    share: float
    error: float

    @property
    def is_much(self) -> bool:
        """Whether it is surely more than MUCH."""
        return self.share - SURE * self.error > MUCH

    @property
    def is_little(self) -> bool:
        """Whether it is surely less."""
        return self.share + SURE * self.error < MUCH

    def line(self) -> str:
        """One line for people."""
        return (
            f"about {100.0 * self.share:.0f} % of the light here is scattered more than once, which mode march leaves "
            "out: render with --mode full, or path (--walks 0 leaves out this test)"
        )


def higher_share(scene: Scene, image: Image, settings: Settings) -> HigherShare | None:
    """The share that light of higher orders would have in the picture `image` of a scene by mode march.

    None where it is not asked for (`settings.walks` is 0, a cut), not worth the walks, or not known: of a box of which
    only some bricks are here, and of matter that modes path and full refuse.
    """
    camera = scene.camera
    whole = all(box.bricks.whole is None for box in scene.boxes)
    if settings.walks == 0 or settings.cut is not None or not whole or camera.width * camera.height < FEWEST_PIXELS:
        return None
    shown = np.flatnonzero(image.alpha.ravel() > 0.0)
    first = image.weights.reshape(-1, image.weights.shape[-1])[shown].astype(np.float64)
    first = float((first @ luminance(image.palette, image.palette.lamps[0])).sum())
    if not first > 0.0:
        return None
    try:
        _, bands = batches_and_bands(scene)
        settings = replace(settings, orders=MOST_ORDERS, samples=1)
        walk = walks_here(scene, settings, SceneCache(), bands)
    except InputError:
        return None
    palette = replace(palette_of_scene(scene, settings), bands=bands.spectra)
    y = luminance(palette, palette.lamps[0]).reshape(len(palette.lamps), -1)[:, -len(bands.spectra) :].ravel()
    brought, random = np.zeros(0), np.random.default_rng(TEST_SEED)
    while len(brought) < MOST_WALKS:
        count = max(len(brought), FIRST_WALKS)
        part = (np.arange(count) + random.random(count)) / count  # one in each stratum of pixels
        pixels = shown[(part * len(shown)).astype(np.int64)]
        more = walk(pixels, len(brought) + np.arange(count)).astype(np.float64) @ y
        brought = np.concatenate([brought, more])
        found = _share(brought, first / len(shown))
        if found.is_much or found.is_little:
            break
    return found


def _share(brought: np.ndarray, first: float) -> HigherShare:
    """Of what walks brought, beside the mean of the first order of pixels."""
    higher = float(brought.mean())
    error = float(brought.std(ddof=1)) / math.sqrt(len(brought))
    every = first + higher
    return HigherShare(higher / every, error * first / every**2)
