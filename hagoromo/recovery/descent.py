"""Descent: a distance field, its colours and gloss move until they explain all photographs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, UInt, arrays, clip, lookup
from hagoromo.progress import Progress, silent
from hagoromo.recovery.distance_field import COLOURS, DistanceField
from hagoromo.recovery.gloss_step import gloss_step, robust
from hagoromo.recovery.hull import redistanced
from hagoromo.recovery.lamp_table import LampTable
from hagoromo.recovery.pixel_table import CHUNK, Drawn, PixelTable
from hagoromo.recovery.rendering import Rendering, SeenLight
from hagoromo.recovery.shading import SurfaceShading

if TYPE_CHECKING:
    from hagoromo.recovery.look import Look

BAND = 3.0  # voxels from the surface within which nodes move
CHOOSE_EVERY, LAST_CHOICE = 30, 0.8  # steps after which moving nodes are chosen anew; share of the steps until then
FIRST_RATE, DISTANCE_RATE = 0.08, 0.05  # [voxel] of a level's first step: from the hull, from another level
COLOUR_RATE = 0.06  # of a body colour, likewise
LAST_RATE = 0.1  # factor on the rates of the last step
LARGEST_CHANGE, LEAST_COLOUR = 0.3, 1e-4  # [voxel] of a distance in a step; of a body colour
EIKONAL, BENDING = 2.0, 0.2  # of |∇d| from 1, and of the Laplacian of d, in units of a pixel's squared error
EVENNESS = 30.0  # of the differences of body colours of neighbours, likewise: it decides where pixels say nothing
SILHOUETTE = 100.0  # of a pixel's opacity, likewise
GLOSS_EVERY, LIGHT_EVERY, STRENGTHS_EVERY = 8, 2, 4  # steps after which gloss, unknown light and strengths are fitted
GLOSS_DRAW = 4  # times as many pixels as a step: several must show each place, as its colour is taken out of them
CAMERAS_EVERY, TURN_SHARE = 5, 4  # steps after which cameras move; one turn of all by every how many drawn chunks
PLACES_EVERY = 6  # steps after which lamps move


class Adam:
    """Steps of Adam (Kingma & Ba 2015) for some numbers."""

    def __init__(self, count: int) -> None:
        jit = arrays()
        self.first, self.second = dr.zeros(jit.Float, count), dr.zeros(jit.Float, count)
        dr.make_opaque(self.first, self.second)
        self.steps = 0

    def step(self, slope: Float, rate: float) -> Float:
        """What is to be subtracted."""
        self.steps += 1
        self.first = 0.9 * self.first + 0.1 * slope
        self.second = 0.98 * self.second + 0.02 * slope * slope
        one, two = 1.0 - 0.9**self.steps, 1.0 - 0.98**self.steps
        scale = dr.opaque(arrays().Float, rate / one)
        change = scale * self.first / (dr.sqrt(self.second / dr.opaque(arrays().Float, two)) + 1e-12)
        dr.eval(self.first, self.second, change)
        return change


class Descent:
    """One level of the lattice: its field and gloss move by the pixels of all views.

    gloss: what `coordinates` gives. seed: of the pixels that are drawn. look: what is estimated beside the object; it
    is fitted, too.
    """

    def __init__(
        self,
        field: DistanceField,
        pixels: PixelTable,
        lamps: LampTable,
        gloss: NDArray[np.floating],
        seed: int,
        shadows: bool,
        look: Look,
    ) -> None:
        self.field, self.pixels, self.lamps, self.look = field, pixels, lamps, look
        self.rendering = Rendering(field, SurfaceShading(lamps, gloss, look.unknown), 1.0, shadows, look.strengths)
        if look.cameras is not None:
            look.cameras.apply(pixels)
        if look.places is not None:
            look.places.apply(lamps)
        self.random = np.random.default_rng(seed)
        self.choose()

    @property
    def shading(self) -> SurfaceShading:
        """That of the surface."""
        return self.rendering.shading

    @property
    def gloss(self) -> NDArray[np.float64]:
        """ln β, ln γ, ln(n − 1)."""
        return np.array(self.shading.gloss, np.float64)

    def choose(self) -> None:
        """Choose the nodes that move, those near the surface; far distances are made distances again."""
        distance = redistanced(self.field.distances())
        self.field.distance = lookup(arrays().Float, distance)
        inner = np.zeros(distance.shape, bool)
        inner[1:-1, 1:-1, 1:-1] = True
        held = np.flatnonzero((np.abs(distance) < BAND) & inner)
        self.nodes = lookup(arrays().UInt, held.astype(np.uint32))
        self.by_distance = Adam(len(held))
        self.by_colours = [Adam(len(held)) for _ in range(COLOURS)]

    def run(
        self,
        steps: int,
        chunks: int,
        softness: tuple[float, float],
        rate: float,
        progress: Progress = silent,
        keep: Callable[[int], None] | None = None,
        first: int = 0,
    ) -> None:
        """`steps` steps, each by `chunks` chunks of pixels; s falls from the first softness to the last [voxel].

        rate: of distances, in the first step [voxel]. keep: is called before a step for which the nodes that move are
        chosen anew. first: such a step, to go on from.
        """
        total = self.pixels.count // CHUNK
        for k in range(first, steps):
            share = k / max(steps - 1, 1)
            progress(k / steps)
            self.rendering.softness = softness[0] * (softness[1] / softness[0]) ** share
            if k > first and k % CHOOSE_EVERY == 0 and share < LAST_CHOICE:
                if keep is not None:
                    keep(k)
                self.choose()
            fall = LAST_RATE**share
            picked = self._pick(chunks, total)
            drawn = self.pixels.of(picked)
            light = self.step(drawn, rate * fall, COLOUR_RATE * fall)
            self._fit_look(k, fall, picked, drawn, light)
            if self.lamps.each and k % GLOSS_EVERY == GLOSS_EVERY - 1:
                many = self.pixels.of(self._pick(GLOSS_DRAW * chunks, total))
                copies = self.pixels.count / dr.width(many.photograph)
                self.shading.set_gloss(gloss_step(self.rendering, many, copies))
        progress(1.0)

    def _fit_look(self, k: int, fall: float, picked: NDArray[np.int64], drawn: Drawn, light: SeenLight) -> None:
        """Fit what is estimated beside the object, in step k, by the pixels of the step. fall: factor on changes of
        each camera and strength, so that the last ones are means over many draws.
        """
        unknown, cameras, strengths = self.look.unknown, self.look.cameras, self.look.strengths
        if unknown is not None and k % LIGHT_EVERY == 0:
            unknown.fit(self.field, drawn, light, drawn.weights)
        if strengths is not None and k % STRENGTHS_EVERY == 0:
            strengths.step(self.pixels, drawn, light, fall)
        if cameras is not None and k % CAMERAS_EVERY == CAMERAS_EVERY - 1:
            cameras.step(self.rendering, self.pixels, picked[:: 1 if cameras.each else TURN_SHARE], fall)
        if self.look.places is not None and k % PLACES_EVERY == PLACES_EVERY - 1:
            self.look.places.step(self.rendering, self.pixels, picked, fall)

    def _pick(self, chunks: int, total: int) -> NDArray[np.int64]:
        """Some chunks of pixels, drawn with equal chances, in order."""
        return np.sort(self.random.integers(0, total, min(chunks, total)))

    def step(self, drawn: Drawn, rate: float, colour_rate: float) -> SeenLight:
        """One step of the field by some pixels; returns their light before it.

        rate: of distances [voxel]. colour_rate: of body colours.
        """
        light = self.rendering.light(drawn)
        count, each = dr.width(drawn.photograph), max(self.lamps.each, 1)
        rest = [a - b for a, b in zip(light.channels, drawn.values, strict=True)]
        doubt = robust(drawn, rest, self.pixels.limit)
        by = [(2.0 / 3.0 / count) * w * r * doubt for w, r in zip(drawn.weights, rest, strict=True)]
        by_light = [light.passed[k] * by[c] for k in range(each) for c in range(COLOURS)]
        clear = dr.exp(-light.seen.depth)
        by_depth = (2.0 * SILHOUETTE / count) * drawn.share_weight * ((1.0 - clear) - drawn.share) * clear
        self.field.no_gradients()
        dr.eval(by_light, by_depth)
        with dr.suspend_grad():
            self.rendering.march.adjoint(drawn.rays, light.seen, by_light, by_depth)
        self._move(rate, colour_rate)
        return light

    def _move(self, rate: float, colour_rate: float) -> None:
        """Move the field against its gradients."""
        jit, field = arrays(), self.field
        by_distance, by_colours = field.by_distance, field.by_colours
        dr.eval(by_distance, by_colours)
        slope = dr.gather(jit.Float, by_distance, self.nodes) + smoothness_slope(field, self.nodes)
        change = clip(self.by_distance.step(slope, rate), -LARGEST_CHANGE, LARGEST_CHANGE)
        dr.scatter_reduce(dr.ReduceOp.Add, field.distance, -change, self.nodes, mode=dr.ReduceMode.NoConflicts)
        for c in range(COLOURS):
            index = self.nodes * COLOURS + c
            slope = dr.gather(jit.Float, by_colours, index) + self._evenness_slope(c)
            change = self.by_colours[c].step(slope, colour_rate)
            new = dr.fmax(dr.gather(jit.Float, field.colours, index) - change, LEAST_COLOUR)
            dr.scatter(field.colours, new, index, mode=dr.ReduceMode.NoConflicts)
        dr.eval(field.distance, field.colours)

    def _evenness_slope(self, channel: int) -> Float:
        """Gradient of what gives places that no light reaches the colours of their neighbours."""
        jit, field = arrays(), self.field

        def at(node: UInt) -> Float:
            return dr.gather(jit.Float, field.colours, node * COLOURS + channel)

        around = sum(at(self.nodes - row) + at(self.nodes + row) for row in field.rows)
        return (EVENNESS / dr.width(self.nodes)) * (6.0 * at(self.nodes) - around)


def smoothness_slope(field: DistanceField, nodes: UInt) -> Float:
    """Gradient, at the nodes that move, of what keeps the field a distance and its surface even."""
    jit, share = arrays(), 1.0 / dr.width(nodes)

    def sides(values: Float, row: UInt) -> tuple[Float, Float]:
        return dr.gather(jit.Float, values, nodes - row), dr.gather(jit.Float, values, nodes + row)

    def among_all(values: Float) -> Float:
        spread = dr.zeros(jit.Float, dr.width(field.distance))
        dr.make_opaque(spread)
        dr.scatter(spread, values, nodes, mode=dr.ReduceMode.NoConflicts)
        return spread

    around = [sides(field.distance, row) for row in field.rows]
    slope = jit.Array3f(*(0.5 * (high - low) for low, high in around))
    length = dr.norm(slope)
    by_slope = slope * (2.0 * EIKONAL * share * (length - 1.0) / dr.fmax(length, 1e-6))
    laplacian = sum(low + high for low, high in around) - 6.0 * dr.gather(jit.Float, field.distance, nodes)
    bending = among_all(2.0 * BENDING * share * laplacian)
    total = -6.0 * dr.gather(jit.Float, bending, nodes)
    for k, row in enumerate(field.rows):
        low, high = sides(among_all(by_slope[k]), row)
        total += 0.5 * (low - high) + sum(sides(bending, row))
    return total
