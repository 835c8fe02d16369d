"""Recover: a capture of many views and lamps → shape, body colours and gloss of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.progress import Progress, part_of, silent
from hagoromo.recovery.camera_turn import CameraTurn
from hagoromo.recovery.choices import Light, Refine
from hagoromo.recovery.descent import Descent
from hagoromo.recovery.distance_field import COLOURS, DistanceField
from hagoromo.recovery.evidence import evidence_of
from hagoromo.recovery.first_look import SIDE, Look, first_look
from hagoromo.recovery.given import check_lamps, check_not_cut, checked, kept_aside
from hagoromo.recovery.hull import box_of, check_all_show_it, hull_distance, outlines_of, redistanced, without_crumbs
from hagoromo.recovery.lamp_table import LampTable
from hagoromo.recovery.lattice import Lattice
from hagoromo.recovery.object_view import ObjectView
from hagoromo.recovery.pixel_table import CHUNK, PixelTable
from hagoromo.recovery.recovered import Recovered
from hagoromo.recovery.shading import START, coordinates
from hagoromo.recovery.silhouettes import views_of
from hagoromo.recovery.unknown_light import UnknownLight

Views: TypeAlias = tuple[ObjectView, ...]
COARSEST = 32  # nodes along the longest edge of the first level
LEAST_SIDE, LARGEST_SIDE = 16, 512  # nodes along the longest edge
FOOTPRINT = 2.5  # pixels of a voxel's edge, at least, that pixels are not joined for
MODEL_ERROR, LAST_MODEL_ERROR = 0.02, 0.01  # relative error of the model, of coarse levels and of the last one
SOFTNESS, LAST_SOFTNESS = (1.0, 0.33), (0.6, 0.2)  # s at begin and end of a level, and of the last one [voxel]
BYTES_PER_NODE, BYTES_PER_PIXEL = 90.0, 120.0  # of all arrays together
LOOK_SHARE = 0.3  # of the work, that a first look is
LEVEL_SHARE = 0.35  # of the steps of the last level, that a coarse one takes of the work


@dataclass(frozen=True)
class RecoverySettings:
    """side: nodes of the lattice along the object's longest edge. steps: of each level of the lattice, coarse to fine.
    rays: of each step. keep: every how many photographs one is kept aside, to be predicted; 0: none. shadows: whether
    the object's own shadows are taken into account. seed: of the pixels that are drawn. light: what light is fixed to
    where no lamp is known; "even": to the object, without dependence on the normal; "auto": the one of the three that
    predicts best. refine: whether one small turn of all cameras is estimated ("cameras"), or "none"; "auto": where no
    lamp is known, if it predicts better.
    """

    side: int = 128
    steps: int = 80
    rays: int = 1 << 16
    keep: int = 8
    shadows: bool = True
    seed: int = 0
    light: Light = "auto"
    refine: Refine = "auto"

    def __post_init__(self) -> None:
        if not LEAST_SIDE <= self.side <= LARGEST_SIDE:
            raise InputError(f"side is {self.side}: give {LEAST_SIDE} to {LARGEST_SIDE} nodes")
        for name, least in (("steps", 1), ("rays", CHUNK), ("keep", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}: give {least} or more")
        for name, words in (("light", get_args(Light)), ("refine", get_args(Refine))):
            if getattr(self, name) not in words:
                raise InputError(f"{name} is {getattr(self, name)!r}: give {', '.join(words)}")
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
    views = views_of(photographs)
    check_not_cut(views)
    aside = kept_aside(len(views), settings.keep)
    used, kept = (tuple(v for v, out in zip(views, aside, strict=True) if out == which) for which in (False, True))
    lit = any(p.lamps for p in photographs)
    look = Look(None, CameraTurn([v.photograph for v in used]) if settings.refine == "cameras" else None, {})
    if not lit:
        coarse = replace(settings, side=min(SIDE, settings.side))
        of_look = part_of(progress, 0.0, LOOK_SHARE, "first look")

        def looked_at(some: Views, others: Views, light: UnknownLight | None, turning: bool) -> Recovered:
            turn = CameraTurn([v.photograph for v in some]) if turning else None
            return _recovered(some, others, coarse, Look(light, turn, {}), of_look)

        look = first_look(used, settings.light, settings.refine, looked_at)
        progress = part_of(progress, LOOK_SHARE, 1.0 - LOOK_SHARE)
    found = _recovered(used, kept, settings, look, progress)
    return replace(found, name=taken.name, assumptions=dict(taken.assumptions))


def _recovered(used: Views, kept: Views, settings: RecoverySettings, look: Look, progress: Progress) -> Recovered:
    """What is recovered of views that are used, by what a first look found."""
    progress(0.0, "hull")
    turn, lit = look.turn, any(v.photograph.lamps for v in used)
    first, hull = _hull(used if turn is None else _turned(used, turn), settings)
    field, gloss = DistanceField(redistanced(hull), np.full((*hull.shape, COLOURS), 0.4)), coordinates(*START)
    nodes = sides(settings.side)
    shares = np.array([LEVEL_SHARE] * (len(nodes) - 1) + [1.0])
    ends = np.concatenate([[0.0], np.cumsum(shares / shares.sum())])
    lattice, descent, known = first, None, None
    try:
        for number, side in enumerate(nodes):
            coarser, level = None, first
            if descent is not None:
                level = lattice.around_surface(without_crumbs(descent.field.distances()), side)
                field, coarser = finer(descent.field, lattice, level), descent.gloss
                gloss = coarser
            last = number == len(nodes) - 1
            lattice, descent = level, _descent(used, level, field, gloss, settings, last, look)
            own = part_of(progress, float(ends[number]), float(np.diff(ends)[number]), f"{side} nodes")
            descent.run(settings.steps, settings.rays // CHUNK, LAST_SOFTNESS if last else SOFTNESS, own)
            known = evidence_of(descent, coarser) if last else None
    except KeyboardInterrupt:
        if descent is None:
            raise
    assert descent is not None  # there is a level
    if turn is not None:
        used, kept = _turned(used, turn), _turned(kept, turn)
    distance = np.asarray(without_crumbs(descent.field.distances()), np.float32)
    return Recovered(
        lattice, distance, descent.field.body_colours(), descent.gloss, descent.rendering.softness,
        tuple(v.photograph for v in used), kept, lit, asdict(settings), stated=used[0].stated, evidence=known,
        unknown=descent.shading.unknown, turn=turn, tried=look.tried,
    )  # fmt: skip


def _turned(views: Views, turn: CameraTurn) -> Views:
    return tuple(replace(view, photograph=turn.of(view.photograph)) for view in views)


def sides(finest: int) -> list[int]:
    """Nodes along the longest edge of all levels: each has voxels of half the edge of the one before."""
    levels = [finest]
    while (levels[0] + 1) // 2 >= COARSEST:
        levels.insert(0, (levels[0] + 1) // 2)
    return levels


def _hull(views: Sequence[ObjectView], settings: RecoverySettings) -> tuple[Lattice, NDArray[np.float64]]:
    """The lattice of the first level, and the hull on it."""
    outlines, stated = outlines_of(views), views[0].stated
    low, high = box_of(outlines, stated)
    finest = Lattice.around(low, high, settings.side)
    require(BYTES_PER_NODE * float(np.prod(finest.shape)), f"a lattice of {settings.side} nodes along its edge")
    lattice = Lattice.around(low, high, sides(settings.side)[0])
    hull = hull_distance(outlines, lattice, stated)
    if stated:
        check_all_show_it(outlines, lattice, hull)
    check_lamps([view.photograph for view in views], lattice, hull)
    return lattice, hull


def _descent(
    views: Sequence[ObjectView],
    lattice: Lattice,
    field: DistanceField,
    gloss: NDArray[np.float64],
    settings: RecoverySettings,
    last: bool,
    look: Look,
) -> Descent:
    """The descent of a level."""
    photographs = [view.photograph for view in views]
    nearest = min(float(np.linalg.norm(p.camera.position - lattice.middle)) for p in photographs)
    foot = lattice.voxel * max(min(p.camera.focal) for p in photographs) / nearest
    reduced = [view.reduced(max(1, int(foot / FOOTPRINT))) for view in views]
    require(BYTES_PER_PIXEL * sum(float(v.share.size) for v in reduced), "the pixels of all photographs")
    bright = [np.percentile(v.photograph.values[v.photograph.mask], 99.0) for v in reduced if v.photograph.mask.any()]
    pixels = PixelTable(reduced, lattice, LAST_MODEL_ERROR if last else MODEL_ERROR, float(np.median(bright)))
    seed = settings.seed + max(lattice.shape)
    lamps = LampTable(photographs, lattice)
    return Descent(field, pixels, lamps, gloss, seed, settings.shadows, look.unknown, look.turn)


def finer(field: DistanceField, coarser: Lattice, lattice: Lattice) -> DistanceField:
    """The field on another lattice."""
    places = coarser.from_world(lattice.nodes())[..., ::-1]
    at = np.moveaxis(places, 3, 0)
    distance = ndimage.map_coordinates(without_crumbs(field.distances()), at, order=1, mode="nearest")
    colours = [
        ndimage.map_coordinates(field.body_colours()[..., c], at, order=1, mode="nearest") for c in range(COLOURS)
    ]
    return DistanceField(distance * (coarser.voxel / lattice.voxel), np.stack(colours, axis=3))
