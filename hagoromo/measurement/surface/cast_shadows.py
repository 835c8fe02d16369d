"""Cast shadows: what photographs show of the depth of parts of a surface that normals do not join.

Where one part of an object hides another, neighbouring pixels have a step of depth, and no normal shows it: integration
joins what is apart. Shadows are evidence of it. A pixel p that a lamp lights has nothing before it on its way to the
lamp, and one in shadow that faces the lamp has something there. With u = ln depth, q a pixel on that way in the picture
and t the length of the way to the ray of q, both are bounds of differences between pixels

    u_q − u_p ≥ b for every q where p is lit,    u_q − u_p ≤ b for one q where it is not,    b = ln (1 + t l_z / z_p)

(shape from shadows: Daum & Dudek 1998). The bounds that are violated join the graph of normals as edges, in rounds,
while edges of normals that are stretched most lose their weight, at first the few that are stretched far, then all
beyond a step (graduated non-convexity: Blake & Zisserman 1987).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.measurement.nearest import nearest_known
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.squares import square_means
from hagoromo.measurement.surface.chords import rays
from hagoromo.measurement.surface.graph import ANCHORED, Graph, differences, graph
from hagoromo.measurement.surface.horizon import height_over_horizon, strides

FACING = 0.15  # cosine to the lamp from which a dark pixel is in a cast shadow
LIT, DARK = 0.75, 0.5  # of the light that the normal predicts: above, below, a pixel is lit, in shadow
MOST_PIXELS = 8000  # of the surface whose steps are sought; of more, means over squares
MOST_LAMPS, MOST_BOUNDS = 24, 20_000  # the latter of lit pixels, and of dark ones, chosen at random
STRENGTHS = (0.3, 1.0, 3.0, 10.0)  # of bounds, in median weights of edges
ROUNDS, LAST_ROUNDS, FINE_ROUNDS = 16, 8, 4  # of separating, of bounds as uncertain as they are, of finer pixels
NARROWER = 1.3  # by how much less stretched edges give way in each of the first
LEAST_PART = 25  # pixels of a part that has a depth of its own
WEAK = 1e-6  # weight of where a part is, in weights of bounds: it holds what no edge and no bound does
BLACK = 1.0 / 3.0  # of that light: below, a pixel beside a lit one is in shadow as a whole
HALF_LIGHT = np.radians(1.0)  # height of a lamp over the horizon from which all its light arrives, and none below −
EVIDENT = 0.25  # by how much Σ (predicted share − share)² over lamps must fall where a pixel changes sides of a step
BETTER = 0.8  # of the misfit of shadows by normals alone: with more nothing is changed


@dataclass(frozen=True, eq=False)
class CastShadows:
    """rows, columns: (P,) pixels of a picture. to_lamp: (K, P, 3) unit, world axes. share: (K, P) of the light that the
    normal predicts, 0 to 1; NaN where the photograph says nothing of cast shadows.
    """

    rows: NDArray[np.intp]
    columns: NDArray[np.intp]
    to_lamp: Array
    share: Array

    def every(self, step: int) -> CastShadows:
        """The pixel in the middle of each square of `step`, as a pixel of a picture of squares."""
        middle = (self.rows % step == step // 2) & (self.columns % step == step // 2)
        pixels = self.rows[middle] // step, self.columns[middle] // step
        return CastShadows(*pixels, self.to_lamp[:, middle], self.share[:, middle])

    def some(self, most: int, seed: int = 0) -> CastShadows:
        """Those of `most` pixels, chosen at random."""
        chosen = np.random.default_rng(seed).permutation(len(self.rows))[:most]
        return CastShadows(self.rows[chosen], self.columns[chosen], self.to_lamp[:, chosen], self.share[:, chosen])

    def misfit(self, points: Array, camera: Camera) -> float:
        """Σ (predicted share − share)² over pixels, mean over the lamps, of shadows that `points` (h, w, 3) cast."""
        every = np.arange(len(self.rows))
        return float(np.sum(self.misfits(points, camera, every))) / max(len(self.share), 1)

    def misfits(self, points: Array, camera: Camera, chosen: NDArray[np.intp], shaded: Array | None = None) -> Array:
        """(N,) Σ (predicted share − share)² over the lamps of the `chosen` pixels (N,), by their numbers.

        shaded: (N, 3) [m], world, where they are in place of what `points` (h, w, 3) says.
        """
        lamp, one = np.nonzero(np.isfinite(self.share[:, chosen]))
        pixel, there = chosen[one], None if shaded is None else shaded[one]
        places = self.rows[pixel], self.columns[pixel]
        height = height_over_horizon(points, camera, places, self.to_lamp[lamp, pixel], there)
        arriving = np.clip(0.5 + 0.5 * height / HALF_LIGHT, 0.0, 1.0)
        squares = (arriving - self.share[lamp, pixel]) ** 2
        return np.bincount(one, squares, len(chosen)).astype(np.float64)


def cast_shadows(normal_map: NormalMap, trusted: NDArray[np.bool_]) -> CastShadows:
    """What the photographs of `normal_map` show of shadows. trusted: (K, P) values that are valid, also in shadow."""
    views, fit = normal_map.views, normal_map.fit
    some = np.unique(np.linspace(0, len(trusted) - 1, min(len(trusted), MOST_LAMPS)).round().astype(int))
    to_lamp = views.to_lamp[some]
    model = fit.evenness(views.place)[some][:, None] * predicted(fit, to_lamp, views.to_eye)
    values = np.where(np.isfinite(views.values[some]), views.values[some], 0.0)
    share = np.clip(np.sum(values * model, axis=1) / np.maximum(np.sum(model**2, axis=1), 1e-300), 0.0, 1.0)
    evident = trusted[some] & (np.einsum("kpi,pi->kp", to_lamp, fit.normals) > FACING)
    if views.lacks is not None:  # where a shadow ends within the pixel it is neither lit nor in shadow
        evident &= (views.lacks[some] == 0.0) | (share < BLACK)
    return CastShadows(views.rows, views.columns, to_lamp, np.where(evident, share, np.nan))


def separated(net: Graph, normals: NDArray[np.floating], camera: Camera, shadows: CastShadows) -> Graph | None:
    """The graph, settled, with its steps open, and values by normals and shadows; None where normals alone do as well.

    net: settled by normals alone. normals: (h, w, 3), world axes.
    """
    known = net.chords.known
    step = max(int(np.ceil(np.sqrt(known.sum() / MOST_PIXELS))), 1)
    small, seen_by, there = (net, camera, shadows) if step == 1 else _coarse(net, normals, camera, shadows, step)
    if not (np.abs(small.stretch(small.values)) > 1.0).any():
        return None
    bounds = _bounds(small, seen_by, there)
    found = [_separated(small, bounds, strength) for strength in STRENGTHS]
    best = found[int(np.argmin([there.misfit(one.points(seen_by), seen_by) for one in found]))]
    best = best if step == 1 else _refined(net, best, step, _bounds(net, camera, shadows))
    best = _moved(best, camera, shadows, 2 * step)
    some = shadows.some(MOST_PIXELS)
    before, after = (some.misfit(one.points(camera), camera) for one in (net, best))
    return best if after < BETTER * before else None


def apart_variance(net: Graph) -> Array:
    """(P,) variance of ln depth of parts that only shadows join to the largest one: that of a step."""
    if net.open.all():
        return np.zeros(len(net.values))
    part = net.parts
    return np.where(part == np.bincount(part).argmax(), 0.0, net.step**2)


@dataclass(frozen=True, eq=False)
class Bounds:
    """N pixels (N,) and those on their ways to a lamp, places (N, S), with the `bound` (N, S) of the difference, −inf
    where there is none; dark: (N,) which are in shadow.
    """

    pixel: NDArray[np.intp]
    places: NDArray[np.intp]
    bound: Array
    dark: NDArray[np.bool_]

    def violated(self, values: Array, margin: float) -> tuple[NDArray[np.intp], Array, Array]:
        """pairs (V, 2), bounds (V,) and by how much (V,) the values pass them, of those passed by more than `margin`.

        Of each pixel the one on its way whose bound is nearest to being reached.
        """
        every = np.arange(len(self.pixel))
        apart = np.where(
            np.isfinite(self.bound), values[self.places] - values[self.pixel][:, None] - self.bound, np.inf
        )
        nearest = np.argmin(apart, axis=1)
        by = apart[every, nearest]
        passed = np.where(self.dark, np.isfinite(by) & (by > margin), by < -margin)
        pair = np.stack([self.pixel, self.places[every, nearest]], axis=1)
        return pair[passed], self.bound[every, nearest][passed], np.abs(by[passed])


def _bounds(net: Graph, camera: Camera, shadows: CastShadows, seed: int = 0) -> Bounds:
    """Of MOST_BOUNDS lit pixels and as many dark ones, chosen at random."""
    random, share, known, index = np.random.default_rng(seed), shadows.share, net.chords.known, net.chords.index
    with np.errstate(invalid="ignore"):
        sets = [np.stack(np.nonzero(one)) for one in (share > LIT, share < DARK)]
    sets = [one[:, random.permutation(one.shape[1])[:MOST_BOUNDS]] for one in sets]
    lamp, pixel = np.concatenate(sets, axis=1)
    dark = np.arange(len(lamp)) >= sets[0].shape[1]
    to_lamp = shadows.to_lamp[lamp, pixel] @ camera.world_to_camera[:3, :3].T
    row, column = shadows.rows[pixel], shadows.columns[pixel]
    ray, focal, principal = rays(camera, row, column), np.array(camera.focal), np.array(camera.principal)
    across = focal * (to_lamp[:, :2] - to_lamp[:, 2:] * ray[:, :2])
    across /= np.maximum(np.linalg.norm(across, axis=1, keepdims=True), 1e-12)
    far = strides(float(np.hypot(*known.shape)))
    place = np.stack([column, row], axis=1)[:, None] + 0.5 + far[:, None] * across[:, None]
    corner = np.floor(place).astype(np.intp)
    inside = ((corner >= 0) & (corner < np.array(known.shape[::-1]))).all(axis=2)
    corner = np.where(inside[..., None], corner, 0)
    # z_p + t l_z on the ray of the pixel, by the component along the way
    aim = (corner + 0.5 - principal) / focal
    along = np.sum((aim - ray[:, None, :2]) * across[:, None], axis=2)
    per_length = np.sum((to_lamp[:, None, :2] - aim * to_lamp[:, None, 2:]) * across[:, None], axis=2)
    length = along / np.where(np.abs(per_length) > 1e-12, per_length, 1e-12)
    ratio = 1.0 + length * to_lamp[:, 2:]
    places = index[corner[..., 1], corner[..., 0]]
    valid = inside & (places >= 0) & (length > 0.0) & (ratio > 1e-3)
    # what casts a shadow is lit itself where the ray touches it, or next to what is
    valid &= ~dark[:, None] | _lit(shadows, known.shape)[lamp[:, None], corner[..., 1], corner[..., 0]]
    own = index[row, column]
    valid &= (own >= 0)[:, None] & (places != own[:, None])
    bound = np.where(valid, np.log(np.maximum(ratio, 1e-3)), -np.inf)
    return Bounds(np.maximum(own, 0), np.where(valid, places, 0), bound, dark)


def _lit(shadows: CastShadows, shape: tuple[int, int]) -> NDArray[np.bool_]:
    """(K, h, w) pixels that are lit, or next to one."""
    from scipy.ndimage import binary_dilation

    lit = np.zeros((len(shadows.share), *shape), bool)
    with np.errstate(invalid="ignore"):
        lit[:, shadows.rows, shadows.columns] = shadows.share > 0.5
    return np.stack([np.asarray(binary_dilation(one)) for one in lit])


def _separated(net: Graph, bounds: Bounds, strength: float) -> Graph:
    """Steps of the graph where shadows ask for them; `strength` of a bound while they are sought."""
    part, weak = np.ones(len(net.weight)), np.full(len(net.values), WEAK / net.step**2)
    values = _solved(net, part, weak, net.values, None, 0.0)
    scale = max(float(np.abs(net.stretch(values)).max()), 1.0)
    for _ in range(ROUNDS):
        values = _solved(net, part, weak, values, bounds, strength * net.typical)
        scale = max(scale / NARROWER, 1.0)
        part = 1.0 / (1.0 + (net.stretch(values) / scale) ** 2)
    return _opened(net, values, bounds)


def _opened(net: Graph, values: Array, bounds: Bounds, rounds: int = LAST_ROUNDS) -> Graph:
    """The graph whose edges are whole or open, from `values` near its own; bounds are as uncertain as a step."""
    weak = np.full(len(values), WEAK / net.step**2)
    for _ in range(rounds):
        stretch = net.stretch(values)
        part = np.where(np.abs(stretch) > 1.0, 0.0, 1.0 / (1.0 + stretch**2))
        values = _solved(net, part, weak, values, bounds, net.step**-2)
    return _without_spikes(net.stepped(values))


def _moved(net: Graph, camera: Camera, shadows: CastShadows, rounds: int) -> Graph:
    """The graph whose pixels beside steps are on the side that their own shadows show, `rounds` pixels far at most.

    Bounds find a step to a few pixels only, more where it was sought on wider ones, and normals alike on both sides say
    nothing of its place: what is left on the wrong side stands out of the surface, in shadow or throwing it.
    """
    net, number = net.stepped(net.values), np.full(len(net.values), -1)
    own = net.chords.index[shadows.rows, shadows.columns]
    number[own[own >= 0]] = np.flatnonzero(own >= 0)
    rows, columns = np.nonzero(net.chords.known)
    ray = rays(camera, rows, columns) @ camera.camera_to_world[:3, :3].T
    some = shadows.some(MOST_PIXELS)
    least = some.misfit(net.points(camera), camera)
    for _ in range(rounds):
        across = np.flatnonzero(net.open == 0.0)
        (one, two), wanted = net.chords.pair[across].T, net.chords.wanted[across]
        pixel = np.concatenate([one, two])
        there = np.concatenate([net.values[two] - wanted, net.values[one] + wanted])
        part = net.parts
        large = np.bincount(part)[part] >= LEAST_PART
        usable = (number[pixel] >= 0) & large[np.concatenate([two, one])]
        pixel, there = pixel[usable], there[usable]
        points, chosen = net.points(camera), number[pixel]
        beyond = ray[pixel] * np.exp(there)[:, None] + camera.position
        gain = shadows.misfits(points, camera, chosen) - shadows.misfits(points, camera, chosen, beyond)
        order = np.argsort(gain, kind="stable")[np.count_nonzero(gain <= EVIDENT) :]
        if not len(order):
            break
        values = net.values.copy()
        values[pixel[order]] = there[order]  # the best, last, stays
        moved = _without_spikes(net.stepped(values))
        misfit = some.misfit(moved.points(camera), camera)
        if misfit >= least:
            break
        net, least = moved, misfit
    return net


def _without_spikes(net: Graph) -> Graph:
    """The graph whose parts of few pixels stand neither before nor behind all that is around: they touch the nearest.

    A pixel that sees both sides of a step belongs to neither, and would cast shadows of its own.
    """
    part = net.parts
    size, stretch, values = np.bincount(part), net.stretch(net.values), net.values.copy()
    ends = part[net.chords.pair]
    around = np.flatnonzero(ends[:, 0] != ends[:, 1])
    own = np.concatenate([ends[around, 0], ends[around, 1]])
    ahead = np.concatenate([stretch[around], -stretch[around]])  # how far what is around lies behind
    least, most = np.full(len(size), np.inf), np.full(len(size), -np.inf)
    np.minimum.at(least, own, ahead)
    np.maximum.at(most, own, ahead)
    shift = np.where(least > 0.0, least, np.where(most < 0.0, most, 0.0))
    shift = np.where((size < LEAST_PART) & np.isfinite(shift), shift, 0.0)
    return replace(net, values=values + net.step * shift[part])


def _solved(net: Graph, part: Array, weak: Array, values: Array, bounds: Bounds | None, weight: float) -> Array:
    """(P,) values by edges and by those bounds that `values` violate; far violations count less (Cauchy)."""
    if bounds is None:
        return np.asarray(net.solver(part, weak)(net.rhs(part) + weak * values))
    pair, bound, by = bounds.violated(values, 0.5 * net.step)
    usual = max(float(np.median(by)), net.step) if len(by) else net.step
    each = weight / (1.0 + (by / usual) ** 2)
    rows = differences(pair, len(values))
    more = rows.T @ rows.multiply(each[:, None]).tocsr()
    return net.solver(part, weak, more)(net.rhs(part) + weak * values + rows.T @ (each * bound))


def _coarse(
    net: Graph, normals: NDArray[np.floating], camera: Camera, shadows: CastShadows, step: int
) -> tuple[Graph, Camera, CastShadows]:
    """The graph of means over squares of `step` pixels, settled by normals alone; its camera and shadows."""
    known = net.chords.known
    whole = square_means(known.astype(np.float64), step) > 0.5
    height, width = whole.shape
    mean = square_means(np.where(known[..., None], normals, 0.0).astype(np.float64), step)
    mean = np.where(whole[..., None], mean, 0.0)
    mean /= np.maximum(np.linalg.norm(mean, axis=2, keepdims=True), 1e-12)
    variance = np.zeros(known.shape)
    variance[known] = net.of_normals
    seen_by = camera.resampled(width, height, (float(step), float(step)))
    small = graph(mean, seen_by, whole, square_means(variance, step))
    seen = shadows.every(step)
    inside = (seen.rows < height) & (seen.columns < width)
    inside &= whole[np.minimum(seen.rows, height - 1), np.minimum(seen.columns, width - 1)]
    seen = CastShadows(seen.rows[inside], seen.columns[inside], seen.to_lamp[:, inside], seen.share[:, inside])
    level = np.full(int(whole.sum()), float(np.mean(net.values)))
    return small.settled(level, small.gauge), seen_by, seen


def _refined(net: Graph, coarse: Graph, step: int, bounds: Bounds) -> Graph:
    """The steps of a graph by those of a coarser one, whose pixels are `step` times as wide."""
    from scipy.ndimage import map_coordinates

    known = net.chords.known
    picture = np.zeros(coarse.chords.known.shape)
    picture[coarse.chords.known] = coarse.values
    place = np.stack(np.nonzero(known)).astype(np.float64)
    level = map_coordinates(
        picture[nearest_known(coarse.chords.known)], (place + 0.5) / step - 0.5, order=1, mode="nearest"
    )
    near = np.full(len(level), net.membrane(step))
    values = replace(net, open=np.ones(len(net.weight))).settled(np.asarray(level), near, ANCHORED).values
    return _opened(net, values, bounds, FINE_ROUNDS)
