"""Match: the coarse levels of a texel transmit and reflect the light that the finest level does.

Averaging densities over cells loses occlusion: yarns hide what is behind them, gaps transmit light, and the
transmittance is an exponential of the density. The densities of a level are scaled until a flat layer of it transmits
as much light as one of the finest level, and the light of every population until it reflects as much, in the mean over
DIRECTION_PAIRS of directions.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import arrays, lookup
from hagoromo.errors import InputError
from hagoromo.reflectance.element import element_weights, projected_area
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.chart import SurfacePoint
from hagoromo.transport.medium import NEGLIGIBLE_OPTICAL_DEPTH
from hagoromo.transport.textures import STEPS_PER_CELL, SeenAlong, Textures
from hagoromo.volume.box import Extinction
from hagoromo.volume.texel import SCALES, Level, Texel, light_features, unscaled

DIRECTION_PAIRS = 128  # pairs of directions, to the eye and to a lamp
LEAST_COSINE = math.cos(math.radians(75))  # least cosine between them and the normal
BEHIND = 4  # every so many pairs have the lamp on the other side of the layer
RAYS_PER_SIDE = 12  # rays along each side of a period, for each pair
PART = 0.35  # largest optical depth of a step
DRAWN = 0.01  # strength of the regularisation towards one factor for all directions
LEAST, MOST = 1e-3, 10.0  # range of the factors on densities
LAMP_DISTANCE_M = 1e3  # [m] distance of the lamps
MATCH_SEED = 1


class Rays:
    """RAYS_PER_SIDE² fixed rays through a layer for each pair of directions (u, v, normal) to eye and lamp."""

    def __init__(self) -> None:
        jit, rng = arrays(), np.random.default_rng(MATCH_SEED)
        eye, lamp = _directions(rng), _directions(rng)
        self.front = np.arange(DIRECTION_PAIRS) % BEHIND > 0
        lamp[~self.front, 2] *= -1.0
        nothing = dr.zeros(jit.Float, DIRECTION_PAIRS)
        features = light_features(_vectors(eye), _vectors(lamp))
        front = np.stack([np.array(value + nothing) for value in features] + [np.zeros(DIRECTION_PAIRS)], axis=1)
        self.features = np.where(self.front[:, None], front, np.eye(SCALES)[-1])  # of `LightScale`
        lanes = DIRECTION_PAIRS * RAYS_PER_SIDE**2
        cell, jitter = np.arange(RAYS_PER_SIDE**2), rng.random((2, DIRECTION_PAIRS, RAYS_PER_SIDE**2))
        self.to_eye, self.to_lamp = (_vectors(np.repeat(d, RAYS_PER_SIDE**2, axis=0)) for d in (eye, lamp))
        self.u, self.v = (
            lookup(jit.Float, ((place + part) / RAYS_PER_SIDE).astype(np.float32))
            for place, part in zip((cell % RAYS_PER_SIDE, cell // RAYS_PER_SIDE), jitter, strict=True)
        )
        self.tile = lookup(jit.Int, rng.integers(0, 1 << 12, lanes).astype(np.int32))


def matched(texel: Texel, tau: float, materials: Sequence[Reflectance], extinction: Extinction = "isotropic") -> Texel:
    """The texel with its coarse levels matched to the finest; tau [1/m], one material per population.

    extinction: of the box that is to have the texel.
    """
    if len(materials) != texel.populations:
        raise InputError(f"{len(materials)} materials are given: a texel needs one per population, {texel.populations}")
    rays, count = Rays(), len(texel.levels)
    textures = _textures(texel)
    elements = tuple(m.element for m in materials) if extinction == "projected" else ()
    depths = [
        tau * np.array(_through(Layer(textures, rays, texel, k, tau, elements=elements))[0]) for k in range(count)
    ]
    passed = float(np.exp(-depths[0]).mean())
    factors = [1.0, *(_factor(depth, passed) for depth in depths[1:])]
    levels = [_denser(level, factor) for level, factor in zip(texel.levels, factors, strict=True)]
    texel = replace(texel, levels=tuple(levels))
    textures = _textures(texel)
    sent = [_sent(Layer(textures, rays, texel, k, tau, materials, elements)) for k in range(count)]
    scales = [unscaled(texel.populations), *(_scale(rays, light, sent[0]) for light in sent[1:])]
    levels = [replace(level, scale=scale) for level, scale in zip(levels, scales, strict=True)]
    return replace(texel, levels=tuple(levels))


def light_sent(
    texel: Texel, level: int, tau: float, materials: Sequence[Reflectance], extinction: Extinction = "isotropic"
) -> NDArray[np.float64]:
    """Light that a flat layer of one level reflects, per direction pair, population, body and interface [1/sr].

    (DIRECTION_PAIRS, populations, 2), per unit of irradiance on a plane that faces the lamp.
    """
    rays = Rays()
    elements = tuple(m.element for m in materials) if extinction == "projected" else ()
    sent = _sent(Layer(_textures(texel), rays, texel, level, tau, materials, elements))
    scales = texel.levels[level].scale.astype(float)
    return sent * np.maximum(np.einsum("rf,pcf->rpc", rays.features, scales), 0.0)


class Layer:
    """A flat layer of one level of a texel, and the rays through it.

    elements: of every population where extinction is by their projected area; empty where it is isotropic.
    """

    def __init__(
        self,
        textures: Textures,
        rays: Rays,
        texel: Texel,
        level: int,
        tau: float,
        materials: Sequence[Reflectance] = (),
        elements: tuple[str, ...] = (),
    ) -> None:
        jit, self.elements = arrays(), elements
        self.textures, self.rays, self.tau, self.materials = textures, rays, tau, tuple(materials)
        self.box, self.row = jit.UInt(0), dr.opaque(jit.UInt, level)
        self.lattice = textures.lattice(self.box, self.row)
        densest = float(texel.levels[level].density.astype(np.float32).sum(axis=0).max())
        step = min(float(texel.edges[level]) / STEPS_PER_CELL, PART / (tau * max(densest, 1e-3)))
        length = (texel.top - texel.bottom) / dr.abs(rays.to_eye.z)
        self.steps = dr.ceil(length / step)
        self.part = length / self.steps
        start = dr.select(rays.to_eye.z > 0, texel.top, texel.bottom)
        self.face = SurfacePoint(rays.tile, jit.Int(0), rays.u, rays.v, start, jit.Float(1))
        self.per_metre = 1.0 / texel.period[0], 1.0 / texel.period[1]
        dr.eval(self.lattice, self.steps, self.part, start)

    def place(self, on: Any) -> SurfacePoint:
        """Points of the rays at a distance `on` [m] behind the face of the layer."""
        return self.face.moved(-on, self.rays.to_eye, self.per_metre)

    @property
    def tangents(self) -> list[Any]:
        """Of every population, whether its axes are tangents; see `Textures.axes`."""
        elements = self.elements or [material.element for material in self.materials]
        return [arrays().Bool(True) if element == "cylinder" else None for element in elements]

    def seen_along(self, direction: Any) -> SeenAlong | None:
        """How a direction sees the elements; None where extinction is isotropic."""
        if not self.elements:
            return None
        area = lambda population, axis: projected_area(self.elements[population], dr.dot(axis, direction))  # noqa: E731
        return SeenAlong(area, self.tangents)

    def densities(self, here: SurfacePoint) -> list[Any]:
        """Density of every population, times its projected area towards the eye where extinction is projected."""
        seen = self.seen_along(self.rays.to_eye)
        if seen is None:
            return self.textures.densities(self.lattice, here)
        return self.textures.seen_densities(self.lattice, here, seen)

    def density(self, here: SurfacePoint) -> Any:
        """All populations together."""
        return sum(self.densities(here)) if self.elements else self.textures.density(self.lattice, here)

    def light(self, here: SurfacePoint) -> list[Any]:
        """Density times the light that the elements at a place reflect: body and interface of every population."""
        way = self.rays.to_lamp
        seen = self.seen_along(way)
        depth, _ = self.textures.optical_depth(self.box, self.row, here, way, LAMP_DISTANCE_M, self.tau, seen)
        arrived, radiance = dr.exp(-depth), []
        densities, axes = self.densities(here), self.textures.axes(self.lattice, here, self.tangents)
        for density, axis, m in zip(densities, axes, self.materials, strict=True):
            unit = dr.normalize(axis + 1e-9)
            weights = element_weights(m.element, unit, way, self.rays.to_eye, m.alpha, m.beta, m.gamma, m.n, m.nu)
            radiance += [density * arrived * weights.body, density * arrived * weights.interface]
        return radiance


@dr.syntax
def _through(layer: Layer) -> tuple[Any, list[Any]]:
    """∫ ρ ds [m] along the rays, and the light that the materials of the layer reflect: body and interface of each."""
    jit, count, tau = arrays(), dr.width(layer.rays.u), layer.tau
    k, passed = dr.zeros(jit.Float, count), dr.zeros(jit.Float, count)
    sent = [dr.zeros(jit.Float, count) for _ in range(2 * len(layer.materials))]
    while k < layer.steps:
        here = layer.place((k + 0.5) * layer.part)
        density = layer.density(here)
        depth = tau * density * layer.part
        if depth > NEGLIGIBLE_OPTICAL_DEPTH:
            if dr.hint(len(layer.materials) > 0, mode="scalar"):
                gain = dr.exp(-tau * passed) * (1.0 - dr.exp(-depth)) / density
                sent = _added(sent, gain, layer.light(here))
            passed += density * layer.part
        k += 1.0
    return passed, sent


def _sent(layer: Layer) -> NDArray[np.float64]:
    """(DIRECTION_PAIRS, populations, 2): see `light_sent`, without the scale of the level."""
    light = np.stack([np.array(values, np.float64) for values in _through(layer)[1]])
    return light.reshape(len(layer.materials), 2, DIRECTION_PAIRS, -1).mean(axis=-1).transpose(2, 0, 1)


def _scale(rays: Rays, sent: NDArray, wanted: NDArray) -> NDArray[np.float32]:
    """Numbers of `LightScale`, (populations, 2, SCALES), that bring the light `sent` closest to the light `wanted`.

    Least squares over the pairs, with a weak regularisation towards one factor for all.
    """
    scales = unscaled(sent.shape[1])
    for k, c in np.ndindex(scales.shape[:2]):
        light, aim = sent[:, k, c], wanted[:, k, c]
        for here, columns in ((rays.front, slice(0, SCALES - 1)), (~rays.front, slice(SCALES - 1, SCALES))):
            if light[here].sum() <= 0.0:
                continue
            mean = aim[here].sum() / light[here].sum()
            rows = (rays.features[here] * light[here, None])[:, columns]
            most = max(float(np.linalg.norm(rows)), 1e-30)
            start = mean * (np.arange(rows.shape[1]) == 0)
            drawn = np.concatenate([rows, DRAWN * most * np.eye(rows.shape[1])])
            rest = np.concatenate([aim[here] - rows @ start, np.zeros(rows.shape[1])])
            scales[k, c, columns] = start + np.linalg.lstsq(drawn, rest, rcond=None)[0]
    return scales


def _textures(texel: Texel) -> Textures:
    return Textures([(texel, (texel.bottom, texel.top), 1.0)])


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
    return replace(level, density=(level.density.astype(np.float32) * factor).astype(np.float16))


def _added(old: list[Any], gain: Any, new: list[Any]) -> list[Any]:
    return [dr.fma(gain, light, sum_) for sum_, light in zip(old, new, strict=True)]


def _directions(rng: np.random.Generator) -> NDArray[np.float64]:
    """DIRECTION_PAIRS unit vectors above the layer, uniform in the cosine with the normal."""
    turn, cosine = (
        2.0 * math.pi * rng.random(DIRECTION_PAIRS),
        LEAST_COSINE + (1.0 - LEAST_COSINE) * rng.random(DIRECTION_PAIRS),
    )
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=-1)


def _vectors(rows: NDArray[np.float64]) -> Any:
    jit = arrays()
    return jit.Array3f(*(lookup(jit.Float, rows[:, k].astype(np.float32)) for k in range(3)))
