"""Replay: the march of a frame without shadows, taken apart into its gathers and its arithmetic.

A first march writes down every step of every ray: where it reads, and what the brick table and the densities answer.
`gathers` reads at the same places in the same order and does nothing else. `arithmetic` is the march itself with every
gather replaced by an operation on its address, and by the recorded answer where that steers the march.
"""

from __future__ import annotations

from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any
from unittest.mock import patch

import drjit as dr

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.transport import lighting as lighting_module
from hagoromo.transport import medium as medium_module
from hagoromo.transport.crossing import Crossing, MarchState
from hagoromo.transport.lighting import Lighting, Materials
from hagoromo.transport.march import END_TRANSMITTANCE, march
from hagoromo.transport.medium import NEGLIGIBLE_OPTICAL_DEPTH, Medium
from hagoromo.volume import voxels as voxels_module
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.table import BLOCK, BRICKS
from hagoromo.volume.voxels import BRICK, CORNERS, HALF_EXPONENT, PAIRS, STORED, VOXELS

ROWS = (0, BRICK, STORED * BRICK, (STORED + 1) * BRICK)  # of the pairs that a density is read from
BLOCKS = 1 << 12  # of bricks: as many as a recorded word can tell apart
TILE = 16  # rays whose words of a step share a cache line


@dataclass
class Counted(MarchState):
    """A `MarchState` that counts steps."""

    count: Any = None


class CountedCrossing(Crossing):
    """A crossing whose rays count their steps."""

    def start(self) -> Counted:
        """Before the first sample."""
        state = super().start()
        return Counted(**vars(state), count=dr.zeros(arrays().UInt, dr.width(state.part)))

    def _moved(self, step: Any, number: Any, state: Any, part: Any, parts: Any) -> Counted:
        return Counted(**vars(super()._moved(step, number, state, part, parts)), count=state.count + 1)


class Replayed(Medium):
    """A medium of one box whose rays are recorded when it is made: a tile of rays step by step, side by side.

    address: block (12 bits), brick in it (9), voxel in that (9), whether the brick is kept (1), and shaded (1).
    answer: of the brick table (16 bits), and the density as half (16).
    """

    def __init__(self, box: VolumeBox, origin: Any, direction: Any) -> None:
        super().__init__([box])
        self.packed: Any = self.voxels
        jit, self.width = arrays(), dr.width(direction)
        if self.coarse.shape[0] > BLOCKS:
            raise InputError(f"the box has {self.coarse.shape[0]} blocks of bricks: at most {BLOCKS} can be replayed")
        self.lane = dr.arange(jit.UInt, self.width)
        self.counts = walked(self, origin, direction)
        self.most = dr.max(self.counts)
        tiles = -(-self.width // TILE)
        self.address, self.answer = (dr.zeros(jit.UInt, tiles * TILE * int(self.most[0])) for _ in range(2))
        dr.eval(self.lane, self.counts, self.most, self.address, self.answer)
        dr.eval(walked(self, origin, direction, True), self.address, self.answer)

    def cross(self, origin: Any, direction: Any, near: Any, far: Any, phase: Any = 0.0, stride: float = 1.0) -> Any:
        """As `Medium.cross`; rays count their steps."""
        return CountedCrossing(self.frames, (origin, direction, near, far), phase, stride, (0.0, 0.0))

    def write(self, step: Any, count: Any, density: Any, shaded: Any) -> None:
        """Record a step."""
        jit = arrays()
        cell = jit.Array3u(step.place)
        brick, inner = cell >> 3, cell & (BRICK - 1)
        block, place = jit.Array3i(brick >> 3), brick & (BLOCK - 1)
        frame = self.frames.frame(step.box)
        address = jit.UInt(frame.first + block.z * frame.layer + block.y * frame.row + block.x)
        for part in (place, inner):
            address = ((address * BLOCK + part.z) * BLOCK + part.y) * BLOCK + part.x
        flags = dr.select(step.brick >= 0, jit.UInt(2), 0) | dr.select(shaded, jit.UInt(1), 0)
        at = self.at(count)
        dr.scatter(self.address, address << 2 | flags, at)
        half = (dr.reinterpret_array(jit.UInt, density / HALF_EXPONENT) >> 13) + 1  # no ray ends later than recorded
        dr.scatter(self.answer, half << 16 | jit.UInt(dr.minimum(step.brick, 0)) & 0xFFFF, at)

    def recorded(self, words: Any, count: Any) -> Any:
        """What was recorded of step number `count` of every ray."""
        return dr.gather(arrays().UInt, words, self.at(count))

    def at(self, count: Any) -> Any:
        """Where the word of step number `count` of every ray is."""
        return (self.lane // TILE * self.most + count) * TILE + self.lane % TILE


@dr.syntax
def walked(medium: Replayed, origin: Any, direction: Any, write: bool = False) -> Any:
    """Number of steps of every ray, each written down if asked."""
    jit = arrays()
    crossing = medium.cross(origin, direction, jit.Float(0), jit.Float(dr.inf))
    state = crossing.start()
    passed, cut = dr.ones(jit.Float, dr.width(direction)), END_TRANSMITTANCE * medium.tolerance
    while crossing.unfinished(state) & (passed > cut):
        step, count = medium.next(crossing, state), state.count
        density, shaded = jit.Float(0), jit.Bool(False)
        if step.brick < 0:
            state = crossing.skip_empty(step, state)
        else:
            density, clearance = medium.density(step)
            depth = step.tau * density * step.length
            shaded = (depth > NEGLIGIBLE_OPTICAL_DEPTH) & ~crossing.must_split(state, depth)
            passed *= dr.select(shaded, dr.exp(-depth), 1.0)
            state = crossing.advance(step, depth, clearance, state)
        if dr.hint(write, mode="scalar"):
            medium.write(step, count, density, shaded)
    return state.count


@dr.syntax
def gathers(medium: Replayed, materials: Materials) -> tuple[Any, Any]:
    """Every gather of the march alone: something made of all that was read, and the number of gathers, per ray."""
    jit = arrays()
    count, total, number = (dr.zeros(jit.UInt, medium.width) for _ in range(3))
    while count < medium.counts:
        word = medium.recorded(medium.address, count)
        voxel, place, block = word >> 2 & (BRICK**3 - 1), word >> 11 & (BRICKS - 1), word >> 20
        outer = dr.gather(jit.Int, medium.coarse, block)
        brick = dr.gather(jit.Int, medium.fine, jit.UInt(outer * BRICKS) + place, outer >= 0)
        total ^= jit.UInt(outer ^ brick)
        number += 3
        if word & 2 == 2:
            z, y, x = voxel >> 6, voxel >> 3 & 7, voxel & 7
            first = jit.UInt(brick) * PAIRS + (z * STORED + y) * BRICK + x
            total ^= read(jit.UInt, medium.packed.densities, first, ROWS)
            number += len(ROWS)
            if word & 1 == 1:
                first = jit.UInt(brick) * VOXELS + (z * STORED + y) * STORED + x
                total ^= read(jit.Int, medium.packed.axes, first, CORNERS)
                material = dr.gather(jit.UInt, medium.first_material, word & 0)
                total ^= read(jit.Float, materials.rows, material * materials.width, range(materials.width))
                number += len(CORNERS) + 1 + materials.width
        count += 1
    return total, number


@dr.syntax
def words(medium: Replayed) -> Any:
    """The recorded words alone: what reading them adds to `gathers` and `arithmetic`."""
    count, total = (dr.zeros(arrays().UInt, medium.width) for _ in range(2))
    while count < medium.counts:
        total ^= medium.recorded(medium.answer, count)
        count += 1
    return total


def read(kind: Any, source: Any, first: Any, offsets: Any) -> Any:
    """Gathers at `first` + each offset, joined by their bits."""
    UInt = arrays().UInt
    joined = UInt(0)
    for offset in offsets:
        joined = joined ^ dr.reinterpret_array(UInt, dr.gather(kind, source, first + offset))
    return joined


def arithmetic(medium: Replayed, lighting: Lighting, origin: Any, direction: Any) -> Any:
    """The march without its gathers, but for one of the recorded answer a step: a picture of other colours."""
    stand_in = WithoutGathers(medium)
    jit = arrays()
    with ExitStack() as modules:
        for module in (medium_module, voxels_module, lighting_module):
            modules.enter_context(patch.object(module, "dr", stand_in))
        channels, _ = march(stand_in.medium, lighting, origin, direction, jit.Float(0), jit.Float(dr.inf))
    return sum(channels)


class WithoutGathers:
    """Dr.Jit for the modules of the march, but that `gather` reads nothing."""

    def __init__(self, medium: Replayed) -> None:
        self.medium, self.nothing = Answering(medium), dr.opaque(arrays().UInt, 0)

    def __getattr__(self, name: str) -> Any:
        return getattr(dr, name)

    def gather(self, kind: Any, source: Any, index: Any, active: Any = True) -> Any:
        """What the march goes on with; the address is worked out in any case."""
        jit, answer = arrays(), self.medium.word
        if source is self.medium.coarse or source is self.medium.fine:
            return jit.Int(answer << 16 | (index & self.nothing)) >> 16
        if source is self.medium.packed.densities:
            return (answer >> 16) * 0x10001 ^ (index & self.nothing)
        return kind(index) + 1


class Answering(Replayed):
    """A replayed medium whose next sample comes with the recorded answer."""

    def __init__(self, medium: Replayed) -> None:
        vars(self).update(vars(medium))

    def next(self, crossing: Crossing, state: Any) -> Any:
        """As `Medium.next`."""
        self.word = self.recorded(self.answer, state.count)
        return super().next(crossing, state)
