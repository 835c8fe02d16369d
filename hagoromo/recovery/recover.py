"""Recover: a capture of many views and lamps → shape, body colours and gloss of the object."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.photograph.capture import Capture, load_capture
from hagoromo.progress import Progress, part_of, silent
from hagoromo.recovery.errors import Errors, errors_of
from hagoromo.recovery.evidence import evidence_of
from hagoromo.recovery.given import LEAST_VIEWS, check_lamps, check_not_cut, checked, kept_aside
from hagoromo.recovery.hull import Outline, box_of, check_all_show_it, hull_distance, outlines_of, without_crumbs
from hagoromo.recovery.lattice import Lattice
from hagoromo.recovery.levels import Levels, Shape, sides
from hagoromo.recovery.pixel_table import CHUNK
from hagoromo.recovery.recovered import Recovered
from hagoromo.recovery.silhouettes import views_of

LEAST_SIDE, LARGEST_SIDE = 16, 512  # nodes along the longest edge
BYTES_PER_NODE = 90.0  # of all arrays together
WHOLE_SHARE = 0.55  # of the work, of what is not done for the errors


@dataclass(frozen=True)
class RecoverySettings:
    """side: nodes of the lattice along the object's longest edge. steps: of each level of the lattice, coarse to fine.
    rays: of each step. keep: every how many photographs one is kept aside, to be predicted; 0: none. shadows: whether
    the object's own shadows are taken into account. errors: whether each half of the photographs gives an object of its
    own, too, so that the errors of places are known: that doubles the time. seed: of the pixels that are drawn.
    """

    side: int = 128
    steps: int = 80
    rays: int = 1 << 16
    keep: int = 8
    shadows: bool = True
    errors: bool = True
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
    views = views_of(photographs)
    check_not_cut(views)
    aside = kept_aside(len(views), settings.keep)
    used, kept = (tuple(v for v, out in zip(views, aside, strict=True) if out == which) for which in (False, True))
    outlines = outlines_of(used)
    progress(0.0, "hull")
    lattices = _lattices(outlines, used[0].stated, settings.side)
    start = Shape.of_hull(lattices[0], hull_distance(outlines, lattices[0], used[0].stated))
    if used[0].stated:
        check_all_show_it(outlines, lattices[0], start.distance)
    check_lamps([view.photograph for view in used], lattices[0], start.distance)
    levels = Levels(used, lattices, start, settings.rays, settings.seed, settings.shadows)
    both = settings.errors and len(used) >= 2 * LEAST_VIEWS
    known, errors = None, None
    try:
        descent = levels.run(settings.steps, part_of(progress, 0.0, WHOLE_SHARE if both else 1.0, ""))
        known = evidence_of(descent, levels.before.gloss if len(lattices) > 1 else None)
        if both:
            own = part_of(progress, WHOLE_SHARE, 1.0 - WHOLE_SHARE, "errors")
            errors = _errors(levels, outlines, settings, own)
    except KeyboardInterrupt:
        if levels.descent is None:
            raise
    found = levels.shape
    return Recovered(
        found.lattice, np.asarray(without_crumbs(found.distance), np.float32), found.colours, found.gloss,
        levels.descent.rendering.softness, tuple(v.photograph for v in used), kept, any(p.lamps for p in photographs),
        asdict(settings), taken.name, dict(taken.assumptions), used[0].stated, known, errors,
        complete=known is not None and (errors is not None or not both),
    )  # fmt: skip


def _lattices(outlines: Sequence[Outline], stated: bool, side: int) -> list[Lattice]:
    """The lattices of all levels."""
    low, high = box_of(outlines, stated)
    lattices = [Lattice.around(low, high, each) for each in sides(side)]
    require(BYTES_PER_NODE * float(np.prod(lattices[-1].shape)), f"a lattice of {side} nodes along its edge")
    return lattices


def _errors(whole: Levels, outlines: Sequence[Outline], settings: RecoverySettings, progress: Progress) -> Errors:
    """The errors of what all photographs gave, by what each half of them gives."""
    halves, stated = [], whole.views[0].stated
    for number in range(2):
        hull = hull_distance(outlines[number::2], whole.lattices[0], stated)
        start = Shape.of_hull(whole.lattices[0], hull)
        half = Levels(
            whole.views[number::2], whole.lattices, start, settings.rays // 2, settings.seed, settings.shadows
        )
        half.run(settings.steps, part_of(progress, 0.5 * number, 0.5, "errors"))
        halves.append(half.shape)
    return errors_of(whole.shape, halves, whole.before if len(whole.lattices) > 1 else None)
