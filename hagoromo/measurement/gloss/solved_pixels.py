"""Solved pixels: gloss, normal and body colour of each pixel together, under known lamps and a law of the gloss.

Enters: views of one material under lamps as they were fitted, and a normal law of (ln β, ln γ) as the prior. Leaves:
the most probable gloss of every pixel with its covariance, the normal and the body being free, by Levenberg–Marquardt
with Cauchy's loss. A pixel that no lamp shows near its highlight keeps the mean of the law, with the spread of the law.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.levenberg_marquardt import Damping, Tolerance, levenberg_marquardt
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.shading import TAIL, shading, turned
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.measurement.parameters import GAMMA_RANGE
from hagoromo.measurement.photometric.gloss_posterior import GlossLaw, GlossPosterior, PixelGloss, least_log_gamma
from hagoromo.measurement.photometric.reading import reading

COARSE = 10.0  # standard deviations of the first steps
SOLVED_STEPS = 15  # of a pixel
SMALLEST_DECREMENT = 1e-3  # of the loss over two: a pixel whose next step would lower it by less has converged
PARTS = 4  # of the pixels, whose number is that of a kernel: other numbers are other kernels, to be compiled
LONGEST_TURN = 0.1  # [rad] of a normal in one step
SMALLEST_CURVATURE = 1e-3  # [rad⁻²] of the turns, so that the step of a pixel that hardly any lamp lights is finite
LEAST_BODY_RATIO = 0.2  # smallest ratio of a body colour after a step to the one before
LONGEST_GLOSS_STEP = 0.7  # of ln β and ln γ each
TURNS, OWN = np.s_[:2], np.s_[2:]  # places of the turns of the normal, and of ln β and ln γ


@dataclass(frozen=True, eq=False)
class SolvedPixels:
    """Views of P pixels of one material, and what is known of them.

    rows: (M, G) `Gloss` rows of its lobes, the first of which is the material's gloss; all lobes of a pixel are wider
    and stronger together. colour: (C,) of the interface. evenness: (K, P) of the lamps. variance: (K, C, P) of the
    values, with the error of the model, inf where a value is not used; clipped ones
    are lower bounds. tail: (P,) 1/ν of the first lobe of each pixel; None: that of `rows`.
    """

    views: Views
    rows: Array
    colour: Array
    evenness: Array
    variance: Array
    tail: Array | None = None

    def pixels(self, chosen: NDArray) -> SolvedPixels:
        """Some of the pixels."""
        parts = self.evenness[:, chosen], self.variance[..., chosen]
        tail = None if self.tail is None else self.tail[chosen]
        return replace(self, views=self.views.pixels(chosen), evenness=parts[0], variance=parts[1], tail=tail)

    def with_tails(self, tail: Array) -> SolvedPixels:
        """The same pixels, with `tail` (P,) of their own."""
        return replace(self, tail=tail)

    def without(self, lamps: NDArray[np.bool_]) -> SolvedPixels:
        """The same pixels, without the values of `lamps` (K,)."""
        return replace(self, variance=np.where(lamps[:, None, None], np.inf, self.variance))

    def solve(self, law: GlossLaw, start: State, steps: int = SOLVED_STEPS) -> tuple[State, PixelGloss]:
        """The most probable state under `law`, and the estimates of its gloss.

        A wrong gloss is many standard deviations off, where Cauchy's loss takes a highlight for an outlier: so the
        first steps are those of errors COARSE times as large.
        """
        tolerance, state, converged = Tolerance(decrement=SMALLEST_DECREMENT), start, np.zeros(0, bool)
        least = least_log_gamma(
            self._least_angle(start.normals), self.rows[0, TAIL] if self.tail is None else self.tail, law
        )
        for factor in (COARSE, 1.0):
            data = replace(self, variance=factor**2 * self.variance)
            state = data.state(state.gloss, state.normals, state.body)
            solution = levenberg_marquardt(
                GlossPosterior(data, law, least), state, Damping(start=1e-2), tolerance, steps
            )
            state, converged = solution.state, solution.statuses.converged
        return state, state.estimates(law, converged)

    def state(self, gloss: Array, normals: Array, body: Array) -> State:
        """Loss and normal equations at gloss (P, 2), normals (P, 3) and body (P, C)."""
        shade, even, colour = self._shade(gloss, normals), self.evenness[:, None], self.colour[:, None]
        lit, of_body = self.evenness * shade.body, body.T
        deviation = self.views.values - even * reading(of_body, shade.body[:, None], colour, shade.interface[:, None])
        variance = self.variance
        if self.views.lower is not None:  # a lower bound that holds says nothing
            variance = np.where(self.views.lower & (deviation < 0.0), np.inf, variance)
        squared = deviation**2 / variance / CAUCHY_SCALE**2
        weight = 1.0 / (variance * (1.0 + squared))
        columns = [
            even * reading(of_body, by_body[:, None], colour, by_lobe[:, None])
            for by_body, by_lobe in zip(shade.body_turned, shade.interface_turned, strict=True)
        ]
        columns += [even * colour * of[:, None] for of in (shade.interface, shade.by_width)]
        weighed = [weight * column for column in columns]
        own = np.array([[np.einsum("kcp,kcp->p", w, column) for column in columns] for w in weighed])
        mixed = np.array([np.einsum("kcp,kp->pc", w, lit) for w in weighed])
        return State(
            gloss,
            normals,
            body,
            CAUCHY_SCALE**2 * np.log1p(squared).sum(axis=(0, 1)),
            np.moveaxis(own, 2, 0),
            np.moveaxis(mixed, 1, 0),
            np.einsum("kcp,kp->pc", weight, lit**2),
            np.array([np.einsum("kcp,kcp->p", w, deviation) for w in weighed]).T,
            np.einsum("kcp,kp->pc", weight * deviation, lit),
        )

    def loss(self, state: State) -> Array:
        """(P,) robust loss of the values."""
        return state.loss

    def equations(self, state: State, prior: Array, damping: Array) -> tuple[Array, Array]:
        """See `GlossPixels`; the prior is not damped."""
        curvature, score, _ = state.reduced(damping)
        curvature[:, OWN, OWN] += prior
        return curvature, score

    def further_decrement(self, state: State) -> Array:
        """(P,) of the body colours, which take steps of their own."""
        return 0.5 * np.sum(state.body_score**2 / state.damped_bodies(np.zeros(len(state.loss))), axis=1)

    def moved(
        self, state: State, step: Array, damping: Array, moving: NDArray[np.bool_], narrowest: Array
    ) -> tuple[State, Array]:
        """The state after a step of the pixels that are moving, their body colours following, and its length (P,)."""
        step[:, OWN] = np.clip(step[:, OWN], -LONGEST_GLOSS_STEP, LONGEST_GLOSS_STEP)
        length = np.linalg.norm(step[:, TURNS], axis=1)
        step[:, TURNS] *= np.minimum(1.0, LONGEST_TURN / np.maximum(length, 1e-12))[:, None]
        by_body = (state.body_score - np.einsum("pic,pi->pc", state.mixed, step)) / state.damped_bodies(damping)
        gloss = state.gloss + step[:, OWN]
        gloss[:, 1] = np.clip(gloss[:, 1], narrowest, np.log(GAMMA_RANGE[1]))
        body = np.maximum(state.body + by_body, LEAST_BODY_RATIO * state.body)
        fits = np.flatnonzero(moving)
        fits = np.resize(fits, -(-PARTS * len(fits) // len(moving)) * len(moving) // PARTS)  # some of them twice
        normals = turned(state.normals, step[:, TURNS], self.views.to_eye)
        found = self.pixels(fits).state(gloss[fits], normals[fits], body[fits])
        return _put(state, found, fits), np.linalg.norm(step, axis=1)

    def chosen(self, better: NDArray[np.bool_], trial: State, state: State) -> State:
        """Of each pixel the better one."""
        return _put(state, trial.of(better), np.flatnonzero(better))

    def _least_angle(self, normals: Array) -> Array:
        """(P,) least half angle [rad] to the highlight over the lamps whose values are used; π without any."""
        half = self.views.to_lamp + self.views.to_eye
        cosine = np.einsum("kpi,pi->kp", half, normals) / np.maximum(np.linalg.norm(half, axis=2), 1e-12)
        lit = np.einsum("kpi,pi->kp", self.views.to_lamp, normals) > 0.0
        counts = lit & np.isfinite(self.variance).any(axis=1)
        return np.where(counts, np.arccos(np.clip(cosine, -1.0, 1.0)), np.pi).min(axis=0)

    def _shade(self, gloss: Array, normals: Array) -> _Shade:
        """Body and interface of all lobes together (K, P), and their slopes."""
        total: _Shade | None = None
        for row in self.rows:
            rows = np.tile(row, (len(gloss), 1))
            rows[:, :2] += gloss - self.rows[0, :2]
            if total is None and self.tail is not None:
                rows[:, TAIL] = self.tail
            shade = shading(normals, self.views.to_lamp, self.views.to_eye, rows)
            one = _Shade(shade.body, shade.body_turned, shade.interface, shade.interface_turned, shade.by_width)
            total = one if total is None else total.with_lobe(one)
        assert total is not None  # there is a first lobe
        return total


class _Shade(NamedTuple):
    """Of all lobes: see `Shading`."""

    body: Array
    body_turned: tuple[Array, Array]
    interface: Array
    interface_turned: tuple[Array, Array]
    by_width: Array

    def with_lobe(self, more: _Shade) -> _Shade:
        """With one lobe more."""
        first, second = (one + other for one, other in zip(self.interface_turned, more.interface_turned, strict=True))
        interface = self.interface + more.interface
        return self._replace(
            interface=interface, interface_turned=(first, second), by_width=self.by_width + more.by_width
        )


@dataclass(frozen=True, eq=False)
class State:
    """A point of the fit of P pixels: gloss (P, 2), normals (P, 3), body (P, C), and what follows there.

    loss: (P,) of the values. own: (P, 4, 4) curvature by both turns of the normal, ln β and ln γ; mixed: (P, 4, C) by
    them and the body; of_body: (P, C) by the body. score: (P, 4) and body_score: (P, C) −½ d loss.
    """

    gloss: Array
    normals: Array
    body: Array
    loss: Array
    own: Array
    mixed: Array
    of_body: Array
    score: Array
    body_score: Array

    def of(self, chosen: NDArray[np.bool_]) -> State:
        """That of some pixels."""
        return State(*(part[chosen] for part in vars(self).values()))

    def damped_bodies(self, ridge: Array) -> Array:
        """(P, C) curvature by the bodies."""
        return self.of_body * (1.0 + ridge[:, None]) + 1e-12

    def reduced(self, ridge: Array) -> tuple[Array, Array, Array]:
        """Curvature (P, 4, 4) and score (P, 4) with the bodies eliminated, and the bodies' curvature (P, C).

        ridge: (P,) of the damping.
        """
        of_body = self.damped_bodies(ridge)
        own = self.own + ridge[:, None, None] * self.own * np.eye(4)
        own[:, 0, 0] += SMALLEST_CURVATURE
        own[:, 1, 1] += SMALLEST_CURVATURE
        part = self.mixed / of_body[:, None]
        left = own - np.einsum("pic,pjc->pij", part, self.mixed)
        return left, self.score - np.einsum("pic,pc->pi", part, self.body_score), of_body

    def estimates(self, law: GlossLaw, converged: NDArray[np.bool_]) -> PixelGloss:
        """The gloss with normals and bodies eliminated, and its covariance under `law`."""
        whole, score, of_body = self.reduced(np.zeros(len(self.loss)))
        across = np.linalg.solve(
            whole[:, TURNS, TURNS], np.concatenate([whole[:, TURNS, OWN], score[:, TURNS, None]], 2)
        )
        information = whole[:, OWN, OWN] - whole[:, OWN, TURNS] @ across[..., :2]
        information = 0.5 * (information + np.swapaxes(information, 1, 2))
        own = score[:, OWN] - np.einsum("pij,pj->pi", whole[:, OWN, TURNS], across[..., 2])
        covariance = np.asarray(np.linalg.inv(information + law.information), np.float64)
        error = np.sqrt(1.0 / of_body)
        return PixelGloss(self.gloss, covariance, information, own, self.body, error, self.loss, converged)

    def normal_variance(self, law: GlossLaw) -> Array:
        """(P,) of the direction [rad²], with gloss and body free."""
        whole = self.reduced(np.zeros(len(self.loss)))[0]
        whole[:, OWN, OWN] += law.information
        return np.einsum("pii->p", np.linalg.inv(whole)[:, TURNS, TURNS])


def _put(state: State, part: State, pixels: NDArray[np.intp]) -> State:
    """`state` with `part` at some of its pixels."""
    found = [one.copy() for one in vars(state).values()]
    for whole, new in zip(found, vars(part).values(), strict=True):
        whole[pixels] = new
    return State(*found)
