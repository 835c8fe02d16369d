"""Levels: an object is recovered on lattices from coarse to fine, each from the result of the one before."""

from __future__ import annotations

import json
from collections.abc import Callable, Sequence
from typing import TypeAlias

import numpy as np

from hagoromo.cluster.cluster import Workers
from hagoromo.files.memory import require
from hagoromo.progress import Progress, part_of
from hagoromo_recovery.descent.descent import Descent
from hagoromo_recovery.descent.look import FoundLook, Look
from hagoromo_recovery.descent.pixel_table import CHUNK, PixelTable
from hagoromo_recovery.hollows import WALLS, FoundHollow, explained_badly, hollowed, left_over
from hagoromo_recovery.matter_shape import MatterShape
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.shading.lamp_table import LampTable
from hagoromo_recovery.shading.shading import matt
from hagoromo_recovery.surface_shape import SurfaceShape
from hagoromo_recovery.work import Checkpoint

COARSEST, LEAST = 32, 16  # nodes along the longest edge of the first level; and where it is the first of two
FOOTPRINT = 2.5  # pixels of a voxel's edge, at least, that pixels are not joined for
MODEL_ERROR, LAST_MODEL_ERROR = 0.02, 0.01  # relative error of the model, of coarse levels and of the last one
SOFT, SHARP = 1.0, 0.15  # s at begin and end of a coarse level [voxel]
LAST_SOFT, LAST_SHARP = 2.0 * SHARP, 0.1  # of the last one: it goes on as sharp as the one before ended
ONLY_SOFT = 0.6  # at begin of the last one where it is the only one, and starts from the hull, or light is unknown
# s at the end of the last level, where pixels are large [px]: the mean of a square pixel blurs an edge by 0.29 px, the
# logistic function of width s by 1.8 s, and d rises by about 1.5 a voxel
PIXEL_EDGE, SOFTEST = 0.24, 0.33  # and s at most [voxel]
SOFT_WALL = 0.125  # of the thickness of a hollow's wall, s at most: it is opaque then, by 97 % where it is straight on
BYTES_PER_PIXEL = 120.0  # of all arrays together
RAYS_SIDE = 64  # nodes along the longest edge of the lattice up to which the rays of a step are as stated
TRIAL, LESS = 0.3, 0.95  # of the steps, in which a hollow is tried; of what is left over, that it must be below
FURTHER_RATE = 0.3  # factor on the rate of what goes on after the last level
LEVEL_SHARE = 0.25  # of the steps of the last level, that a coarse one takes of the work


Keep: TypeAlias = Callable[[Checkpoint], None]


def nothing_kept(checkpoint: Checkpoint) -> None:
    """Where nobody wants to go on."""


class Levels:
    """The way of an object from coarse to fine.

    views: what it is recovered from. start: on the lattice of the first level. sides: nodes along the longest edge of
    all levels. rays: of each step up to RAYS_SIDE nodes; beyond, they grow with the square of the nodes, as a surface
    does. seed: of the pixels that are drawn. look: what is estimated beside the object; it is fitted, too. `before`:
    the result of the level before; `hollow`: the one that was found. workers: whose work the pixels of a step are.
    albedo: see `Rendering`.
    """

    def __init__(
        self,
        views: Sequence[ObjectView],
        start: MatterShape,
        sides: Sequence[int],
        rays: int,
        seed: int,
        shadows: bool,
        look: Look,
        workers: Workers | None = None,
        albedo: float | None = None,
    ) -> None:
        self.views, self.sides, self.rays, self.seed, self.shadows = views, sides, rays, seed, shadows
        self.workers, self.albedo = workers, albedo
        self.lit = any(view.photograph.lamps for view in views)
        self.start, self.before, self.begin, self.look = start, start, start, look
        self.descent: Descent | None = None
        self.hollow: FoundHollow | None = None

    @property
    def shape(self) -> MatterShape:
        """What there is."""
        if self.descent is None:
            return self.start
        return self.begin.after(self.descent.field, self.descent.gloss)

    @property
    def softness(self) -> float:
        """s by now [voxel]."""
        return self._softness(True)[1] if self.descent is None else self.descent.rendering.softness

    def checkpoint(self, level: int, step: int = 0) -> Checkpoint:
        """Where the work stands, before a step of a level."""
        random = "" if self.descent is None else json.dumps(self.descent.random.bit_generator.state)
        return Checkpoint(level, step, self.shape, self.before, FoundLook.of(self.look), random, self.hollow)

    @property
    def end(self) -> Checkpoint:
        """Where the work stands after all levels."""
        return self.checkpoint(len(self.sides))

    def go_back_to(self, checkpoint: Checkpoint) -> None:
        """Take what was found by then."""
        self.start, self.before, self.begin = checkpoint.shape, checkpoint.before, checkpoint.shape
        self.look, self.hollow = checkpoint.look.of_views(self.views), checkpoint.hollow

    def run(
        self, steps: int, progress: Progress, keep: Keep = nothing_kept, since: Checkpoint | None = None
    ) -> Descent | None:
        """Go through all levels; gives the descent of the last, None where all were done before.

        keep: takes a checkpoint, from time to time. since: one to go on from.
        """
        if since is not None:
            self.go_back_to(since)
        shares = np.array([LEVEL_SHARE] * (len(self.sides) - 1) + [1.0])
        ends = np.concatenate([[0.0], np.cumsum(shares / shares.sum())])
        for number in range(0 if since is None else since.level, len(self.sides)):
            first = since.step if since is not None and number == since.level else 0
            if first == 0:
                self.before = self.shape
            begin = self.before.finer(self.sides[number]) if number and first == 0 else self.shape
            last = number == len(self.sides) - 1
            own = part_of(progress, float(ends[number]), float(np.diff(ends)[number]), f"{self.sides[number]} nodes")
            if last and number and first == 0 and isinstance(begin, SurfaceShape):
                begin, own = self._with_hollow(begin, steps, own)
            self.begin, self.descent = begin, self._descent(begin, last)
            if since is not None and first:
                self.descent.random.bit_generator.state = json.loads(since.random)
            softness, rate = self._softness(last), self.descent.moves.rates[min(number, 1)]

            def kept(step: int, number: int = number) -> None:
                keep(self.checkpoint(number, step))

            self.descent.run(steps, self.chunks_of(self.sides[number]), softness, rate, own, kept, first)
        return self.descent

    def without_gloss(self, steps: int, progress: Progress) -> None:
        """Go on with the last level, without gloss, for some further steps: body colours take what the gloss had."""
        assert self.descent is not None
        self.descent.shading.set_gloss(matt(self.descent.gloss))
        softness = self.softness, self.softness
        rate = FURTHER_RATE * self.descent.moves.rates[1]
        self.descent.run(steps, self.chunks_of(self.sides[-1]), softness, rate, progress)

    def chunks_of(self, side: int) -> int:
        """Chunks of pixels of each step of a level."""
        return round(self.rays * max(1.0, side / RAYS_SIDE) ** 2) // CHUNK

    def _with_hollow(self, begin: SurfaceShape, steps: int, progress: Progress) -> tuple[SurfaceShape, Progress]:
        """The begin of the last level, with a hollow where photographs ask for one, see `hollows`; and the progress of
        what is left.
        """
        hollows = self._hollows(begin)
        if not hollows:
            return begin, progress
        look, tried = FoundLook.of(self.look), []
        share = TRIAL / (1.0 + TRIAL * (1 + len(hollows)))  # of the work of the level, that a trial takes
        softness = min(SOFT, SOFT_WALL * min(hollows)), SHARP  # of all alike: a soft edge by itself leaves more
        for number, shape in enumerate((begin, *hollows.values())):
            self.look = look.of_views(self.views)
            descent, chunks = self._descent(shape, True), self.chunks_of(self.sides[-1])
            own = part_of(progress, number * share, share)
            descent.run(max(round(TRIAL * steps), 1), chunks, softness, descent.moves.rates[1], own)
            tried.append((left_over(descent), shape.after(descent.field, descent.gloss), FoundLook.of(self.look)))
        best = min(range(len(tried)), key=lambda k: tried[k][0])
        if best and tried[best][0] <= LESS * tried[0][0]:
            left, begin, look = tried[best]
            wall = list(hollows)[best - 1] * begin.lattice.voxel
            self.hollow = FoundHollow(wall, left / tried[0][0])
        self.look = look.of_views(self.views)
        return begin, part_of(progress, len(tried) * share, 1.0 - len(tried) * share)

    def _hollows(self, begin: SurfaceShape) -> dict[float, SurfaceShape]:
        """The begin of the last level where it is badly explained, by thickness of the walls that stay [voxel]."""
        if not self.lit:
            return {}
        seen = self._descent(begin, True)
        seen.rendering.softness = SHARP
        seen.find_between()
        bad = explained_badly(seen)
        made = {wall: hollowed(begin, bad, wall) for wall in WALLS}
        return {wall: shape for wall, shape in made.items() if shape is not None}

    def _footprint(self, lattice: Lattice) -> float:
        """Pixels of a voxel's edge where a photograph shows it largest."""
        photographs = [view.photograph for view in self.views]
        nearest = min(float(np.linalg.norm(p.camera.position - lattice.middle)) for p in photographs)
        return lattice.voxel * max(min(p.camera.focal) for p in photographs) / nearest

    def _joined(self, lattice: Lattice) -> int:
        """Pixels that are joined to one, along each edge."""
        return max(1, int(self._footprint(lattice) / FOOTPRINT))

    def _softness(self, last: bool) -> tuple[float, float]:
        """s at begin and end of a level [voxel]."""
        if not last:
            return SOFT, SHARP
        lattice = self.begin.lattice
        pixel = self._joined(lattice) / self._footprint(lattice)  # [voxel]
        end = float(np.clip(PIXEL_EDGE * pixel, LAST_SHARP, SOFTEST))
        return max(LAST_SOFT if self.lit and len(self.sides) > 1 else ONLY_SOFT, end), end

    def _descent(self, begin: MatterShape, last: bool) -> Descent:
        """The descent of a level."""
        photographs, lattice = [view.photograph for view in self.views], begin.lattice
        joined = self._joined(lattice)
        reduced = [view.reduced(joined) for view in self.views]
        require(BYTES_PER_PIXEL * sum(float(v.share.size) for v in reduced), "the pixels of all photographs")
        bright = [
            np.percentile(v.photograph.values[v.photograph.mask], 99.0) for v in reduced if v.photograph.mask.any()
        ]
        error = LAST_MODEL_ERROR if last else MODEL_ERROR
        soft = SHARP if isinstance(begin, SurfaceShape) and not last else None  # of the last, less than a pixel
        pixels = PixelTable(reduced, lattice, error, float(np.median(bright)), soft)
        field, seed = begin.field(), self.seed + max(lattice.shape)
        lamps = LampTable(photographs, lattice)
        made = Descent(field, pixels, lamps, begin.gloss, seed, self.shadows, self.look, self.workers, self.albedo)
        made.moves.colour_rate = made.moves.colour_rates[int(last or not self.lit)]
        return made


def sides_of(finest: int) -> list[int]:
    """Nodes along the longest edge of all levels: each has voxels of half the edge of the one before.

    The last halving of the voxel shows the error of the lattice.
    """
    levels = [finest]
    while (coarser := (levels[0] + 1) // 2) >= (LEAST if len(levels) == 1 else COARSEST):
        levels.insert(0, coarser)
    return levels
