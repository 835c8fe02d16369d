"""Full walks: what a picture of mode full is off, by random walks through pixels of some of its blocks.

Only light of higher orders is compared: that of the first order is the same integral in both modes. Enters: a picture
of mode full, and its scene. Leaves: sums over walks of what they brought less what the picture has at their pixel, by
block and fold. Folds are walks apart from each other, so that one judges what was fitted to others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from hagoromo.image.path.picture import WalkStream, batches_and_bands, walks_at_once
from hagoromo.image.path.walk_sums import luminance
from hagoromo.image.picture.full_error import BLOCK
from hagoromo.image.picture.image import Image
from hagoromo.image.prepared.lamp_batches import Batch, WeightsOfLamps
from hagoromo.image.prepared.prepared_scene import SceneCache
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_palette import palette_of_scene
from hagoromo.image.scene.settings import Settings
from hagoromo.transport.palette import Palette
from hagoromo.transport.path.bands import Bands

FOLDS = 8
ROUNDS_AT_ONCE = 1 << 13  # walks through all pixels of a block, whose numbers are held at a time
FEWEST_BLOCKS, MOST_BLOCKS = 1 << 6, 1 << 12  # that are walked, of a picture: spread over it in strata
FIRST_WALK = 1 << 24  # number of the first walk of a pixel: those of mode path stay below
EVEN = 0.5  # share of the walks that all blocks get alike; the others are where there is light of higher orders
Array = NDArray[np.float64]
Numbers = NDArray[np.int64]

# Channels (walks, channels) of walks through pixels, of a number in each: those of the whole picture.
WalkThrough = Callable[[Numbers, Numbers], NDArray[np.float32]]


@dataclass(frozen=True, eq=False)
class PictureBlocks:
    """The blocks of a picture, BLOCK × BLOCK pixels each, smaller at its ends, row after row.

    higher: (height, width, channels) of higher orders. y: (channels,) Y of one unit of each. first: (height, width) Y
    of the first order. matter: (blocks,) which show any.
    """

    higher: Array
    y: Array
    first: Array
    matter: NDArray[np.bool_]

    @classmethod
    def of(cls, image: Image) -> PictureBlocks:
        """Those of a picture of mode full, without the lights that the camera sees."""
        palette = image.palette
        y = luminance(palette, palette.lamps[0])
        is_band = np.zeros((len(palette.lamps), len(palette.colours)), bool)
        is_band[:, len(palette.colours) - len(palette.bands) :] = True
        weights = image.weights.astype(np.float64)
        first = np.einsum("hwc,c->hw", weights, np.where(is_band.ravel(), 0.0, y))
        higher = np.ascontiguousarray(weights[..., is_band.ravel()])
        there = (image.alpha > 0.0) | (higher > 0.0).any(axis=2)
        matter = in_blocks(there.astype(float)[..., None])[:, 0] > 0.0
        return cls(higher, y[is_band.ravel()], first, matter)

    @property
    def grid(self) -> tuple[int, int]:
        """Rows and columns of blocks."""
        height, width = self.first.shape
        return -(-height // BLOCK), -(-width // BLOCK)

    @cached_property
    def sizes(self) -> Array:
        """Pixels of each block."""
        return in_blocks(np.ones((*self.first.shape, 1)))[:, 0]

    @cached_property
    def means(self) -> Array:
        """Means of the channels: (blocks, channels)."""
        return in_blocks(self.higher) / self.sizes[:, None]

    @cached_property
    def all_y(self) -> Array:
        """Mean Y of all light: (blocks,)."""
        return in_blocks(self.first[..., None])[:, 0] / self.sizes + np.einsum("bc,c->b", self.means, self.y)


def in_blocks(values: Array) -> Array:
    """Sums (blocks, channels) over blocks of (height, width, channels), in a fixed order."""
    values = np.add.reduceat(values, np.arange(0, values.shape[0], BLOCK), axis=0)
    values = np.add.reduceat(values, np.arange(0, values.shape[1], BLOCK), axis=1)
    return values.reshape(-1, values.shape[2])


def chosen_blocks(blocks: PictureBlocks, seed: int, most: int) -> tuple[Numbers, int]:
    """The blocks that are walked, in order, and the side of the strata of blocks of which each has one: 1 where all
    that show matter are.
    """
    places, side = np.flatnonzero(blocks.matter), 1
    while len(np.unique(strata(blocks, places, side))) > most:
        side += 1
    order = np.random.default_rng([seed, 0x8B10C]).permutation(places)
    _, first = np.unique(strata(blocks, order, side), return_index=True)
    return np.sort(order[first]), side


def strata(blocks: PictureBlocks, places: Numbers, side: int) -> Numbers:
    """The number of the stratum of each of some blocks."""
    row, column = np.divmod(places, blocks.grid[1])
    return row // side * blocks.grid[1] + column // side


class BlockSums:
    """Sums over walks of what they bring less what the picture has, by block and fold, of the blocks that are walked.

    total: (blocks, FOLDS, channels). square: (blocks, channels), and of Y as a last channel. walks: (blocks, FOLDS).
    """

    def __init__(self, blocks: PictureBlocks, seed: int, most: int = MOST_BLOCKS) -> None:
        """most: blocks that are walked at most."""
        self.blocks = blocks
        self.chosen, self.side = chosen_blocks(blocks, seed, most)
        count, channels = len(self.chosen), len(blocks.y)
        self.total = np.zeros((count, FOLDS, channels))
        self.square = np.zeros((count, channels + 1))
        self.walks = np.zeros((count, FOLDS), np.int64)
        self.rounds = np.zeros(count, np.int64)  # walks through each pixel
        light = np.einsum("bc,c->b", blocks.means[self.chosen], blocks.y)
        mean = float(light.mean()) if count else 0.0
        self.shares = EVEN + (1.0 - EVEN) * light / mean if mean > 0.0 else np.ones(count)

    @cached_property
    def stand_for(self) -> Array:
        """Pixels of blocks with matter that each walked block stands for: (walked,)."""
        if self.side == 1:
            return self.blocks.sizes[self.chosen]
        stratum = strata(self.blocks, np.arange(self.blocks.matter.size), self.side)
        pixels: Array = np.bincount(stratum, np.where(self.blocks.matter, self.blocks.sizes, 0.0)).astype(float)
        return pixels[stratum[self.chosen]]

    @property
    def count(self) -> int:
        """Walks so far."""
        return int(self.walks.sum())

    @property
    def least(self) -> int:
        """Fewest further walks of which `walk_on` makes any: one through each pixel of the walked blocks."""
        return int(self.blocks.sizes[self.chosen].sum())

    def walk_on(self, walks: int, through: WalkThrough) -> None:
        """Further walks, about so many: some more through each pixel of every block."""
        sizes = self.blocks.sizes[self.chosen]
        each = (self.count + walks) / max(float((sizes * self.shares).sum()), 1.0)
        wanted = np.maximum(np.rint(self.shares * each), 1.0)
        more = np.maximum(wanted.astype(np.int64) - self.rounds, 0)
        some = np.repeat(np.arange(len(more)), more)
        number = np.arange(len(some)) - np.repeat(np.cumsum(more) - more, more) + self.rounds[some]
        for first in range(0, len(some), ROUNDS_AT_ONCE):
            part = slice(first, first + ROUNDS_AT_ONCE)
            self._walk(some[part], number[part], through)
        self.rounds += more

    def _walk(self, some: Numbers, number: Numbers, through: WalkThrough) -> None:
        """A walk of a number through each pixel of some of the blocks."""
        height, width = self.blocks.first.shape
        down, across = np.divmod(np.arange(BLOCK * BLOCK), BLOCK)
        row, column = np.divmod(self.chosen[some], self.blocks.grid[1])
        row, column = row[:, None] * BLOCK + down, column[:, None] * BLOCK + across
        inside = (row < height) & (column < width)
        owner = np.broadcast_to(some[:, None], row.shape)[inside]
        # two pixels across and four down are of all folds, each pixel of another one in the next round
        fold = ((down % 4 * 2 + across % 2 + 3 * number[:, None]) % FOLDS)[inside]
        number = np.broadcast_to(number[:, None], row.shape)[inside]
        row, column = row[inside], column[inside]
        light = through(row * width + column, number).astype(np.float64)
        off = light - self.blocks.higher[row, column]
        np.add.at(self.total, (owner, fold), off)
        np.add.at(self.walks, (owner, fold), 1)
        squares = np.concatenate([off, np.einsum("nc,c->n", off, self.blocks.y)[:, None]], axis=1) ** 2
        np.add.at(self.square, owner, squares)


def lamps_in_batches(scene: Scene) -> list[Batch]:
    """The lights of a scene in batches, as numbers of `Scene.lights`, as mode path walks under them."""
    return batches_and_bands(scene)[0]


def walks_here(scene: Scene, settings: Settings, cache: SceneCache, bands: Bands) -> WalkThrough:
    """Walks in this process through the pixels of a picture of a scene; bands: of the picture."""
    batches = enumerate(lamps_in_batches(scene))
    parts = [LampWalks(scene.under(batch), settings, cache, bands, number) for number, batch in batches]

    def through(pixels: Numbers, numbers: Numbers) -> NDArray[np.float32]:
        return in_channels(scene, settings, [(part.palette, part.light(pixels, numbers)) for part in parts])

    return through


class LampWalks:
    """Walks under one batch of the lamps of a scene."""

    def __init__(self, lit: Scene, settings: Settings, cache: SceneCache, bands: Bands, number: int) -> None:
        self.stream = WalkStream(lit, settings, cache, bands, number)
        if self.stream.walks.lights is not None:
            self.stream.walks.lights.seen = False  # they are no part of what was solved
        self.at_once = walks_at_once(self.stream, lit.camera.width * lit.camera.height)
        self.palette = replace(palette_of_scene(lit, settings), bands=bands.spectra)

    def light(self, pixels: Numbers, numbers: Numbers) -> NDArray[np.float32]:
        """What walks through pixels bring, of a number in each: (walks, channels)."""
        parts = [np.zeros((0, self.palette.channels), np.float32)]
        for first in range(0, len(pixels), self.at_once):
            some = pixels[first : first + self.at_once]
            sample = FIRST_WALK + numbers[first : first + self.at_once].astype(float)
            queue = self.stream.walk(some, sample, np.ones_like(some))
            parts.append(np.array(queue.light).reshape(len(some), -1))
        return np.concatenate(parts)


def in_channels(
    scene: Scene, settings: Settings, parts: Sequence[tuple[Palette, NDArray[np.float32]]]
) -> NDArray[np.float32]:
    """Higher orders (walks, channels) of a picture from what walks bring under each batch of its lamps."""
    bands = parts[0][0].bands
    total = WeightsOfLamps(replace(palette_of_scene(scene, settings), bands=bands), (1, len(parts[0][1])))
    for batch, (palette, light) in zip(lamps_in_batches(scene), parts, strict=True):
        total.add(batch, palette, light[None])
    count, groups = len(total.values[0]), len(total.palette.lamps)
    return total.values.reshape(count, groups, -1)[..., -len(bands) :].reshape(count, -1)
