"""Pixel tasks: the gradient and the slopes of a step's pixels, here or by workers, with the same bits.

Pixels are drawn in the order of their photographs, and each worker takes a part of them: a group of views. What a pixel
adds to a gradient does not depend on its neighbours, and it is added in whole numbers: the sum has the same bits
whatever the parts are, and whoever computes them. A worker holds the field as it was when the nodes that move were
chosen; with each task it gets what these nodes have by now, and gives the gradients by them.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from itertools import pairwise
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.cluster.cluster import Cluster
from hagoromo_recovery.descent.gloss_step import Slopes, slopes_of
from hagoromo_recovery.descent.light_between import LightBetween, PlainBetween
from hagoromo_recovery.descent.pixel_gradient import add_gradient
from hagoromo_recovery.descent.pixel_table import CHUNK, Drawn
from hagoromo_recovery.descent.rendering import Rendering, SeenLight
from hagoromo_recovery.descent.strengths import Strengths
from hagoromo_recovery.field.matter_field import COLOURS, MatterField
from hagoromo_recovery.field.matter_march import LatticeRays, Seen
from hagoromo_recovery.shading.lamp_table import LampTable
from hagoromo_recovery.shading.shading import NodeShading
from hagoromo_recovery.shading.unknown_light import UnknownLight

LEAST_PART = 1 << 10  # pixels of a task, at least
Floats = NDArray[np.float32]


class PixelsHere:
    """What a descent asks of some pixels of its rendering, in this process."""

    def __init__(self, rendering: Rendering, limit: float) -> None:
        self.rendering, self.limit = rendering, limit

    def choose(self, nodes: NDArray[np.uint32]) -> None:
        """Other nodes move, or those that do not have changed."""

    def gradient(self, drawn: Drawn, with_light: bool) -> SeenLight | None:
        """The field's gradients are those of the mean squared error of some pixels; gives their light, if wanted."""
        self.rendering.field.no_gradients()
        return add_gradient(self.rendering, drawn, dr.width(drawn.photograph), self.limit)

    def slopes(self, drawn: Drawn) -> Slopes:
        """Slopes of the light of some pixels by the gloss and by body colours."""
        return slopes_of(self.rendering, drawn)


class HeldMatter(NamedTuple):
    """A field as plain arrays, by a key of their content. nodes: (n,) that move. between: light between its parts."""

    key: str
    law: type[MatterField]
    arrays: tuple[Floats, ...]
    nodes: NDArray[np.uint32]
    between: PlainBetween | None


class StepState(NamedTuple):
    """What changes from step to step. numbers: of the nodes that move, see `MatterField.at`."""

    numbers: list[Floats]
    gloss: NDArray[np.floating]
    softness: float
    lamps: LampTable
    unknown: UnknownLight | None
    strengths: Strengths | None
    shadows: bool


class PlainPixels(NamedTuple):
    """Some pixels: numbers of photographs (n,), and all else of `Drawn` as columns (18, n)."""

    photograph: NDArray[np.uint32]
    columns: Floats

    @classmethod
    def of(cls, drawn: Drawn) -> PlainPixels:
        """Of pixels on the device."""
        rays, count = drawn.rays, dr.width(drawn.photograph)
        floats = [*rays.origin, *rays.direction, rays.near, rays.far, *drawn.values, *drawn.weights, drawn.share]
        columns = [np.broadcast_to(np.array(each), count) for each in (*floats, drawn.share_weight)]
        return cls(np.array(drawn.photograph), np.stack(columns))

    def part(self, first: int, last: int) -> PlainPixels:
        """Some of them."""
        return PlainPixels(self.photograph[first:last], np.ascontiguousarray(self.columns[:, first:last]))

    def drawn(self) -> Drawn:
        """On the device."""
        jit = arrays()
        c = [lookup(jit.Float, each) for each in self.columns]
        rays = LatticeRays(jit.Array3f(*c[:3]), jit.Array3f(*c[3:6]), c[6], c[7])
        return Drawn(rays, lookup(jit.UInt, self.photograph), c[8:11], c[11:14], c[14], c[15])


class PixelsOnWorkers(PixelsHere):
    """The same by the workers of a cluster. Their number decides how many parts there are, and no bits."""

    def __init__(self, rendering: Rendering, limit: float, cluster: Cluster) -> None:
        super().__init__(rendering, limit)
        self.cluster = cluster

    def choose(self, nodes: NDArray[np.uint32]) -> None:
        """Send the field anew."""
        field = self.rendering.field
        plain, key = field.plain(), hashlib.sha256(nodes.tobytes())
        between = None if self.rendering.between is None else self.rendering.between.plain
        for array in (*plain, *(between or ())):
            key.update(np.ascontiguousarray(array).tobytes())
        self.nodes, self.workers = lookup(arrays().UInt, nodes), max(self.cluster.workers, 1)
        self.held = self.cluster.hold(HeldMatter(key.hexdigest(), type(field), plain, nodes, between))

    def gradient(self, drawn: Drawn, with_light: bool) -> SeenLight | None:
        """By parts, whose gradients are summed."""
        field, count = self.rendering.field, dr.width(drawn.photograph)
        parts = self._of_parts(gradient_of_part, drawn, count, self.limit, with_light)
        field.no_gradients()
        field.set_sums(self.nodes, [np.sum(each, axis=0) for each in zip(*(sums for sums, _ in parts), strict=True)])
        if not with_light:
            return None
        each = max(self.rendering.shading.lamps.each, 1)
        return seen_light(np.concatenate([light for _, light in parts], axis=1), each)

    def slopes(self, drawn: Drawn) -> Slopes:
        """By parts, in their order."""
        parts = self._of_parts(slopes_of_part, drawn)
        return Slopes(*(np.concatenate(each) for each in zip(*parts, strict=True)))

    def _of_parts(self, work: Callable[..., Any], drawn: Drawn, *more: Any) -> list[Any]:
        """What `work` gives of each part, in their order."""
        rendering, pixels = self.rendering, PlainPixels.of(drawn)
        shading, chunks = rendering.shading, len(pixels.photograph) // CHUNK
        state = StepState(
            rendering.field.at(self.nodes), np.array(shading.gloss), rendering.softness, shading.lamps, shading.unknown,
            rendering.strengths, rendering.shadows,
        )  # fmt: skip
        count = max(min(self.workers, len(pixels.photograph) // LEAST_PART), 1)
        ends = [CHUNK * (chunks * k // count) for k in range(count + 1)]
        tasks = [(self.held, state, pixels.part(a, b), *more) for a, b in pairwise(ends)]
        return [result for _, result in sorted(self.cluster.results(work, tasks), key=lambda each: each[0])]


_held: list[tuple[str, MatterField, LightBetween | None]] = []  # one field at most, by its key


def _rendering(held: HeldMatter, state: StepState) -> Rendering:
    """On a worker: the field of a state, and what is seen of it."""
    if not _held or _held[0][0] != held.key:
        _held.clear()  # before another one takes memory
        light = None if held.between is None else LightBetween(held.between)
        _held.append((held.key, held.law(*held.arrays), light))
    _, field, between = _held[0]
    field.set_at(lookup(arrays().UInt, held.nodes), state.numbers)
    shading = NodeShading(state.lamps, state.gloss, state.unknown, field.element)
    rendering = Rendering(field, shading, state.softness, state.shadows, state.strengths)
    rendering.between = between
    return rendering


def gradient_of_part(
    held: HeldMatter, state: StepState, pixels: PlainPixels, count: int, limit: float, with_light: bool
) -> tuple[list[NDArray[np.int64]], Floats | None]:
    """On a worker: gradients by the nodes that move, in whole numbers, and the light of the pixels, if wanted."""
    rendering, drawn = _rendering(held, state), pixels.drawn()
    rendering.field.no_gradients()
    light = add_gradient(rendering, drawn, count, limit)
    sums = rendering.field.sums(lookup(arrays().UInt, held.nodes))
    return sums, light.plain(len(pixels.photograph)) if with_light else None


def slopes_of_part(held: HeldMatter, state: StepState, pixels: PlainPixels) -> Slopes:
    """On a worker: slopes of some pixels."""
    return slopes_of(_rendering(held, state), pixels.drawn())


def seen_light(rows: Floats, each: int) -> SeenLight:
    """What `SeenLight.plain` gives of `each` lamp of a photograph, on the device."""
    depth, way, *rest = (lookup(arrays().Float, row) for row in rows)
    factors = each + COLOURS * (len(rest) > (1 + COLOURS) * each)  # those of light between parts are behind
    return SeenLight(Seen(rest[factors:], depth, way), rest[:each], rest[each:factors])
