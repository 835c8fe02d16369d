"""Smooth normals: those of a surface as smooth as photographs left out show it to be.

Noise turns each normal by itself. A lobe narrower than that noise is then lit by the wrong lamps. The normals of a
smooth surface are nearer. With x the two components of a normal across the camera's axis, x̂ and σ² those that a pixel's
own photographs give, and D second differences between neighbours (0 on a plane and on a sphere),

    Σ_p (x_p − x̂_p)² / σ_p² + λ |D x|²  →  min.

λ is the one under which normals from half of the lamps, smoothed, are nearest to those that the other half gives, not
smoothed: noise is not in both, detail of the surface is. Where smoothing brings them no nearer, normals stay.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.lobe_samples import RELATIVE_ERROR
from hagoromo.measurement.normals.photometric_model import Fit, further_rows, precision, precision_of_bounds
from hagoromo.measurement.normals.pixel_errors import UNKNOWN_DIRECTION
from hagoromo.measurement.normals.pixel_fit import (
    LEAST_BODY_RATIO,
    NormalFit,
    PixelConditions,
    fit_pixels,
)
from hagoromo.measurement.normals.shading import LEAST_COSINE, lit_values, tangents
from hagoromo.measurement.normals.smooth_share import SmoothShare, Stiffness
from hagoromo.measurement.normals.views import FEWEST_LAMPS, Array, Views

STIFFNESSES = np.geomspace(1e2, 1e8, 7)  # [rad⁻²] candidates of λ, from the least on
LEAST_GAIN = 0.01  # of the squared distance between the halves: with less normals stay
FARTHEST = 9.0  # standard deviations at which distances are cut off
CHOICE_PIXELS, TILE = 10_000, 48  # pixels from which λ is chosen, at most about; of squares of this side [px]
BODY_PASSES = 3  # of re-weighting
FARTHEST_PROBES = 8  # [px] between pixels whose variance is found together, at most
TOGETHER = 16  # probes that are solved at once
REACH = 3.0  # of the lengths over which errors are alike: so far apart these pixels are
LEAST_FACTOR = 0.05  # of stated variances
WINDOW = 4.0  # [px] standard deviation of the neighbourhood over which squares are averaged
SEED = 0


def with_smooth_normals(views: Views, fit: Fit) -> Fit:
    """`fit` of `views` with the normals of a smooth surface and the body colours that go with them; as it is where the
    lamps are too few for two halves, or smooth normals are no nearer.
    """
    if len(views.values) < 2 * FEWEST_LAMPS:
        return fit
    both = of_halves(views, fit)
    scatter = noise_factor(views, both)
    stiffness = chosen_stiffness(views, both, scatter)
    if stiffness is None:
        return fit
    variance = known_variance(scatter * fit.variance)
    normals, share = smooth_surface(views, stiffness.value, fit.normals, variance)
    fit = replace(fit, normals=normals, variance=share * fit.variance, smooth=SmoothShare(stiffness, share, variance))
    return replace(fit, body=bodies_at(views, fit))


def smooth_surface(views: Views, stiffness: float, normals: Array, variance: Array) -> tuple[Array, Array]:
    """Smooth normals (P, 3) from `normals` of `variance` (P,) [rad²], and the share (P,) of it that is left to them."""
    surface = SmoothField(views, stiffness)
    systems = surface.systems(normals, variance)
    smooth, share = surface.smoothed(normals, variance, systems), surface.share(normals, variance, systems)
    return smooth, np.minimum(share + flattened(views, normals, smooth, variance, share) / variance, 1.0)


def of_halves(views: Views, fit: Fit, place: Array | None = None, steps: int | None = None) -> list[NormalFit]:
    """The normals of both halves of the lamps, from those of all lamps in at most so many steps.

    place: (P, 2) of pixels that are part of an object.
    """
    parts = halves(views)
    return [fit_pixels(half, conditions(half, fit, place), fit.normals, fit.body, steps) for half in parts]


def conditions(views: Views, fit: Fit, place: Array | None = None) -> PixelConditions:
    """Those of `fit`, with all its lobes; beside several, errors of the model are those with which they were found, and
    clipped values are lower bounds: the peak of one lobe alone is not that of the highlight.

    place: (P, 2) of pixels that are part of an object.
    """
    model_error = fit.model_error if fit.lobes is None else max(fit.model_error, RELATIVE_ERROR)
    even = fit.evenness(views.place if place is None else place)
    lower = None if fit.lobes is None else precision_of_bounds(views, model_error)
    return PixelConditions(fit.rows, even, precision(views, model_error), further_rows(fit), lower)


def smoother_of(views: Views, fit: Fit) -> Callable[[Array], Array]:
    """What smooths changes (P, 3) of the normals of `fit` as these were; where they were not, changes stay."""
    if fit.smooth is None:
        return lambda changes: changes
    return SmoothField(views, fit.smooth.stiffness.value).smoother(fit.normals, fit.smooth.variance)


def smoothed_modes(views: Views, fit: Fit, modes: Array) -> Array:
    """(m, P, 3) changes of the normals of `fit` that were `modes` (m, P, 3) before these were smoothed."""
    smoother = smoother_of(views, fit)
    return np.stack([smoother(mode) for mode in modes])


def noise_factor(views: Views, both: Sequence[NormalFit]) -> Array:
    """(P,) by how much normals of both halves scatter more than stated, in the neighbourhood of each pixel, squared.

    What they differ by throughout the neighbourhood is no scatter: lamps that are off make it.
    """
    apart, total = both[0].normals - both[1].normals, sum(known_variance(one.variance) for one in both)
    apart = apart / np.sqrt(total)[:, None]
    apart *= np.minimum(1.0, FARTHEST / np.maximum(np.linalg.norm(apart, axis=1, keepdims=True), 1e-12))
    mean = np.stack([_around(views, part) for part in apart.T])
    pixels = 4.0 * np.pi * WINDOW**2  # that the mean is of
    scatter = _around(views, np.sum(apart**2, axis=1)) - np.sum(mean**2, axis=0)
    return np.maximum(scatter / (1.0 - 1.0 / pixels), LEAST_FACTOR)


def chosen_stiffness(views: Views, both: Sequence[NormalFit], scatter: Array) -> Stiffness | None:
    """λ under which the normals of each half of the lamps are nearest to the other's.

    None where smoothing brings them no nearer. scatter: see `noise_factor`.
    """
    some = _squares(views)
    views, both = (
        views.pixels(some),
        [NormalFit(one.normals[some], one.body, one.variance[some], one.status) for one in both],
    )
    variances = [known_variance(scatter[some] * one.variance) for one in both]
    total = variances[0] + variances[1]

    def distance(normals: list[Array]) -> float:
        """Mean square, in units of the stated variance, cut off."""
        cosines = (np.einsum("pi,pi->p", one, other.normals) for one, other in zip(normals, both[::-1], strict=True))
        squared = (np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2 / total for cosine in cosines)
        return float(np.mean([np.minimum(one, FARTHEST**2).mean() for one in squared]))

    before = least = distance([one.normals for one in both])
    best = 0.0
    for stiffness in STIFFNESSES.tolist():
        surface = SmoothField(views, stiffness)
        pairs = zip(both, variances, strict=True)
        after = distance([surface.smoothed(one.normals, variance) for one, variance in pairs])
        if after >= least:
            break
        best, least = stiffness, after
    gain = 1.0 - least / max(before, 1e-300)
    return None if gain < LEAST_GAIN else Stiffness(best, gain)


def flattened(views: Views, before: Array, after: Array, variance: Array, share: Array) -> Array:
    """(P,) mean square [rad²] around each pixel by which smoothing took away what the surface has, 0 if only noise.

    before, after: normals (P, 3) whose distance is that of noise of this variance (P,), of which the share (P,) is
    left, where nothing else was taken away. Noise is measured by the median over all pixels.
    """
    squared = np.arccos(np.clip(np.einsum("pi,pi->p", before, after), -1.0, 1.0)) ** 2
    # of the smoother S: (1 − S)² = 1 − 2 S + S², and diag S² = ½ diag S where λ |D x|² has two dimensions
    expected = variance * (1.0 - 1.5 * share)
    noise = expected * float(np.median(squared / expected)) / np.log(2.0)  # squares of two turns: exponential
    found, chance = (_around(views, one) for one in (np.minimum(squared, 16.0 * noise), noise))
    return np.maximum(found - (1.0 + 1.0 / np.sqrt(4.0 * np.pi * WINDOW**2)) * chance, 0.0)


def halves(views: Views) -> tuple[Views, Views]:
    """`views` that use the one and the other half of the lamps: every second of them in turn about their middle."""
    towards = views.to_lamp.mean(axis=1)
    across = _across(towards / np.linalg.norm(towards, axis=1, keepdims=True), views)[..., :2]
    across = across - across.mean(axis=0)
    order = np.argsort(np.arctan2(across[:, 1], across[:, 0]), kind="stable")
    first = np.zeros(len(order), bool)
    first[order[::2]] = True
    return views.of_lamps(first), views.of_lamps(~first)


class _System(NamedTuple):
    """A component (P,) of normals, the weights (P,), and what solves (weights + λ DᵀD) x = y."""

    component: Array
    weights: Array
    solve: Callable[[Array], Array]


@dataclass(frozen=True, eq=False)
class SmoothField:
    """The least squares of the pixels of `views` for one λ, `stiffness` [rad⁻²]."""

    views: Views
    stiffness: float

    def smoothed(self, normals: Array, variance: Array, systems: Sequence[_System] = ()) -> Array:
        """(P, 3) smooth normals, unit, from `normals` (P, 3) of `variance` (P,) [rad²], the sum of two turns.

        systems: of both components, where they are known.

        Normals that lean away from the camera's axis by nearly 90° stay.
        """
        across = _across(normals, self.views)
        systems = systems or self.systems(normals, variance)
        solved = [solve(weight * x) for x, weight, solve in systems]
        found = np.stack([*solved, np.zeros(len(normals))], axis=1)
        left = 1.0 - np.sum(found**2, axis=1)
        found[:, 2] = np.sqrt(np.maximum(left, 0.0))
        there = (across[:, 2] > LEAST_COSINE) & (found[:, 2] > LEAST_COSINE)
        found = np.where(there[:, None], found, across) @ _axes(self.views)
        short = np.maximum(LEAST_COSINE - np.einsum("pi,pi->p", found, self.views.to_eye), 0.0)
        found = found + short[:, None] * self.views.to_eye
        return found / np.linalg.norm(found, axis=1, keepdims=True)

    def smoother(self, normals: Array, variance: Array) -> Callable[[Array], Array]:
        """What smooths small changes (P, 3) of smooth `normals` (P, 3), which were of `variance` (P,) [rad²]."""
        across, axes = _across(normals, self.views), _axes(self.views)
        systems = self.systems(normals, variance)
        there, height = across[:, 2] > LEAST_COSINE, np.maximum(across[:, 2], LEAST_COSINE)

        def smoothed(changes: Array) -> Array:
            both = [solve(weight * x) for x, (_, weight, solve) in zip((changes @ axes.T).T, systems, strict=False)]
            third = -(across[:, 0] * both[0] + across[:, 1] * both[1]) / height  # unit normals stay so
            return np.where(there[:, None], np.stack([*both, third], axis=1) @ axes, changes)

        return smoothed

    def share(self, normals: Array, variance: Array, systems: Sequence[_System] = ()) -> Array:
        """(P,) share of the variance of a normal that is left in the smooth one, at most 1.

        The diagonal of the inverse of both systems, by sums over pixels of a lattice with random signs: pixels so far
        apart have nothing in common.
        """
        across, random = _across(normals, self.views), np.random.default_rng(SEED)
        reach = REACH * float(self.stiffness * np.median(variance) / 2.0) ** 0.25
        step = int(np.clip(np.ceil(reach), 2, FARTHEST_PROBES))
        place = (self.views.rows % step) * step + self.views.columns % step
        left = np.zeros((2, len(normals)))
        for i, (_, _, solve) in enumerate(systems or self.systems(normals, variance)):
            for numbers in np.array_split(np.arange(step**2), -(-(step**2) // TOGETHER)):
                signs = random.choice([-1.0, 1.0], (len(numbers), len(place))).T
                probes = np.where(place[:, None] == numbers, signs, 0.0)
                left[i] += np.sum(probes * solve(probes), axis=1)
        slope2 = across[:, :2].T ** 2 / np.maximum(across[:, 2], LEAST_COSINE) ** 2  # of the third component
        if reach > step:  # probes reach one another: their random signs cancel over a neighbourhood
            left = np.stack([_around(self.views, part) for part in left])
        share = np.sum(left * (1.0 + slope2), axis=0) / variance
        return np.where(across[:, 2] > LEAST_COSINE, np.clip(share, 0.0, 1.0), 1.0)

    def systems(self, normals: Array, variance: Array) -> list[_System]:
        """Of both components across the camera's axis."""
        from scipy.sparse import diags_array
        from scipy.sparse.linalg import splu

        across, bent, systems = _across(normals, self.views), _second_differences(self.views), []
        stiff = self.stiffness * (bent.T @ bent)
        for x in across[:, :2].T:
            # a turn of variance σ² changes a component x of a unit vector by σ² (1 − x²)
            weight = 2.0 / (variance * np.maximum(1.0 - x**2, LEAST_COSINE**2))
            weight = np.where(across[:, 2] > LEAST_COSINE, weight, 1e-3 * weight)
            matrix = (diags_array(weight) + stiff).tocsc()
            factors = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
            systems.append(_System(x, weight, factors.solve))
        return systems


def bodies_at(views: Views, fit: Fit, place: Array | None = None) -> Array:
    """(C, P) body colours by robust least squares at the normals and lobes of `fit`; place: see `conditions`."""
    body, interface = lit_values(fit.normals, views.to_lamp, views.to_eye, fit.rows, further_rows(fit))
    light_of = conditions(views, fit, place)
    even, inverse = light_of.evenness[:, None], light_of.precision
    lit, light, body = even * body[:, None], even * fit.interface_colour * interface[:, None], fit.body
    for _ in range(BODY_PASSES):
        squared = (views.values - lit * body - light) ** 2 * inverse / CAUCHY_SCALE**2
        weight = inverse / (1.0 + squared)
        found = np.sum(weight * lit * (views.values - light), axis=0) / (np.sum(weight * lit**2, axis=0) + 1e-12)
        body = np.maximum(found, LEAST_BODY_RATIO * fit.body)
    return body


def _around(views: Views, pixels: Array) -> Array:
    """(P,) mean of `pixels` (P,) in the neighbourhood of each."""
    from scipy.ndimage import gaussian_filter

    known, whole = (gaussian_filter(views.image(one), WINDOW) for one in (np.ones(len(pixels)), pixels))
    return whole[views.rows, views.columns] / known[views.rows, views.columns]


def _axes(views: Views) -> Array:
    """(3, 3) rows: two axes across that of the camera, and the direction to the camera."""
    to_camera = -views.axis / np.linalg.norm(views.axis)
    first, second = tangents(to_camera[None])
    return np.concatenate([first, second, to_camera[None]])


def _across(vectors: Array, views: Views) -> Array:
    """(…, 3) components of `vectors` (…, 3) along `_axes`."""
    return vectors @ _axes(views).T


def known_variance(variance: Array) -> Array:
    """That of any direction where it is unknown."""
    return np.clip(variance, 1e-12, UNKNOWN_DIRECTION)


def _squares(views: Views) -> NDArray[np.intp]:
    """Numbers of the pixels in some squares of the picture, of about CHOICE_PIXELS; of all where there are no more."""
    count = len(views.rows)
    if count <= CHOICE_PIXELS:
        return np.arange(count)
    square = np.unique((views.rows // TILE) * views.shape[1] + views.columns // TILE, return_inverse=True)[1]
    order = np.random.default_rng(SEED).permutation(int(square.max()) + 1)
    enough = int(np.searchsorted(np.cumsum(np.bincount(square)[order]), CHOICE_PIXELS)) + 1
    return np.flatnonzero(np.isin(square, order[:enough]))


def _second_differences(views: Views) -> Any:
    """Sparse (N, P): along both axes of the picture and across, where all of their pixels are there.

    |D x|² is the sum of x_rr², x_cc² and 2 x_rc², which is the same in all directions.
    """
    from scipy.sparse import csr_array, vstack

    index = np.full(np.add(views.shape, 2), -1)
    index[views.rows + 1, views.columns + 1] = np.arange(len(views.rows))
    root = float(np.sqrt(2.0))
    parts = []
    for signs, offsets in (
        ((1.0, -2.0, 1.0), ((-1, 0), (0, 0), (1, 0))),
        ((1.0, -2.0, 1.0), ((0, -1), (0, 0), (0, 1))),
        ((root, -root, -root, root), ((0, 0), (0, 1), (1, 0), (1, 1))),
    ):
        places = np.stack([index[views.rows + 1 + row, views.columns + 1 + column] for row, column in offsets])
        places = places[:, (places >= 0).all(axis=0)]
        entries = np.repeat(signs, places.shape[1]), (np.tile(np.arange(places.shape[1]), len(signs)), places.ravel())
        parts.append(csr_array(entries, (places.shape[1], len(views.rows))))
    return vstack(parts, format="csr")
