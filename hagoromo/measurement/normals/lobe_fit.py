"""Lobe fit: further lobes of the interface, on solved normals, where photographs that are left out need them.

The photometric fit has one lobe, and its robust loss takes a narrow spike above a wide haze for outliers: the normals
are right, but the highlight is missing. Here the density of the facets is a sum of Gaussians of many widths, all with β
of 0 or more (non-negative least squares), and body colours are eliminated pixel by pixel. Light in excess of the model
counts in full, as it is what is sought; light that is missing counts little, as shadows do. A clipped value is a lower
bound. The lobes stay where they predict photographs that were left out better.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays
from hagoromo.least_squares.loss import CAUCHY_SCALE
from hagoromo.measurement.normals.photometric_model import Fit, Lobes
from hagoromo.measurement.normals.shading import Gloss, N, shading
from hagoromo.measurement.normals.views import Array, Views
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.reflectance import MOST_LOBES
from hagoromo.reflectance.torrance_sparrow import cosines, weights_at

WIDTHS = np.radians(np.geomspace(0.5, 45.0, 16))  # [rad] of the candidates
DISTINCT = 1.25  # ratio of a candidate's width to γ of the first lobe, at least
LOBE_PIXELS = 6000  # pixels of a material, at most, from which its lobes are estimated
FEWEST_PIXELS = 200
FOLDS = 3  # parts of the lamps, each left out once
LEAST_GAIN = 0.05  # of the squared error of lamps left out: with less the lobes are not kept
LEAST_SHARE = 1e-3  # of the light of all lobes: a lobe with less is dropped
RELATIVE_ERROR = 0.02  # of the model, in the weights
PASSES = 2  # of re-weighting
LAST_PASSES = 6  # of the lobes that are kept: their spike rises until clipped values are reached
CLIPPED = 0.98  # of the largest valid value: masked values above are clipped
RIDGE = 1e-8  # relative, of the normal equations


@dataclass(frozen=True, eq=False)
class Samples:
    """Some pixels under K lamps: values (K, C, P); trusted (K, P) whether they are valid; lower (K, C, P) whether they
    are clipped, and so lower bounds; body and first: what a body of 1 and the first lobe give, (K, P); flat: the
    interface for D = β = 1; angle2: φ² [rad²]; colour (C, P) of the interface; noise (K, C, P): variance.
    """

    values: Array
    trusted: NDArray[np.bool_]
    lower: NDArray[np.bool_]
    body: Array
    first: Array
    flat: Array
    angle2: Array
    colour: Array
    noise: Array

    def lamps(self, chosen: NDArray) -> Samples:
        """The samples of some lamps."""
        parts = {key: value[chosen] for key, value in vars(self).items() if key != "colour"}
        return replace(self, **parts)

    def column(self, width: float) -> Array:
        """(K, P) a Gaussian lobe of β = 1 and this half width [rad]."""
        return self.flat * np.exp2(-self.angle2 / width**2)

    def interface(self, weights: Array, widths: Array) -> Array:
        """(K, P) the first lobe times weights[0], and lobes of `widths` with β weights[1:]."""
        total = weights[0] * self.first
        for weight, width in zip(weights[1:], widths, strict=True):
            if weight > 0.0:
                total = total + weight * self.column(float(width))
        return total


def with_lobes(capture: Capture, views: Views, fit: Fit, seed: int = 0) -> Fit:
    """`fit` with further lobes of each material whose highlight needs them, and body colours that go with them.

    Pixels of materials without further lobes stay as they are. capture: of `views`, whose masks are used here.
    """
    random, found = np.random.default_rng(seed), fit
    rows, body, lobes, gains = fit.gloss.rows.copy(), fit.body.copy(), [], []
    for number in range(len(rows)):
        own = np.flatnonzero(fit.labels == number)
        lobes.append(())
        gains.append(0.0)
        if len(own) < FEWEST_PIXELS or len(views.values) < 2 * FOLDS or not np.exp(rows[number, 0]) > 0.0:
            continue
        some = np.sort(random.choice(own, min(len(own), LOBE_PIXELS), replace=False))
        samples = samples_of(capture, views.pixels(some), fit.pixels(some), views.place[some])
        gamma = float(np.exp(rows[number, 1]))
        widths = WIDTHS[np.abs(np.log(WIDTHS / gamma)) > np.log(DISTINCT)]
        weights, kept = _fewest(samples, *_lobes(samples, widths))
        if _gain(samples, samples, weights, kept) < LEAST_GAIN:  # not even of the photographs that it was fitted to
            continue
        gain = _cross_validated(samples, widths, random)
        if gain < LEAST_GAIN:
            continue
        weights, widths = _lobes(samples, kept, LAST_PASSES, weights)
        weights[0] = max(weights[0], LEAST_SHARE)
        gains[-1], lobes[-1] = gain, tuple(zip(weights[1:].tolist(), widths.tolist(), strict=True))
        rows[number, 0] += np.log(weights[0])
        for part in np.array_split(own, -(-len(own) // LOBE_PIXELS)):  # bounded memory
            here = samples_of(capture, views.pixels(part), fit.pixels(part), views.place[part])
            body[:, part] = _body(here, here.interface(weights, widths))
    if any(lobes):
        found = replace(fit, gloss=Gloss(rows), body=body, lobes=Lobes(tuple(lobes), tuple(gains)))
    return found


def samples_of(capture: Capture, views: Views, fit: Fit, place: Array) -> Samples:
    """The samples of `views`, whose pixels `fit` (and `place`) have, with the clipped values of `capture`."""
    trusted = np.stack([photograph.mask[views.rows, views.columns] for photograph in capture.photographs])
    rows = fit.rows
    shade, (flat, angle2) = shading(fit.normals, views.to_lamp, views.to_eye, rows), _flat(views, fit.normals)
    even = fit.evenness(place)
    values = np.where(np.isfinite(views.values), views.values, 0.0)
    noise = np.where(np.isfinite(views.variance) & (views.variance > 0.0), views.variance, np.inf)
    lower = np.zeros(values.shape, bool)
    for k, photograph in enumerate(capture.photographs):
        raw = photograph.values[views.rows, views.columns].T
        top = photograph.values[photograph.mask].max(initial=0.0)
        lower[k] = ~trusted[k] & (np.nan_to_num(raw) >= CLIPPED * top) & (top > 0.0)
    noise = np.where(lower, np.nanmedian(np.where(np.isfinite(noise), noise, np.nan)), noise)
    parts = (even * shade.body, even * shade.interface, even * flat)
    return Samples(values, trusted, lower, *parts, angle2, fit.interface_colour, noise)


def _flat(views: Views, normals: Array) -> tuple[Array, Array]:
    """F G / cosθ_r (K, P), and φ² [rad²], of all lamps."""
    jit, (lamps, pixels) = arrays(), views.to_lamp.shape[:2]

    def wide(vectors: Array) -> jit.Array3f:  # type: ignore[name-defined]
        return jit.Array3f(np.ascontiguousarray(np.tile(vectors, (lamps, 1)).T, np.float32))

    towards = jit.Array3f(views.to_lamp.reshape(-1, 3).T.astype(np.float32))
    at = cosines(wide(normals), towards, wide(views.to_eye))
    flat = weights_at(at, 0.0, 1.0, dr.opaque(jit.Float, 1e6), N).interface
    half = views.to_lamp + views.to_eye
    cosine = np.einsum("kpi,pi->kp", half, normals) / np.maximum(np.linalg.norm(half, axis=2), 1e-12)
    angle2 = np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2
    return np.array(flat).reshape(lamps, pixels).astype(np.float64), angle2


def _cross_validated(samples: Samples, widths: Array, random: np.random.Generator) -> float:
    """Median, over parts of the lamps that are left out, of the `_gain` of lobes of some of the `widths`."""
    lamps, gains = random.permutation(len(samples.values)), []
    for fold in range(FOLDS):
        left_out = np.zeros(len(lamps), bool)
        left_out[lamps[fold::FOLDS]] = True
        rest = samples.lamps(~left_out)
        gains.append(_gain(rest, samples.lamps(left_out), *_fewest(rest, *_lobes(rest, widths))))
    return float(np.median(gains))


def _gain(rest: Samples, test: Samples, weights: Array, widths: Array) -> float:
    """Share of the squared error of `test` by which these lobes beat the first alone; bodies are those of `rest`."""
    alone, none = np.array([1.0]), np.zeros(0)
    one, several = (
        _squared_error(test, _model(test, test.interface(*lobes), _body(rest, rest.interface(*lobes))))
        for lobes in ((alone, none), (weights, widths))
    )
    return 1.0 - several / max(one, 1e-300)


def _squared_error(samples: Samples, model: Array) -> float:
    """Of all pixels, clipped values as they are recorded and the model clipped there."""
    model = np.where(samples.lower, np.minimum(model, samples.values), model)
    known = samples.trusted[:, None] | samples.lower
    return float(np.sum(np.where(known, samples.values - model, 0.0) ** 2))


def _lobes(samples: Samples, widths: Array, passes: int = PASSES, start: Array | None = None) -> tuple[Array, Array]:
    """Factor of the first lobe and β of lobes of `widths`, by non-negative least squares; and the widths."""
    weights = np.r_[1.0, np.zeros(len(widths))] if start is None else start
    columns = [samples.first, *(samples.column(float(width)) for width in widths)]
    for turn in range(passes):
        interface = samples.interface(weights, widths)
        model = _model(samples, interface, _body(samples, interface)) if turn or start is not None else None
        weight = _weights(samples, model)
        weights = _non_negative(samples, columns, weight)
    return weights, widths


def _weights(samples: Samples, model: Array | None) -> Array:
    """(K, C, P) inverse variance; less where light is missing; 0 where a lower bound holds already."""
    level = np.maximum(samples.values, samples.values.mean(axis=0))
    weight = 1.0 / (samples.noise + (RELATIVE_ERROR * level) ** 2)
    weight = np.where(samples.trusted[:, None] | samples.lower, weight, 0.0)
    if model is None:
        return weight
    missing = np.maximum(model - samples.values, 0.0)
    weight = weight / (1.0 + missing**2 * weight / CAUCHY_SCALE**2)
    return np.where(samples.lower & (model >= samples.values), 0.0, weight)


def _non_negative(samples: Samples, columns: list[Array], weight: Array) -> Array:
    """Weights of `columns` (K, P), 0 or more, with the body colours of all pixels eliminated."""
    from scipy.optimize import nnls

    count = len(columns)
    matrix, rhs = np.zeros((count, count)), np.zeros(count)
    for c in range(samples.values.shape[1]):
        own, colour = weight[:, c], samples.colour[c]
        power = np.maximum(np.sum(own * samples.body**2, axis=0), 1e-30)

        def rest(of: Array, own: Array = own, power: Array = power) -> Array:
            return of - samples.body * (np.sum(own * samples.body * of, axis=0) / power)

        parts = np.stack([rest(colour * column) for column in columns]).reshape(count, -1)
        weighed = parts * own.ravel()
        matrix += weighed @ parts.T
        rhs += weighed @ rest(samples.values[:, c]).ravel()
    scale = 1.0 / np.sqrt(np.maximum(np.diag(matrix), 1e-300))
    root = np.linalg.cholesky(matrix * scale[:, None] * scale + RIDGE * np.eye(count))
    found, _ = nnls(root.T, np.linalg.solve(root, rhs * scale))
    return np.asarray(found * scale, np.float64)


def _fewest(samples: Samples, weights: Array, widths: Array) -> tuple[Array, Array]:
    """The MOST_LOBES lobes with most light, estimated anew without the others; the first lobe is always kept."""
    light = [float(np.sum(weight * samples.column(float(w)))) for weight, w in zip(weights[1:], widths, strict=True)]
    total = sum(light) + float(np.sum(weights[0] * samples.first))
    order = sorted(range(len(widths)), key=lambda i: -light[i])[:MOST_LOBES]
    kept = np.array(sorted(i for i in order if light[i] > LEAST_SHARE * total), np.intp)
    weights, widths = _lobes(samples, widths[kept])
    weights[0] = max(weights[0], LEAST_SHARE)
    return weights, widths


def _body(samples: Samples, interface: Array) -> Array:
    """(C, P) body colours by least squares of what the interface (K, P) leaves, less where light is missing."""
    values = samples.values - samples.colour * interface[:, None]
    body, weight = np.zeros(values.shape[1:]), _weights(samples, None)
    for _ in range(PASSES):
        power = np.einsum("kcp,kp->cp", weight, samples.body**2)
        body = np.einsum("kcp,kp,kcp->cp", weight, samples.body, values) / np.maximum(power, 1e-30)
        body = np.maximum(body, 1e-4 * np.maximum(body.mean(), 1e-30))
        weight = _weights(samples, _model(samples, interface, body))
    return body


def _model(samples: Samples, interface: Array, body: Array) -> Array:
    """(K, C, P) values of body colours (C, P) and the interface (K, P)."""
    return body * samples.body[:, None] + samples.colour * interface[:, None]
