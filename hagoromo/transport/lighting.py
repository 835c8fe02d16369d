"""Lighting: the lamps of a scene on the device, and the radiance that matter reflects to the eye.

f = w_d c_b(λ) + w_s e with purely geometric weights, so light is kept as weights: one channel for every group of lamps
with one spectrum and every colour of the palette (MODEL §5). Exposing through a camera happens afterwards.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import copy
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, NamedTuple, Protocol

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Array4f, Bool, Float, UInt, arrays, lookup
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp, by_place
from hagoromo.light.lamp_light import LampInTurn, LampLight
from hagoromo.light.spectrum import Spectrum
from hagoromo.transport.lamps_in_turn import MOST_UNROLLED, in_turn
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import position_of
from hagoromo.transport.sample import Element, TexelHit

LAMPS_OF_A_PART = 16  # of a kernel that follows rays of the camera; one of 32 takes twice as long to compile
MOST_LAMPS = 512  # of one kernel, each a part of it; pictures are made of batches of fewer
ShadowRay = tuple[Array3f, Array3f, Float]  # origin, to_lamp, distance to the lamp [m]
AttenuationOfAll = Callable[[list[ShadowRay]], list[Float]]  # transmittance 0…1 of each; see `DifferentiableMedium`


@dataclass
class WayToLamp:
    """The straight way from a point of matter or of a surface to a lamp.

    origin: world [m]. to_lamp: unit. distance: to the lamp [m]. extinction: around the point [1/m]. seen: share of the
    point's light that reaches the eye, at most. texel_hit: its place in a texel; None without texels. box: number of
    that which the point is matter of; None of a surface.
    """

    origin: Array3f
    to_lamp: Array3f
    distance: Float
    extinction: Float
    seen: Float
    texel_hit: TexelHit | None
    box: UInt | None = None


Attenuation = Callable[[int | LampInTurn, WayToLamp], Float]  # (lamp number, way) → transmittance 0…1


class LampRow(NamedTuple):
    """A lamp as kernels read it, and its group in the palette.

    shares: of lamps at one place, each one's group and its share of the intensity, in place of one group.
    """

    light: LampLight
    group: int
    shares: Sequence[tuple[int, Float]] = ()

    @property
    def groups(self) -> Sequence[tuple[int, Float]]:
        """Each group of its light, and its share."""
        return self.shares or [(self.group, 1.0)]

    @property
    def kind(self) -> tuple[bool, str, Sequence[int]]:
        """Equal for lamps that are the same code in a kernel."""
        return self.light.near, type(self.light.beam).__name__, [group for group, _ in self.groups]


class Arrived(NamedTuple):
    """Light of a lamp at a point without shadows: unit direction to it, its distance [m] and irradiance, and whether
    there is any.
    """

    to_lamp: Array3f
    distance: Float
    irradiance: Float
    any: Bool


class HigherOrders(Protocol):
    """Light that was scattered before it arrives at a sample, see `hagoromo.transport.field`."""

    channels: int

    def scattered(
        self, point: Array3f, to_eye: Array3f, elements: Sequence[Element], coefficients: Sequence[Sequence[Float]]
    ) -> list[Float]:
        """Radiance of every channel that it becomes towards the eye."""
        ...

    def taken(self, gain: Float, smooth: Sequence[Float]) -> None:
        """The march says here which share of that radiance reaches the eye."""
        ...


class HigherOrdersOnSurfaces(Protocol):
    """Light that was scattered before it arrives at a surface, see `hagoromo.transport.field.joint`."""

    channels: int

    def radiance(
        self, point: Array3f, element: Element, coefficients: list[Float], to_eye: Array3f, there: Bool
    ) -> list[Float]:
        """Radiance of every channel that it becomes towards the eye; coefficients: of the surface on the palette."""
        ...


class Lighting:
    """Lamps as kernels read them, and the `attenuation` of their light on its way to a point; `field`, if solved."""

    def __init__(
        self,
        lamps: Sequence[Lamp],
        materials: Materials,
        attenuation: Attenuation | AttenuationOfAll | None = None,
        bases: Sequence[Sequence[Spectrum]] = (),
        together: bool = False,
        all_at_once: bool = False,
    ) -> None:
        """`bases`: per volume box, the spectra of its per-voxel body colours (empty where it has none). together:
        whether lamps at one place are one of `self.lamps`; `attenuation` counts these. all_at_once: whether it is an
        `AttenuationOfAll`.

        `InputError` for more than MOST_LAMPS lamps, or one with an intensity per channel.
        """
        if len(lamps) > MOST_LAMPS:
            raise InputError(
                f"{len(lamps)} lamps: light along single rays is computed under {MOST_LAMPS} at most, as kernels grow "
                f"with them; give fewer, or add what parts of them give"
            )
        jit, self.materials = arrays(), materials
        self.attenuation: Any = attenuation
        self.all_at_once = all_at_once
        self.field: HigherOrders | None = None
        self.surface_light: HigherOrdersOnSurfaces | None = None
        bodies = materials.palette.bodies
        self.voxel_bases = {box: [position_of(s, bodies) for s in basis] for box, basis in enumerate(bases) if basis}
        self.lamps: list[LampRow] = []
        for numbers in by_place(lamps) if together else [[number] for number in range(len(lamps))]:
            lamp, strengths = lamps[numbers[0]], [_strength(lamps[number]) for number in numbers]
            of_lamps = materials.palette.lamp_groups
            groups = [
                of_lamps[n] if of_lamps else position_of(lamps[n].spectrum, materials.palette.lamps) for n in numbers
            ]
            total = sum(strengths)
            shares = [dr.opaque(jit.Float, one / total if total > 0.0 else 0.0) for one in strengths]
            each = list(zip(groups, shares, strict=True)) if len(numbers) > 1 else []
            self.lamps.append(LampRow(LampLight(lamp, total), groups[0], each))

    def in_parts(self) -> list[Lighting]:
        """Of many lamps, LAMPS_OF_A_PART at most in each, those of one kind together; light of higher orders is in the
        first. Parts that have the same kinds of lamps have the same kernels.
        """
        attenuation, count = self.attenuation, -(-len(self.lamps) // LAMPS_OF_A_PART)
        if count <= 1 or self.all_at_once:
            return [self]
        order = sorted(range(len(self.lamps)), key=lambda number: self.lamps[number].kind)
        size = -(-len(order) // count)
        parts = []
        for numbers in (order[first : first + size] for first in range(0, len(order), size)):
            part = copy(self)
            part.lamps = [self.lamps[number] for number in numbers]
            if attenuation is not None:
                part.attenuation = partial(_of_part, attenuation, numbers)
            if parts:
                part.field = part.surface_light = None
            parts.append(part)
        return parts

    @property
    def channels(self) -> int:
        """Number of channels of the march: those of the palette, then those of the field."""
        smooth = self.field or self.surface_light
        return self.materials.palette.channels + (smooth.channels if smooth else 0)

    @property
    def tracked(self) -> bool:
        """Whether derivatives by its materials are asked for."""
        return dr.grad_enabled(self.materials.rows)

    def with_voxel_colour(self, coefficients: list[Float], box: UInt, colour: Array4f) -> list[Float]:
        """Coefficients on the palette, with the body colour of the voxel where the box has one."""
        mixed = list(coefficients)
        for number, places in self.voxel_bases.items():
            here = box == number
            for j in range(len(self.materials.palette.bodies)):
                value = colour[places.index(j)] if j in places else 0.0
                mixed[j] = dr.select(here, value, mixed[j])
        return mixed

    def arriving(self, lamp: int, point: Array3f) -> tuple[Array3f, Float, Float]:
        """Unit direction to a lamp, the distance to it [m] and its irradiance at `point`, without shadows."""
        return self.lamps[lamp].light.arriving(point)

    def reflected_radiance(
        self,
        point: Array3f,
        to_eye: Array3f,
        elements: list[Element],
        coefficients: list[list[Float]],
        texel_hit: TexelHit | None = None,
        extinction: Float = 0.0,
        seen: Float = 1.0,
        box: UInt | None = None,
    ) -> tuple[list[Float], list[Float]]:
        """Weights of the radiance that matter at `point` sends to the eye, I_t of MODEL §3, of every lamp and colour of
        the palette (see `in_groups`); and the transmittance from every lamp, 1 where it lights nothing.

        coefficients: of every element, on the palette. texel_hit: place of the point in a texel; None without texels.
        extinction: around the point [1/m]. seen: share of its light that reaches the eye, at most. box: number of that
        which the point is matter of; None of a surface.
        """
        arrived, count = self._arrived(point), 1 + len(self.materials.palette.colours)
        ahead: list[Float] = []
        if self.all_at_once and self.attenuation:
            lit = [self._scattered(each, to_eye, elements, texel_hit)[1] for each in arrived]
            ahead = self._transmittances(point, elements[0], arrived, lit)

        def each(lamp: int | LampInTurn, *known: Any) -> list[Float]:
            """Transmittance from one lamp, and its light of every colour."""
            here, passed = Arrived(*known), arrays().Float(1)
            weights, lit = self._scattered(here, to_eye, elements, texel_hit)
            irradiance = here.irradiance
            if self.attenuation is not None:
                way = WayToLamp(point, here.to_lamp, here.distance, extinction, seen, texel_hit, box)
                transmittance = (
                    ahead[lamp] if isinstance(lamp, int) and ahead else self.transmittance(lamp, lit, elements[0], way)
                )
                passed, irradiance = dr.select(lit, transmittance, 1.0), irradiance * transmittance
            return [passed, *(irradiance * total for total in self._in_colours(weights, coefficients))]

        lights = [row.light for row in self.lamps]
        one_by_one = self.attenuation is None or self.all_at_once or self.tracked
        found = in_turn(lights, arrived, each, count, len(lights) if one_by_one else MOST_UNROLLED)
        return [one for k, one in enumerate(found) if k % count], found[::count]

    def _arrived(self, point: Array3f) -> list[Arrived]:
        """The light of every lamp at a point."""
        jit, found = arrays(), []
        for lamp, row in enumerate(self.lamps):
            to_lamp, distance, irradiance = self.arriving(lamp, point)
            any_light = jit.Bool(True) if row.light.beam is None else irradiance > 0.0
            found.append(Arrived(jit.Array3f(to_lamp), jit.Float(distance), jit.Float(irradiance), any_light))
        return found

    def _scattered(
        self, arrived: Arrived, to_eye: Array3f, elements: list[Element], texel_hit: TexelHit | None
    ) -> tuple[list[list[Float]], Bool]:
        """Weights of what each element sends of the light of a lamp, and whether any sends some."""
        weights, lit = [], arrays().Bool(False)
        for element in elements:
            each = self._weights(element, arrived.to_lamp, to_eye)
            lit |= sum(each[1:], each[0]) > 0.0
            if element.scales and texel_hit:
                factors = element.scales.at(*(texel_hit.frame.inwards(way) for way in (to_eye, arrived.to_lamp)))
                scaled = [  # fewer than weights where no element of a texel transmits
                    dr.select(texel_hit.textured, part * factor, part)
                    for part, factor in zip(each, factors, strict=False)
                ]
                each = [*scaled, *each[len(scaled) :]]
            weights.append([part * element.share for part in each])
        return weights, lit & arrived.any

    def _in_colours(self, weights: list[list[Float]], coefficients: list[list[Float]]) -> list[Float]:
        """Weights of elements as those of each colour of the palette; coefficients: of every element."""
        palette, found = self.materials.palette, []
        for j in range(len(palette.colours)):
            total = arrays().Float(0)
            for each, share in zip(weights, coefficients, strict=True):
                total = dr.fma(each[palette.parts[j]], share[j], total)
            found.append(total)
        return found

    def _weights(self, element: Element, to_lamp: Array3f, to_eye: Array3f) -> Sequence[Float]:
        """Weights of f of an element; 0 where it is not there."""
        if element.there is None:
            return self.materials.weights(element.material, element.axis, to_lamp, to_eye, element.gamma)

        def there(material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> list[Float]:
            return list(self.materials.weights(material, axis, to_lamp, to_eye))

        def nowhere(*_: Any) -> list[Float]:
            return [arrays().Float(0)] * (4 if self.materials.transmit else 2)

        ways = arrays().Array3f(to_lamp), arrays().Array3f(to_eye)
        return dr.if_stmt((element.material, element.axis, *ways), element.there, there, nowhere)

    def in_groups(self, light: list[Float]) -> list[Float]:
        """Radiances of every lamp and colour as those of every group of lamps and colour: the channels of a picture."""
        colours = len(self.materials.palette.colours)
        channels: list[Any] = [arrays().Float(0)] * self.materials.palette.channels
        for k, each in enumerate(light):
            for group, share in self.lamps[k // colours].groups:
                channel = group * colours + k % colours
                channels[channel] = channels[channel] + each * share
        return channels

    def transmittance(self, lamp: int | LampInTurn, lit: Bool, element: Element, way: WayToLamp) -> Float:
        """Transmittance of a `way` from an `element` to a lamp; looked up only where matter faces the lamp (`lit`).

        With a shadow bias it is the lesser one of two rays: the first, past the skin of the element, has the shadows
        of what is near, the second ends those of all other matter where they should.
        """
        origin = element.shadow_origin(way.origin, way.to_lamp)
        first = self._looked_up(lamp, lit, replace(way, origin=origin))
        if element.shadow_bias is None:
            return first
        biased = lit & (element.shadow_bias > 0.0) & (first > 0.0)
        origin, rest = element.far_shadow_origin(way.origin, way.to_lamp, way.distance)
        second = self._looked_up(lamp, biased, replace(way, origin=origin, distance=rest, extinction=0.0))
        return dr.select(biased, dr.fmin(first, second), first)

    def irradiances(
        self, element: Element, point: Array3f, extinction: Float, texel_hit: TexelHit | None
    ) -> list[Float]:
        """Irradiance from every lamp on what faces it, with shadows; see `reflected_radiance`."""
        arrived = self._arrived(point)
        if self.attenuation is None:
            return [each.irradiance for each in arrived]

        def each(lamp: int | LampInTurn, *known: Any) -> list[Float]:
            here = Arrived(*known)
            way = WayToLamp(point, here.to_lamp, here.distance, extinction, 1.0, texel_hit)
            return [here.irradiance * self.transmittance(lamp, arrays().Bool(True), element, way)]

        return in_turn([row.light for row in self.lamps], arrived, each, 1)

    def _transmittances(self, point: Array3f, element: Element, arrived: list[Arrived], lit: list[Bool]) -> list[Float]:
        """`transmittance` from every lamp, all at once; 1 where it lights nothing."""
        rays: list[ShadowRay] = []
        for (to_lamp, distance, _, _), asked in zip(arrived, lit, strict=True):
            distance = dr.select(asked, distance, 0.0)
            rays.append((element.shadow_origin(point, to_lamp), to_lamp, distance))
            if element.shadow_bias is not None:
                origin, rest = element.far_shadow_origin(point, to_lamp, distance)
                rays.append((origin, to_lamp, rest))
        passed = self.attenuation(rays)
        if element.shadow_bias is None:
            return passed
        biased = element.shadow_bias > 0.0
        pairs = zip(passed[::2], passed[1::2], strict=True)
        return [dr.select(biased, dr.fmin(first, second), first) for first, second in pairs]

    def _looked_up(self, lamp: int | LampInTurn, where: Bool, way: WayToLamp) -> Float:
        """Transmittance of a `way` to a lamp, 0 but `where` it is asked for."""
        attenuation, Float = self.attenuation, arrays().Float
        assert attenuation is not None
        numbers = {key: Float(getattr(way, key)) for key in ("distance", "extinction", "seen")}
        return dr.if_stmt(
            args=(replace(way, **numbers),),
            cond=where,
            true_fn=lambda way: attenuation(lamp, way),
            false_fn=lambda way: Float(0),
        )


def _of_part(attenuation: Attenuation, numbers: Sequence[int], lamp: int | LampInTurn, way: WayToLamp) -> Float:
    """The `attenuation` of a lamp of a part, of which `numbers` are those in all."""
    if isinstance(lamp, int):
        return attenuation(numbers[lamp], way)
    in_all = lookup(arrays().UInt, np.array(numbers, np.uint32))
    return attenuation(lamp._replace(number=dr.gather(arrays().UInt, in_all, lamp.number)), way)


def _strength(lamp: Lamp) -> float:
    """The intensity of a lamp that has one."""
    if not isinstance(lamp.intensity, (int, float)):
        raise InputError(f"lamp {lamp.name!r} has an intensity per channel: rendering needs one and a spectrum")
    return float(lamp.intensity)
