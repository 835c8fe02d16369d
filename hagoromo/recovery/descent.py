"""Descent: a distance field, its colours and gloss move until they explain all photographs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, arrays, clip, lookup
from hagoromo.progress import Progress, silent
from hagoromo.recovery.distance_field import COLOURS, DistanceField
from hagoromo.recovery.hull import redistanced
from hagoromo.recovery.lamp_table import LampTable
from hagoromo.recovery.pixel_table import CHUNK, ROBUST, Drawn, PixelTable
from hagoromo.recovery.rendering import Rendering, SeenLight
from hagoromo.recovery.shading import SurfaceShading
from hagoromo.recovery.unknown_light import UnknownLight

if TYPE_CHECKING:
    from hagoromo.recovery.camera_turn import CameraTurn

BAND = 3.0  # voxels from the surface within which nodes move
CHOOSE_EVERY, LAST_CHOICE = 30, 0.8  # steps after which moving nodes are chosen anew; share of the steps until then
DISTANCE_RATE, COLOUR_RATE, LAST_RATE = 0.08, 0.06, 0.1  # rates of the first step; factor on those of the last
LARGEST_CHANGE, LEAST_COLOUR = 0.3, 1e-4  # [voxel] of a distance in a step; of a body colour
EIKONAL, BENDING = 2.0, 0.2  # of |∇d| from 1, and of the Laplacian of d, in units of a pixel's squared error
SILHOUETTE = 100.0  # of a pixel's opacity, likewise
LIGHT_EVERY = 2  # steps after which unknown light is fitted
TURN_EVERY, TURN_SHARE = 5, 4  # steps after which cameras turn; by every how many of the drawn chunks
GLOSS_EVERY, GLOSS_DIFFERENCE, GLOSS_CHANGE = 2, 0.02, 0.4  # steps; of the logarithms
GLOSS_RANGE = np.log([[1e-3, 1e3], [0.01, 1.2], [0.15, 2.0]])  # of β, γ and n − 1
N_USUAL, N_SPREAD = 1.5, 0.3  # of dielectrics, and standard deviation of ln(n − 1)
CORRELATED = 200.0  # values whose errors are alike, as neighbours have them: so many count as one


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

    gloss: what `coordinates` gives. seed: of the pixels that are drawn. unknown: light where no lamp is known, which
    is fitted, too. turn: of all cameras, likewise.
    """

    def __init__(
        self,
        field: DistanceField,
        pixels: PixelTable,
        lamps: LampTable,
        gloss: NDArray[np.floating],
        seed: int,
        shadows: bool = True,
        unknown: UnknownLight | None = None,
        turn: CameraTurn | None = None,
    ) -> None:
        self.field, self.pixels, self.lamps, self.turn = field, pixels, lamps, turn
        self.rendering = Rendering(field, SurfaceShading(lamps, gloss, unknown), 1.0, shadows)
        if turn is not None:
            turn.apply(pixels)
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

    def run(self, steps: int, chunks: int, softness: tuple[float, float], progress: Progress = silent) -> None:
        """`steps` steps, each by `chunks` chunks of pixels; s falls from the first softness to the last [voxel]."""
        total = self.pixels.count // CHUNK
        for k in range(steps):
            share = k / max(steps - 1, 1)
            progress(k / steps)
            self.rendering.softness = softness[0] * (softness[1] / softness[0]) ** share
            if k and k % CHOOSE_EVERY == 0 and share < LAST_CHOICE:
                self.choose()
            fall = LAST_RATE**share
            picked = np.sort(self.random.integers(0, total, min(chunks, total)))
            drawn = self.pixels.of(picked)
            light = self.step(drawn, fall)
            if self.shading.unknown is not None and k % LIGHT_EVERY == 0:
                self.shading.unknown.fit(self.field, drawn, light, drawn.weights)
            if self.turn is not None and k % TURN_EVERY == TURN_EVERY - 1:
                self.turn.step(self.rendering, self.pixels, picked[::TURN_SHARE])
            if self.lamps.each and k % GLOSS_EVERY == GLOSS_EVERY - 1:
                self.shading.set_gloss(
                    gloss_step(self.rendering, drawn, self.pixels.count / dr.width(drawn.photograph))
                )
        progress(1.0)

    def step(self, drawn: Drawn, fall: float) -> SeenLight:
        """One step of the field by some pixels; returns their light before it. fall: factor on the rates."""
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
        self._move(fall)
        return light

    def _move(self, fall: float) -> None:
        """Move the field against its gradients."""
        jit, field = arrays(), self.field
        dr.eval(field.by_distance, field.by_colours)
        slope = dr.gather(jit.Float, field.by_distance, self.nodes) + self._smoothness()
        change = clip(self.by_distance.step(slope, DISTANCE_RATE * fall), -LARGEST_CHANGE, LARGEST_CHANGE)
        dr.scatter_reduce(dr.ReduceOp.Add, field.distance, -change, self.nodes, mode=dr.ReduceMode.NoConflicts)
        for c in range(COLOURS):
            index = self.nodes * COLOURS + c
            change = self.by_colours[c].step(dr.gather(jit.Float, field.by_colours, index), COLOUR_RATE * fall)
            new = dr.fmax(dr.gather(jit.Float, field.colours, index) - change, LEAST_COLOUR)
            dr.scatter(field.colours, new, index, mode=dr.ReduceMode.NoConflicts)
        dr.eval(field.distance, field.colours)

    def _smoothness(self) -> Float:
        """Gradient, at the nodes that move, of what keeps the field a distance and its surface even."""
        jit, field = arrays(), self.field
        free = dr.detach(field.distance) + 0.0
        dr.enable_grad(free)
        middle, slope, around = dr.gather(jit.Float, free, self.nodes), [], jit.Float(0)
        for row in field.rows:
            low, high = (dr.gather(jit.Float, free, node) for node in (self.nodes - row, self.nodes + row))
            slope.append(0.5 * (high - low))
            around += high + low
        length = dr.norm(jit.Array3f(*slope))
        energy = EIKONAL * dr.square(length - 1.0) + BENDING * dr.square(around - 6.0 * middle)
        dr.backward(energy * (1.0 / dr.width(self.nodes)))
        return dr.gather(jit.Float, dr.grad(free), self.nodes)


def robust(drawn: Drawn, rest: list[Float], limit: float = ROBUST) -> Float:
    """Weight of pixels that nothing explains, such as stray light: Cauchy's. limit: [standard deviations]."""
    square = sum(w * r * r for w, r in zip(drawn.weights, rest, strict=True)) / COLOURS
    return dr.rcp(1.0 + square * (1.0 / limit**2))


def gloss_step(rendering: Rendering, drawn: Drawn, copies: float) -> NDArray[np.float64]:
    """The gloss after half a step of Gauss and Newton by some pixels, of which there are `copies` times as many.

    What is known beforehand of n (that of most matter) decides where the photographs do not.
    """
    gloss = np.array(rendering.shading.gloss, np.float64)
    prior = np.diag([0.0, 0.0, 1.0 / N_SPREAD**2])
    matrix, slope, _ = gloss_normal_equations(rendering, drawn, rendering.light(drawn), copies)
    slope = slope + prior @ (np.log(N_USUAL - 1.0) - gloss)
    damped = matrix + prior + np.diag(1e-3 * np.diag(matrix) + 1e-9)
    change = np.clip(np.linalg.solve(damped, slope), -GLOSS_CHANGE, GLOSS_CHANGE)
    return np.clip(gloss + 0.5 * change, *GLOSS_RANGE.T)


def gloss_normal_equations(
    rendering: Rendering, drawn: Drawn, base: SeenLight, copies: float
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
    """Jᵀ W J (3, 3) and Jᵀ W r (3,) of the gloss, and J (pixels · 3, 3) times √W, by differences from light `base`."""
    rest = [value - light for value, light in zip(drawn.values, base.channels, strict=True)]
    weight = robust(drawn, rest)
    roots = [np.sqrt(np.maximum(np.array(w * weight, np.float64), 0.0)) for w in drawn.weights]
    gloss, columns = np.array(rendering.shading.gloss, np.float64), []
    for k in range(len(gloss)):
        moved = gloss.copy()
        moved[k] += GLOSS_DIFFERENCE
        rendering.shading.set_gloss(moved)
        seen = rendering.light(drawn)
        slopes = [(a - b) * (1.0 / GLOSS_DIFFERENCE) for a, b in zip(seen.channels, base.channels, strict=True)]
        columns.append(np.concatenate([np.array(s, np.float64) * r for s, r in zip(slopes, roots, strict=True)]))
    rendering.shading.set_gloss(gloss)
    jacobian = np.stack(columns, axis=1)
    residual = np.concatenate([np.array(each, np.float64) * r for each, r in zip(rest, roots, strict=True)])
    copies = copies / CORRELATED
    return copies * jacobian.T @ jacobian, copies * jacobian.T @ residual, jacobian
