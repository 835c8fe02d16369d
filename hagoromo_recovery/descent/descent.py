"""Descent: a field of matter, its colours and gloss move until they explain all photographs."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.cluster.cluster import Cluster, Workers
from hagoromo.progress import Progress, silent
from hagoromo_recovery.descent.gloss_step import Slopes, gloss_step
from hagoromo_recovery.descent.pixel_table import CHUNK, Drawn, PixelTable
from hagoromo_recovery.descent.pixel_tasks import PixelsHere, PixelsOnWorkers
from hagoromo_recovery.descent.rendering import Rendering, SeenLight
from hagoromo_recovery.descent.share_step import ShareSteps
from hagoromo_recovery.field.matter_field import MatterField
from hagoromo_recovery.shading.lamp_table import LampTable
from hagoromo_recovery.shading.shading import NodeShading, is_matt

if TYPE_CHECKING:
    from hagoromo_recovery.descent.look import Look

CHOOSE_EVERY, LAST_CHOICE = 30, 0.8  # steps after which moving nodes are chosen anew; share of the steps until then
LAST_RATE = 0.1  # factor on the rates of the last step
GLOSS_EVERY, LIGHT_EVERY, STRENGTHS_EVERY = 8, 2, 4  # steps after which gloss, unknown light and strengths are fitted
GLOSS_DRAW = 4  # times as many pixels as a step: several must show each place, as its colour is taken out of them
CAMERAS_EVERY, TURN_SHARE = 5, 4  # steps after which cameras move; one turn of all by every how many drawn chunks
FIRST_LEAST = 0.25  # of each gloss in the first steps: one that no place has would not be found
PLACES_EVERY = 6  # steps after which lamps move


class Descent:
    """One level of the lattice: its field and gloss move by the pixels of all views.

    gloss: what `coordinates` gives. seed: of the pixels that are drawn. look: what is estimated beside the object; it
    is fitted, too. workers: whose work the pixels of a step are; bits do not depend on them. albedo: see `Rendering`.
    """

    def __init__(
        self,
        field: MatterField,
        pixels: PixelTable,
        lamps: LampTable,
        gloss: NDArray[np.floating],
        seed: int,
        shadows: bool,
        look: Look,
        workers: Workers | None = None,
        albedo: float | None = None,
    ) -> None:
        self.field, self.pixels, self.lamps, self.look = field, pixels, lamps, look
        self.rendering = Rendering(
            field,
            NodeShading(lamps, gloss, look.unknown, field.element),
            1.0,
            shadows,
            look.strengths,
            albedo,
        )
        if look.cameras is not None:
            look.cameras.apply(pixels)
        if look.places is not None:
            look.places.apply(lamps)
        on_workers = isinstance(workers, Cluster)
        self.work = (
            PixelsOnWorkers(self.rendering, pixels.limit, workers)
            if on_workers
            else PixelsHere(self.rendering, pixels.limit)
        )
        self.random = np.random.default_rng(seed)
        self.moves = field.moves()
        self.choose()

    @property
    def shading(self) -> NodeShading:
        """What a place sends to the eye."""
        return self.rendering.shading

    @property
    def gloss(self) -> NDArray[np.float64]:
        """ln β, ln γ, ln(n − 1)."""
        return np.array(self.shading.gloss, np.float64)

    def choose(self) -> None:
        """Choose the nodes that move anew."""
        self.moves.choose()
        nodes = np.array(self.moves.nodes)
        self.shares = None if self.field.shares is None else ShareSteps(nodes, self.field.shape)
        self.work.choose(nodes)

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

        rate: of the values of the field, in the first step. keep: is called before a step for which the nodes that move
        are chosen anew. first: such a step, to go on from.
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
                self.find_between()
            elif k == first:
                self.find_between()
            fall = LAST_RATE**share
            picked = self._pick(chunks, total)
            drawn = self.pixels.of(picked)
            wanted = k % LIGHT_EVERY == 0 and (self.look.unknown is not None or self.look.strengths is not None)
            light = self.step(drawn, rate * fall, fall, wanted)
            self._fit_look(k, fall, picked, drawn, light)
            if self.lamps.each and k % GLOSS_EVERY == GLOSS_EVERY - 1 and not is_matt(self.gloss):
                many = self.pixels.of(self._pick(GLOSS_DRAW * chunks, total))
                copies = self.pixels.count / dr.width(many.photograph)
                slopes = self.work.slopes(many)
                self.shading.set_gloss(gloss_step(self.gloss, slopes, copies))
                if self.shares is not None:
                    self._move_shares(self.shares, slopes, max(FIRST_LEAST * (1.0 - 2.0 * share), 0.0))
        self.find_between()
        progress(1.0)

    def find_between(self) -> None:
        """Compute light between parts of the object as it is by now, where it is asked for."""
        if self.rendering.albedo is not None:
            self.rendering.find_between(len(self.pixels.places))
            self.work.choose(np.array(self.moves.nodes))

    def _move_shares(self, steps: ShareSteps, slopes: Slopes, least: float) -> None:
        """Move how much of both glosses places have, `least` of each, by the slopes of some pixels."""
        self.field.set_shares(steps.nodes, steps.step(self.field.shares_of(steps.nodes), slopes, least))
        self.work.choose(np.array(self.moves.nodes))  # they are not among what moves with each step

    def _fit_look(self, k: int, fall: float, picked: NDArray[np.int64], drawn: Drawn, light: SeenLight | None) -> None:
        """Fit what is estimated beside the object, in step k, by the pixels of the step. fall: factor on changes of
        each camera and strength, so that the last ones are means over many draws.
        """
        unknown, cameras, strengths = self.look.unknown, self.look.cameras, self.look.strengths
        if unknown is not None and light is not None and k % LIGHT_EVERY == 0:
            unknown.fit(self.field, drawn, light, drawn.weights)
            self.work.choose(np.array(self.moves.nodes))  # body colours of all nodes have changed
        if strengths is not None and light is not None and k % STRENGTHS_EVERY == 0:
            strengths.step(self.pixels, drawn, light, fall)
        if cameras is not None and k % CAMERAS_EVERY == CAMERAS_EVERY - 1:
            cameras.step(self.rendering, self.pixels, picked[:: 1 if cameras.each else TURN_SHARE], fall)
        if self.look.places is not None and k % PLACES_EVERY == PLACES_EVERY - 1:
            self.look.places.step(self.rendering, self.pixels, picked, fall)

    def _pick(self, chunks: int, total: int) -> NDArray[np.int64]:
        """Some chunks of pixels, drawn with equal chances, in order."""
        return np.sort(self.random.integers(0, total, min(chunks, total)))

    def step(self, drawn: Drawn, rate: float, fall: float, with_light: bool = True) -> SeenLight | None:
        """One step of the field by some pixels; gives their light before it, if wanted.

        rate: of the field's values. fall: factor on the rates of all else.
        """
        light = self.work.gradient(drawn, with_light)
        self.moves.move(rate, fall)
        return light
