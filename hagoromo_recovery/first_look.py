"""First look: what unknown light is fixed to, by how much all cameras turn, whether the matter has a surface, whether
its gloss differs from place to place, and whether parts of it light each other.

Each kind of light, law of matter, kind of gloss and orders of light recovers the object on a coarse lattice from a part
of the photographs; the one that predicts the others best is taken. Photographs that the user keeps aside take no part.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple, TypeAlias, get_args

import numpy as np

from hagoromo_recovery.choices import AUTO, FoundMatter, Law, Light, parts_of
from hagoromo_recovery.descent.look import FoundLook
from hagoromo_recovery.given import kept_aside
from hagoromo_recovery.outline.object_view import ObjectView

if TYPE_CHECKING:
    from hagoromo_recovery.recovered import Recovered

Views: TypeAlias = tuple[ObjectView, ...]
KINDS: tuple[Light, ...] = ("even", "object", "camera")
SIDE = 48  # nodes along the longest edge
KEEP = 5  # every how many photographs one judges
FUZZY_BETTER = 0.5  # dB by which matter without a surface must predict better than a surface
BETTER = 0.2  # dB by which a light that depends on the normal, or a turn of the cameras, must predict better than none


class Trial(NamedTuple):
    """What is tried of a surface: its usual kind, the other one, and dB by which that must predict better."""

    usual: str
    other: str
    better: float


TRIALS = {"gloss": Trial("one", "places", 0.1), "orders": Trial("first", "all", 0.1)}  # by field of `FoundMatter`


def first_look(
    views: Sequence[ObjectView], kind: Light, refine: str, coarse: Callable[[Views, Views, FoundLook], Recovered]
) -> FoundLook:
    """The light of some views, and what is refined. coarse: recovers from used views and kept ones, from a look on.

    A turn of all cameras is taken where it predicts better, if `refine` leaves that open: the hull is made anew with it
    before it is judged. `KeyboardInterrupt` where a coarse recovery was interrupted: there is nothing to give yet.
    """
    used, kept = judged(views)
    open_yet = refine == AUTO and bool(kept)
    parts = ("turn",) if open_yet else parts_of(refine)
    found: dict[Light, Recovered] = {}
    for each in KINDS if kind == "auto" and kept else ("even" if kind == "auto" else kind,):
        start = FoundLook(parts, each if each == "object" or each == "camera" else None)
        found[each] = _complete(coarse(used, kept, start))
    tried = {each: _psnr(one) for each, one in found.items()} if kept else {}
    best = max(found, key=lambda each: tried.get(each, 0.0) - (0.0 if each == "even" else BETTER))
    if open_yet:
        turned = FoundLook.of(found[best].look)
        starts = FoundLook(parts, turned.frame, cameras=turned.cameras), FoundLook((), turned.frame)
        again, stated = (_complete(coarse(used, kept, start)) for start in starts)
        found[best] = again if _psnr(again) >= _psnr(stated) + BETTER else stated
    return replace(FoundLook.of(found[best].look), tried={str(each): score for each, score in tried.items()})


def law_of(views: Sequence[ObjectView], coarse: Callable[[Views, Views, Law], Recovered]) -> FoundMatter:
    """Whether the matter of some views has a surface. coarse: recovers from used views and kept ones, by a law."""
    tried = _tried(views, get_args(Law), coarse)
    fuzzy = bool(tried) and tried["fuzzy"] >= tried["surface"] + FUZZY_BETTER
    return FoundMatter("fuzzy" if fuzzy else "surface", tried=tried)


def tried_on_surface(
    name: str,
    views: Sequence[ObjectView],
    found: FoundMatter,
    look: FoundLook,
    coarse: Callable[[Views, Views, FoundMatter, FoundLook], Recovered],
) -> FoundMatter:
    """`found` with the kind of `name`, of TRIALS, that predicts kept views better, and what both predict.

    coarse: recovers from used views and kept ones, by a kind of matter, beside what is estimated in `look`.
    """

    def recovered(used: Views, kept: Views, kind: str) -> Recovered:
        return coarse(used, kept, _with_kind(found, name, kind), look)

    trial = TRIALS[name]
    tried = _tried(views, (trial.usual, trial.other), recovered)
    better = bool(tried) and tried[trial.other] >= tried[trial.usual] + trial.better
    return _with_kind(found, name, trial.other if better else trial.usual, tried)


def _with_kind(found: FoundMatter, name: str, kind: str, tried: dict[str, float] | None = None) -> FoundMatter:
    """`found` with another kind of `name`, and PSNR [dB] of each that was tried."""
    changed: dict[str, Any] = {name: kind} | ({} if tried is None else {f"{name}_tried": tried})
    return replace(found, **changed)


def _tried(
    views: Sequence[ObjectView], kinds: Sequence[str], coarse: Callable[[Views, Views, Any], Recovered]
) -> dict[str, float]:
    """PSNR [dB] of kept views by each kind of what is recovered; nothing where there are too few views to keep one."""
    used, kept = judged(views)
    return {kind: _psnr(_complete(coarse(used, kept, kind))) for kind in kinds} if kept else {}


def judged(views: Sequence[ObjectView]) -> tuple[Views, Views]:
    """The views that coarse recoveries use, and those that judge them."""
    aside = kept_aside(len(views), KEEP)
    used, kept = (tuple(v for v, out in zip(views, aside, strict=True) if out == which) for which in (False, True))
    return used, kept


def _complete(found: Recovered) -> Recovered:
    if not found.complete:
        raise KeyboardInterrupt
    return found


def _psnr(found: Recovered) -> float:
    """Mean over the photographs that judge [dB]."""
    return float(np.mean([score.psnr for score in found.scores()]))
