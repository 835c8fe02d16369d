"""Test whether two glosses of one colour differ at the same angles.

A lobe of a wrong shape fits the middle of a highlight with one width and its tails with another. So the facet density
is estimated without a model of it, at nodes of φ, for each gloss: two materials differ at nodes that both cover, while
one material with an unsuitable lobe does not. Bins of θ_Q separate the Fresnel term, whose n is unknown.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.observations import Pixels
from hagoromo.measurement.sight import Array, Sight, sight_of
from hagoromo.photograph.capture import Capture

WIDTHS = np.geomspace(0.03, 0.6, 24)  # γ [rad] of the lobes that are tried
NODES = np.array([0.0, 0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 2.5, 3.0, 4.0, 6.0])  # φ over the lobes' mean width
DEVIATIONS = np.radians([30.0, 42.0, 51.0, 58.0, 64.0, 69.0, 74.0])  # edges of bins of θ_Q with nearly constant F
FLAT = np.log(1e3)  # ln γ at which every facet density is 1
LOG_N1 = np.log(0.5)  # ln(n − 1) of most dielectrics; with bins of θ_Q it has little influence
DIFFERENT = 0.15  # relative difference, root mean square over the nodes that both glosses cover
SIGNIFICANT = 4.0  # standard errors
LARGEST_NODE_ERROR = 0.1  # standard error of a node, relative to the peak of the density, up to which it is used
BRIGHT = 0.4  # of the peak: below, body and gloss cannot be separated well
FEWEST_NODES = 3  # nodes that two glosses must share
MOST_PHOTOGRAPHS = 12


class TriedLobe(NamedTuple):
    """width: index into WIDTHS; strength: β F₀ [1/sr]."""

    width: int
    strength: float


def glosses_differ(capture: Capture, pixels: Pixels, number: NDArray[np.integer], lobes: list[TriedLobe]) -> bool:
    """Whether every two of `lobes` differ at the nodes that both cover; number (M,): index of each pixel's lobe."""
    scale = float(np.exp(np.mean([np.log(WIDTHS[lobe.width]) for lobe in lobes if lobe.strength > 0.0])))
    densities = [facet_densities(capture, pixels[number == i], scale) for i in range(len(lobes))]
    return all(_differ(densities[i], densities[j]) for i in range(len(lobes)) for j in range(i))


def facet_densities(capture: Capture, pixels: Pixels, scale: float) -> tuple[Array, Array]:
    """β F₀ D (B,) at the nodes of φ/scale in every bin of θ_Q, and its standard error, inf where no sample is.

    Linear between nodes of φ. Least squares with each pixel's own body, which is eliminated.
    """
    count, photographs = len(NODES) * (len(DEVIATIONS) + 1), capture.photographs
    if len(photographs) > MOST_PHOTOGRAPHS:
        chosen = np.linspace(0, len(photographs) - 1, MOST_PHOTOGRAPHS).astype(int)
        photographs = tuple(photographs[i] for i in chosen)
    channels = capture.photographs[0].values.shape[2]
    power, body_rhs = np.zeros((len(pixels), channels)), np.zeros((len(pixels), channels))
    rhs, normal = np.zeros(count), np.zeros(count * count)
    columns: list[tuple[NDArray[np.intp], Array]] = []  # node of each pixel, and its term of w b x
    index = pixels.rows, pixels.columns
    for photograph in photographs:
        geometry = sight_of(photograph, pixels.points, pixels.normals)
        used = (geometry.fit_to_use & photograph.mask[index])[:, None]
        weight = np.where(used, 1.0 / np.where(used, photograph.variance[index], 1.0), 0.0)
        values, body = np.where(used, photograph.values[index], 0.0), geometry.body
        flat = geometry.interface(np.array([FLAT]), np.array([LOG_N1]))[0][0]
        power += weight * body**2
        body_rhs += weight * body * values
        nodes = _nodes(geometry, scale)
        for node, part in nodes:
            columns.append((node, weight * body * flat * part[:, None]))
            rhs += np.bincount(node, part * (weight * flat * values).sum(axis=1), count)
            for other, beside in nodes:
                both = part * beside * (weight * flat**2).sum(axis=1)
                normal += np.bincount(node * count + other, both, count * count)
    inverse = np.divide(1.0, power, out=np.zeros_like(power), where=power > 0.0)
    for node, shared in columns:
        rhs -= np.bincount(node, (shared * body_rhs * inverse).sum(axis=1), count)
        for other, beside in columns:
            normal -= np.bincount(node * count + other, (shared * beside * inverse).sum(axis=1), count * count)
    return _solved(normal.reshape(count, count), rhs)


def _solved(normal: Array, rhs: Array) -> tuple[Array, Array]:
    """The solution (B,) of normal equations and its standard error, inf where it is not determined."""
    power = np.diag(normal)
    known = power > 1e-9 * power.max(initial=0.0)
    scale = np.where(known, 1.0 / np.sqrt(np.where(known, power, 1.0)), 0.0)
    covariance = np.linalg.pinv(normal * np.outer(scale, scale), rcond=1e-10, hermitian=True) * np.outer(scale, scale)
    return covariance @ rhs, np.where(known, np.sqrt(np.maximum(np.diag(covariance), 0.0)), np.inf)


def _differ(one: tuple[Array, Array], other: tuple[Array, Array]) -> bool:
    """Whether two densities differ at nodes where both are known and one of them is bright."""
    spread, most = np.hypot(one[1], other[1]), np.maximum(one[0], other[0])
    peak = max(float(np.max(of, where=error < LARGEST_NODE_ERROR * of, initial=0.0)) for of, error in (one, other))
    both = (most > BRIGHT * peak) & (spread < LARGEST_NODE_ERROR * peak)
    if peak == 0.0 or both.sum() < FEWEST_NODES:
        return False
    off, size, spread = (one[0] - other[0])[both], 0.5 * np.abs(one[0] + other[0])[both], spread[both]
    large = np.sum(off**2) > DIFFERENT**2 * np.sum(size**2)
    return bool(large and np.sum((off / spread) ** 2) > both.sum() + SIGNIFICANT * np.sqrt(2.0 * both.sum()))


def _nodes(sight: Sight, scale: float) -> list[tuple[NDArray[np.intp], Array]]:
    """The two nodes (M,) next to each pixel's φ, for the lamp nearest to its highlight, and their weights (M,)."""
    cosines = sight.cosines
    nearest = np.argmax(np.where(cosines.incidence > 0.0, cosines.half, -1.0), axis=1)[:, None]
    deviation = np.arccos(np.clip(np.take_along_axis(cosines.deviation, nearest, axis=1)[:, 0], -1.0, 1.0))
    place = np.interp(sight.least_half_angle / scale, NODES, np.arange(len(NODES)))
    low = np.minimum(place.astype(np.intp), len(NODES) - 2)
    beside = np.digitize(deviation, DEVIATIONS)
    across = len(DEVIATIONS) + 1
    return [(low * across + beside, 1.0 - (place - low)), ((low + 1) * across + beside, place - low)]
