"""Lamp batches: a scene of many lamps is rendered under a part of them at a time, as light adds.

Every lamp is a part of the kernels, whose time of compilation grows faster than their number, and has a shadow map of
up to 96 MiB. Enters: the lamps of a scene, and pictures under parts of them. Leaves: their weights together.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from hagoromo.files.memory import require
from hagoromo.image.picture.image import Image
from hagoromo.image.scene.scene import Scene
from hagoromo.light.lamp import Lamp, by_place
from hagoromo.progress import Progress, part_of, silent
from hagoromo.transport.palette import Palette

LAMPS_AT_ONCE = 32  # lamps of a batch; a constant, not what fits the memory: steps of the march depend on it a little

Batch = list[int]  # numbers of lamps in their scene


def lamp_batches(lamps: Sequence[Lamp]) -> list[Batch]:
    """The lamps in batches of one size, the last one smaller: all of them in one, or LAMPS_AT_ONCE in each at most.

    Those of one kind stand together: batches whose lamps are of the same kinds have the same kernels. Lamps at one
    place count as one.
    """
    places = by_place(lamps)
    count = -(-len(places) // LAMPS_AT_ONCE)
    if count <= 1:
        return [list(range(len(lamps)))]
    size = -(-len(places) // count)
    order = sorted(places, key=lambda numbers: _kind(lamps[numbers[0]]))
    batches = [order[first : first + size] for first in range(0, len(places), size)]
    return [[number for numbers in batch for number in numbers] for batch in batches]


def _kind(lamp: Lamp) -> tuple[bool, str, bytes]:
    """Equal for lamps that are the same code in a kernel."""
    return not lamp.near, lamp.beam.word, lamp.spectrum.values.tobytes()


class WeightsOfLamps:
    """The weights of a picture under all lamps, `palette`, as the sum of those under batches of them."""

    def __init__(self, palette: Palette, size: tuple[int, ...]) -> None:
        """`size`: height and width of the picture [px]."""
        what = f"a picture of {size[1]} × {size[0]} pixels with {palette.channels} weights each"
        require(4.0 * size[0] * size[1] * palette.channels, what)
        self.palette, self.values = palette, np.zeros((*size, palette.channels), np.float32)

    def add(self, batch: Batch, part: Palette, weights: NDArray[np.float32]) -> None:
        """Add the `weights` of a picture under the lamps of `batch`, whose palette is `part`."""
        colours = len(part.colours)
        groups = {own: self.palette.lamp_groups[lamp] for own, lamp in zip(part.lamp_groups, batch, strict=True)}
        for own, group in groups.items():
            self.values[..., group * colours : (group + 1) * colours] += weights[..., own * colours :][..., :colours]


def under_batches(
    scene: Scene,
    batches: Sequence[Batch],
    separate: bool,
    image_of: Callable[[int, Scene, Progress], Image],
    progress: Progress = silent,
) -> Image:
    """The picture of a scene as the sum of those under batches of its lamps; the coverage is that of the last.

    separate: see `Settings.separate_lamps`. image_of: the picture of the scene under the lamps of a batch of a number.
    """
    total: WeightsOfLamps | None = None
    variance: NDArray[np.float32] | None = None
    image: Image | None = None
    for number, batch in enumerate(batches):
        lit = scene.under(batch)
        image = image_of(number, lit, part_of(progress, number / len(batches), 1.0 / len(batches)))
        if len(batches) == 1:
            return image
        if total is None:
            total = WeightsOfLamps(image.palette.with_lamps(scene.lights, separate), image.alpha.shape)
            variance = None if image.variance is None else np.zeros_like(image.variance)
        total.add(batch, image.palette, image.weights)
        variance = None if variance is None or image.variance is None else variance + image.variance
    assert total is not None and image is not None
    return Image(total.values, image.alpha, total.palette, image.metadata | {"scene": scene.record()}, variance)
