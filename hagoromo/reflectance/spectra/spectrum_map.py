"""Reflectance spectra of many pixels at once: the estimate of `estimate_spectrum`, made once for pixels of like colour.

Readings y of mean 1 that lie in one small cell share their estimate at the mean of the cell, which is exact, and its
derivative: r(y) = r(y₀) + J (y − y₀). Under a mixture of Gaussians, r = Σ_p w_p r_p with r_p = a_p + G_p y, and
J = Σ_p w_p (G_p + r_p g_pᵀ) − r Σ_p w_p g_pᵀ with g_p = ∂ ln w_p / ∂y.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.reflectance.spectra.bounded_spectra import within_bounds
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS
from hagoromo.reflectance.spectra.reflectance_prior import ReflectancePrior
from hagoromo.reflectance.spectra.spectrum_estimate import BRIGHTNESS, read_parts, unexplained_above

BLOCK = 128  # cells of like colour that are estimated together
CELL, NOISES = 0.015, 5.0  # side of a cell, of readings of mean 1: the larger of this and so many times their noise
SORTING = 4.0  # side of the larger cells by which cells are sorted, in sides of a cell
NOISE_STEP = 1.5  # pixels of a cell differ in their relative noise by less; they are given its root mean square
LIGHTEST = 1e-5  # least weight of a part of the mixture that takes part in a block, in one of its cells
LOG_OF_NOTHING = -60.0  # ln of the weight below which it is 0
Array = NDArray[Any]
MOST_LIMITED = 4096  # pixels at their bounds that are solved together


@dataclass(frozen=True, eq=False)
class SpectrumMap:
    """Spectra of many pixels, of the shape (...) of the readings; NaN where a pixel has no readings above 0.

    values, standard_error: (..., wavelengths). chi_square: (...), see `SpectrumEstimate`; readings: their number.
    probability: (..., priors), in the order of `priors`. limited: (...) whether a bound was active.
    """

    wavelengths: Array
    values: NDArray[np.float32]
    standard_error: NDArray[np.float32]
    chi_square: NDArray[np.float32]
    readings: int
    probability: NDArray[np.float32]
    priors: tuple[str, ...]
    limited: NDArray[np.bool_]

    @property
    def explained(self) -> NDArray[np.bool_]:
        """(...) whether a likely reflectance explains the readings of each pixel; False where it has none."""
        return self.chi_square <= unexplained_above(self.readings)


def estimate_spectra(
    matrix: Array, values: ArrayLike, errors: ArrayLike, priors: Sequence[ReflectancePrior], upper: float = 1.0
) -> SpectrumMap:
    """As `estimate_spectrum`, of many pixels, whose readings are independent.

    matrix: (m, wavelengths), see `reading_matrix`. values: (..., m) readings relative to white. errors: their standard
    errors, of a shape that broadcasts to it. Differs from the estimate of one pixel by the noise, see `NOISE_STEP`.
    """
    readings = np.asarray(values, np.float64)
    if readings.ndim < 1 or readings.shape[-1] != len(matrix):
        raise InputError(f"readings of shape {readings.shape} do not have the {len(matrix)} values of the matrix")
    flat = readings.reshape(-1, len(matrix))
    noise = np.broadcast_to(np.asarray(errors, np.float64), readings.shape).reshape(flat.shape)
    bright = flat.mean(axis=1)
    usable = np.flatnonzero(np.isfinite(flat).all(axis=1) & (bright > 0.0) & (noise > 0.0).all(axis=1))
    bright = bright[usable, None]
    shape, relative = flat[usable] / bright, noise[usable] / bright
    cell, count = _cells(shape, relative)
    middle, noises = _means(cell, count, shape), _means(cell, count, relative**2)
    mixture = _Mixture.of(matrix, priors)
    cells = _estimate_cells(mixture, matrix, middle, noises, len(priors))
    off = (shape - middle[cell]).astype(np.float32)
    estimated = cells.mean[cell] + (cells.slope[cell] @ off[..., None])[..., 0]
    limited = np.flatnonzero(((estimated < 0.0) | (estimated * bright > upper)).any(axis=1))
    for start in range(0, len(limited), MOST_LIMITED):
        some = limited[start : start + MOST_LIMITED]
        estimated[some] = _limited(estimated[some], cells, cell[some], upper / bright[some])
    found = (
        bright * estimated,
        bright * np.sqrt(cells.variance[cell]),
        _chi_square(mixture, matrix, cells.nearest[cell], noises[cell], shape)[:, None],
        cells.probability[cell],
        np.isin(np.arange(len(usable)), limited)[:, None],
    )
    full = [_filled(len(flat), usable, part).reshape(*readings.shape[:-1], part.shape[1]) for part in found]
    names = tuple(prior.name for prior in priors)
    return SpectrumMap(
        WAVELENGTHS, full[0], full[1], full[2][..., 0], len(matrix), full[3], names, full[4][..., 0] > 0.5
    )


def _filled(count: int, places: NDArray[np.int64], part: NDArray) -> NDArray[np.float32]:
    """(count, …): `part` at `places`, NaN elsewhere."""
    full = np.full((count, part.shape[1]), np.nan, np.float32)
    full[places] = part
    return full


def _cells(shape: Array, relative: Array) -> tuple[NDArray[np.int64], int]:
    """Number of the cell of colour and noise that each pixel lies in, in an order of like colours, and their count."""
    level = np.rint(np.log(np.mean(relative**2, axis=1)) / (2.0 * np.log(NOISE_STEP)))
    side = np.maximum(CELL, NOISES * NOISE_STEP**level)[:, None]
    fine = np.column_stack([level, np.floor(shape / (SORTING * side)), np.floor(shape / side)]).astype(np.int64)
    low = fine.min(axis=0, initial=0)
    key = np.zeros(len(fine), np.uint64)
    for column in (fine - low).T.astype(np.uint64):  # a number for each row; that two rows share one is unlikely
        key = (key ^ column) * np.uint64(0x9E3779B97F4A7C15)
        key ^= key >> np.uint64(29)
    _, first, cell = np.unique(key, return_index=True, return_inverse=True)
    order = np.lexsort(fine[first, shape.shape[1] :: -1].T)
    rank = np.empty(len(first), np.int64)
    rank[order] = np.arange(len(first))
    return rank[cell], len(first)


def _means(cell: NDArray[np.int64], count: int, values: Array) -> Array:
    """(cells, m) means of `values` (pixels, m)."""
    sums = [np.bincount(cell, column, count) for column in values.T]
    return np.stack(sums, axis=1) / np.bincount(cell, minlength=count)[:, None]


class _Cells(NamedTuple):
    """Estimates of cells (k) of readings of mean 1.

    mean (k, n); slope: J (k, n, m); variance (k, n); probability (k, priors); nearest: the part of the mixture whose χ²
    is least (k,). covariance: makes that of some cells (…, n, n).
    """

    mean: NDArray[np.float32]
    slope: NDArray[np.float32]
    variance: NDArray[np.float32]
    probability: NDArray[np.float32]
    nearest: NDArray[np.int64]
    covariance: Callable[[NDArray[np.int64]], Array]


class _CellTables(NamedTuple):
    """What cells of one noise share, per part of the mixture (p).

    log: (features, p) of ln w. square: (features, p) of χ². inverse: (p, m, m) of the covariance of the readings.
    """

    log: Array
    square: Array
    inverse: Array

    def some(self, parts: NDArray[np.int64]) -> _CellTables:
        """Those of these parts only."""
        return _CellTables(self.log[:, parts], self.square[:, parts], self.inverse[parts])


class _Mixture(NamedTuple):
    """The parts of all priors, through the readings: see `Parts`; before: covariance of each (p, n, n)."""

    centres: Array
    expected: Array
    gain: Array
    before: Array
    log_weights: Array
    owner: NDArray[np.int64]

    @staticmethod
    def of(matrix: Array, priors: Sequence[ReflectancePrior]) -> _Mixture:
        """The parts of `priors` through the `matrix` of the readings."""
        parts = [read_parts(prior, matrix) for prior in priors]
        before = [
            part.scale[:, None, None] ** 2 * prior.covariances
            + BRIGHTNESS**2 * part.centres[:, :, None] * part.centres[:, None, :]
            for prior, part in zip(priors, parts, strict=True)
        ]
        owner = np.repeat(np.arange(len(priors)), [len(prior.centres) for prior in priors])
        return _Mixture(
            np.concatenate([part.centres for part in parts]),
            np.concatenate([part.expected for part in parts]),
            np.concatenate([part.gain for part in parts]),
            np.concatenate(before),
            np.concatenate([prior.log_weights + np.log(prior.odds) for prior in priors]),
            owner,
        )

    def some(self, parts: NDArray[np.int64]) -> _Mixture:
        """The mixture of these parts only."""
        return _Mixture(**{name: field[parts] for name, field in self._asdict().items()})

    def tables(self, matrix: Array, variance: Array) -> _CellTables:
        """Tables for all pixels whose readings have mean 1 and this `variance` (m,)."""
        total = matrix @ self.gain + np.diag(variance)
        inverse = np.linalg.inv(total)
        linear = np.einsum("pab,pb->pa", inverse, self.expected)
        constant = np.einsum("pa,pa->p", self.expected, linear)
        rows, columns = np.triu_indices(len(matrix))
        twice = np.where(rows == columns, 1.0, 2.0)
        square = np.vstack([twice[:, None] * inverse[:, rows, columns].T, -2.0 * linear.T, constant])
        log = -0.5 * square
        log[-1] += self.log_weights - 0.5 * np.linalg.slogdet(total)[1]
        return _CellTables(log, square, inverse)


def _active(tables: _CellTables, shape: Array) -> NDArray[np.int64]:
    """The parts of the mixture that cells of like colour need."""
    logs = _features(shape) @ tables.log
    return np.flatnonzero((logs > logs.max(axis=1, keepdims=True) + np.log(LIGHTEST)).any(axis=0))


def _features(shape: Array) -> Array:
    """(cells, features): products of two readings, readings, 1."""
    rows, columns = np.triu_indices(shape.shape[1])
    return np.hstack([shape[:, rows] * shape[:, columns], shape, np.ones((len(shape), 1))])


def _estimate_cells(mixture: _Mixture, matrix: Array, shape: Array, variance: Array, priors: int) -> _Cells:
    """Estimate all cells, block by block, each by the parts of the mixture that it needs."""
    count, width = len(shape), len(WAVELENGTHS)
    found = _Cells(
        np.empty((count, width), np.float32),
        np.empty((count, width, shape.shape[1]), np.float32),
        np.empty((count, width), np.float32),
        np.zeros((count, priors), np.float32),
        np.empty(count, np.int64),
        lambda some: _covariances(mixture, matrix, shape[some], variance[some]),
    )
    for start in range(0, count, BLOCK):
        block = slice(start, start + BLOCK)
        tables = mixture.tables(matrix, variance[block].mean(axis=0))
        active = _active(tables, shape[block])
        parts = {name: part[block] for name, part in found._asdict().items() if name != "covariance"}
        _estimate_block(mixture, active, tables.some(active), shape[block], found._replace(**parts))
        found.nearest[block] = active[found.nearest[block]]
    return found


def _estimate_block(
    mixture: _Mixture, active: NDArray[np.int64], tables: _CellTables, shape: Array, found: _Cells
) -> None:
    """Estimate cells of like colour and noise by the `active` parts, of these `tables`, and write them to `found`."""
    centres, expected, prior_gain, owner = (
        part[active] for part in (mixture.centres, mixture.expected, mixture.gain, mixture.owner)
    )
    features = _features(shape)
    weight = _weights(features @ tables.log)
    gain = prior_gain @ tables.inverse
    middle = shape.mean(axis=0)
    at_middle = centres + (gain @ (middle - expected)[..., None])[..., 0]
    base = weight.mean(axis=0) @ at_middle  # single precision holds differences from it
    table = np.concatenate([(at_middle - base)[..., None], gain], axis=2).astype(np.float32)  # (p, n, 1 + m)
    off = np.hstack([np.ones((len(shape), 1)), shape - middle]).astype(np.float32)
    weighted = _contracted(weight, table)
    mean = _dot(weighted, off)
    rows, columns = np.triu_indices(off.shape[1])
    twice = np.where(rows == columns, 1.0, 2.0).astype(np.float32)
    square = _contracted(weight, twice * table[..., rows] * table[..., columns])
    between = np.maximum(_dot(square, off[:, rows] * off[:, columns]) - mean**2, 0.0)
    within = np.einsum("pnn->pn", mixture.before)[active] - (gain * prior_gain).sum(axis=2)
    found.mean[:] = base + mean
    found.variance[:] = weight @ within.astype(np.float32) + between
    found.slope[:] = weighted[..., 1:]
    for channel in range(shape.shape[1]):  # g_p = −(A K_p Aᵀ + noise)⁻¹ (y − A c_p)
        row = tables.inverse[:, channel]
        pull = weight * (np.sum(row * expected, axis=1) - shape @ row.T).astype(np.float32)
        found.slope[..., channel] += _dot(_contracted(pull, table), off) - mean * pull.sum(axis=1, keepdims=True)
    for prior in np.unique(owner):
        found.probability[:, prior] = weight[:, owner == prior].sum(axis=1)
    found.nearest[:] = (features @ tables.square).argmin(axis=1)


def _weights(logs: Array) -> NDArray[np.float32]:
    """Shares of the parts of the mixture, from logs (cells, p); none is a subnormal number: these are slow."""
    below = (logs - logs.max(axis=1, keepdims=True)).astype(np.float32)
    weight = np.exp(below, where=below > LOG_OF_NOTHING, out=np.zeros_like(below))
    return weight / weight.sum(axis=1, keepdims=True)


def _contracted(weight: NDArray, table: Array) -> NDArray[np.float32]:
    """Σ_p weight (cells, p) · table (p, n, f): (cells, n, f)."""
    return (weight @ table.reshape(len(table), -1).astype(np.float32, copy=False)).reshape(-1, *table.shape[1:])


def _dot(table: NDArray, features: NDArray) -> NDArray[np.float32]:
    """Σ_f table (cells, n, f) · features (cells, f): (cells, n)."""
    return (table @ features[..., None])[..., 0]


def _covariances(mixture: _Mixture, matrix: Array, shape: Array, variance: Array) -> Array:
    """(cells, n, n) of readings of mean 1, cells in their order."""
    width = len(WAVELENGTHS)
    result = np.empty((len(shape), width, width))
    for start in range(0, len(shape), BLOCK):
        block = slice(start, start + BLOCK)
        noise = variance[block].mean(axis=0)
        part = mixture.some(_active(mixture.tables(matrix, noise), shape[block]))
        tables = part.tables(matrix, noise)
        weight = _weights(_features(shape[block]) @ tables.log)
        gain = part.gain @ tables.inverse
        within = (part.before - gain @ part.gain.transpose(0, 2, 1)).astype(np.float32)
        result[block] = _contracted(weight, within)
        offset = (part.centres - np.einsum("pna,pa->pn", gain, part.expected)).astype(np.float32)
        slope = gain.astype(np.float32)
        for k, readings in enumerate(shape[block].astype(np.float32)):
            means = offset + slope @ readings
            means -= weight[k] @ means
            result[start + k] += (weight[k][:, None] * means).T @ means
    return result


def _limited(values: NDArray, cells: _Cells, cell: NDArray[np.int64], upper: Array) -> Array:
    """Pixels' values (n,) of readings of mean 1 within 0…`upper` (pixels, 1)."""
    of_cells, place = np.unique(cell, return_inverse=True)
    return within_bounds(values.astype(np.float64), cells.covariance(of_cells)[place], upper)


def _chi_square(
    mixture: _Mixture, matrix: Array, nearest: NDArray[np.int64], variance: Array, shape: Array
) -> NDArray[np.float32]:
    """χ² of each pixel from the part of the mixture that is nearest to its cell."""
    total = (matrix @ mixture.gain)[nearest]
    total[:, np.arange(len(matrix)), np.arange(len(matrix))] += variance
    off = shape - mixture.expected[nearest]
    return np.einsum("ka,ka->k", off, np.linalg.solve(total, off[..., None])[..., 0]).astype(np.float32)
