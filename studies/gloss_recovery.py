"""Recoveries of objects whose gloss differs from place to place, by one gloss and by one of each place.

Parts of the object of `recover_scenes` are glazed (β 2.2, γ 0.1), others are mat (β 0.15, γ 0.3), and between both ln β
and ln γ change evenly with the share of glaze.
"""

from __future__ import annotations

import functools
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, NamedTuple, TypeAlias

import drjit as dr
import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.backend import arrays, vectors
from hagoromo_recovery.choices import GlossChoice
from studies.fuzzy_recovery import FAR, NEAR, SEED
from studies.recover_scenes import Simulated, TrueObject, shots, simulated
from studies.recovery_scores import TWO_SIDED, box_psnr, places, psnr, shape_errors

Array = NDArray[np.float64]
GLAZED, MAT = (2.2, 0.1), (0.15, 0.3)  # β and γ
Medians: TypeAlias = tuple[float | None, float | None]  # of the glazed and of the mat region; None where there is none
REGION = 0.1  # share of glaze up to which a place counts as mat, and from 1 as glazed


class Glaze(TrueObject):
    """The object of the study of recovery, glazed in parts. share: of glaze at points, 0 … 1."""

    def __init__(self, share: Callable[[Any], Any]) -> None:
        super().__init__(*GLAZED)
        self.share = share

    def gloss(self, p: Any) -> tuple[Any, Any]:
        """β and γ: their logarithms are linear in the share of glaze."""
        share = self.share(p)
        beta, gamma = (mat * dr.power(glazed / mat, share) for glazed, mat in zip(GLAZED, MAT, strict=True))
        return beta, gamma


def halves(p: Any) -> Any:
    """The upper half is glazed, with a sharp border."""
    return dr.select(p.z > 0.0, 1.0, arrays().Float(0))


def spots(p: Any) -> Any:
    """Glazed spots of about 1 cm, with sharp borders."""
    wave = dr.sin(260.0 * p.x + 0.5) * dr.sin(240.0 * p.y) * dr.cos(220.0 * p.z + 0.3)
    return dr.select(dr.abs(wave) > 0.35, 1.0, arrays().Float(0))


def smooth(p: Any) -> Any:
    """The share of glaze changes evenly."""
    return 0.5 + 0.5 * dr.sin(70.0 * p.x + 50.0 * p.z + 0.4)


def everywhere(p: Any) -> Any:
    """One gloss, that of glaze."""
    return 1.0 + 0.0 * p.x


class GlossCase(NamedTuple):
    """Where the object is glazed, how it is recovered, whether errors are stated, and nodes."""

    share: Callable[[Any], Any]
    gloss: GlossChoice
    errors: bool = False
    side: int = 64


SHARES = (halves, spots, smooth, everywhere)
GLOSS_CASES = {
    f"{share.__name__}_{gloss}": GlossCase(share, gloss) for share in SHARES for gloss in ("one", "places", "auto")
} | {"halves_errors": GlossCase(halves, "places", True)}


@dataclass(frozen=True)
class GlossRow:
    """Scores of a case. new, far, normals, surface, seconds: see `RecoveryRow`. box: how much worse its box shows the
    former through `render` [dB]. found: what the object was recovered by. beta, gamma: medians of found over true
    values in the glazed and in the mat region; spread: medians of the absolute logarithm of that, of β and γ in both
    regions. covered: share [%] of true points whose 95 % intervals of β and of γ hold the truth.
    """

    case: str
    side: int
    found: str
    new: float
    far: float
    box: float
    normals: float
    surface: float
    beta: Medians
    gamma: Medians
    spread: tuple[Medians, Medians]
    covered: tuple[float, float] | None
    tried: dict[str, float]
    seconds: float


@functools.cache
def gloss_captures(share: Callable[[Any], Any]) -> tuple[Glaze, Simulated, Simulated, Simulated]:
    """The object, its photographs with noise, and exact ones under new lamps like those, and from the side."""
    truth = Glaze(share)
    new, far = (simulated(truth, shots(8, *lamps, seed), noise=False) for lamps, seed in ((NEAR, 2), (FAR, 3)))
    return truth, simulated(truth, shots(36, *NEAR, SEED), SEED), new, far


def _of_regions(values: Array, regions: tuple[NDArray[np.bool_], NDArray[np.bool_]]) -> Medians:
    """Medians of values in both regions."""
    glazed, mat = (float(np.median(values[where])) if where.any() else None for where in regions)
    return glazed, mat


def gloss_covered(found: hg.Recovered, at: Any, off: Array) -> tuple[float, float] | None:
    """Share [%] of places whose 95 % intervals of β and γ hold the truth. off: (2, n) found less true logarithms."""
    if found.errors is None or found.errors.gloss is None:
        return None
    errors = found.errors.gloss.reshape(-1, 2)[found.surface_field.nearest_node(at)].T
    held = np.where(np.isfinite(errors), np.abs(off) < TWO_SIDED * errors, np.nan)
    beta, gamma = 100.0 * np.nanmean(held, axis=1)
    return float(beta), float(gamma)


def measured_gloss(case: str) -> GlossRow:
    """Recover an object from 36 views, a near lamp each, and compare it with eight new views of each kind."""
    given = GLOSS_CASES[case]
    truth, taken, new, far = gloss_captures(given.share)
    begin = time.process_time()
    asked = hg.RecoverySettings(side=given.side, keep=0, errors=given.errors, gloss=given.gloss)
    found = hg.recover(taken.capture, asked)
    seconds, scores = time.process_time() - begin, (psnr(found, new), psnr(found, far))
    shown = shape_errors(found, new)
    at, points = places(found, shown.points), vectors(shown.points)
    own = found.gloss_at(at)
    true = np.log([np.broadcast_to(np.array(each, float), len(shown.points)) for each in truth.gloss(points)])
    off = np.log(own) - true
    share = np.broadcast_to(np.array(truth.share(points)), len(shown.points))
    regions = share > 1.0 - REGION, share < REGION
    ratio = [_of_regions(np.exp(row), regions) for row in off]
    spread = [_of_regions(np.abs(row), regions) for row in off]
    edge = max(found.lattice.shape) * found.lattice.voxel
    return GlossRow(
        case, given.side, "one" if found.shares is None else "places", *scores,
        scores[0] - box_psnr(found, new), float(shown.angles.mean()), 100.0 * float(shown.distances.mean()) / edge,
        ratio[0], ratio[1], (spread[0], spread[1]), gloss_covered(found, at, off), dict(found.gloss_tried), seconds,
    )  # fmt: skip
