"""Match: the coarse levels of a texel transmit and reflect the light that the finest level does.

Averaging densities over cells loses occlusion: yarns hide what is behind them, gaps transmit light, and the
transmittance is an exponential of the density. The densities of a level are scaled until a flat layer of it transmits
as much light as one of the finest level, in the mean over directions. The light of every population is then scaled
until the layer sends back as much, for every pair of directions of `table_directions`, on either side of the layer.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.chart import SurfacePoint
from hagoromo.transport.medium import NEGLIGIBLE_OPTICAL_DEPTH
from hagoromo.transport.textures import STEPS_PER_CELL
from hagoromo.volume.box_header import Extinction
from hagoromo.volume.texel import LEAST_FACTOR, Level, Texel, table_directions, unscaled
from hagoromo_matter.texel.layer import LAMP_DISTANCE_M, Layer, on_device
from hagoromo_matter.texel.layer_light import MatterPoints, light_of_pairs, parts_of, vectors, weights_of

DIRECTION_PAIRS = 128  # pairs of directions, to the eye and to a lamp
LEAST_COSINE = math.cos(math.radians(75))  # least cosine between them and the normal
BEHIND = 4  # every so many pairs have the lamp on the other side of the layer
RAYS_PER_SIDE = 12  # rays along each side of a period, for each pair
PART = 0.35  # largest optical depth of a step
LEAST, MOST = 1e-3, 10.0  # range of the factors on densities
POINTS_OF_FINEST, POINTS_OF_COARSE = 1 << 15, 1 << 12  # of matter, to and from which light is followed
DRAWN_OF_FINEST, DRAWN_OF_COARSE = 2048, 1024  # of them, at which f is computed for each pair of directions
FAINT = 1e-3  # of the mean f of a population, added to the light of both levels: their quotient stays finite
MOST_MADE_UP = 3.0  # largest factor by which some light makes up for other
MATCH_SEED = 1


class LayerRays:
    """`per_side`² fixed rays through a layer for each pair of directions (u, v, normal) to eye and lamp.

    ways: directions to the eye and to the lamp, (pairs, 3) each; without them they are DIRECTION_PAIRS random ones, on
    either side of the layer. front: pairs with eye and lamp on one side.
    """

    def __init__(self, per_side: int = RAYS_PER_SIDE, ways: tuple[NDArray, NDArray] | None = None) -> None:
        jit, rng = arrays(), np.random.default_rng(MATCH_SEED)
        eye, lamp = ways or _random_pairs(rng)
        self.front, self.pairs, each = eye[:, 2] * lamp[:, 2] > 0.0, len(eye), per_side**2
        lanes, cell, jitter = self.pairs * each, np.arange(each), rng.random((2, self.pairs, each))
        self.to_eye, self.to_lamp = (vectors(np.repeat(d, each, axis=0)) for d in (eye, lamp))
        self.u, self.v = (
            lookup(jit.Float, ((place + part) / per_side).astype(np.float32))
            for place, part in zip((cell % per_side, cell // per_side), jitter, strict=True)
        )
        self.tile = lookup(jit.Int, rng.integers(0, 1 << 12, lanes).astype(np.int32))


def matched(texel: Texel, tau: float, materials: Sequence[Reflectance], extinction: Extinction = "isotropic") -> Texel:
    """The texel with its coarse levels matched to the finest; tau [1/m], one material per population.

    extinction: of the box that is to have the texel.
    """
    if len(materials) != texel.populations:
        raise InputError(f"{len(materials)} materials are given: a texel needs one per population, {texel.populations}")
    rays, like = LayerRays(), (tau, [m.element for m in materials], extinction == "projected")
    depths = [tau * np.array(_through(RaysThrough(layer, rays))[0]) for layer in _layers(texel, *like)]
    passed = float(np.exp(-depths[0]).mean())
    factors = [1.0, *(_factor(depth, passed) for depth in depths[1:])]
    levels = [_denser(level, factor) for level, factor in zip(texel.levels, factors, strict=True)]
    texel = replace(texel, levels=tuple(levels))
    sent = [_sent_everywhere(layer, materials) for layer in _layers(texel, *like)]
    scales = [unscaled(texel.populations, parts_of(materials)), *(_scale(light, sent[0]) for light in sent[1:])]
    levels = [replace(level, scale=scale) for level, scale in zip(levels, scales, strict=True)]
    return replace(texel, levels=tuple(levels))


def _layers(texel: Texel, tau: float, elements: Sequence[str], projected: bool) -> Iterator[Layer]:
    """A layer of every level, of one copy of the texel on the device."""
    dr.flush_malloc_cache()  # of what is there no longer, such as the copy before
    textures = on_device(texel)
    return (Layer(texel, k, tau, elements, projected, textures) for k in range(len(texel.levels)))


def light_sent(
    texel: Texel,
    level: int,
    tau: float,
    materials: Sequence[Reflectance],
    extinction: Extinction = "isotropic",
    rays: LayerRays | None = None,
) -> NDArray[np.float64]:
    """Light that a flat layer of one level sends on, per direction pair of the `rays`, population and part.

    (pairs, populations, parts) [1/sr], body and interface, and what is transmitted where some transmit, per unit of
    irradiance on a plane that faces the lamp. It is followed along rays, as a camera's, and has no part in the match.
    """
    rays = rays or LayerRays()
    elements = [m.element for m in materials]
    layer = Layer(texel, level, tau, elements, extinction == "projected", on_device(texel))
    light = np.stack([np.array(values, np.float64) for values in _through(RaysThrough(layer, rays, materials))[1]])
    return light.reshape(len(materials), parts_of(materials), rays.pairs, -1).mean(axis=-1).transpose(2, 0, 1)


class RaysThrough:
    """Rays through a layer. materials: of every population; none where light is not asked for."""

    def __init__(self, layer: Layer, rays: LayerRays, materials: Sequence[Reflectance] = ()) -> None:
        texel, self.layer, self.rays, self.materials = layer.texel, layer, rays, tuple(materials)
        densest = float(max(rows.sum(axis=0, dtype=np.float32).max() for rows in _rows(texel.levels[layer.level])))
        step = min(float(texel.edges[layer.level]) / STEPS_PER_CELL, PART / (layer.tau * max(densest, 1e-3)))
        length = layer.thickness / dr.abs(rays.to_eye.z)
        self.sums = len(materials) * parts_of(materials)
        self.steps = dr.ceil(length / step)
        self.part = length / self.steps
        start = dr.select(rays.to_eye.z > 0, texel.top, texel.bottom)
        self.face = SurfacePoint(rays.tile, arrays().Int(0), rays.u, rays.v, start, arrays().Float(1))
        self.per_metre = 1.0 / texel.period[0], 1.0 / texel.period[1]
        dr.eval(layer.lattice, self.steps, self.part, start)

    def place(self, on: Any) -> SurfacePoint:
        """Points of the rays at a distance `on` [m] behind the face of the layer."""
        return self.face.moved(-on, self.rays.to_eye, self.per_metre)

    def densities(self, here: SurfacePoint) -> list[Any]:
        """Density of every population, times its projected area towards the eye where extinction is projected."""
        layer, seen = self.layer, self.layer.seen_along(self.rays.to_eye)
        if seen is None:
            return layer.textures.densities(layer.lattice, here)
        return layer.textures.seen_densities(layer.lattice, here, seen)

    def density(self, here: SurfacePoint) -> Any:
        """All populations together."""
        layer = self.layer
        return sum(self.densities(here)) if layer.projected else layer.textures.density(layer.lattice, here)

    def light(self, here: SurfacePoint) -> list[Any]:
        """Density times the light that the elements at a place send on: every part of every population."""
        layer, way, eye = self.layer, self.rays.to_lamp, self.rays.to_eye
        depth = layer.textures.optical_depth(
            layer.box, layer.row, here, way, LAMP_DISTANCE_M, layer.tau, layer.seen_along(way)
        )
        arrived, radiance = dr.exp(-depth), []
        densities, axes = self.densities(here), layer.textures.axes(layer.lattice, here, layer.tangents)
        scales = layer.textures.scales(layer.row)
        for density, axis, m, scale in zip(densities, axes, self.materials, scales, strict=True):
            unit = dr.normalize(axis + 1e-9)
            weights = weights_of(m, parts_of(self.materials), unit, way, eye)
            for value, factor in zip(weights, scale.at(eye, way), strict=True):
                radiance.append(density * arrived * value * factor)
        return radiance


@dr.syntax
def _through(through: RaysThrough) -> tuple[Any, list[Any]]:
    """∫ ρ ds [m] along the rays, and the light that the materials of the layer send on: every part of each."""
    jit, count, tau = arrays(), dr.width(through.rays.u), through.layer.tau
    k, passed = dr.zeros(jit.Float, count), dr.zeros(jit.Float, count)
    sent = [dr.zeros(jit.Float, count) for _ in range(through.sums)]
    while k < through.steps:
        here = through.place((k + 0.5) * through.part)
        density = through.density(here)
        depth = tau * density * through.part
        if depth > NEGLIGIBLE_OPTICAL_DEPTH:
            if dr.hint(len(through.materials) > 0, mode="scalar"):
                gain = dr.exp(-tau * passed) * (1.0 - dr.exp(-depth)) / density
                sent = _added(sent, gain, through.light(here))
            passed += density * through.part
        k += 1.0
    return passed, sent


def _sent_everywhere(layer: Layer, materials: Sequence[Reflectance]) -> NDArray[np.float64]:
    """`light_of_pairs` for all pairs of directions of the table: (DIRECTIONS, DIRECTIONS, populations, parts + 1)."""
    count, drawn = (POINTS_OF_COARSE, DRAWN_OF_COARSE) if layer.level else (POINTS_OF_FINEST, DRAWN_OF_FINEST)
    ways, where = np.unique(
        table_directions().round(12), axis=0, return_inverse=True
    )  # the poles stand there repeatedly
    pairs = np.stack(np.meshgrid(*[np.arange(len(ways))] * 2, indexing="ij"), axis=-1).reshape(-1, 2)
    light = light_of_pairs(MatterPoints(layer, count), materials, ways, pairs, drawn).reshape(
        len(ways), len(ways), len(materials), -1
    )
    return light[np.ix_(where, where)]


def _scale(sent: NDArray, wanted: NDArray) -> NDArray[np.float16]:
    """Logarithms of the factors on the light `sent` that make it the light `wanted`; both as `_sent_everywhere`.

    Where parallel mean axes send back no light of a population or part, the others make up for it: the sum is kept.
    """
    faint = FAINT * wanted[..., :-1].sum(axis=(0, 1)) / np.maximum(wanted[..., -1:].sum(axis=(0, 1)), 1e-30)
    light, aim = (values[..., :-1] + faint * values[..., -1:] for values in (sent, wanted))
    factor = np.where((light > 0.0) & (aim > 0.0), aim / np.maximum(light, 1e-30), 1.0)
    factor = np.clip(factor, LEAST_FACTOR, 1.0 / LEAST_FACTOR)
    rest = (faint * wanted[..., -1:]).sum(axis=(2, 3))
    whole = [values.sum(axis=(2, 3)) + rest for values in (sent[..., :-1] * factor, wanted[..., :-1])]
    lost = np.where(whole[0] > 0.0, whole[1] / np.maximum(whole[0], 1e-30), 1.0)
    factor *= np.clip(lost, 1.0 / MOST_MADE_UP, MOST_MADE_UP)[..., None, None]
    return np.log(factor).transpose(2, 3, 0, 1).astype(np.float16)


def _factor(depth: NDArray, passed: float) -> float:
    """Factor on the optical depths that makes the mean transmittance equal `passed`."""
    from scipy.optimize import root_scalar

    def excess(logarithm: float) -> float:
        return float(np.exp(-math.exp(logarithm) * depth).mean()) - passed

    low, high = math.log(LEAST), math.log(MOST)
    if excess(low) * excess(high) >= 0.0:
        return 1.0
    return math.exp(root_scalar(excess, bracket=(low, high)).root)


def _denser(level: Level, factor: float) -> Level:
    if factor == 1.0:
        return level
    return replace(level, density=(level.density.astype(np.float32) * factor).astype(np.float16))


def _rows(level: Level) -> Iterator[NDArray[np.float16]]:
    """Densities of one row along v after the other: (populations, u, h)."""
    return (level.density[:, row] for row in range(level.nodes[0]))


def _added(old: list[Any], gain: Any, new: list[Any]) -> list[Any]:
    return [dr.fma(gain, light, sum_) for sum_, light in zip(old, new, strict=True)]


def _random_pairs(rng: np.random.Generator) -> tuple[NDArray, NDArray]:
    """DIRECTION_PAIRS directions to eye and lamp; every BEHIND-th lamp is behind the layer."""
    eye, lamp = _directions(rng), _directions(rng)
    number = np.arange(DIRECTION_PAIRS)
    lamp[number % BEHIND == 0, 2] *= -1.0
    below = number // BEHIND % 2 > 0
    eye[below, 2], lamp[below, 2] = -eye[below, 2], -lamp[below, 2]
    return eye, lamp


def _directions(rng: np.random.Generator) -> NDArray[np.float64]:
    """DIRECTION_PAIRS unit vectors above the layer, uniform in the cosine with the normal."""
    turn, cosine = (
        2.0 * math.pi * rng.random(DIRECTION_PAIRS),
        LEAST_COSINE + (1.0 - LEAST_COSINE) * rng.random(DIRECTION_PAIRS),
    )
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1)
