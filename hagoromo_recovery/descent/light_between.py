"""Light between: light of higher orders at a surface, from other parts of the object, under the lamps of photographs.

Places of the surface send on what the lamps bring them, body and interface; what other places get of it their bodies
send on again, and so forth: x = once + K x, the equation of mode full, solved by its `accelerated`. x is the irradiance
by other parts. The field is held: x is computed anew from time to time while it moves.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, UInt, arrays, column, lookup, vectors
from hagoromo.transport.field.solve import accelerated
from hagoromo_recovery.field.matter_field import COLOURS
from hagoromo_recovery.field.matter_march import LatticeRays
from hagoromo_recovery.field.object_sky import INSIDE, ObjectSky, Unlit

if TYPE_CHECKING:
    from hagoromo_recovery.descent.rendering import Rendering
    from hagoromo_recovery.field.matter_field import MatterField
    from hagoromo_recovery.recovered import Recovered

Array = NDArray[np.float64]
WHITEST = 0.98  # body colour that places send on at most


class PlainBetween(NamedTuple):
    """Irradiance by other parts, as plain arrays. row: (nodes,) of a node in the others, from 1 on; 0: none. normals:
    (rows, 3). values: (rows, photographs, 3).
    """

    row: NDArray[np.uint32]
    normals: NDArray[np.float32]
    values: NDArray[np.float32]


class LightBetween:
    """Irradiance by other parts at the nodes near a surface, on the device."""

    def __init__(self, plain: PlainBetween) -> None:
        jit = arrays()
        self.plain, self.photographs = plain, plain.values.shape[1]
        self.row, self.normals = lookup(jit.UInt, plain.row), lookup(jit.Float, plain.normals)
        self.values = lookup(jit.Float, plain.values)

    def at(self, field: MatterField, photograph: UInt, place: Array3f, normal: Array3f) -> list[Float]:
        """Irradiance of each channel at places of unit normals: a mean of the nodes around that face the same way."""
        jit = arrays()
        total, found = jit.Float(0), [jit.Float(0)] * COLOURS
        for node, weight in field.corner_nodes(place):
            row = dr.gather(jit.UInt, self.row, node)
            facing = dr.dot(dr.gather(jit.Array3f, self.normals, row), normal)
            share = dr.select(row > 0, weight * dr.fmax(facing, 0.0), 0.0)
            first = (row * self.photographs + photograph) * COLOURS
            total += share
            for c in range(COLOURS):
                found[c] = dr.fma(share, dr.gather(jit.Float, self.values, first + c), found[c])
        return [each / dr.fmax(total, 1e-6) for each in found]


class ArrivingLight(NamedTuple):
    """Irradiance (n, photographs, 3) at the places of a sky: of lamps, and of higher orders by other parts."""

    lamps: Array
    between: Array


def light_between(rendering: Rendering, photographs: int, unit: float, sky: ObjectSky | None = None) -> LightBetween:
    """That of a surface as it is, under the lamps of `photographs` photographs.

    unit: the albedo of a body colour of 1. sky: of this surface, if it is known.
    """
    sky = sky or sky_of(rendering)
    near, values = sky.near, sky.to_near(arriving(rendering, photographs, unit, sky).between.reshape(sky.count, -1))
    row = np.zeros(near.nodes.size, np.uint32)
    row[near.nodes.ravel()] = np.arange(1, len(near.places) + 1)
    values = np.pad(values, ((1, 0), (0, 0))).reshape(-1, photographs, COLOURS)
    return LightBetween(PlainBetween(row, np.pad(near.normals, ((1, 0), (0, 0))), values.astype(np.float32)))


def sky_of(rendering: Rendering) -> ObjectSky:
    """What places of the surface of a rendering see of it."""
    return ObjectSky(rendering.field.march(Unlit(), rendering.softness, False))


def arriving(rendering: Rendering, photographs: int, unit: float, sky: ObjectSky) -> ArrivingLight:
    """The light at places of a surface under the lamps of photographs, see `light_between`."""
    place, normal = vectors(sky.places), vectors(sky.normals)
    whitest = WHITEST / unit
    colours = [dr.clip(each, 0.0, whitest) for each in rendering.field.colours_at(place)]
    lamps = np.zeros((sky.count, photographs, COLOURS))
    once = np.zeros((sky.count, photographs, COLOURS))
    for number in range(photographs):
        lit = LitPlaces(rendering, dr.opaque(arrays().UInt, number), place, normal)
        lamps[:, number] = lit.irradiance()
        once[:, number] = np.pi * unit * sky.gathered(lit.sent(sky, whitest)) if len(sky.sender) else 0.0
    albedo = unit * np.stack([np.array(each, np.float64) for each in colours], axis=1)
    return ArrivingLight(lamps, _of_all_orders(sky, once, albedo))


def _of_all_orders(sky: ObjectSky, once: Array, albedo: Array) -> Array:
    """The fixed point x = once + seen (albedo · x), of places, photographs and channels."""
    jit, seen = arrays(), sky.of_places()

    def swept(light: list[list[Float]]) -> list[list[Float]]:
        x = np.array(light[0][0], np.float64).reshape(once.shape)
        sent = (albedo[:, None] * x).reshape(sky.count, -1)
        return [[lookup(jit.Float, np.asarray(seen @ sent, np.float32))]]

    first = [[lookup(jit.Float, once.astype(np.float32))]]
    light, _, _ = accelerated(first, swept(first), [jit.Float(1)], swept)
    return np.array(light[0][0], np.float64).reshape(once.shape)


def share_between(recovered: Recovered) -> Array:
    """(n,) share of the light of places of a surface that comes from other parts, the sums over its photographs."""
    rendering = recovered.rendering.under(recovered.photographs, recovered.lattice)
    light = arriving(rendering, len(recovered.photographs), recovered.dim, sky_of(rendering))
    lamps, between = (each.sum(axis=(1, 2)) for each in light)
    return between / np.maximum(lamps + between, 1e-30)


class LitPlaces:
    """Places of a surface under the lamps of a photograph."""

    def __init__(self, rendering: Rendering, photograph: UInt, place: Array3f, normal: Array3f) -> None:
        self.rendering, self.photograph, self.place, self.normal = rendering, photograph, place, normal
        self.passed = self._passed()

    def _passed(self) -> list[Float]:
        """Share of each lamp's light that arrives, times its factor."""
        rendering, jit = self.rendering, arrays()
        lamps, shares = rendering.shading.lamps, []
        factors = [jit.Float(1.0)] * lamps.each
        if rendering.strengths is not None:
            factors = rendering.strengths.on(self.photograph)
        for k in range(lamps.each):
            to_lamp, distance, _ = lamps.arriving(self.photograph, k, self.place)
            facing, passed = dr.dot(self.normal, to_lamp) > 0.0, jit.Float(1.0)
            if rendering.shadows:
                far = dr.fmin(distance, rendering.field.way_to_edge(self.place, to_lamp, INSIDE))
                rays = LatticeRays(self.place, to_lamp, jit.Float(0), dr.select(facing, far, 0.0))
                passed = rendering.march.transmittance(rays)
            shares.append(dr.select(facing, factors[k] * passed, 0.0))
            dr.eval(shares[-1])
        return shares

    def irradiance(self) -> Array:
        """(n, 3)."""
        lamps, total = self.rendering.shading.lamps, [arrays().Float(0)] * COLOURS
        for k, passed in enumerate(self.passed):
            to_lamp, _, strength = lamps.arriving(self.photograph, k, self.place)
            cosine = dr.fmax(dr.dot(self.normal, to_lamp), 0.0) * passed
            total = [dr.fma(cosine, each, old) for each, old in zip(strength, total, strict=True)]
        return _columns(total, len(np.array(self.place.x)))

    def sent(self, sky: ObjectSky, whitest: float) -> Array:
        """(m, 3) radiance along the rays of a sky."""
        jit, shading, field = arrays(), self.rendering.shading, self.rendering.field
        sender = column(jit.UInt, sky.sender.astype(np.uint32))
        place, normal = (dr.gather(jit.Array3f, each, sender) for each in (self.place, self.normal))
        looks = field.looks_at(place)
        looks = [*(dr.clip(each, 0.0, whitest) for each in looks[:COLOURS]), *looks[COLOURS:]]
        own, shading.photograph = shading.photograph, self.photograph
        light = shading(place, normal, vectors(-sky.towards), looks)
        shading.photograph = own
        total = [jit.Float(0)] * COLOURS
        for k, passed in enumerate(self.passed):
            share = dr.gather(jit.Float, passed, sender)
            total = [dr.fma(share, light[k * COLOURS + c], total[c]) for c in range(COLOURS)]
        return _columns(total, len(sky.sender))


def _columns(channels: list[Float], count: int) -> Array:
    return np.stack([np.broadcast_to(np.array(each, np.float64), count) for each in channels], axis=1)
