"""Lobe shape: strength and half width of all lobes of a highlight together, as few as do, with their covariance.

From lobes on a grid of widths ln β and ln γ of each are fitted by Gauss and Newton, with exponent and roughness of the
body, and with the body colours eliminated. Lobes, tails and a colour of the interface are given up where the squared
error rises by less than a share without them: several lobes look like tails, and like a colour, to a fit of one lobe.
Residuals of a lamp, and of a part of the object, count as one each in the covariance (a sandwich), as errors of the
model are alike there.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float, arrays, column, evaluate
from hagoromo.measurement.facets import TAIL_RANGE, facet_density
from hagoromo.measurement.normals.lobe_samples import Samples, inner_products
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.parameters import GAMMA_RANGE
from hagoromo.reflectance.facets import LN2

STEPS = 12
LONGEST_STEP = 0.5  # of ln β and ln γ
SETTLED = 1e-3  # largest step of the last round
RIDGE = 1e-6  # relative, of the curvature
TILES = 4.0  # in a radius of the object: parts whose errors are independent
MOST_DAMPING = 1e6
UNKNOWN = 1e6  # variance of ln β or ln γ that has no effect on the photographs
LAW_SPREAD = 0.2  # of the prior of σ and ln(1 + ε)


@dataclass(frozen=True, eq=False)
class LobeShapes:
    """Lobes of a highlight: each (J, 2) ln β and ln γ [rad], of which the first has the tail 1/ν; law (2,): change of
    (σ, ln(1 + ε)) of the body; covariance (2J + 3, 2J + 3) of all these in turn, 0 for a tail of 0; empty before it is
    estimated.
    """

    each: Array
    tail: float
    law: Array = field(default_factory=lambda: np.zeros(2))
    covariance: Array = field(default_factory=lambda: np.zeros((0, 0)))

    def without(self, number: int) -> LobeShapes:
        """All lobes but this one."""
        return replace(self, each=np.delete(self.each, number, axis=0))

    @property
    def lobes(self) -> tuple[tuple[float, float], ...]:
        """β and γ of all but the first."""
        return tuple((float(np.exp(b)), float(np.exp(g))) for b, g in self.each[1:])


def fewest(samples: Samples, start: LobeShapes, least_gain: float) -> tuple[LobeShapes, Samples]:
    """The fewest of the lobes from `start`, refined, and the samples with the interface colour that stays.

    What takes less than the share `least_gain` off the squared error is left out.
    """
    found = refined(samples, start)
    error = _error(samples, found)
    if found.tail > 0.0:
        plain = refined(samples, replace(found, tail=0.0))
        found, error = _simpler(found, error, plain, _error(samples, plain), least_gain)
    if samples.coloured:
        neutral = samples.neutral()
        plain = refined(neutral, found)
        if _error(neutral, plain) * (1.0 - least_gain) < error:
            samples, found, error = neutral, plain, _error(neutral, plain)
    while len(found.each) > 1:
        shorter = [found.without(number) for number in range(int(found.tail > 0.0), len(found.each))]
        least = refined(samples, min(shorter, key=lambda one: _error(samples, one)))
        after = _simpler(found, error, least, _error(samples, least), least_gain)
        if after[0] is found:
            break
        found, error = after
    return found, samples


def _simpler(
    found: LobeShapes, error: float, plain: LobeShapes, of_plain: float, least_gain: float
) -> tuple[LobeShapes, float]:
    return (plain, of_plain) if of_plain * (1.0 - least_gain) < error else (found, error)


def refined(samples: Samples, start: LobeShapes) -> LobeShapes:
    """The lobes of least weighted squares near `start`; a tail of 0 stays 0."""
    found, damping, cost = start, 1e-3, cost_of(samples, start)
    for _ in range(STEPS):
        equations = _equations(samples, found)
        curvature = equations.curvature + damping * np.diag(np.diag(equations.curvature))
        step = np.asarray(np.linalg.solve(curvature, equations.score - equations.pull), np.float64)
        step = np.clip(step, -LONGEST_STEP, LONGEST_STEP)
        moved = _moved(found, step)
        after = cost_of(samples, moved)
        if not after < cost:
            damping *= 10.0
            if damping > MOST_DAMPING:
                break
            continue
        found, cost, damping = moved, after, 0.2 * damping
        if np.abs(step).max() < SETTLED:
            break
    return found


def _moved(found: LobeShapes, step: Array) -> LobeShapes:
    """`found` after a step of its numbers, within their ranges."""
    each = found.each + step[:-3].reshape(-1, 2)
    each[:, 1] = np.clip(each[:, 1], *np.log(GAMMA_RANGE))
    tail = float(np.clip(found.tail + step[-3], *TAIL_RANGE)) if found.tail > 0.0 else 0.0
    return replace(found, each=each, tail=tail, law=found.law + step[-2:])


def with_covariance(samples: Samples, found: LobeShapes, place: Array) -> LobeShapes:
    """`found` with its covariance; place: (P, 2) of the samples, in radii of the object."""
    equations = _equations(samples, found)
    tile = tiles_of(place)
    scores = [(one * equations.left).sum(axis=1, dtype=np.float64) for one in equations.columns]  # (K, P) each
    parts = np.stack([np.bincount(tile, one.sum(axis=0)) for one in scores])
    lamps = np.stack([one.sum(axis=1) for one in scores])
    inverse = np.linalg.inv(equations.curvature)
    covariance = inverse @ (parts @ parts.T + lamps @ lamps.T) @ inverse
    without_effect = np.flatnonzero(equations.unused[:-3])
    covariance[without_effect, without_effect] = UNKNOWN
    if found.tail == 0.0:
        covariance[-3] = covariance[:, -3] = 0.0
    return replace(found, covariance=covariance)


def tiles_of(place: Array) -> NDArray[np.intp]:
    """(P,) number of the part of the object that each sample lies in; place: (P, 2) in radii of the object."""
    return np.unique(np.floor(TILES * place).astype(np.int64), axis=0, return_inverse=True)[1].ravel()


def with_errors_of_normals(samples: Samples, found: LobeShapes, variance: Array) -> Samples:
    """The samples with the noise that normals of this variance (P,) [rad²] make on the flanks of the lobes."""
    slope = 0.0 * samples.flat
    for log_beta, log_gamma in found.each:
        peak = dr.opaque(arrays().Float, 2.0 * LN2 * float(np.exp(log_beta - 2.0 * log_gamma)))
        slope = slope + peak * samples.flat * samples.density(float(log_gamma)) * dr.sqrt(samples.angle2)
    evaluate(slope)
    return samples.flank_noise(slope, np.where(np.isfinite(variance), variance, 0.0) / 2.0)  # of the turn to the lamp


def widened(found: LobeShapes, normal_error: float, model_error: float) -> LobeShapes:
    """`found` with the errors that normals and model, alike in all photographs, make in each lobe.

    No half width is known better than the normals [rad], at the same light β γ²; nor is a peak, and the light at half
    of it, better than the relative error of the model.
    """
    covariance = found.covariance.copy()
    for number, (_, log_gamma) in enumerate(found.each):
        of_normals = normal_error * np.exp(-log_gamma) * np.array([-2.0, 1.0])
        place = np.s_[2 * number : 2 * number + 2]
        covariance[place, place] += np.outer(of_normals, of_normals)
        covariance[place, place] += model_error**2 * np.diag([1.0, (2.0 * LN2) ** -2])
    return replace(found, covariance=covariance)


def interface_of(samples: Samples, found: LobeShapes) -> Float:
    """(K, P) all lobes together."""
    return _interface(samples, found)[0]


@dataclass(frozen=True, eq=False)
class _Equations:
    """curvature (G, G) and score (G,) of the numbers of the lobes, the tail and the law, bodies eliminated; columns (G,
    K, C, P) and left (K, C, P), times the root of the weight, of which these are the products; pull (G,) of the prior;
    unused (G,) whether a number has no effect on any value that counts.
    """

    curvature: Array
    score: Array
    columns: list[NDArray[np.float32]]
    left: NDArray[np.float32]
    pull: Array
    unused: NDArray[np.bool_]


def _interface(samples: Samples, found: LobeShapes) -> tuple[Float, list[Float]]:
    """(K, P) all lobes together, and its slopes by ln β and ln γ of each, and by the tail."""
    total, slopes, by_tail = 0.0 * samples.flat, [], 0.0 * samples.flat
    for number, (log_beta, log_gamma) in enumerate(found.each):
        light = dr.opaque(arrays().Float, float(np.exp(log_beta))) * samples.flat
        if number == 0 and found.tail > 0.0:
            angle2 = samples.numbers(samples.angle2).astype(np.float64)
            density = facet_density(angle2, log_gamma, np.array(found.tail))
            value, by_width, tail = (column(arrays().Float, one.astype(np.float32)) for one in density)
            by_tail = light * tail
        else:
            value = samples.density(float(log_gamma))
            by_width = 2.0 * LN2 * dr.opaque(arrays().Float, float(np.exp(-2.0 * log_gamma))) * samples.angle2 * value
        slopes += [light * value, light * by_width]
        evaluate(slopes[-2:])
        total = total + slopes[-2]
    evaluate(total, by_tail)
    return total, [*slopes, by_tail]


def _equations(samples: Samples, found: LobeShapes) -> _Equations:
    samples, (interface, slopes) = samples.under_law(found.law), _interface(samples, found)
    body = samples.bodies(interface)
    root, left = samples.weighed(interface, body)
    pairs = [*((slope, samples.colour) for slope in slopes), *((by_law, body) for by_law in samples.by_law)]
    columns = samples.beside_bodies(pairs, root)
    rest, count = samples.numbers(root * left), len(columns)
    products = inner_products([*columns, rest])
    curvature, score = products[:-1, :-1], products[:-1, -1]
    prior = np.r_[np.zeros(count - 2), np.full(2, LAW_SPREAD**-2)]
    unused = np.diag(curvature) <= 0.0
    tiny = RIDGE * np.diag(curvature) + unused
    pull = prior * np.r_[np.zeros(count - 2), found.law]
    return _Equations(curvature + np.diag(tiny + prior), score, columns, rest, pull, unused)


def cost_of(samples: Samples, found: LobeShapes) -> float:
    """Twice the loss: light in excess counts by its square, missing light by Cauchy's loss; and the prior."""
    samples, *model = _model(samples, found)
    return samples.loss(*model) + float(np.sum((found.law / LAW_SPREAD) ** 2))


def _error(samples: Samples, found: LobeShapes) -> float:
    samples, *model = _model(samples, found)
    return samples.squared_error(*model)


def weighed_residuals(samples: Samples, found: LobeShapes) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
    """(K, C, P) root of the weight, and it times what the lobes, and the bodies that go with them, leave."""
    samples, *model = _model(samples, found)
    root, left = samples.weighed(*model)
    return samples.numbers(root), samples.numbers(root * left)


def _model(samples: Samples, found: LobeShapes) -> tuple[Samples, Float, Float]:
    """The samples under the law of the bodies, the interface (K, P), and the bodies (C, P) that go with it."""
    samples = samples.under_law(found.law)
    interface = interface_of(samples, found)
    return samples, interface, samples.bodies(interface)
