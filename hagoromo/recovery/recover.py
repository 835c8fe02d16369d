"""Recover: a capture of many views and lamps → shape, body colours and gloss of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy import ndimage

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.progress import Progress, part_of, silent
from hagoromo.recovery.descent import Descent
from hagoromo.recovery.distance_field import COLOURS, DistanceField
from hagoromo.recovery.evidence import evidence_of
from hagoromo.recovery.given import check_lamps, check_not_cut, checked, kept_aside
from hagoromo.recovery.hull import box_of, check_all_show_it, hull_distance, redistanced, without_crumbs
from hagoromo.recovery.lamp_table import LampTable
from hagoromo.recovery.lattice import Lattice
from hagoromo.recovery.recovered import Kept, Recovered
from hagoromo.recovery.shading import START, coordinates
from hagoromo.recovery.silhouettes import silhouettes_of
from hagoromo.recovery.views import CHUNK, Pixels, View

COARSEST = 32  # nodes along the longest edge of the first level
LEAST_SIDE, LARGEST_SIDE = 16, 512  # nodes along the longest edge
FOOTPRINT = 2.5  # pixels of a voxel's edge, at least, that pixels are not joined for
MODEL_ERROR, LAST_MODEL_ERROR = 0.02, 0.01  # relative error of the model, of coarse levels and of the last one
SOFTNESS, LAST_SOFTNESS = (1.0, 0.33), (0.6, 0.2)  # s at begin and end of a level, and of the last one [voxel]
BYTES_PER_NODE, BYTES_PER_PIXEL = 90.0, 120.0  # of all arrays together
LEVEL_SHARE = 0.35  # of the steps of the last level, that a coarse one takes of the work


@dataclass(frozen=True)
class RecoverySettings:
    """side: nodes of the lattice along the object's longest edge. steps: of each level of the lattice, coarse to fine.
    rays: of each step. keep: every how many photographs one is kept aside, to be predicted; 0: none. shadows: whether
    the object's own shadows are taken into account. seed: of the pixels that are drawn.
    """

    side: int = 128
    steps: int = 80
    rays: int = 1 << 16
    keep: int = 8
    shadows: bool = True
    seed: int = 0

    def __post_init__(self) -> None:
        if not LEAST_SIDE <= self.side <= LARGEST_SIDE:
            raise InputError(f"side is {self.side}: give {LEAST_SIDE} to {LARGEST_SIDE} nodes")
        for name, least in (("steps", 1), ("rays", CHUNK), ("keep", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}: give {least} or more")
        if self.keep == 1:
            raise InputError("keep is 1: every photograph would be kept aside; give 2 or more, or 0 for none")


def recover(
    capture: Capture | str | Path, settings: RecoverySettings | None = None, progress: Progress = silent
) -> Recovered:
    """Shape, body colours and gloss of an object, from photographs taken all around it under known lamps.

    The surface is the zero of a signed distance on a lattice, its body colour one of each node; β, γ and n of
    Torrance–Sparrow are those of one material. They move until photographs are explained, by the derivative of their
    light; each pixel counts by its variance. Photographs without lamps are those of fixed unknown light: the light that
    a place sends out then stands for its body colour. Interrupted (KeyboardInterrupt), it gives what there is.
    `InputError` for fewer than three views, silhouettes that meet nowhere, a lattice too large for the memory, and
    photographs of other than one or three channels.

        recovered = hg.recover("capture")
        recovered.box().save("box.zarr")
    """
    settings = settings or RecoverySettings()
    taken = capture if isinstance(capture, Capture) else load_capture(capture)
    photographs = checked(taken)
    silhouettes, stated = silhouettes_of(photographs)
    check_not_cut(photographs, silhouettes)
    aside = kept_aside(len(photographs), settings.keep)
    used = tuple(View(p, s, stated) for p, s, out in zip(photographs, silhouettes, aside, strict=True) if not out)
    progress(0.0, "hull")
    low, high = box_of([v.photograph for v in used], [v.share for v in used], stated)
    levels = [Lattice.around(low, high, side) for side in sides(settings.side)]
    require(BYTES_PER_NODE * float(np.prod(levels[-1].shape)), f"a lattice of {settings.side} nodes along its edge")
    state, complete, known, coarser = None, True, None, None
    shares = np.array([LEVEL_SHARE] * (len(levels) - 1) + [1.0])
    ends = np.concatenate([[0.0], np.cumsum(shares / shares.sum())])
    try:
        for number, level in enumerate(levels):
            last = number == len(levels) - 1
            coarser = None if state is None else np.array(state.descent.shading.gloss, np.float64)
            state = _begun(used, level, state, settings, last)
            own = part_of(progress, float(ends[number]), float(np.diff(ends)[number]), f"{max(level.shape)} nodes")
            state.descent.run(settings.steps, settings.rays // CHUNK, LAST_SOFTNESS if last else SOFTNESS, own)
        assert state is not None  # there is a level
        known = evidence_of(state.descent, coarser)
    except KeyboardInterrupt:
        if state is None:
            raise
        complete = False
    kept = tuple(Kept(p, s) for p, s, out in zip(photographs, silhouettes, aside, strict=True) if out)
    field = state.descent.field
    distance = np.asarray(without_crumbs(field.distances()), np.float32)
    return Recovered(
        state.lattice, distance, field.body_colours(), np.array(state.descent.shading.gloss, np.float64),
        state.descent.rendering.softness, tuple(v.photograph for v in used), kept, any(p.lamps for p in photographs),
        asdict(settings), taken.name, complete, dict(taken.assumptions), stated, known,
    )  # fmt: skip


def sides(finest: int) -> list[int]:
    """Nodes along the longest edge of all levels: each has voxels of half the edge of the one before."""
    levels = [finest]
    while (levels[0] + 1) // 2 >= COARSEST:
        levels.insert(0, (levels[0] + 1) // 2)
    return levels


class _State(NamedTuple):
    """The descent of a level."""

    lattice: Lattice
    descent: Descent


def _begun(
    views: Sequence[View], lattice: Lattice, before: _State | None, settings: RecoverySettings, last: bool
) -> _State:
    """The descent of a level, from the hull or from the field of the coarser one."""
    photographs = [view.photograph for view in views]
    nearest = min(float(np.linalg.norm(p.camera.position - lattice.middle)) for p in photographs)
    foot = lattice.voxel * max(min(p.camera.focal) for p in photographs) / nearest
    reduced = [view.reduced(max(1, int(foot / FOOTPRINT))) for view in views]
    require(BYTES_PER_PIXEL * sum(float(v.share.size) for v in reduced), "the pixels of all photographs")
    bright = [np.percentile(v.photograph.values[v.photograph.mask], 99.0) for v in reduced if v.photograph.mask.any()]
    pixels = Pixels(reduced, lattice, LAST_MODEL_ERROR if last else MODEL_ERROR, float(np.median(bright)))
    if before is None:
        hull = hull_distance(photographs, [v.share for v in views], lattice, views[0].stated)
        if views[0].stated:
            check_all_show_it(photographs, [v.share for v in views], lattice, hull)
        check_lamps(photographs, lattice, hull)
        field, gloss = DistanceField(redistanced(hull), np.full((*lattice.shape, COLOURS), 0.4)), coordinates(*START)
    else:
        field = finer(before.descent.field, before.lattice, lattice)
        gloss = np.array(before.descent.shading.gloss, np.float64)
    lamps = LampTable(photographs, lattice)
    return _State(lattice, Descent(field, pixels, lamps, gloss, settings.seed + max(lattice.shape), settings.shadows))


def finer(field: DistanceField, coarser: Lattice, lattice: Lattice) -> DistanceField:
    """The field on another lattice."""
    places = coarser.from_world(lattice.nodes())[..., ::-1]
    at = np.moveaxis(places, 3, 0)
    distance = ndimage.map_coordinates(without_crumbs(field.distances()), at, order=1, mode="nearest")
    colours = [
        ndimage.map_coordinates(field.body_colours()[..., c], at, order=1, mode="nearest") for c in range(COLOURS)
    ]
    return DistanceField(distance * (coarser.voxel / lattice.voxel), np.stack(colours, axis=3))
