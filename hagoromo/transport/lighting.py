"""Lighting: lamps, materials and colours of a scene on the device, and the radiance that matter reflects to the eye.

f = w_d c_b(λ) + w_s e with purely geometric weights, so light is kept as weights: one channel for every group of lamps
with one spectrum and every colour of the palette (MODEL §5). Exposing through a camera happens afterwards.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Protocol

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Array4f, Bool, Float, UInt, arrays, lookup, opaque_vector
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp, by_place
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import ELEMENTS, element_weights, graded_place, sphere_body, sphere_table
from hagoromo.reflectance.facets import GAUSSIAN, is_gaussian
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.torrance_sparrow import Weights, cos_deviation, fresnel
from hagoromo.reflectance.transmission import (
    AllWeights,
    around_fibre,
    clear_lobes,
    facing,
    far_body,
    lobe_widths,
    table_from,
)
from hagoromo.transport.emission import Emission, emission_of
from hagoromo.transport.medium import Element, TexelHit

MOST_LAMPS = 512  # of one kernel, each a part of it; pictures are made of batches of fewer
SPHERE_ENTRIES = 256  # of the table over χ of the sphere's interface part
# (lamp number, point, to_lamp, distance to the lamp [m], extinction at the point [1/m], place in a texel)
# → transmittance 0…1
Attenuation = Callable[[int, Array3f, Array3f, Float, Float, TexelHit | None], Float]


class Light(Protocol):
    """A lamp of any kind as a palette knows it."""

    @property
    def name(self) -> str:
        """Its name; empty for none."""
        ...

    @property
    def spectrum(self) -> Spectrum:
        """The relative spectrum of its light."""
        ...


@dataclass(frozen=True)
class Palette:
    """The distinct spectra of a scene's body colours, interface colours and lamps.

    transmitted, twice: the colours of light that has passed through elements once, and those squared, of light that has
    gone twice as far in clear fibres; empty where no element transmits.
    bands: in pictures of all orders, the hat functions that light of higher orders is kept in (`transport/path/bands`).
    lamps: the spectrum of each group of lamps. lamp_names, lamp_groups: name and group of every lamp, in the order of
    the scene; empty where they are not known, as in images of version 0.2.
    """

    bodies: tuple[Spectrum, ...]
    interfaces: tuple[Spectrum, ...]
    lamps: tuple[Spectrum, ...]
    lamp_names: tuple[str, ...] = ()
    lamp_groups: tuple[int, ...] = ()
    bands: tuple[Spectrum, ...] = ()
    transmitted: tuple[Spectrum, ...] = ()
    twice: tuple[Spectrum, ...] = ()

    @property
    def colours(self) -> tuple[Spectrum, ...]:
        """Bodies, interfaces, transmitted ones, then bands: the channels of one lamp group, in order."""
        return self.bodies + self.interfaces + self.transmitted + self.twice + self.bands

    @property
    def parts(self) -> tuple[int, ...]:
        """Of every colour but the bands, the weight of `AllWeights` that it belongs to, by its number."""
        each = self.bodies, self.interfaces, self.transmitted, self.twice
        return tuple(part for part, colours in enumerate(each) for _ in colours)

    @property
    def channels(self) -> int:
        """Number of weights of a pixel."""
        return len(self.lamps) * len(self.colours)

    def with_lamps(self, lamps: Sequence[Light], separate: bool = False) -> Palette:
        """With the groups of `lamps`: those of one spectrum together, or each lamp its own (`separate`)."""
        spectra = [lamp.spectrum for lamp in lamps]
        distinct_spectra = tuple(spectra) if separate else distinct(spectra)
        groups = range(len(lamps)) if separate else [position_of(one, distinct_spectra) for one in spectra]
        names = tuple(lamp.name or f"lamp {k + 1}" for k, lamp in enumerate(lamps))
        return replace(self, lamps=distinct_spectra, lamp_names=names, lamp_groups=tuple(groups))


class Materials:
    """Reflectances as rows that kernels read: alpha, beta, gamma, n, element, then coefficients on the palette.

    Where the body of some reflectance departs from Lambert's law, `epsilon` and `sigma` follow; where the facets of
    some have tails, `nu` is the last entry (infinity: Gaussian facets). Otherwise there are no such entries, and
    kernels compute Lambert's law and Gaussian facets alone. Before all these stand beta and gamma of further lobes, as
    many as the reflectance with most of them has; they are those of planes and cylinders, a sphere's are in its table.
    Where some transmit, the weight of far-side body light, the share of clear light and the widths of its two lobes
    follow; only then do kernels hold anything of transmission.
    """

    def __init__(self, reflectances: Sequence[Reflectance], palette: Palette) -> None:
        jit, self.palette, self.count = arrays(), palette, len(reflectances)
        self.elements = tuple(sorted({r.element for r in reflectances}))
        self.have_tails = not all(is_gaussian(r.nu) for r in reflectances)
        self.have_body_laws = not all(r.has_lambert_body for r in reflectances)
        self.lobes = max(len(r.lobes) for r in reflectances)
        self.transmit = any(r.transmits for r in reflectances)
        further = [
            _lobes(r, self.lobes)
            + [r.epsilon, r.sigma] * self.have_body_laws
            + _passed_row(r) * self.transmit
            + [r.nu] * self.have_tails
            for r in reflectances
        ]
        own = [_row(r, palette) for r in reflectances]
        rows = np.array([row + more for row, more in zip(own, further, strict=True)], np.float32)
        self.width = rows.shape[1]
        self.rows = lookup(jit.Float, rows)
        tables = [_sphere_table(r, self.have_tails) for r in reflectances if r.element == "sphere"]
        self.spheres = lookup(jit.Float, np.concatenate(tables)) if tables else None
        order = np.cumsum([r.element == "sphere" for r in reflectances]) - 1
        self.sphere_of = lookup(jit.UInt, np.maximum(order, 0).astype(np.uint32))
        clear = [around_fibre(float(r.gamma), float(r.n)) for r in reflectances if r.clear_share > 0.0]
        self.fibres = lookup(jit.Float, np.stack(clear).astype(np.float32)) if clear else None
        order = np.cumsum([r.clear_share > 0.0 for r in reflectances]) - 1
        self.fibre_of = lookup(jit.UInt, np.maximum(order, 0).astype(np.uint32)) if clear else None
        dr.eval(self.rows, self.spheres, self.sphere_of, self.fibres, self.fibre_of)

    def read(self, material: UInt, entry: int) -> Float:
        """One entry of the row of `material` (UInt)."""
        return dr.gather(arrays().Float, self.rows, material * self.width + entry)

    def coefficients(self, material: UInt) -> list[Float]:
        """Coefficients of a material's body and interface colours on the palette."""
        return [self.read(material, 5 + j) for j in range(len(self.palette.colours))]

    def weights(self, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> Weights | AllWeights:
        """Body and interface weights of f for the element of `material` [1/sr]; `AllWeights` where some transmit."""
        if not self.transmit:
            return self._reflected(material, axis, to_lamp, to_eye)
        transmitted = self._transmitted(material, axis, to_lamp, to_eye)
        if "plane" in self.elements:
            axis = self.facing(material, axis, to_eye)
        return AllWeights(*self._reflected(material, axis, to_lamp, to_eye), *transmitted)

    def facing(self, material: UInt, axis: Array3f, to_eye: Array3f) -> Array3f:
        """The normal of the side that the eye sees of a plane that transmits; other axes as they are."""
        sheet = (self.read(material, 4) == ELEMENTS.index("plane")) & (self.passed(material, 0) > 0.0)
        return dr.select(sheet, facing(axis, to_eye), axis)

    def passed(self, material: UInt, entry: int) -> Float:
        """Weight of far-side body light, share of clear light, or width of its first or second lobe."""
        first = 5 + len(self.palette.colours) + 2 * (self.lobes + self.have_body_laws)
        return self.read(material, first + entry)

    def _transmitted(self, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> tuple[Float, Float]:
        """Weights of light that has passed through once, and twice as far."""
        element, body = self.read(material, 4), arrays().Float(0)
        for name in self.elements:
            body = dr.select(element == ELEMENTS.index(name), far_body(name, axis, to_lamp, to_eye), body)
        once, share = self.passed(material, 0) * body, self.passed(material, 1)
        if self.fibres is None:
            return once, arrays().Float(0)
        table = table_from(self.fibres, dr.gather(arrays().UInt, self.fibre_of, material))
        widths = self.passed(material, 2), self.passed(material, 3)
        through, twice = clear_lobes(axis, to_lamp, to_eye, self.read(material, 3), widths, table)
        return dr.fma(share, through, once), share * twice

    def _reflected(self, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> Weights:
        alpha, beta, gamma, n, element = (self.read(material, entry) for entry in range(5))
        nu = self.read(material, self.width - 1) if self.have_tails else GAUSSIAN
        body_law = self.body_law(material)
        chosen: Weights | None = None
        for name in self.elements:
            weights = self._element(name, material, axis, to_lamp, to_eye, alpha, beta, gamma, n, nu, body_law)
            if chosen is None:
                chosen = weights
            else:
                here = element == ELEMENTS.index(name)
                chosen = Weights(*(dr.select(here, new, old) for new, old in zip(weights, chosen, strict=True)))
        assert chosen is not None
        return self._with_lobes(chosen, material, axis, to_lamp, to_eye)

    def body_law(self, material: UInt) -> tuple[Float, Float]:
        """ε and σ of a material's body; the numbers 0 where all are after Lambert."""
        if not self.have_body_laws:
            return 0.0, 0.0
        first = 5 + len(self.palette.colours) + 2 * self.lobes
        return self.read(material, first), self.read(material, first + 1)

    def _with_lobes(
        self, weights: Weights, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f
    ) -> Weights:
        """`weights` and what the further lobes of `material` add; a lobe that a material lacks has β = 0."""
        n, element, interface = self.read(material, 3), self.read(material, 4), weights.interface
        for k in range(self.lobes):
            beta, gamma = (self.read(material, 5 + len(self.palette.colours) + 2 * k + part) for part in (0, 1))
            for name in self.elements:
                if name != "sphere":
                    more = element_weights(name, axis, to_lamp, to_eye, 0.0, beta, gamma, n).interface
                    interface = interface + dr.select(element == ELEMENTS.index(name), more, 0.0)
        return Weights(weights.body, interface)

    def _element(
        self,
        name: str,
        material: UInt,
        axis: Array3f,
        to_lamp: Array3f,
        to_eye: Array3f,
        alpha: Float,
        beta: Float,
        gamma: Float,
        n: Float,
        nu: Float,
        body_law: tuple[Float, Float],
    ) -> Weights:
        """As `element_weights`, with the sphere's facets from its table."""
        if name != "sphere":
            return element_weights(name, axis, to_lamp, to_eye, alpha, beta, gamma, n, nu, *body_law)
        cos_phase = dr.dot(to_lamp, to_eye)
        mirror = beta * fresnel(cos_deviation(cos_phase), n)
        return Weights(alpha * sphere_body(cos_phase), mirror * self._sphere(material, cos_phase))

    def _sphere(self, material: UInt, cos_phase: Float) -> Float:
        """Linear look-up of the sphere's facets at χ = arccos(L·V)."""
        jit = arrays()
        if self.have_tails:
            at = graded_place(cos_phase) * (SPHERE_ENTRIES - 1)
        else:
            at = dr.acos(dr.fmin(dr.fmax(cos_phase, -1.0), 1.0)) * ((SPHERE_ENTRIES - 1) / math.pi)
        first = dr.minimum(jit.UInt(at), SPHERE_ENTRIES - 2)
        start = dr.gather(jit.UInt, self.sphere_of, material) * SPHERE_ENTRIES + first
        low, high = (dr.gather(jit.Float, self.spheres, start + k) for k in (0, 1))
        return dr.fma(at - jit.Float(first), high - low, low)


class LampRow(NamedTuple):
    """A lamp as kernels read it: where it is [m], or the direction to it; its intensity; and its group in the palette.

    emission: relative intensity over the direction; None for a lamp that shines alike all around. shares: of lamps at
    one place, each one's group and its share of the intensity, in place of one group.
    """

    where: Array3f
    intensity: Float
    near: bool
    group: int
    emission: Emission | None
    shares: Sequence[tuple[int, Float]] = ()

    @property
    def groups(self) -> Sequence[tuple[int, Float]]:
        """Each group of its light, and its share."""
        return self.shares or [(self.group, 1.0)]


class HigherOrders(Protocol):
    """Light that was scattered before it arrives at a sample, see `hagoromo.transport.field`."""

    channels: int

    def scattered(
        self, point: Array3f, to_eye: Array3f, elements: Sequence[Element], coefficients: Sequence[Sequence[Float]]
    ) -> list[Float]:
        """Radiance of every channel that it becomes towards the eye."""
        ...

    def taken(self, gain: Float, smooth: Sequence[Float]) -> None:
        """Told by the march of which share of that radiance reaches the eye."""
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
        attenuation: Attenuation | None = None,
        bases: Sequence[Sequence[Spectrum]] = (),
        together: bool = False,
    ) -> None:
        """`bases`: per volume box, the spectra of its per-voxel body colours (empty where it has none). together:
        whether lamps at one place are one of `self.lamps`; `attenuation` counts these.

        `InputError` for more than MOST_LAMPS lamps, or one with an intensity per channel.
        """
        if len(lamps) > MOST_LAMPS:
            raise InputError(
                f"{len(lamps)} lamps: light along single rays is computed under {MOST_LAMPS} at most, as kernels grow "
                f"with them; give fewer, or add what parts of them give"
            )
        jit, self.materials, self.attenuation = arrays(), materials, attenuation
        self.field: HigherOrders | None = None
        self.surface_light: HigherOrdersOnSurfaces | None = None
        bodies = materials.palette.bodies
        self.voxel_bases = {box: [position_of(s, bodies) for s in basis] for box, basis in enumerate(bases) if basis}
        self.lamps: list[LampRow] = []
        for numbers in by_place(lamps) if together else [[number] for number in range(len(lamps))]:
            lamp, strengths = lamps[numbers[0]], [_strength(lamps[number]) for number in numbers]
            place = lamp.position if lamp.position is not None else lamp.to_lamp
            assert place is not None
            of_lamps, near = materials.palette.lamp_groups, lamp.position is not None
            groups = [
                of_lamps[n] if of_lamps else position_of(lamps[n].spectrum, materials.palette.lamps) for n in numbers
            ]
            total = sum(strengths)
            shares = [dr.opaque(jit.Float, one / total if total > 0.0 else 0.0) for one in strengths]
            each = list(zip(groups, shares, strict=True)) if len(numbers) > 1 else []
            intensity = dr.opaque(jit.Float, total)
            self.lamps.append(LampRow(opaque_vector(place), intensity, near, groups[0], emission_of(lamp), each))

    @property
    def channels(self) -> int:
        """Number of channels of the march: those of the palette, then those of the field."""
        smooth = self.field or self.surface_light
        return self.materials.palette.channels + (smooth.channels if smooth else 0)

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
        where, intensity, near, _, emission, _ = self.lamps[lamp]
        to_lamp, distance, irradiance = where, math.inf, intensity
        if near:
            offset = where - point
            squared = dr.squared_norm(offset)
            inverse = dr.rsqrt(squared)
            to_lamp, distance, irradiance = offset * inverse, squared * inverse, intensity / squared
        return to_lamp, distance, irradiance if emission is None else irradiance * emission(to_lamp)

    def reflected_radiance(
        self,
        point: Array3f,
        to_eye: Array3f,
        elements: list[Element],
        coefficients: list[list[Float]],
        texel_hit: TexelHit | None = None,
        extinction: Float = 0.0,
    ) -> tuple[list[Float], list[Float]]:
        """Weights of the radiance that matter at `point` sends to the eye, I_t of MODEL §3, of every lamp and colour of
        the palette (see `in_groups`); and the transmittance from every lamp, 1 where it lights nothing.

        coefficients: of every element, on the palette. texel_hit: place of the point in a texel; None without texels.
        extinction: around the point [1/m].
        """
        palette = self.materials.palette
        light: list[Any] = []
        eye = texel_hit.frame.inwards(to_eye) if texel_hit else None
        passed: list[Any] = []
        for number, lamp in enumerate(self.lamps):
            to_lamp, distance, irradiance = self.arriving(number, point)
            ways = (eye, texel_hit.frame.inwards(to_lamp)) if texel_hit else ()
            weights, lit = [], arrays().Bool(False)
            for element in elements:
                each = self.materials.weights(element.material, element.axis, to_lamp, to_eye)
                lit |= sum(each[1:], each[0]) > 0.0
                if element.scales and texel_hit:
                    factors = element.scales.at(*ways)  # fewer than weights where no element of a texel transmits
                    scaled = [
                        dr.select(texel_hit.textured, part * factor, part)
                        for part, factor in zip(each, factors, strict=False)
                    ]
                    each = [*scaled, *each[len(scaled) :]]
                weights.append([part * element.share for part in each])
            if lamp.emission is not None:
                lit &= irradiance > 0.0
            passed.append(arrays().Float(1))
            if self.attenuation is not None:
                transmittance = self.transmittance(
                    number, lit, elements[0], point, to_lamp, distance, extinction, texel_hit
                )
                passed[-1], irradiance = dr.select(lit, transmittance, 1.0), irradiance * transmittance
            for j in range(len(palette.colours)):
                total = arrays().Float(0)
                for each, share in zip(weights, coefficients, strict=True):
                    total = dr.fma(each[palette.parts[j]], share[j], total)
                light.append(irradiance * total)
        return light, passed

    def in_groups(self, light: list[Float]) -> list[Float]:
        """Radiances of every lamp and colour as those of every group of lamps and colour: the channels of a picture."""
        colours = len(self.materials.palette.colours)
        channels: list[Any] = [arrays().Float(0)] * self.materials.palette.channels
        for k, each in enumerate(light):
            for group, share in self.lamps[k // colours].groups:
                channel = group * colours + k % colours
                channels[channel] = channels[channel] + each * share
        return channels

    def transmittance(
        self,
        lamp: int,
        lit: Bool,
        element: Element,
        point: Array3f,
        to_lamp: Array3f,
        distance: Float,
        extinction: Float,
        texel_hit: TexelHit | None,
    ) -> Float:
        """Transmittance from a lamp to an `element` at `point`; looked up only where matter faces the lamp (`lit`).

        With a shadow bias it is the lesser one of two rays: the first, past the skin of the element, has the shadows
        of what is near, the second ends those of all other matter where they should.
        """
        origin = element.shadow_origin(point, to_lamp)
        first = self._looked_up(lamp, lit, origin, to_lamp, distance, extinction, texel_hit)
        if element.shadow_bias is None:
            return first
        biased = lit & (element.shadow_bias > 0.0) & (first > 0.0)
        origin, rest = element.far_shadow_origin(point, to_lamp, distance)
        second = self._looked_up(lamp, biased, origin, to_lamp, rest, arrays().Float(0), texel_hit)
        return dr.select(biased, dr.fmin(first, second), first)

    def _looked_up(
        self,
        lamp: int,
        where: Bool,
        origin: Array3f,
        to_lamp: Array3f,
        distance: Float,
        extinction: Float,
        texel_hit: TexelHit | None,
    ) -> Float:
        """Transmittance from a lamp to `origin`, 0 but `where` it is asked for."""
        attenuation, Float = self.attenuation, arrays().Float
        assert attenuation is not None
        return dr.if_stmt(
            args=(origin, to_lamp, Float(distance), Float(extinction), texel_hit),
            cond=where,
            true_fn=lambda *place: attenuation(lamp, *place),
            false_fn=lambda *place: Float(0),
        )


def _strength(lamp: Lamp) -> float:
    """The intensity of a lamp that has one."""
    if not isinstance(lamp.intensity, (int, float)):
        raise InputError(f"lamp {lamp.name!r} has an intensity per channel: rendering needs one and a spectrum")
    return float(lamp.intensity)


def palette_of(reflectances: Sequence[Reflectance], bases: Sequence[Spectrum], lamps: Sequence[Spectrum]) -> Palette:
    """The distinct spectra of some reflectances, further body colours and lamps."""
    bodies = [r.body_colour for r in reflectances]
    once = distinct([r.transmitted[0] for r in reflectances if r.transmits])
    twice = distinct([r.transmitted[1] for r in reflectances if r.clear_share > 0.0])
    interfaces = distinct([r.interface_colour for r in reflectances])
    return Palette(distinct([*bodies, *bases]), interfaces, distinct(lamps), transmitted=once, twice=twice)


def distinct(spectra: Sequence[Spectrum]) -> tuple[Spectrum, ...]:
    """Spectra without repeats, in order."""
    return tuple({_key(s): s for s in reversed(spectra)}[key] for key in dict.fromkeys(_key(s) for s in spectra))


def position_of(spectrum: Spectrum, among: Sequence[Spectrum]) -> int:
    """Where a spectrum stands in a palette."""
    return [_key(s) for s in among].index(_key(spectrum))


def _key(spectrum: Spectrum) -> tuple[bytes, bytes]:
    return spectrum.wavelengths.tobytes(), spectrum.values.tobytes()


def _lobes(r: Reflectance, count: int) -> list[float]:
    """β and γ of `count` further lobes; those that `r` lacks, and those of a sphere, have β = 0."""
    own = [] if r.element == "sphere" else list(r.lobes)
    return [number for lobe in (own + [(0.0, 1.0)] * count)[:count] for number in lobe]


def _sphere_table(r: Reflectance, graded: bool) -> np.ndarray:
    """The facets of a sphere, of all lobes together, in units of β."""
    table = sphere_table(r.gamma, SPHERE_ENTRIES, nu=r.nu, graded=graded)
    for beta, gamma in r.lobes:
        table = table + np.float32(beta / r.beta) * sphere_table(gamma, SPHERE_ENTRIES, graded=graded)
    return table


def _row(r: Reflectance, palette: Palette) -> list[float]:
    own = _one(r.body_colour, palette.bodies) + _one(r.interface_colour, palette.interfaces)
    own += _one(r.transmitted[0] if r.transmits else None, palette.transmitted)
    own += _one(r.transmitted[1] if r.clear_share > 0.0 else None, palette.twice)
    return [r.alpha, r.beta, r.gamma, r.n, ELEMENTS.index(r.element), *own]


def _one(colour: Spectrum | None, among: Sequence[Spectrum]) -> list[float]:
    """Coefficients of a colour on some spectra: 1 on its own, and 0; all 0 for None."""
    place = -1 if colour is None else position_of(colour, among)
    return [float(j == place) for j in range(len(among))]


def _passed_row(r: Reflectance) -> list[float]:
    return [r.far_body, r.clear_share, *lobe_widths(float(r.gamma), float(r.n))]
