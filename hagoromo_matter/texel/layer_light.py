"""Layer light: what a flat layer of one level of a texel sends back, for any pairs of directions to the eye and a lamp.

Per unit of irradiance on a plane that faces the lamp, f̄(V, L) = 1 / (A |V_n|) ∫ σ(V) T(x, V) T(x, L) f(a(x); L, V) dx
[1/sr], with the transmittances T out of the layer. The integral is a sum over points of its matter. They are drawn
where light comes in and goes out: at the top, at the bottom, and where it passes from one to the other.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.chart import SurfacePoint
from hagoromo.transport.film import R3
from hagoromo.transport.textures import SHADOW_STEP
from hagoromo.volume.texel import ALL_PARTS, REFLECTED
from hagoromo_matter.texel.layer import LAMP_DISTANCE_M, Layer

CANDIDATES = 8  # places of which a point is drawn
PROBES = tuple(
    (cosine, turn) for cosine in (0.9, 0.5) for turn in (0.4, 2.5, 4.6)
)  # ways out that show where it is lit
DRAWN_AT = (0.25, 0.25, 0.4, 0.1)  # shares of the points: at the top, at the bottom, where light passes, anywhere
TO_EYE = 1.0  # length of a step towards the eye, in steps of a camera ray
LANES = 1 << 20  # points and pairs that are computed together
POINT_SEED = 1
Materials = Sequence[Reflectance]


class MatterPoints:
    """Points of the matter of a layer, and the volume per area [m] that each stands for; count: a power of 2."""

    def __init__(self, layer: Layer, count: int) -> None:
        rng, candidates = np.random.default_rng(POINT_SEED), CANDIDATES * count
        self.layer, self.count = layer, count
        unit = (rng.random(3) + np.arange(candidates)[:, None] * R3) % 1.0
        tile = rng.integers(0, 1 << 12, candidates).astype(np.int32)
        share = _shares(layer, _placed(layer, unit, tile))
        steps = (np.arange(count) + rng.random()) / count
        chosen = np.minimum(np.searchsorted(np.cumsum(share), steps), candidates - 1)
        chosen = chosen[np.argsort(_along_a_curve(unit[chosen]), kind="stable")]
        self.volume = layer.thickness / (candidates * count * np.maximum(share[chosen], 1e-30))
        self.places = _placed(layer, unit[chosen], tile[chosen])

    def passed(self, ways: NDArray, stride: float) -> Any:
        """Transmittance from every point out of the layer along `ways` (n, 3): Float (n · count)."""
        jit, rows, at_once = arrays(), [], max(LANES // self.count, 1)
        for begin in range(0, len(ways), at_once):
            some = ways[begin : begin + at_once]
            lane = dr.arange(jit.UInt, len(some) * self.count)
            here, way = self._at(lane % self.count), dr.gather(jit.Array3f, vectors(some), lane // self.count)
            rows.append(_passed(self.layer, here, way, stride))
            dr.eval(rows[-1])
        return dr.concat(rows)

    def _at(self, number: Any) -> SurfacePoint:
        """The points of these numbers, UInt."""
        p = self.places
        u, v, height = (dr.gather(type(value), value, number) for value in (p.u, p.v, p.height))
        return SurfacePoint(dr.gather(type(p.tile_u), p.tile_u, number), p.tile_v, u, v, height, p.presence)


def light_of_pairs(
    points: MatterPoints, materials: Materials, ways: NDArray, pairs: NDArray, drawn: int
) -> NDArray[np.float64]:
    """Light that a layer sends to the eye along ways[pairs[:, 0]] from a lamp along ways[pairs[:, 1]] [1/sr].

    (pairs, populations, parts + 1): of each population its body and its interface, what passes through once and twice
    as far where some transmit, and as much as f = 1 would send. One material per population. drawn: points at which f
    is computed for each pair, of those that are both lit and seen.
    """
    jit, layer, rows, parts = arrays(), points.layer, [], parts_of(materials)
    to_eye, to_lamp = points.passed(ways, TO_EYE), points.passed(ways, SHADOW_STEP)
    densities = layer.textures.densities(layer.lattice, points.places)[: len(materials)]
    axes = [dr.normalize(a + 1e-9) for a in layer.textures.axes(layer.lattice, points.places, layer.tangents)]
    whole = dr.fmax(sum(densities[1:], densities[0]), 1e-30)
    matter, directions = whole * lookup(jit.Float, points.volume.astype(np.float32)), vectors(ways)
    dr.eval(densities, axes, whole, matter)
    at_once = max(LANES // points.count, 1)
    for begin in range(0, len(pairs), at_once):
        eye, lamp = (lookup(jit.UInt, pairs[begin : begin + at_once, k].astype(np.uint32)) for k in (0, 1))
        number, pair, total = _lit_and_seen((to_eye, to_lamp), matter, (eye, lamp), drawn)
        eye, lamp = (dr.gather(jit.Array3f, directions, dr.gather(jit.UInt, way, pair)) for way in (eye, lamp))
        sums = []
        for k, (m, density, axis) in enumerate(zip(materials, densities, axes, strict=False)):
            there = dr.gather(jit.Array3f, axis, number)
            weights = weights_of(m, parts, there, lamp, eye)
            share = dr.gather(jit.Float, density, number) / dr.gather(jit.Float, whole, number)
            share *= layer.projected_area(k, there, eye) / drawn
            sums += [dr.block_sum(share * value, drawn) * total for value in (*weights, 1.0)]
        dr.eval(sums)
        rows.append(np.stack([np.array(values, float) for values in sums], axis=-1))
    light = np.concatenate(rows)[: len(pairs)].reshape(len(pairs), len(materials), parts + 1)
    return light * (layer.tau / np.abs(ways[pairs[:, 0], 2]))[:, None, None]


def parts_of(materials: Materials) -> int:
    """Number of weights of the materials of a texel: all where some of them transmit."""
    return ALL_PARTS if any(m.transmits for m in materials) else REFLECTED


def weights_of(material: Reflectance, parts: int, axis: Any, to_lamp: Any, to_eye: Any) -> list[Any]:
    """So many weights of a material; those that it lacks are 0."""
    weights = list(material.weights(axis, to_lamp, to_eye))
    return weights + [0.0 * weights[0]] * (parts - len(weights))


def _lit_and_seen(passed: tuple[Any, Any], matter: Any, pair: tuple[Any, Any], drawn: int) -> tuple[Any, Any, Any]:
    """Some points, `drawn` for each pair of ways, by how much matter is lit and seen there.

    passed: transmittances to the eye and to the lamp (ways · points), matter (points). Returns the numbers of points
    and of pairs, UInt (pairs · drawn), and the sum of what they were drawn by over all points, Float (pairs).
    """
    jit, count, pairs = arrays(), dr.width(matter), dr.width(pair[0])
    lane = dr.arange(jit.UInt, pairs * count)
    light = dr.gather(jit.Float, matter, lane % count)
    for transmittance, way in zip(passed, pair, strict=True):
        light *= dr.gather(jit.Float, transmittance, dr.gather(jit.UInt, way, lane // count) * count + lane % count)
    sums = dr.block_prefix_reduce(dr.ReduceOp.Add, light, count, exclusive=False)
    total = dr.gather(jit.Float, sums, (dr.arange(jit.UInt, pairs) + 1) * count - 1)
    dr.eval(sums, total)
    lane = dr.arange(jit.UInt, pairs * drawn)
    number, point = lane // drawn, dr.zeros(jit.UInt, pairs * drawn)
    step = (jit.Float(lane % drawn) + 0.5) / drawn * dr.gather(jit.Float, total, number)
    for bit in reversed(range(count.bit_length() - 1)):  # the first point at which the sum reaches the step
        probe = point + (1 << bit)
        point = dr.select(dr.gather(jit.Float, sums, number * count + probe - 1) < step, probe, point)
    return point, number, total


def _placed(layer: Layer, unit: NDArray, tile: NDArray[np.int32]) -> SurfacePoint:
    """Points at u, v and height (n, 3) as shares of the period and of the thickness."""
    jit = arrays()
    u, v, h = (lookup(jit.Float, unit[:, k].astype(np.float32)) for k in range(3))
    height = dr.fma(h, layer.thickness, layer.texel.bottom)
    return SurfacePoint(lookup(jit.Int, tile), jit.Int(0), u, v, height, jit.Float(1))


def _shares(layer: Layer, places: SurfacePoint) -> NDArray[np.float64]:
    """Probability with which each place is drawn: by its density and the light that goes in and out there."""
    density = np.array(layer.textures.density(layer.lattice, places), float)
    up, down = (
        sum(np.array(_passed(layer, places, _way(cosine, turn, side), SHADOW_STEP), float) for cosine, turn in PROBES)
        for side in (1.0, -1.0)
    )
    share = np.zeros(len(density))
    for part, light in zip(DRAWN_AT, (up * up, down * down, up * down, 1.0), strict=True):
        share += part * density * light / max(float((density * light).sum()), 1e-30)
    return share / max(float(share.sum()), 1e-30)


def _passed(layer: Layer, here: SurfacePoint, way: Any, stride: float) -> Any:
    """Transmittance from points of the layer out of it along unit ways (u, v, normal)."""
    seen = layer.seen_along(way)
    depth = layer.textures.optical_depth(layer.box, layer.row, here, way, LAMP_DISTANCE_M, layer.tau, seen, stride)
    return dr.exp(-depth)


def _way(cosine: float, turn: float, side: float) -> Any:
    sine = math.sqrt(1.0 - cosine * cosine)
    return dr.opaque(arrays().Array3f, [sine * math.cos(turn), sine * math.sin(turn), side * cosine])


def _along_a_curve(unit: NDArray) -> NDArray[np.int64]:
    """Order of places (n, 3) in 0…1 along Morton's curve: neighbours on it are neighbours in space."""
    cell, code = (unit * 1023.0).astype(np.int64), np.zeros(len(unit), np.int64)
    for bit in range(10):
        for k in range(3):
            code |= ((cell[:, k] >> bit) & 1) << (3 * bit + k)
    return code


def vectors(rows: NDArray) -> Any:
    """Rows (n, 3) as an Array3f."""
    jit = arrays()
    return jit.Array3f(*(lookup(jit.Float, np.ascontiguousarray(rows[:, k], np.float32)) for k in range(3)))
