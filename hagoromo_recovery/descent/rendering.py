"""Rendering: what photographs show of a field of matter, under their lamps, with shadows."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays, column, evaluate
from hagoromo.matter.shape import unit
from hagoromo.photograph.photograph import Photograph
from hagoromo_recovery.descent.light_between import LightBetween, light_between, sky_of
from hagoromo_recovery.descent.pixel_table import Drawn, span
from hagoromo_recovery.field.matter_field import COLOURS, MatterField
from hagoromo_recovery.field.matter_march import LatticeRays, Seen
from hagoromo_recovery.field.object_sky import ObjectSky
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.shading.lamp_table import LampTable
from hagoromo_recovery.shading.shading import NodeShading

if TYPE_CHECKING:
    from hagoromo_recovery.descent.strengths import Strengths

OPAQUE = 1e-2  # optical depth of rays that count as hits
INSIDE = 1.0  # [voxel] from the edge of the lattice where shadow rays end


class SeenLight:
    """What rays see. seen: without shadows of a surface. passed: share of each lamp's light that arrives at it.
    between: irradiance of each channel by other parts of the object; nothing for light of the first order alone.
    channels: of the sum.
    """

    def __init__(self, seen: Seen, passed: list[Float], between: Sequence[Float] = ()) -> None:
        self.seen, self.passed, self.between = seen, passed, between
        self.channels = [
            sum(factor * light for factor, light in zip(self.factors[c::COLOURS], seen.light[c::COLOURS], strict=True))
            for c in range(COLOURS)
        ]

    @property
    def factors(self) -> list[Float]:
        """On the light of every lamp and channel, and on that from other parts."""
        return [*(share for share in self.passed for _ in range(COLOURS)), *self.between]

    @property
    def of_lamps(self) -> NDArray[np.float64]:
        """(lamps, channels, rays) what arrives of each lamp's light."""
        parts = [
            share * self.seen.light[k * COLOURS + c] for k, share in enumerate(self.passed) for c in range(COLOURS)
        ]
        return np.stack([np.array(part, np.float64) for part in parts]).reshape(len(self.passed), COLOURS, -1)

    def plain(self, count: int) -> NDArray[np.float32]:
        """(2 + 4 lamps, rays) depth, way, share and light of all lamps, of `count` rays; six rows more with light
        between parts.
        """
        rows = [self.seen.depth, self.seen.way, *self.passed, *self.between, *self.seen.light]
        return np.stack([np.broadcast_to(np.array(row), count) for row in rows])

    @property
    def opacity(self) -> NDArray[np.float32]:
        """(rays,) share of what is behind that the object hides."""
        return np.asarray(1.0 - np.exp(-np.array(self.seen.depth)), np.float32)


class Rendering:
    """A field of matter, the shading of its places, and s [voxel], the softness of a surface.

    shadows: whether the object keeps the light of lamps from itself. Those on a surface have no derivative: they
    are found anew in each step, and held in it. strengths: factors on the light of lamps; None where they are as
    stated. albedo: of a body colour of 1, for light between parts of the object; None: of the first order alone.
    """

    def __init__(
        self,
        field: MatterField,
        shading: NodeShading,
        softness: float,
        shadows: bool = True,
        strengths: Strengths | None = None,
        albedo: float | None = None,
    ) -> None:
        self.field, self.shading, self.shadows, self.strengths = field, shading, shadows, strengths
        self.albedo, self.between = albedo, None
        self._sky: ObjectSky | None = None
        self.softness = softness

    @property
    def between(self) -> LightBetween | None:
        """Irradiance by other parts of the object; None: light of the first order alone."""
        return self._between

    @between.setter
    def between(self, light: LightBetween | None) -> None:
        self._between, self.shading.between = light, light is not None

    def find_between(self, photographs: int) -> None:
        """Compute the light between parts of the field as it is, under the lamps of all photographs."""
        if self.albedo is not None and self.shading.lamps.each:
            self.between = light_between(self, photographs, self.albedo)

    @property
    def softness(self) -> float:
        """s [voxel]."""
        return self._softness

    @softness.setter
    def softness(self, s: float) -> None:
        self._softness = s
        self.march = self.field.march(self.shading, s, self.shadows)

    def light(self, drawn: Drawn) -> SeenLight:
        """The light of some pixels."""
        self.shading.photograph = drawn.photograph
        with dr.suspend_grad():
            seen = self.march.seen(drawn.rays)
            evaluate(seen)
            return SeenLight(seen, self._passed(drawn, seen), self._arriving(drawn, seen))

    def _arriving(self, drawn: Drawn, seen: Seen) -> list[Float]:
        """Irradiance of each channel by other parts of the object."""
        if self.between is None:
            return []
        place = drawn.rays.at(seen.way)
        light = self.between.at(self.field, drawn.photograph, place, unit(self.field.axis_at(place)))
        dr.eval(light)
        return light

    def _passed(self, drawn: Drawn, seen: Seen) -> list[Float]:
        jit, lamps = arrays(), self.shading.lamps
        factors = [jit.Float(1.0)] * max(lamps.each, 1)
        if self.strengths is not None:
            factors = self.strengths.on(drawn.photograph)
        if self.march.lights_pieces or not (self.shadows and lamps.each):
            return factors
        place = dr.fma(drawn.rays.direction, seen.way, drawn.rays.origin)
        shares = []
        for k in range(lamps.each):
            to_lamp, distance, _ = lamps.arriving(drawn.photograph, k, place)
            far = dr.select(seen.depth > OPAQUE, dr.fmin(distance, self.field.way_to_edge(place, to_lamp, INSIDE)), 0.0)
            passed = self.march.transmittance(LatticeRays(place, to_lamp, jit.Float(0), far))
            shares.append(factors[k] * passed)
            dr.eval(shares[-1])
        return shares

    def picture(self, photograph: Photograph, lattice: Lattice) -> tuple[NDArray[np.float32], NDArray[np.float32]]:
        """Light (h, w, 3) that a camera sees under the lamps of `photograph`, and the opacity (h, w) there."""
        shown = self.under([photograph], lattice)
        if self.albedo is not None and shown.shading.lamps.each:
            self._sky = self._sky or sky_of(self)
            shown.between = light_between(shown, 1, self.albedo, self._sky)
        light = shown.light(whole_picture(photograph, lattice))
        size = photograph.camera.height, photograph.camera.width
        channels = [np.broadcast_to(np.array(each), light.opacity.shape) for each in light.channels]
        return np.stack(channels, axis=1).reshape(*size, COLOURS), light.opacity.reshape(size)

    def normals(self, photograph: Photograph, lattice: Lattice) -> tuple[NDArray[np.float64], NDArray[np.float32]]:
        """Unit normals, or axes of fibres, that a camera sees (h, w, 3), and the opacity (h, w) there."""
        place, opacity = self._places(photograph, lattice)
        normals = np.array(unit(self.field.axis_at(place)), np.float64).T
        return normals.reshape(*opacity.shape, 3), opacity

    def nodes(self, photograph: Photograph, lattice: Lattice) -> tuple[NDArray[np.int64], NDArray[np.float32]]:
        """Number (h, w) of the node nearest to what a camera sees, and the opacity (h, w) there."""
        place, opacity = self._places(photograph, lattice)
        return self.field.nearest_node(place).reshape(opacity.shape), opacity

    def _places(self, photograph: Photograph, lattice: Lattice) -> tuple[Array3f, NDArray[np.float32]]:
        """Places of the lattice that the pixels of a camera see, and the opacity (h, w) there."""
        drawn = whole_picture(photograph, lattice)
        light = Rendering(self.field, self.under([photograph], lattice).shading, self.softness, shadows=False).light(
            drawn
        )
        place = dr.fma(drawn.rays.direction, light.seen.way, drawn.rays.origin)
        return place, light.opacity.reshape(photograph.camera.height, photograph.camera.width)

    def under(self, photographs: Sequence[Photograph], lattice: Lattice) -> Rendering:
        """The same matter under the lamps of photographs, without light between its parts."""
        unknown = self.shading.unknown
        light = None if unknown is None else unknown.of(photographs)
        table, gloss = LampTable(photographs, lattice), np.array(self.shading.gloss)
        return Rendering(self.field, NodeShading(table, gloss, light, self.field.element), self.softness, self.shadows)


def whole_picture(photograph: Photograph, lattice: Lattice) -> Drawn:
    """All pixels of a photograph, for their rays alone."""
    jit, camera = arrays(), photograph.camera
    directions, origin = camera.pixel_directions(), lattice.from_world(camera.position)
    near, far = span(origin, directions, lattice)

    def of_pixels(values: Any) -> Float:
        return column(jit.Float, np.broadcast_to(values, near.shape).astype(np.float32))

    begin = jit.Array3f(*(of_pixels(x) for x in origin))
    way = jit.Array3f(*(of_pixels(directions[..., k]) for k in range(3)))
    rays = LatticeRays(begin, way, of_pixels(near), of_pixels(np.maximum(far, near)))
    nothing = of_pixels(0.0)
    return Drawn(rays, dr.zeros(jit.UInt, near.size), [nothing] * 3, [nothing] * 3, nothing, nothing)
