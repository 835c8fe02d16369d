"""Errors of normals: what each pixel has of its own, and what all pixels share, by lamps that are left out.

Enters: views and their fit. Leaves: the fit with errors that also hold where lamps, reflectance and pixels are not
quite as the model has them. There are three parts.

Shared: blocks of neighbouring lamps are left out in turn, and everything (gloss, the other lamps, normals, bodies) is
moved by one Gauss–Newton step. Each change, averaged over neighbouring pixels, is a field of errors, a mode: their
squares sum to the variance of the jackknife (Künsch 1989). Noise of the pixels is left in these means, by as much as
their scatter says; it is their own, and taken off. Lamps near one another have errors in common, so that they
are left out together: the cube root of their number, which is optimal for variances (Hall, Horowitz & Jing 1995).

Own: the variance that noise and model error give, times how much larger the changes are, beside those of the
neighbours, when each lamp is left out of a pixel (the sandwich with lamps as clusters; MacKinnon & White 1985, HC2).
Each pixel also shows more than its middle: `footprint`, smoothed as normals were.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.stats import t as student

from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.normals.photometric_model import Fit, further_lobes
from hagoromo.measurement.normals.photometric_step import OF_LAMP, PixelProblem, PixelStep, pack_shared, unpack_shared
from hagoromo.measurement.normals.pixel_errors import UNKNOWN_DIRECTION, PixelErrors, footprint
from hagoromo.measurement.normals.shading import tangents
from hagoromo.measurement.normals.smooth_normals import smoothed_modes
from hagoromo.measurement.normals.views import FEWEST_LAMPS, Array, Views

SAMPLED_VALUES, FEWEST_SAMPLED = 24_000, 400  # lamps × pixels in which lamps are left out, and pixels at least
MOST_BLOCKS = 24  # of lamps
NEIGHBOURS = 9  # sampled pixels over which changes are averaged
POOLED = 81  # sampled pixels over which the share of their noise is averaged
RIDGE = 1e-6  # of a pixel's curvature: where the other lamps do not determine its normal


def with_errors(views: Views, fit: Fit, seed: int = 0) -> Fit:
    """`fit` of `views` with `errors`, whose sum becomes its variance, and gloss with the errors that lamps make.

    As it is where the fit has no lamps of its own, or fewer than FEWEST_LAMPS.
    """
    lamps, count = len(views.values), len(views.rows)
    if fit.prior is None or lamps < FEWEST_LAMPS:
        return fit
    size = min(max(SAMPLED_VALUES // lamps, FEWEST_SAMPLED), count)
    sample = np.sort(np.random.default_rng(seed).choice(count, size, replace=False))
    step = _step(views, fit, sample)
    blocks, freedom = blocks_of(views)
    changes, gloss = _blocks_left_out(step, fit, blocks)
    wider = float(student.ppf(0.975, freedom)) / NORMAL_95
    factor, of_body = _own(step)
    nearest, changes = _nearest(views, step.problem.views), _without_noise(changes, step.problem.views)
    changes = wider * np.stack([one[nearest].mean(axis=1) for one in changes])
    modes, of_bodies = changes[..., :3], np.moveaxis(changes[..., 3:], 2, 1)
    modes -= np.einsum("mpi,pi->mp", modes, fit.normals)[..., None] * fit.normals
    own = np.minimum(fit.variance * factor[nearest[:, 0]], UNKNOWN_DIRECTION)
    width = smoothed_modes(views, fit, footprint(views.image(fit.normals))[:, views.rows, views.columns])
    errors = PixelErrors(own, modes, np.zeros(len(own)), of_body[nearest[:, 0]].T, of_bodies, width).leading()
    covariance = fit.covariance + wider**2 * gloss
    return replace(fit, errors=errors, variance=errors.variance, covariance=covariance)


def blocks_of(views: Views) -> tuple[list[NDArray[np.intp]], float]:
    """Blocks of neighbouring lamps, and the degrees of freedom of a variance that follows from them.

    A block is a lamp with those nearest to it: the cube root of their number, rounded, but FEWEST_LAMPS are left where
    there are more. Blocks overlap, which gives half as many degrees of freedom again as disjoint ones (Meketon &
    Schmeiser 1984).
    """
    towards = views.to_lamp.mean(axis=1)
    towards /= np.linalg.norm(towards, axis=1, keepdims=True)
    count = len(towards)
    size = max(min(round(count ** (1.0 / 3.0)), count - FEWEST_LAMPS), 1)
    middles = np.unique(np.linspace(0, count - 1, min(count, MOST_BLOCKS)).round().astype(int))
    blocks = [np.argsort(-(towards @ towards[k]), kind="stable")[:size] for k in middles]
    return blocks, (1.0 if size == 1 else 1.5) * (count / size - 1.0)


def _step(views: Views, fit: Fit, sample: NDArray[np.intp]) -> PixelStep:
    """The joint least squares of the sampled pixels at the solution, whose views have the lamps where it has them."""
    few, part = views.pixels(sample), fit.pixels(sample)
    place, further = views.place[sample], further_lobes(part, few.to_lamp, few.to_eye)
    if further is not None:
        light = fit.evenness(place)[:, None] * part.interface_colour * further[:, None]
        few = replace(few, values=few.values - light)
    free = np.ones(fit.gloss.rows.shape, bool) if fit.choice is None else fit.choice.free
    assert fit.prior is not None
    problem = PixelProblem(few, place, fit.share * len(views.rows) / len(sample), fit.prior, free)
    return PixelStep(problem, replace(part, shift=np.zeros_like(fit.shift), depth=0.0, lobes=None))


def _blocks_left_out(step: PixelStep, fit: Fit, blocks: list[NDArray[np.intp]]) -> tuple[Array, Array]:
    """Modes (m, P, 3 + C) of normals, world, and relative body colours; and the covariance (M, G, G) of the gloss."""
    whole, of_whole = _changed(step, fit)
    left_out, lamps = len(blocks[0]), len(fit.strength)
    scale = math.sqrt((lamps - left_out) / (left_out * len(blocks)))
    modes, gloss = [], np.zeros(fit.covariance.shape)
    for block in blocks:
        there, of_there = _changed(step.without(block), fit)
        modes.append(scale * (there - whole))
        by = scale * (of_there - of_whole)
        gloss += np.einsum("mi,mj->mij", by, by)
    return np.stack(modes), gloss


def _changed(step: PixelStep, fit: Fit) -> tuple[Array, Array]:
    """(P, 3 + C) changes of normals and relative bodies, (M, G) of the gloss, in one step; the prior of the lamps stays
    where they were stated.
    """
    lamps = np.zeros((len(fit.strength), OF_LAMP))
    assert fit.prior is not None
    lamps[:, 3:] = -fit.shift * fit.prior.direction**-2.0
    pull = pack_shared(np.zeros(fit.gloss.rows.shape), lamps, -fit.depth * fit.prior.distance**-2.0)
    local, shared = step.newton(pull)
    return _in_world(local, step.fit), unpack_shared(shared, fit.gloss.rows.shape)[0]


def _in_world(local: Array, part: Fit) -> Array:
    """Changes (..., P, 2 + C) by turns and body colours → (..., P, 3 + C) by normals, world, and relative colours.

    Turns are cut off at the mean of those to any direction, relative colours at 1.
    """
    first, second = tangents(part.normals)
    turns = local[..., :1] * first + local[..., 1:2] * second
    length = np.linalg.norm(turns, axis=-1, keepdims=True)
    turns = turns * np.minimum(1.0, math.sqrt(UNKNOWN_DIRECTION) / np.maximum(length, 1e-300))
    colours = local[..., 2:] / np.maximum(part.body.T, 1e-300)
    return np.concatenate([turns, np.clip(colours, -1.0, 1.0)], axis=-1)


def _own(step: PixelStep) -> tuple[Array, Array]:
    """(P,) by how much the own variance of normals is larger than noise and model error make it, at least 1; and (P, C)
    the own variance of the relative body colours.
    """
    bread, *pair = step.lamps_left_out(RIDGE)
    changes, plain = (_in_world(np.moveaxis(one, 1, 0), step.fit) for one in pair)  # (K, P, 3 + C)
    inverse = np.einsum("pii->pi", np.linalg.inv(bread))
    of_bodies = inverse[:, 2:] / np.maximum(step.fit.body.T, 1e-300) ** 2
    noise = np.concatenate([inverse[:, :2].sum(axis=1, keepdims=True), of_bodies], axis=1)
    nearest = _nearest(step.problem.views, step.problem.views)
    count, found = nearest.shape[1], np.zeros((len(nearest), changes.shape[2]))
    for one, other in zip(changes, plain, strict=True):
        together = (one[nearest] * other[nearest]).mean(axis=1)
        found += together - one[nearest].mean(axis=1) * other[nearest].mean(axis=1)
    found *= count / max(count - 1, 1)
    found = np.concatenate([found[:, :3].sum(axis=1, keepdims=True), found[:, 3:]], axis=1)
    factor = np.maximum(found / np.maximum(noise[nearest].mean(axis=1), 1e-300), 1.0)
    return factor[:, 0], factor[:, 1:] * noise[:, 1:]


def _without_noise(changes: Array, sample: Views) -> Array:
    """(m, S, 3 + C) `changes` of the sampled pixels, made smaller by the share of the squares of their means over
    neighbours that noise of these pixels has.
    """
    nearest, around = _nearest(sample, sample), _nearest(sample, sample, POOLED)
    squared, noise = np.zeros((2, *changes.shape[1:]))
    for one in changes:
        squared += one[nearest].mean(axis=1) ** 2
        noise += one[nearest].var(axis=1) / max(nearest.shape[1] - 1, 1)
    for turn in (squared, noise):  # the directions of a normal have one share
        turn[:, :3] = turn[:, :3].sum(axis=1, keepdims=True)
    squared, noise = (one[around].mean(axis=1) for one in (squared, noise))
    return changes * np.sqrt(np.maximum(1.0 - noise / np.maximum(squared, 1e-300), 0.0))


def _nearest(of: Views, among: Views, most: int = NEIGHBOURS) -> NDArray[np.intp]:
    """(P, n) numbers of the pixels `among` that are nearest to each pixel `of`, nearest first."""
    from scipy.spatial import KDTree

    count = min(most, len(among.rows))
    places = [np.stack([one.rows, one.columns], axis=1) for one in (among, of)]
    return np.asarray(KDTree(places[0]).query(places[1], count)[1], np.intp).reshape(len(of.rows), count)
