"""Evidence: how well photographs know what was recovered from them.

Errors of pixels of one photograph are alike (a pose, a lamp, the model), so the covariance of the gloss is estimated
from what each photograph as a whole would change (the sandwich of Huber 1967, clustered by photograph), after the body
colour of each place has been fitted to it. What changed between the last two levels of the lattice is added.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Float
from hagoromo.recovery.descent import N_SPREAD, Descent, gloss_normal_equations
from hagoromo.recovery.distance_field import COLOURS
from hagoromo.recovery.pixel_table import CHUNK, Drawn
from hagoromo.recovery.shading import GLOSS, figures

AT_ONCE = 1 << 12  # chunks
MOST_CHUNKS = 1 << 16  # that are looked at: more would not say more
COLOUR_DIFFERENCE = 0.01
HIT = 0.5  # opacity from which a pixel shows a place
NORMAL_95 = 1.959964  # standard deviations
IDENTIFIABLE = 0.5  # standard error of a logarithm up to which a parameter counts as known by the photographs


@dataclass(frozen=True, eq=False)
class Evidence:
    """covariance: (3, 3) of ln β, ln γ, ln(n − 1). seen: (nz, ny, nx) pixels that show each place of the surface.

    colour_error: (nz, ny, nx, 3) standard errors of body colours by the noise of the pixels that show them; NaN where
    none does.
    """

    covariance: NDArray[np.float64]
    seen: NDArray[np.int32]
    colour_error: NDArray[np.float32]

    def material(self, gloss: NDArray[np.floating]) -> dict[str, Any]:
        """The gloss with standard errors and 95 % intervals, with the keys of materials.json."""
        errors = np.sqrt(np.diag(self.covariance))
        found = dict(zip(GLOSS, figures(gloss), strict=True))
        low, high = (figures(np.asarray(gloss) + sign * NORMAL_95 * errors) for sign in (-1.0, 1.0))
        scale = {"beta": found["beta"], "gamma": found["gamma"], "n": found["n"] - 1.0}
        return {
            **found,
            "standard_error": {key: float(scale[key] * e) for key, e in zip(GLOSS, errors, strict=True)},
            "interval_95": {key: [low[k], high[k]] for k, key in enumerate(GLOSS)},
            "identifiable": {
                key: bool(e < (0.7 * N_SPREAD if key == "n" else IDENTIFIABLE))
                for key, e in zip(GLOSS, errors, strict=True)
            },
        }


def evidence_of(descent: Descent, coarser: NDArray[np.floating] | None = None) -> Evidence:
    """What the pixels of a descent say of its result.

    coarser: the gloss that the level before found; the square of what changed since counts as variance, as the lattice
    has an error, too.
    """
    shape = descent.field.shape
    count = int(np.prod(shape))
    total = descent.pixels.count // CHUNK
    chosen = np.arange(total)
    if total > MOST_CHUNKS:
        chosen = np.sort(np.random.default_rng(0).choice(total, MOST_CHUNKS, replace=False))
    copies = total / len(chosen)
    seen, known = np.zeros(count, np.int64), np.zeros((count, COLOURS))
    parts = []
    for first in range(0, len(chosen), AT_ONCE):
        drawn = descent.pixels.of(chosen[first : first + AT_ONCE])
        parts.append(_part(descent, drawn, seen, known))
    gloss = _gloss_covariance(parts, count, copies) if descent.lamps.each else np.zeros((3, 3))
    if coarser is not None and descent.lamps.each:
        gloss = gloss + np.diag((descent.gloss - coarser) ** 2)
    with np.errstate(divide="ignore"):
        error = np.where(known > 0.0, 1.0 / np.sqrt(known * copies), np.nan)
    return Evidence(
        gloss, np.asarray(seen * copies, np.int32).reshape(shape), error.astype(np.float32).reshape(*shape, COLOURS)
    )


def _part(descent: Descent, drawn: Drawn, seen: NDArray, known: NDArray) -> tuple[NDArray, ...]:
    """Of some pixels: J √W by the gloss and by the body colour, residuals √W, place and photograph."""
    rendering, field = descent.rendering, descent.field
    base = rendering.light(drawn)
    place = dr.fma(drawn.rays.direction, base.seen.way, drawn.rays.origin)
    node = _node_of(place, descent)
    hit = (np.array(base.seen.depth) > -np.log(1.0 - HIT)) & (np.array(drawn.weights[1]) > 0.0)
    roots = np.sqrt(np.stack([np.array(w, np.float64) for w in drawn.weights], axis=1))
    rest = np.stack([np.array(v - c, np.float64) for v, c in zip(drawn.values, base.channels, strict=True)], axis=1)
    old = field.colours
    field.colours = old + COLOUR_DIFFERENCE
    dr.eval(field.colours)
    moved = rendering.light(drawn)
    by_colour = np.stack(
        [np.array(b - a, np.float64) / COLOUR_DIFFERENCE for a, b in zip(base.channels, moved.channels, strict=True)], 1
    )
    field.colours = old
    jacobian = np.zeros((len(hit) * COLOURS, len(GLOSS)))
    if descent.lamps.each:
        jacobian = gloss_normal_equations(rendering, drawn, base, 1.0)[2]
    by_gloss = np.moveaxis(jacobian.reshape(COLOURS, len(hit), len(GLOSS)), 0, 1)
    np.add.at(seen, node[hit], 1)
    np.add.at(known, node[hit], (by_colour[hit] * roots[hit]) ** 2)
    photograph = np.array(drawn.photograph)[hit]
    return by_gloss[hit], (by_colour * roots)[hit], (rest * roots)[hit], node[hit], photograph


def _node_of(place: Any, descent: Descent) -> NDArray[np.int64]:
    """Number of the node nearest to each place."""
    nz, ny, nx = descent.field.shape

    def nearest(x: Float, most: int) -> NDArray[np.int64]:
        return np.clip(np.rint(np.array(x)), 0, most - 1).astype(np.int64)

    return (nearest(place.z, nz) * ny + nearest(place.y, ny)) * nx + nearest(place.x, nx)


def _gloss_covariance(parts: list[tuple[NDArray, ...]], count: int, copies: float) -> NDArray[np.float64]:
    """Covariance of the gloss by all parts."""
    by_gloss, by_colour, rest, node, photograph = (np.concatenate(each) for each in zip(*parts, strict=True))
    square = np.zeros((count, COLOURS))
    np.add.at(square, node, by_colour**2)
    free, left = by_gloss.copy(), rest.copy()
    for k in range(len(GLOSS)):  # what the body colour of a place can explain is taken out
        mixed = np.zeros((count, COLOURS))
        np.add.at(mixed, node, by_colour * by_gloss[..., k])
        free[..., k] -= by_colour * (mixed / np.maximum(square, 1e-30))[node]
    mixed = np.zeros((count, COLOURS))
    np.add.at(mixed, node, by_colour * rest)
    left -= by_colour * (mixed / np.maximum(square, 1e-30))[node]
    matrix = copies * np.einsum("nck,ncl->kl", free, free)
    scores = np.zeros((int(photograph.max(initial=0)) + 1, len(GLOSS)))
    np.add.at(scores, photograph, copies * np.einsum("nck,nc->nk", free, left))
    scores -= scores.mean(axis=0)
    prior = np.diag([1e-6, 1e-6, 1.0 / N_SPREAD**2])
    used = max(len(scores), 2)
    spread = used / (used - 1.0) * scores.T @ scores
    sandwich = np.linalg.pinv(matrix) @ spread @ np.linalg.pinv(matrix)
    return np.linalg.inv(np.linalg.pinv(sandwich) + prior)
