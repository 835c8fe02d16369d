"""First look: what unknown light is fixed to, and by how much all cameras turn, from coarse recoveries.

Each kind of light recovers the object on a coarse lattice from a part of the photographs; the kind that predicts the
others best is taken. Photographs that the user keeps aside take no part.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

import numpy as np
from numpy.typing import NDArray

from hagoromo.recovery.camera_turn import CameraTurn
from hagoromo.recovery.choices import Light, Refine
from hagoromo.recovery.given import kept_aside
from hagoromo.recovery.object_view import ObjectView
from hagoromo.recovery.unknown_light import Frame, UnknownLight

if TYPE_CHECKING:
    from hagoromo.recovery.recovered import Recovered

Turn: TypeAlias = NDArray[np.float64]  # (3,) of all cameras, a rotation vector [rad]
KINDS: tuple[Light, ...] = ("even", "object", "camera")
SIDE = 48  # nodes along the longest edge
KEEP = 5  # every how many photographs one judges
BETTER = 0.2  # dB by which a light that depends on the normal, or a turn of the cameras, must predict better than none


@dataclass(frozen=True, eq=False)
class Look:
    """unknown: see `Recovered`. turn: of all cameras. tried: PSNR [dB] of each kind of light that was tried."""

    unknown: UnknownLight | None
    turn: CameraTurn | None
    tried: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class FoundLook:
    """A first look as plain data. frame: of unknown light that depends on the normal."""

    frame: Frame | None
    coefficients: NDArray[np.float64] | None
    turn: NDArray[np.float64] | None
    tried: dict[str, float]

    def of_views(self, views: Sequence[ObjectView]) -> Look:
        """The look again, at some views."""
        photographs = [view.photograph for view in views]
        light = None if self.frame is None else UnknownLight(self.frame, photographs, self.coefficients)
        turn = None if self.turn is None else CameraTurn(photographs, self.turn)
        return Look(light, turn, self.tried)

    @staticmethod
    def of(look: Look) -> FoundLook:
        """That of a look."""
        light, turn = look.unknown, look.turn
        return FoundLook(
            None if light is None else light.frame,
            None if light is None else light.coefficients,
            None if turn is None else turn.vector,
            dict(look.tried),
        )


def unknown_light(kind: Light, views: Sequence[ObjectView]) -> UnknownLight | None:
    """A light to start from; None for an even one."""
    return UnknownLight(kind, [v.photograph for v in views]) if kind == "object" or kind == "camera" else None


def first_look(
    views: Sequence[ObjectView],
    kind: Light,
    refine: Refine,
    coarse: Callable[[tuple[ObjectView, ...], tuple[ObjectView, ...], UnknownLight | None, Turn | None], Recovered],
) -> FoundLook:
    """The light and the turn of some views. coarse: recovers from used views and kept ones under a kind of light, with
    cameras that turn further from a turn, or that stay (None). A turn is taken where it predicts better, if `refine`
    leaves that open: the hull is made anew with it before it is judged.

    `KeyboardInterrupt` where a coarse recovery was interrupted: there is nothing to give yet.
    """
    aside = kept_aside(len(views), KEEP)
    used, kept = (tuple(v for v, out in zip(views, aside, strict=True) if out == which) for which in (False, True))
    found: dict[Light, Recovered] = {}
    turn = None if refine == "none" else np.zeros(3)
    for each in KINDS if kind == "auto" and kept else ("even" if kind == "auto" else kind,):
        found[each] = _complete(coarse(used, kept, unknown_light(each, used), turn))
    tried = {each: _psnr(one) for each, one in found.items()} if kept else {}
    best = max(found, key=lambda each: tried.get(each, 0.0) - (0.0 if each == "even" else BETTER))
    if (turned := found[best].turn) is not None and refine == "auto" and kept:
        again, stated = (
            _complete(coarse(used, kept, unknown_light(best, used), each)) for each in (turned.vector, None)
        )
        found[best] = again if _psnr(again) >= _psnr(stated) + BETTER else stated
    return FoundLook.of(Look(found[best].unknown, found[best].turn, tried))


def _complete(found: Recovered) -> Recovered:
    if not found.complete:
        raise KeyboardInterrupt
    return found


def _psnr(found: Recovered) -> float:
    """Mean over the photographs that judge [dB]."""
    return float(np.mean([score.psnr for score in found.scores()]))
