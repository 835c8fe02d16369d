"""Evidence: how well photographs know what was recovered from them.

Errors of pixels of one photograph are alike (a pose, a lamp, the model), so the covariance of the gloss is estimated
from what each photograph as a whole would change (the sandwich of Huber 1967, clustered by photograph), after the body
colour of each place has been fitted to it. What changed between the last two levels of the lattice is added, and what
all photographs have in common: that a pixel has an area, and that normals are a little off.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy import ndimage

from hagoromo.least_squares.loss import NORMAL_95
from hagoromo_recovery.descent.descent import Descent
from hagoromo_recovery.descent.gloss_step import GLOSS_RANGE, N_SPREAD, N_USUAL, Slopes, beforehand, without_colours
from hagoromo_recovery.descent.pixel_table import CHUNK
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.shading.shading import GLOSS, START, each_gloss, figures

AT_ONCE = 1 << 12  # chunks
MOST_CHUNKS = 1 << 16  # that are looked at: more would not say more
LIT = 0.02  # light by a body colour, of that of bright pixels, from which a photograph shows a place lit
BRIGHT = 90  # percentile of pixels that are bright
FEIGNED = 1.0 / 3.0  # of the squared residual where its light is, that a gloss must explain to be one
AROUND = 1.0  # voxels, standard deviation of means over places
IDENTIFIABLE = 0.5  # standard error of a logarithm up to which a parameter counts as known by the photographs


@dataclass(frozen=True, eq=False)
class Evidence:
    """covariance: of the gloss, see `NodeShading`. photographs: (nz, ny, nx) that show each place of the surface lit.
    most_beta: upper end of the 95 % interval of the β that was fitted, where the object is taken for matt; None: it has
    a gloss. in_its_place: (nz, ny, nx, 3, glosses) body colour that would send the light of each gloss; None: that is
    not known.
    """

    covariance: NDArray[np.float64]
    photographs: NDArray[np.int32]
    most_beta: float | None = None
    in_its_place: NDArray[np.float32] | None = None

    def in_order(self, order: list[int]) -> Evidence:
        """With the numbers of the gloss in another order."""
        held = self.in_its_place if self.in_its_place is None or order[0] == 0 else self.in_its_place[..., ::-1]
        return replace(self, covariance=self.covariance[np.ix_(order, order)], in_its_place=held)

    def with_halves(self, first: NDArray[np.floating], second: NDArray[np.floating]) -> Evidence:
        """With the gloss that each half of the photographs gives: the square of half of what they differ by counts as
        variance, too. It holds where the descent of each ended, which no slope of the photographs shows.
        """
        return replace(self, covariance=self.covariance + np.diag((0.5 * (np.asarray(first) - second)) ** 2))

    def with_change(self, change: NDArray[np.floating]) -> Evidence:
        """With what the numbers of the gloss may all be off by together: its square counts as variance."""
        return replace(self, covariance=self.covariance + np.outer(change, change))

    def with_normals(self, gloss: NDArray[np.floating], errors: NDArray[np.floating]) -> Evidence:
        """With what errors of normals do to the gloss. errors: (nz, ny, nx) [rad], root of the mean square angle.

        Normals that are off by a mean square of e² spread a highlight as facets do: γ² looks larger by ln 2 · e², and
        its peak, β, lower in proportion. All highlights of the object do so alike, so the change counts as variance.
        """
        there = np.isfinite(errors) & (self.photographs > 0)
        if not there.any():
            return self
        square = float(np.mean(errors[there] ** 2))
        known = self
        for one in each_gloss(gloss):
            wider = 0.5 * np.log1p(np.log(2.0) * square / np.exp(2.0 * gloss[one[1]]))
            change = np.zeros(len(self.covariance))
            change[one[0]], change[one[1]] = -2.0 * wider, wider
            known = known.with_change(change)
        return known

    def colour_doubt(self, gloss: NDArray[np.floating]) -> NDArray[np.float32] | float:
        """Standard errors (nz, ny, nx, 3) of body colours by those of the weights of glosses: what is no gloss is body.

        A gloss whose weight is not known at all may be none: its whole light is in doubt, and no more than that.
        """
        if self.in_its_place is None or self.most_beta is not None:
            return 0.0
        betas = [one[0] for one in each_gloss(gloss)]
        share = np.minimum(np.sqrt(np.diag(self.covariance)[betas]), 1.0)
        return np.asarray(np.sqrt(((share * self.in_its_place) ** 2).sum(axis=-1)), np.float32)

    def materials(self, gloss: NDArray[np.floating]) -> list[dict[str, Any]]:
        """Each gloss with standard errors and 95 % intervals, with the keys of materials.json."""
        if self.most_beta is not None:
            return [_matt_material(self.most_beta)]
        errors = np.sqrt(np.diag(self.covariance))
        return [_material(np.asarray(gloss)[one], errors[one]) for one in each_gloss(gloss)]


def feigned(slopes: Slopes) -> bool:
    """Whether one gloss may be an error of the model, such as at outlines: where its light is, the squared residual
    would grow by less than a share of FEIGNED without it. Light is linear in β, so its slope by ln β is the gloss.

    Pixels count by the square of the light of the gloss that no body colour explains.
    """
    free, left = without_colours(slopes)
    gloss = free[..., 0]
    held = float((gloss**2 * left**2).sum())
    return float((gloss**2 * (left + gloss) ** 2).sum()) < (1.0 + FEIGNED) * held


def slopes_in(descent: Descent) -> tuple[Slopes, float]:
    """Slopes of the pixels of a descent, or of many of them, and how many each of these stands for."""
    total = descent.pixels.count // CHUNK
    chosen = np.arange(total)
    if total > MOST_CHUNKS:
        chosen = np.sort(np.random.default_rng(0).choice(total, MOST_CHUNKS, replace=False))
    parts = [
        descent.work.slopes(descent.pixels.of(chosen[first : first + AT_ONCE]))
        for first in range(0, len(chosen), AT_ONCE)
    ]
    return Slopes(*(np.concatenate(each) for each in zip(*parts, strict=True))), total / len(chosen)


def evidence_of(descent: Descent, seen: tuple[Slopes, float], coarser: NDArray[np.floating] | None = None) -> Evidence:
    """What the pixels of a descent say of its result.

    seen: its slopes, see `slopes_in`. coarser: the gloss that the level before found; the square of what changed since
    counts as variance, as the lattice has an error, too.
    """
    shape = descent.field.shape
    count = int(np.prod(shape))
    slopes, copies = seen
    numbers = len(descent.gloss)
    gloss = _gloss_covariance(slopes, copies, numbers) if descent.lamps.each else np.zeros((numbers, numbers))
    if coarser is not None and descent.lamps.each:
        gloss = gloss + np.diag((descent.gloss - coarser) ** 2)
    photographs = _photographs(slopes, count).reshape(shape)
    instead = None
    if descent.lamps.each and descent.field.element == "plane":
        instead = _in_its_place(slopes, [one[0] for one in each_gloss(descent.gloss)], shape)
    photographs = ndimage.maximum_filter(photographs, 1 + 2 * descent.field.shown_around)
    return Evidence(gloss, photographs, in_its_place=instead)


def _in_its_place(slopes: Slopes, betas: list[int], shape: tuple[int, ...]) -> NDArray[np.float32]:
    """See `Evidence`; means over neighbours. betas: which slopes are by ln β, and so the light of a gloss itself."""
    found = np.zeros((*shape, COLOURS, len(betas)), np.float32)

    def around(values: NDArray[np.floating]) -> NDArray[np.floating]:
        sums = np.bincount(slopes.node, values, minlength=int(np.prod(shape))).reshape(shape)
        return ndimage.gaussian_filter(sums, AROUND, mode="constant")

    for c in range(COLOURS):
        by = slopes.by_colour[:, c]
        all_of = np.maximum(around(by * by), 1e-30)
        for k, beta in enumerate(betas):
            found[..., c, k] = around(by * slopes.by_gloss[:, c, beta]) / all_of
    return found


def _photographs(slopes: Slopes, count: int) -> NDArray[np.int32]:
    """(count,) photographs that show each node under light of their lamps: in its shadow nothing is known of it."""
    light = slopes.by_colour.max(axis=1, initial=0.0)
    lit = light > (LIT * np.percentile(light, BRIGHT) if light.size else 0.0)
    most = int(slopes.photograph.max(initial=0)) + 1
    pairs = np.unique(slopes.node[lit] * most + slopes.photograph[lit])
    return np.bincount(pairs // most, minlength=count).astype(np.int32)


def _gloss_covariance(slopes: Slopes, copies: float, count: int) -> NDArray[np.float64]:
    """Covariance of the `count` numbers of the gloss by all pixels; shares are held."""
    free, left = without_colours(slopes)
    free = free[:, :, :count]
    matrix = copies * np.einsum("nck,ncl->kl", free, free)
    scores = np.zeros((int(slopes.photograph.max(initial=0)) + 1, free.shape[2]))
    np.add.at(scores, slopes.photograph, copies * np.einsum("nck,nc->nk", free, left))
    scores -= scores.mean(axis=0)
    prior = np.diag(np.maximum(beforehand(free.shape[2]), 1e-6))
    used = max(len(scores), 2)
    spread = used / (used - 1.0) * scores.T @ scores
    sandwich = np.linalg.pinv(matrix) @ spread @ np.linalg.pinv(matrix)
    return np.linalg.inv(np.linalg.pinv(sandwich) + prior)


def _matt_material(most_beta: float) -> dict[str, Any]:
    """No gloss: β is 0 or little, and nothing is known of γ and n."""
    n1, spread = N_USUAL - 1.0, float(np.exp(NORMAL_95 * N_SPREAD))
    ends = {"gamma": np.exp(GLOSS_RANGE[1]).tolist(), "n": [1.0 + n1 / spread, 1.0 + n1 * spread]}
    return {
        **dict(zip(GLOSS, START, strict=True)),
        "beta": 0.0,
        "standard_error": {"beta": most_beta / NORMAL_95, "gamma": ends["gamma"][1], "n": n1 * N_SPREAD},
        "interval_95": {"beta": [0.0, most_beta], **ends},
        "identifiable": dict.fromkeys(GLOSS, False),
    }


def _material(gloss: NDArray[np.floating], errors: NDArray[np.floating]) -> dict[str, Any]:
    """One gloss, with standard errors of the logarithms. One whose β is not identifiable may be none."""
    found = dict(zip(GLOSS, figures(gloss), strict=True))
    low, high = (figures(np.asarray(gloss) + sign * NORMAL_95 * errors) for sign in (-1.0, 1.0))
    known = {
        key: bool(e < (0.7 * N_SPREAD if key == "n" else IDENTIFIABLE)) for key, e in zip(GLOSS, errors, strict=True)
    }
    nothing = {"beta": [0.0, high[0]]}
    scale = {"beta": found["beta"], "gamma": found["gamma"], "n": found["n"] - 1.0}
    return {
        **found,
        "standard_error": {key: float(scale[key] * e) for key, e in zip(GLOSS, errors, strict=True)},
        "interval_95": {key: [low[k], high[k]] for k, key in enumerate(GLOSS)} | ({} if known["beta"] else nothing),
        "identifiable": known,
    }
