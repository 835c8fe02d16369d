"""Recover: a capture of many views and lamps → shape, body colours and gloss of the object."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import NamedTuple, get_args

import numpy as np

from hagoromo.cluster.cluster import Here, Workers, here_or_on
from hagoromo.errors import InputError
from hagoromo.files.memory import SHARE_OF_MEMORY, free_memory
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.progress import Progress, part_of, silent
from hagoromo_recovery.choices import (
    AUTO,
    NONE,
    FoundMatter,
    GlossChoice,
    Law,
    Light,
    MatterChoice,
    OrdersChoice,
    parts_of,
)
from hagoromo_recovery.colour_unit import colour_unit, counted_back, counted_in
from hagoromo_recovery.descent.look import FoundLook, Look
from hagoromo_recovery.descent.pixel_gloss import pixel_gloss
from hagoromo_recovery.descent.pixel_table import CHUNK
from hagoromo_recovery.errors import errors_of
from hagoromo_recovery.evidence import evidence_of, feigned, slopes_in
from hagoromo_recovery.first_look import SIDE, TRIALS, Views, first_look, law_of, tried_on_surface
from hagoromo_recovery.fuzzy_shape import FuzzyShape
from hagoromo_recovery.given import LEAST_VIEWS, check_lamps, check_not_cut, checked, kept_aside, with_light
from hagoromo_recovery.levels import Levels, sides_of
from hagoromo_recovery.matter_shape import SHAPES, MatterShape
from hagoromo_recovery.outline.agreement import check_agree, misses_of
from hagoromo_recovery.outline.hull import box_of, check_all_show_it, hull_distance, outlines_of, without_crumbs
from hagoromo_recovery.outline.lattice import LARGEST_SIDE, LEAST_SIDE, Lattice
from hagoromo_recovery.outline.mask_offset import MaskOffset, mask_offset, with_masks_moved, without_mixed_pixels
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.outline.silhouettes import views_of
from hagoromo_recovery.recovered import Recovered
from hagoromo_recovery.shading.shading import is_matt, matt, order_of
from hagoromo_recovery.surface_shape import SurfaceShape
from hagoromo_recovery.work import Work

BYTES_PER_NODE: dict[Law, float] = {"surface": 90.0, "fuzzy": 200.0}  # of all arrays together
BYTES_OF_SHARES = 16.0  # further ones of a node where places have shares of two glosses
LOOK_SHARE = 0.3  # of the work, that a first look is
WHOLE, HALVES = "whole", ("first half", "second half")  # what there are checkpoints of
LEAST_POSES = 6  # of a half of the photographs, if those from one pose are to be in one half
FURTHER = 1.0 / 3.0  # of the steps of a level, that follow where the object turns out to have no gloss
WHOLE_SHARE = 0.55  # of the work, of what is not done for the errors


@dataclass(frozen=True)
class RecoverySettings:
    """side: nodes of the lattice along the object's longest edge. steps: of each level of the lattice, coarse to fine.
    rays: of each step up to 64 nodes; beyond, they grow with the square of the nodes, so that each node of the surface
    is seen as often. keep: every how many photographs one is kept aside, to be predicted; 0: none. shadows: whether
    the object's own shadows are taken into account. errors: whether each half of the photographs gives an object of its
    own, too, so that the errors of places are known: that doubles the time. seed: of the pixels that are drawn.
    light: what light is fixed to where no lamp is known; "even": to the object, without dependence on the normal;
    "auto": the one of the three that predicts best. refine: what is estimated beside the object, a list of "turn" (one
    small turn of all cameras), "cameras" (of each, a turn and a shift), "lamps" and "exposure" (a factor on the light
    of each lamp, and of each photograph), "places" (a shift of each lamp), "masks" (of a surface, outlines are moved to
    where photographs show them), such as "cameras,lamps"; "none"; "auto": masks, and a turn, where no lamp is known, if
    it predicts better. matter: "surface"; "fuzzy": fibres without a surface, such as
    fur and down, a free density at each node; "auto": the one that predicts better, on a coarse lattice. gloss: of a
    surface under known lamps; "one": β and γ are those of the whole object; "places": each node has its own; "auto":
    "places", where that predicts better, on a coarse lattice. orders: of light, of a surface under known lamps;
    "first": that of lamps alone; "all": also from one part of the object to another; "auto": "all", where that predicts
    better, on a coarse lattice.
    """

    side: int = 128
    steps: int = 200
    rays: int = 1 << 14
    keep: int = 8
    shadows: bool = True
    errors: bool = True
    seed: int = 0
    light: Light = "auto"
    refine: str = AUTO
    matter: MatterChoice = "surface"
    gloss: GlossChoice = "one"
    orders: OrdersChoice = "first"

    def __post_init__(self) -> None:
        if not LEAST_SIDE <= self.side <= LARGEST_SIDE:
            raise InputError(f"side is {self.side}: give {LEAST_SIDE} to {LARGEST_SIDE} nodes")
        for name, least in (("steps", 1), ("rays", CHUNK), ("keep", 0)):
            if getattr(self, name) < least:
                raise InputError(f"{name} is {getattr(self, name)}: give {least} or more")
        if self.light not in get_args(Light):
            raise InputError(f"light is {self.light!r}: give {', '.join(get_args(Light))}")
        if self.matter not in get_args(MatterChoice):
            raise InputError(f"matter is {self.matter!r}: give {', '.join(get_args(MatterChoice))}")
        if self.gloss not in get_args(GlossChoice):
            raise InputError(f"gloss is {self.gloss!r}: give {', '.join(get_args(GlossChoice))}")
        if self.orders not in get_args(OrdersChoice):
            raise InputError(f"orders is {self.orders!r}: give {', '.join(get_args(OrdersChoice))}")
        if self.orders == "all" and self.matter == "fuzzy":
            raise InputError("orders is 'all', which is of a surface, and matter is 'fuzzy': give orders first")
        if self.gloss == "places" and self.matter == "fuzzy":
            raise InputError("gloss is 'places', which is of a surface, and matter is 'fuzzy': give gloss one")
        parts_of(self.refine)
        if self.keep == 1:
            raise InputError("keep is 1: every photograph would be kept aside; give 2 or more, or 0 for none")


class RecoveryRun(NamedTuple):
    """progress: of the work. work: file of what was found. workers: who compute what pixels of a step ask for."""

    progress: Progress
    work: Work
    workers: Workers = Here()

    def part(self, first: float, share: float, name: str = "") -> RecoveryRun:
        """That of a part of the work."""
        return self._replace(progress=part_of(self.progress, first, share, name))

    def without_file(self) -> RecoveryRun:
        """One that begins anew and keeps nothing."""
        return self._replace(work=Work(None, (), {}))


def recover(
    capture: Capture | str | Path,
    settings: RecoverySettings | None = None,
    progress: Progress = silent,
    work: str | Path | None = None,
    scheduler: str | int | None = None,
) -> Recovered:
    """Shape, body colours and gloss of an object, from photographs taken all around it under known lamps.

    The surface is the zero of a signed distance on a lattice, its body colour one of each node; β, γ and n of
    Torrance–Sparrow are those of one material. Fuzzy matter has an extinction and an axis of fibres at each node
    instead. They move until photographs are explained, by the derivative of their light; each pixel counts by its
    variance. Photographs without lamps are those of fixed unknown light: the light that a place sends out then stands
    for its body colour. Interrupted (KeyboardInterrupt), it gives what there is.
    `InputError` for fewer than three views, silhouettes that meet nowhere, a lattice too large for the memory, and
    photographs of other than one or three channels.

    work: file (.npz) of what was found so far. It is written from time to time and removed at the end. Where it exists,
    the work goes on from it, and ends with the bits that it would have had.
    scheduler: whose workers take the pixels of each step, see `workers_of`; by default this process does. The bits are
    the same.

        recovered = hg.recover("capture")
        recovered.box().save("box.zarr")
    """
    settings = settings or RecoverySettings()
    taken = capture if isinstance(capture, Capture) else load_capture(capture)
    photographs, dark = with_light(checked(taken))
    views = views_of(photographs)
    check_not_cut(views)
    offset = mask_offset(views) if settings.matter == "surface" else None  # outlines of fibres are nowhere
    if offset is not None and (settings.refine == AUTO or "masks" in parts_of(settings.refine)):
        views, offset = with_masks_moved(views, offset), replace(offset, moved=True)
    views = without_mixed_pixels(views) if settings.matter == "surface" else views
    if views[0].stated:
        check_agree(outlines_of(views))
    aside = kept_aside(len(views), settings.keep)
    used, kept = (tuple(v for v, out in zip(views, aside, strict=True) if out == which) for which in (False, True))
    lit = any(p.lamps for p in photographs)
    _check_lamps_of(settings.refine, lit)
    _check_light_of(settings, lit)
    if settings.orders == "all" and not lit:
        raise InputError(
            "orders is 'all', but no photograph has a lamp, whose light it is: give lamps, or orders first"
        )
    kept_work = Work(None if work is None else Path(work), photographs, asdict(settings))
    with here_or_on(scheduler) as workers:
        matter, look, run = _first_looks(used, settings, lit, RecoveryRun(progress, kept_work, workers))
        found = _recovered(used, kept, settings, matter, look, run)
    if found.complete:
        kept_work.end()
    found = found if offset is None else _with_doubt(found, offset)
    if found.errors is not None and found.beyond:
        found = replace(found, errors=found.errors.with_doubt(abs(found.beyond)))
    return replace(found, name=taken.own_name, assumptions=dict(taken.assumptions), dark=dark)


def _first_looks(
    used: Views, settings: RecoverySettings, lit: bool, run: RecoveryRun
) -> tuple[FoundMatter, Look, RecoveryRun]:
    """The law of the matter, what is estimated beside the object, and the run of what is left to be done."""
    coarse = replace(settings, side=min(SIDE, settings.side), errors=False)
    work = run.work
    matter = work.found.matter or FoundMatter(
        "fuzzy" if settings.matter == "fuzzy" else "surface",
        "places" if settings.gloss == "places" else "one",
        "all" if settings.orders == "all" else "first",
    )
    known = work.found.look or FoundLook(parts_of(settings.refine))
    trials = [name for name in TRIALS if getattr(settings, name) == AUTO and lit and settings.matter != "fuzzy"]
    looks = (not lit) + (settings.matter == AUTO) + len(trials)

    def looked_at(number: int) -> Callable[..., Recovered]:
        own = run.part(LOOK_SHARE * number, LOOK_SHARE, "first look")

        def recovered(some: Views, others: Views, tried: FoundMatter, start: FoundLook) -> Recovered:
            return _recovered(some, others, coarse, tried, start.of_views(some), own.without_file())

        return recovered

    if not lit and work.found.look is None:
        light, first = "even" if matter.law == "fuzzy" else settings.light, looked_at(0)
        known = first_look(
            used, light, settings.refine, lambda a, b, start: first(a, b, FoundMatter(matter.law), start)
        )
        work.keep(look=known)
    if settings.matter == AUTO:
        if work.found.matter is None:
            plain, second = FoundLook(known.parts, cameras=known.cameras), looked_at(int(not lit))

            def by_law(some: Views, others: Views, law: Law) -> Recovered:
                return second(
                    some, others, FoundMatter(law, orders=matter.orders), known if law == "surface" else plain
                )

            tried = law_of(used, by_law)
            kept = matter if tried.law == "surface" else FoundMatter("fuzzy")
            matter = replace(kept, tried=tried.tried)
            work.keep(matter=matter)
        known = known if matter.law == "surface" else FoundLook(known.parts, cameras=known.cameras)
    for number, name in enumerate(trials, looks - len(trials)):
        if matter.law == "surface" and not getattr(matter, f"{name}_tried"):
            matter = tried_on_surface(name, used, matter, known, looked_at(number))
            work.keep(matter=matter)
    return matter, known.of_views(used), run.part(LOOK_SHARE * looks, 1.0 - LOOK_SHARE * looks)


def _recovered(
    used: Views,
    kept: Views,
    settings: RecoverySettings,
    matter: FoundMatter,
    look: Look,
    run: RecoveryRun,
) -> Recovered:
    """What is recovered of views that are used, by what first looks found."""
    run.progress(0.0, "hull")
    work = run.work
    levels, unit = _levels(used, settings, matter, look, settings.rays, run.workers)
    both = settings.errors and len(used) >= 2 * LEAST_VIEWS
    known, errors, halves = work.found.known, None, []
    try:
        of_whole = run.part(0.0, WHOLE_SHARE if both else 1.0)
        descent = levels.run(settings.steps, of_whole.progress, work.keeps(WHOLE), work.found.checkpoints.get(WHOLE))
        if known is None and descent is not None:
            coarser = levels.before.gloss if len(levels.sides) > 1 else None
            seen = slopes_in(descent)
            one = matter.law == "surface" and matter.gloss == "one" and descent.lamps.each
            none = bool(one and feigned(seen[0]))
            known = evidence_of(descent, seen, None if none else coarser)  # levels differ in what is no gloss
            if none:
                most = known.materials(descent.gloss)[0]["interval_95"]["beta"][1]
                known = replace(known, most_beta=most * unit)
                further = run.part(WHOLE_SHARE if both else 1.0, 0.0, "without gloss")
                levels.without_gloss(max(round(FURTHER * settings.steps), 1), further.progress)
            elif matter.law == "surface" and descent.lamps.each:
                known = known.with_change(pixel_gloss(descent) - descent.gloss)
            work.keep(known=known, checkpoints={WHOLE: levels.end})
        if both:
            of_halves = run.part(WHOLE_SHARE, 1.0 - WHOLE_SHARE, "errors")
            halves = _halves(levels, unit, settings, matter, of_halves)
            before = levels.before.surface() if len(levels.sides) > 1 else None
            errors = errors_of(
                levels.shape.surface(), [half.surface() for half in halves], before, matter.law == "fuzzy"
            ).counted_back(unit)
            errors = errors if known is None else errors.where_lit(known.photographs)
    except KeyboardInterrupt:
        if levels.descent is None and levels.start is levels.before:
            raise
    shape, look = counted_back(levels.shape, unit), levels.look
    found = shape.surface().in_order()
    if known is not None:
        known = known.in_order(order_of(shape.gloss))
        known = known.with_halves(*(half.gloss[order_of(half.gloss)] for half in halves)) if halves else known
        known = known if errors is None else known.with_normals(found.gloss, errors.normal)
        errors = errors and errors.with_colour_doubt(unit * known.colour_doubt(found.gloss))
    used, kept = _changed(used, look), _changed(kept, look)
    return Recovered(
        found.lattice, np.asarray(without_crumbs(found.distance), np.float32), found.colours, found.gloss,
        levels.softness, tuple(v.photograph for v in used), kept, any(v.photograph.lamps for v in used),
        asdict(settings), stated=used[0].stated, evidence=known, errors=errors,
        complete=known is not None and (errors is not None or not both), look=look,
        fuzzy=shape if isinstance(shape, FuzzyShape) else None, matter_tried=matter.tried, shares=found.shares,
        gloss_tried=matter.gloss_tried, orders=matter.orders, orders_tried=matter.orders_tried, hollow=levels.hollow,
    )  # fmt: skip


def _with_doubt(found: Recovered, offset: MaskOffset) -> Recovered:
    """What was recovered from masks that are off: positions are known as well as outlines are."""
    pixel = np.median(
        [np.linalg.norm(p.camera.position - found.lattice.middle) / min(p.camera.focal) for p in found.photographs]
    )
    doubt = float(pixel) * (offset.error if offset.moved else abs(offset.pixels))
    return replace(found, masks=offset, errors=None if found.errors is None else found.errors.with_doubt(doubt))


def _levels(
    views: Views,
    settings: RecoverySettings,
    matter: FoundMatter,
    look: Look,
    rays: int,
    workers: Workers,
    no_gloss: bool = False,
    unit: float | None = None,
) -> tuple[Levels, float]:
    """The levels of some views, from their hull, and the unit in which they count body colours.

    no_gloss: whether the object is known to be matt. unit: in which views are counted already, if they are.
    """
    seen = _changed(views, look)
    outlines, stated = outlines_of(seen), views[0].stated
    misses = 0 if stated else misses_of(outlines)
    low, high = box_of(outlines, misses)
    finest = Lattice.around(low, high, settings.side)
    _check_room(matter, settings.side, finest)
    sides = sides_of(settings.side)
    lattice = Lattice.around(low, high, sides[0])
    hull = hull_distance(outlines, lattice, misses)
    if stated:
        check_all_show_it(outlines, lattice, hull)
    check_lamps([view.photograph for view in seen], lattice, hull)
    start = SHAPES[matter.law].of_hull(lattice, hull)
    if isinstance(start, SurfaceShape) and matter.gloss == "places":
        start = start.with_two_glosses()
    start = replace(start, gloss=matt(start.gloss)) if no_gloss else start
    own = colour_unit(seen, lattice.middle) if unit is None else unit
    counted = views if unit is not None else [counted_in(view, own) for view in views]
    albedo = own if matter.orders == "all" and matter.law == "surface" else None
    return Levels(counted, start, sides, rays, settings.seed, settings.shadows, look, workers, albedo), own


def _check_room(matter: FoundMatter, side: int, lattice: Lattice) -> None:
    """`InputError` for a lattice that is larger than the memory: how many nodes would fit."""
    each = BYTES_PER_NODE[matter.law] + BYTES_OF_SHARES * (matter.gloss == "places")
    need, free = each * float(np.prod(lattice.shape)), free_memory()
    if need > SHARE_OF_MEMORY * free:
        fits = int(side * (SHARE_OF_MEMORY * free / need) ** (1.0 / 3.0)) - 1  # an edge may have a node more
        raise InputError(
            f"a lattice of {side} nodes along its edge needs {need / 2**30:.3g} GiB of memory and "
            f"{free / 2**30:.3g} GiB are free: "
            + (f"--side {fits} would fit" if fits >= LEAST_SIDE else "no lattice would fit")
        )


def _halves(
    whole: Levels, unit: float, settings: RecoverySettings, matter: FoundMatter, run: RecoveryRun
) -> list[MatterShape]:
    """What each half of the photographs gives, from which the errors of what all gave follow. unit: of body colours."""
    halves, work = [], run.work
    for number, (name, views) in enumerate(zip(HALVES, halves_of(whole.views), strict=True)):
        keep = work.keeps(name)
        look = FoundLook.of(whole.look).of_views(views)
        no_gloss = is_matt(whole.shape.gloss)
        half, _ = _levels(views, settings, matter, look, settings.rays // 2, run.workers, no_gloss, unit)
        own = run.part(0.5 * number, 0.5)
        half.run(settings.steps, own.progress, keep, work.found.checkpoints.get(name))
        keep(half.end)
        halves.append(half.shape)
    return halves


def halves_of(views: Sequence[ObjectView]) -> tuple[Views, Views]:
    """Every second view, and the others. Photographs from one pose have errors in common, such as of their outline, and
    are in one half, if each half has poses enough: otherwise every second photograph.
    """
    poses = list(dict.fromkeys(view.photograph.camera.world_to_camera.tobytes() for view in views))
    by_pose = len(poses) >= 2 * LEAST_POSES
    number = [poses.index(v.photograph.camera.world_to_camera.tobytes()) if by_pose else k for k, v in enumerate(views)]
    first, second = (tuple(v for k, v in zip(number, views, strict=True) if k % 2 == half) for half in (0, 1))
    return first, second


def _changed(views: Views, look: Look) -> Views:
    """Views with the cameras and lamps that were found."""
    return tuple(replace(view, photograph=look.of(view.photograph)) for view in views)


def _check_light_of(settings: RecoverySettings, lit: bool) -> None:
    if not lit and settings.gloss == "places":
        raise InputError("gloss is 'places', but no photograph has a lamp that could show it: give lamps, or gloss one")
    if not lit and settings.matter == "fuzzy" and settings.light not in (AUTO, "even"):
        raise InputError(
            f"light is {settings.light!r}, which is by the normal, and fuzzy matter has none: give light even"
        )


def _check_lamps_of(refine: str, lit: bool) -> None:
    if not lit and {"lamps", "exposure", "places"} & set(parts_of(refine)):
        raise InputError(
            f"refine is {refine!r}, but no photograph has a lamp that could be refined: give lamps, or "
            f"refine {NONE}, turn or cameras"
        )
