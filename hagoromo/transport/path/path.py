"""Path: light of all orders along rays, by random walks from the eye (MODEL §1; Kajiya 1986).

    L(o, v) = Σ_n ∫ … ∫ f(x_1) … f(x_n) E(x_n) T(x_n, lamp)

A walk flies to a collision with matter or a surface, looks at one lamp from there, draws the direction from which the
light comes that it sends on, and goes that way. The first event gives the weights of the palette, as the march does;
later ones give the transfer in bands, as a colour multiplied by another is no sum over the palette.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.materials import FAR_BODY
from hagoromo.transport.path.bands import Bands
from hagoromo.transport.path.free_flight import Collision, Matter, Random, first_collision, transmittance
from hagoromo.transport.path.lights import Lights, front_of, share_of_drawn
from hagoromo.transport.path.next_event import LampDrawn, lamp_drawn
from hagoromo.transport.path.optics import Optics
from hagoromo.transport.path.scatter import Scattering
from hagoromo.transport.surface_colours import SurfaceColours, SurfaceHit

LANES = 1 << 12  # that walks go on at a time on a processor, enough for its threads; the rest waits
FAINT = 0.6  # throughput below which a walk goes on by chance
FAINT_TO_LIGHTS = 0.3  # the same where it may meet a light, or glass, in which radiance is (1/n)² of that outside


class SurfaceHits(Protocol):
    """Surfaces as walks need them. shadow_bias: of the points of hits, along the normal [m].

    instant: as of `Frames`, of surfaces that move.
    """

    shadow_bias: Float
    instant: UInt | None

    def hit(self, origin: Array3f, direction: Array3f) -> SurfaceHit:
        """First hit of rays."""
        ...

    def visible(self, point: Array3f, to_lamp: Array3f, distance: Float) -> Bool:
        """Whether no surface stands between points and the lamp."""
        ...


@dataclass
class Event:
    """Where a walk is: at matter or a surface. `face`: normal of a surface that light may not go below; else 0.
    distance: from where the walk was before [m]; infinity: it hit nothing. front: see `front_of`. gamma: half
    width of the facets [rad]; None where all have that of their material.
    """

    there: Bool
    distance: Float
    point: Array3f
    axis: Array3f
    face: Array3f
    material: UInt
    coefficients: list[Float]  # of its colours, on the palette
    front: UInt
    gamma: Float | None = None


class Walks:
    """A scene as walks need it."""

    def __init__(
        self,
        matter: Matter | None,
        surfaces: SurfaceHits | None,
        first_on_surface: UInt,
        lighting: Lighting,
        scattering: Scattering,
        bands: Bands,
        lights: Lights | None = None,
        optics: Optics | None = None,
        surface_colours: SurfaceColours | None = None,
        thickness: Float | None = None,
    ) -> None:
        """first_on_surface: number of the material of the first surface. lights: of a scene with lamps of a size.
        optics: of one with mirrors or glass. surface_colours: of one with textures. thickness: of sheets, see
        `surface_element`.
        """
        self.thickness = thickness
        self.optics, self.surface_colours = optics, surface_colours
        self.matter, self.surfaces, self.first_on_surface = matter, surfaces, first_on_surface
        self.lighting, self.scattering, self.bands, self.lights = lighting, scattering, bands, lights
        palette = lighting.materials.palette
        self.colours, self.parts, self.groups = len(palette.colours), palette.parts, len(palette.lamps)
        self.in_bands = lookup(arrays().Float, bands.of(palette.colours).astype(np.float32))

    @property
    def channels(self) -> int:
        """Weights of a walk: of every group of lamps, one for each colour of the palette and each band."""
        return self.groups * (self.colours + self.bands.count)

    @property
    def faint(self) -> float:
        """Throughput below which a walk goes on by chance."""
        return FAINT if self.lights is None and self.optics is None else FAINT_TO_LIGHTS

    def is_at(self, instant: UInt | None) -> None:
        """Have boxes and surfaces that move stand where they are at an instant of each walk."""
        if self.matter is not None:
            self.matter.medium.frames.instant = instant
        if self.surfaces is not None:
            self.surfaces.instant = instant

    def event(self, origin: Array3f, direction: Array3f, random: Random) -> tuple[Event, Random]:
        """The next event along rays."""
        jit, materials = arrays(), self.lighting.materials
        far = dr.full(jit.Float, dr.inf, dr.width(direction))
        nothing = jit.Array3f(0.0)
        event = Event(jit.Bool(False), far, nothing, nothing, nothing, jit.UInt(0), [], jit.UInt(0))
        hit: SurfaceHit | None = None
        if self.surfaces is not None:
            hit = self.surfaces.hit(origin, direction)
            far, material = hit.distance, self.first_on_surface + hit.surface
            event = Event(dr.isfinite(far), far, hit.point, hit.normal, hit.flat, material, [], jit.UInt(0))
            event.front = front_of(hit)
        if self.matter is None:
            event.coefficients = materials.coefficients(event.material)
            return self._with_textures(event, hit, event.there), random
        found, random = first_collision(self.matter, origin, direction, far, random)
        inside = dr.isfinite(found.distance)
        axis, material = self._element(found, direction, inside, random.next_float32())
        event = Event(
            event.there | inside,
            dr.select(inside, found.distance, far),
            dr.select(inside, dr.fma(direction, dr.select(inside, found.distance, 0.0), origin), event.point),
            dr.select(inside, axis, event.axis),
            dr.select(inside, nothing, event.face),
            dr.select(inside, material, event.material),
            [],
            dr.select(inside, jit.UInt(0), event.front),
        )
        event.coefficients = materials.coefficients(event.material)
        if self.lighting.voxel_bases:
            event.coefficients = self._with_voxel_colour(event.coefficients, found, inside)
        return self._with_textures(event, hit, event.there & ~inside), random

    def _with_textures(self, event: Event, hit: SurfaceHit | None, there: Bool) -> Event:
        """Events with the textures of those that are `there`, on a surface."""
        if self.surface_colours is None or hit is None:
            return event
        mixed = self.surface_colours.with_textures(event.coefficients, hit)
        mixed = [dr.select(there, own, old) for own, old in zip(mixed, event.coefficients, strict=True)]
        plain = self.lighting.materials.read(event.material, "gamma")
        gamma = self.surface_colours.gamma(hit, plain)
        return replace(event, coefficients=mixed, gamma=None if gamma is None else dr.select(there, gamma, plain))

    def _element(self, found: Collision, direction: Array3f, inside: Bool, number: Float) -> tuple[Array3f, UInt]:
        """Axis and material of what a ray collides with: of a texel's populations one, by its share of extinction."""
        assert self.matter is not None
        medium = self.matter.medium

        def element(found: Collision, direction: Array3f, number: Float) -> tuple[Array3f, UInt]:
            place = medium.at(found.box, found.place, found.brick)
            first, *others = medium.elements(place, direction)[0]
            axis, material, below = first.axis, first.material, first.share
            for one in others:
                here = (number >= below) & (one.share > 0.0)
                axis, material = dr.select(here, one.axis, axis), dr.select(here, one.material, material)
                below = below + one.share
            return axis, material

        return dr.if_stmt(
            (found, direction, number), inside, element,
            lambda found, direction, number: (arrays().Array3f(0.0), arrays().UInt(0)),
        )  # fmt: skip

    def _with_voxel_colour(self, coefficients: list[Float], found: Collision, inside: Bool) -> list[Float]:
        assert self.matter is not None
        medium = self.matter.medium
        colour = dr.if_stmt(
            (found,), inside,
            lambda found: medium.colour(medium.at(found.box, found.place, found.brick)),
            lambda found: arrays().Array4f(0.0),
        )  # fmt: skip
        mixed = self.lighting.with_voxel_colour(coefficients, found.box, colour)
        return [dr.select(inside, own, old) for own, old in zip(mixed, coefficients, strict=True)]

    def lamp(self, event: Event, to_eye: Array3f, random: Random) -> tuple[LampDrawn, list[Float], Random]:
        """A lamp drawn for the event, and the weights of the light of it that the eye sees: see `Palette.parts`."""
        if self.lights is None:
            lamp = lamp_drawn(self.lighting.lamps, event.point, random.next_float32())
        else:
            lamp, random = self.lights.drawn(event.point, self.groups, random)
        weights = self.lighting.materials.weights(event.material, event.axis, lamp.to_lamp, to_eye, event.gamma)
        f = sum(weights[1:], weights[0])
        lit = event.there & (f > 0.0) & (lamp.irradiance > 0.0)
        point = self.on_side(event, lamp.to_lamp).point
        if self.surfaces is not None:
            lit &= self.surfaces.visible(point, lamp.to_lamp, lamp.distance)
        passed = dr.select(lit, arrays().Float(1), 0.0)
        if self.matter is not None:
            passed, random = transmittance(self.matter, point, lamp.to_lamp, lamp.distance, lit, random)
        seen = lit & (passed > 0.0)
        irradiance = lamp.irradiance * passed
        if self.lights is not None:
            irradiance *= share_of_drawn(lamp, self.lights.spread(event.material, f, event.gamma))
        return lamp, [dr.select(seen, irradiance * weight, 0.0) for weight in weights], random

    def on_side(self, event: Event, direction: Array3f) -> Event:
        """An event on a sheet on the side of it to which a direction points; others as they are."""
        if self.thickness is None:
            return event
        behind = (dr.dot(event.face, direction) < 0.0) & (self.lighting.materials.read(event.material, FAR_BODY) > 0.0)
        across = event.point - event.face * self.thickness
        return replace(
            event,
            point=dr.select(behind, across, event.point),
            face=dr.select(behind, -event.face, event.face),
        )

    def mixed(self, coefficients: list[Float], weights: Sequence[Float]) -> list[Float]:
        """body · c_b + interface · e, and what is transmitted, in every band."""
        sums = []
        for k in range(self.bands.count):
            total = arrays().Float(0)
            for j, share in enumerate(coefficients):
                value = dr.gather(arrays().Float, self.in_bands, arrays().UInt(j * self.bands.count + k))
                total = dr.fma(share * weights[self.parts[j]], value, total)
            sums.append(total)
        return sums

    def added(
        self,
        channels: list[Float],
        first: Bool,
        lamp: LampDrawn,
        coefficients: list[Float],
        weights: Sequence[Float],
        carried: list[Float],
    ) -> list[Float]:
        """The channels with the light of a lamp, that of the first event among the colours, else among the bands."""
        jit = arrays()
        light = [
            dr.select(first, share * weights[part], 0.0) for share, part in zip(coefficients, self.parts, strict=True)
        ]
        in_bands = self.mixed(coefficients, weights)
        light += [dr.select(first, 0.0, old * new) for old, new in zip(carried, in_bands, strict=True)]
        each = len(light)
        if lamp.tints is not None:
            return [dr.fma(lamp.tints[k // each], light[k % each], old) for k, old in enumerate(channels)]
        own = [jit.Bool(True)] if self.groups == 1 else [lamp.group == group for group in range(self.groups)]
        return [old + dr.select(own[k // each], light[k % each], 0.0) for k, old in enumerate(channels)]

    def hit(
        self,
        channels: list[Float],
        origin: Array3f,
        direction: Array3f,
        event: Event,
        events: UInt,
        onwards: Onwards,
        carried: list[Float],
    ) -> list[Float]:
        """The channels with the light that a walk hits on its way to an event: after the first one among the colours,
        else among the bands, which together are 1 at every wavelength.
        """
        assert self.lights is not None
        first, one = events == 0, events == 1
        light = self.lights.hit(origin, direction, event, onwards.spread, first, self.groups)
        weights = [dr.select(one, weight, 0.0) for weight in onwards.weights]
        weights += [dr.select(one, 0.0, old) for old in carried]
        each = len(weights)
        return [dr.fma(light[k // each], weights[k % each], old) for k, old in enumerate(channels)]

    def turned(
        self,
        event: Event,
        direction: Array3f,
        to_eye: Array3f,
        sent: Sequence[Float],
        good: Bool,
        glass: UInt,
        u: Float,
    ) -> tuple[Event, Array3f, list[Float], Bool, UInt, Bool]:
        """Event, direction, weights, whether the walk goes on and in which glass, see `Optics.left`, now that it may
        have hit a mirror or glass; and whether it did.
        """
        assert self.optics is not None
        turn = self.optics.turned(event.material, event.there, event.axis, to_eye, glass, u)
        behind = event.point - event.face * (2.0 * self.optics.bias)
        moved = replace(
            event,
            point=dr.select(turn.refracted, behind, event.point),
            face=dr.select(turn.refracted, -event.face, event.face),
        )
        weights = [dr.select(turn.here, turn.factor if part == 1 else 0.0, old) for part, old in enumerate(sent)]
        return moved, dr.select(turn.here, turn.direction, direction), weights, good | turn.here, turn.glass, turn.here

    def left(self, event: Event, glass: UInt, carried: list[Float]) -> list[Float]:
        """What glass has left of the light in every band on the way to an event."""
        assert self.optics is not None
        return self.optics.left(glass, event.distance, carried)

    def goes_on(self, events: UInt, most: UInt) -> Bool:
        """Whether a walk goes on after some events: from the last one only to meet lights."""
        return events < most if self.lights is None else events <= most

    def onwards(
        self, event: Event, direction: Array3f, to_eye: Array3f, sent: Sequence[Float], stays: Float
    ) -> Onwards:
        """What a walk takes along from an event; stays: the chance that it goes on."""
        assert self.lights is not None
        f = self.lighting.materials.weights(event.material, event.axis, direction, to_eye, event.gamma)
        scale = dr.rcp(dr.fmax(stays, 1e-30))
        weights = [share * sent[part] * scale for share, part in zip(event.coefficients, self.parts, strict=True)]
        return Onwards(self.lights.spread(event.material, sum(f[1:], f[0]), event.gamma), weights)


@dataclass
class Onwards:
    """What a walk takes along where it may meet lights: about the density of its direction [1/sr], and its weight for
    each colour of the palette after its first event.
    """

    spread: Float
    weights: list[Float]


class Queue:
    """Walks that wait for a lane, and what came of those that have ended: `light`, the channels of each walk side by
    side, and `events`, how often each was scattered.

    Walks have very different lengths. A lane that is done takes the next of the queue at once; otherwise all lanes of a
    packet would wait for the longest of their walks. What a walk brings does not depend on the lane that it has.
    A plain object: loops do not take its values into their state.
    """

    def __init__(
        self, origin: Array3f, direction: Array3f, random: Random, channels: int, instant: UInt | None = None
    ) -> None:
        """One walk for each ray. channels: numbers that a walk brings. instant: of boxes that move, see `Frames`."""
        jit = arrays()
        self.count, self.channels = dr.width(direction), channels
        nothing = dr.zeros(jit.Float, self.count)
        self.rays = [value + nothing for vector in (origin, direction) for value in vector]
        self.random, self.size, self.instant = random, dr.opaque(jit.UInt, self.count), instant
        few = dr.backend_v(jit.Float) == dr.JitBackend.LLVM
        self.lanes = min(self.count, LANES) if few else self.count
        self.taken = dr.full(jit.UInt, self.lanes, 1)  # walks that have a lane or had one
        self.light, self.events = dr.zeros(jit.Float, self.count * channels), dr.zeros(jit.UInt, self.count)
        dr.eval(self.rays, self.random, self.taken, self.light, self.events, self.instant)

    def next(self) -> UInt:
        """A further walk, `size` or more where none is left."""
        return dr.scatter_inc(self.taken, arrays().UInt(0))

    def start(self, walk: UInt) -> tuple[Array3f, Array3f, Random]:
        """The ray of a walk, and its random numbers."""
        jit = arrays()
        there = walk < self.size
        x, y, z, *way = (dr.gather(jit.Float, value, walk, there) for value in self.rays)
        return jit.Array3f(x, y, z), jit.Array3f(*way), dr.gather(jit.PCG32, self.random, walk, there)

    def instant_of(self, walk: UInt) -> UInt | None:
        """The instant of a walk; None where nothing moves."""
        return None if self.instant is None else dr.gather(arrays().UInt, self.instant, walk, walk < self.size)

    def end(self, walk: UInt, channels: list[Float], events: UInt) -> None:
        """Keep what a walk has brought."""
        for k, channel in enumerate(channels):
            dr.scatter(self.light, channel, walk * self.channels + k)
        dr.scatter(self.events, events, walk)


def light_of_walks(
    walks: Walks, origin: Array3f, direction: Array3f, random: Random, most: UInt, instant: UInt | None = None
) -> Queue:
    """One walk along each ray, and what came of it: weights of the radiance towards the origin, see `Walks.channels`.

    most: number of events of a walk, after which it ends. instant: of each walk, where boxes move, see `Frames`.
    """
    queue = Queue(origin, direction, random, walks.channels, instant)
    try:
        return walked_to_the_end(walks, queue, most)
    finally:
        walks.is_at(None)


@dr.syntax
def walked_to_the_end(walks: Walks, queue: Queue, most: UInt) -> Queue:
    """All walks of a queue, see `light_of_walks`."""
    jit = arrays()
    colours = walks.colours if walks.lights is not None else 0
    walk = dr.arange(jit.UInt, queue.lanes)
    alive = walk < queue.size
    origin, direction, random = queue.start(walk)
    channels, carried, events, glass, onwards = fresh(walks, queue.lanes, colours)
    while alive:
        walks.is_at(queue.instant_of(walk))
        event, random = walks.event(origin, direction, random)
        to_eye = -direction
        if dr.hint(walks.lights is not None, mode="scalar"):
            channels = walks.hit(channels, origin, direction, event, events, onwards, carried)
            event.there &= events < most
        if dr.hint(walks.optics is not None, mode="scalar"):
            carried = walks.left(event, glass, carried)
        lamp, weights, random = walks.lamp(event, to_eye, random)
        channels = walks.added(channels, events == 0, lamp, event.coefficients, weights, carried)
        events += dr.select(event.there, 1, jit.UInt(0))
        numbers = five_of(random)
        direction, sent, good = walks.scattering.drawn(event.material, event.axis, to_eye, numbers, event.gamma)
        single = jit.Bool(False)
        sent = list(sent)
        if dr.hint(walks.optics is not None, mode="scalar"):
            event, direction, sent, good, glass, single = walks.turned(
                event, direction, to_eye, sent, good, glass, random.next_float32()
            )
        carried = products(carried, walks.mixed(event.coefficients, sent))
        event = walks.on_side(event, direction)
        goes_on = event.there & good & walks.goes_on(events, most)
        goes_on &= dr.all(event.face == 0.0) | (dr.dot(event.face, direction) > 0.0)
        origin = event.point
        stays = dr.fmin(largest(carried) * (1.0 / walks.faint), 1.0)
        goes_on &= random.next_float32() < stays
        carried = [old / dr.fmax(stays, 1e-30) for old in carried]
        if dr.hint(walks.lights is not None, mode="scalar"):
            onwards = walks.onwards(event, direction, to_eye, sent, stays)
            onwards.spread = dr.select(single, dr.inf, onwards.spread)
        if ~goes_on:
            queue.end(walk, channels, events)
            walk = queue.next()
            alive = walk < queue.size
            origin, direction, random = queue.start(walk)
            channels, carried, events, glass, onwards = fresh(walks, 1, colours)
    return queue


def fresh(walks: Walks, count: int, colours: int) -> tuple[list[Float], list[Float], UInt, UInt, Onwards]:
    """What walks have at their beginning: channels, throughput of each band, events, in which glass, what is taken
    along.
    """
    jit = arrays()
    nothing, one = dr.zeros(jit.Float, count), dr.full(jit.Float, 1.0, count)
    onwards = Onwards(dr.full(jit.Float, dr.inf, count), [nothing] * colours)
    none = dr.zeros(jit.UInt, count)
    return [nothing] * walks.channels, [one] * walks.bands.count, dr.zeros(jit.UInt, count), none, onwards


def five_of(random: Random) -> list[Float]:
    """Five random numbers."""
    return [random.next_float32() for _ in range(5)]


def products(some: list[Float], others: list[Float]) -> list[Float]:
    """The product of each two (`dr.syntax` takes no comprehension over pairs)."""
    return [one * other for one, other in zip(some, others, strict=True)]


def largest(values: Sequence[Float]) -> Float:
    """The largest of some values, where none is NaN."""
    most = values[0]
    for value in values[1:]:
        most = dr.fmax(most, value)
    return most


def random_numbers(pixel: UInt, sample: UInt, seed: int) -> Random:
    """A stream of random numbers of its own for each sample of each pixel, the same on every machine."""
    jit = arrays()
    state = scrambled(jit.UInt64(pixel) | (jit.UInt64(sample) << 32))
    state = scrambled(state ^ dr.opaque(jit.UInt64, (seed * 0x9E3779B97F4A7C15) & 0xFFFFFFFFFFFFFFFF))
    # a size above 1 would add the number of the lane, by which walks would depend on those beside them
    return jit.PCG32(1, state, scrambled(state + jit.UInt64(0x9E3779B97F4A7C15)))


def scrambled(value: NDArray | Float) -> Float:
    """The bits of a 64-bit number mixed, by the finaliser of SplitMix64 (Steele, Lea & Flood 2014)."""
    value = (value ^ (value >> 30)) * type(value)(0xBF58476D1CE4E5B9)
    value = (value ^ (value >> 27)) * type(value)(0x94D049BB133111EB)
    return value ^ (value >> 31)
