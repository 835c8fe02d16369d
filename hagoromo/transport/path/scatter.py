"""Scatter: directions drawn nearly as an element sends light, with what they weigh.

f of an element is the mean of the plane's f over the normals that the eye sees (MODEL §2, "Micro-elements"). So one of
these normals is drawn, by the area that the eye sees of it, and then a direction by the plane's own sampling about it:
its body by the cosine, its interface by the half vectors of its facets, one lobe or another by its share. The weight is
that of the plane for this normal over the density for this normal; its mean is f over the density of the direction.
Of elements that transmit, a share of the directions is drawn for each way through them: far-side body light by the
cosine about the opposite of the normal, clear light by rays across the fibre.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, clip, lookup
from hagoromo.directions import frame_about, local
from hagoromo.reflectance.body import is_number
from hagoromo.reflectance.element import ELEMENTS
from hagoromo.reflectance.facets import GAUSSIAN
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.reflectance.sampling import (
    LEAST_SHARE,
    LobeShare,
    density_of_lobes,
    to_lamp_by_lobes,
)
from hagoromo.reflectance.torrance_sparrow import Weights, torrance_sparrow
from hagoromo.reflectance.transmission import AllWeights, along_fibre, longer_way, passed_at, turned_by
from hagoromo.transport.gamma_rows import GammaRows
from hagoromo.transport.materials import CLEAR_SHARE, CLEAR_WIDTHS, FAR_BODY, Materials

STRAIGHT = 0.8  # share of the samples of clear light that go straight through


class Scattering:
    """The reflectances of a scene, to be drawn from. A row for each: share, β and γ of the lobes."""

    def __init__(
        self, reflectances: Sequence[Reflectance], materials: Materials, gamma_rows: GammaRows | None = None
    ) -> None:
        """gamma_rows: of a scene with textures of γ."""
        self.materials, self.lobes = materials, 1 + max(len(r.lobes) for r in reflectances)
        self.gamma_rows = gamma_rows
        every = gamma_rows.reflectances if gamma_rows else reflectances
        rows = np.array([_lobe_row(r, self.lobes) for r in every], np.float32)
        self.rows = lookup(arrays().Float, rows)
        passed = np.array([_passed_shares(r) for r in reflectances], np.float32)
        self.passed = lookup(arrays().Float, passed) if materials.transmit else None
        dr.eval(self.rows, self.passed)

    def _lobe(self, material: UInt, lobe: int, gamma: Float | None) -> list[Float]:
        """Share of the samples, β and γ of a lobe; gamma: of the first one, in place of that of the material."""
        if gamma is None or self.gamma_rows is None:
            return self._row(material, lobe)
        first, second, share = self.gamma_rows.at(material, gamma)
        (low, *_), (high, *_), (_, beta, own) = (self._row(row, lobe) for row in (first, second, material))
        return [dr.fma(share, high - low, low), beta, own if lobe else gamma]

    def _row(self, row: UInt, lobe: int) -> list[Float]:
        start = (row * self.lobes + lobe) * 3
        return [dr.gather(arrays().Float, self.rows, start + k) for k in range(3)]

    def drawn(
        self, material: UInt, axis: Array3f, to_eye: Array3f, numbers: Sequence[Float], gamma: Float | None = None
    ) -> tuple[Array3f, Weights | AllWeights, Bool]:
        """A direction from where light comes, the weights of f over its density, and whether light may come from there.

        axis, to_eye: unit, world. numbers: five, independent, uniform in [0, 1). gamma: half width of the facets of
        planes [rad]; default: that of the material.
        """
        if self.passed is None:
            return self._reflected(material, axis, to_eye, numbers, gamma)
        far, clear = (dr.gather(arrays().Float, self.passed, material * 2 + k) for k in (0, 1))
        choice, rest = numbers[2], 1.0 - far - clear
        is_far, is_clear = choice < far, (choice >= far) & (choice < far + clear)
        begin = dr.select(is_far, 0.0, dr.select(is_clear, far, far + clear))
        share = dr.fmax(dr.select(is_far, far, dr.select(is_clear, clear, rest)), 1e-6)
        again = dr.fmin((choice - begin) / share, 1.0 - 1e-7)
        numbers = [*numbers[:2], again, *numbers[3:]]
        if "plane" in self.materials.elements:
            axis = self.materials.facing(material, axis, to_eye)
        ways = [self._far(material, axis, to_eye, numbers), self._reflected(material, axis, to_eye, numbers, gamma)]
        (way, once, good), (back, reflected, back_good) = ways
        way, good = dr.select(is_far, way, back), dr.select(is_far, good, back_good)
        reflects = ~(is_far | is_clear)
        body, interface = (dr.select(reflects, each, 0.0) for each in reflected)
        once, twice = dr.select(is_far, once, 0.0), arrays().Float(0)
        if self.materials.fibres is not None:
            along, clear_once, clear_twice, clear_good = self._clear(material, axis, to_eye, numbers)
            way, good = dr.select(is_clear, along, way), dr.select(is_clear, clear_good, good)
            once, twice = dr.select(is_clear, clear_once, once), dr.select(is_clear, clear_twice, 0.0)
        scale = dr.rcp(share)
        return way, AllWeights(body * scale, interface * scale, once * scale, twice * scale), good

    def _far(
        self, material: UInt, axis: Array3f, to_eye: Array3f, numbers: Sequence[Float]
    ) -> tuple[Array3f, Float, Bool]:
        """A direction of far-side body light, by the cosine about the opposite of a normal that the eye sees."""
        normal, seen = self.visible_normal(material, axis, to_eye, *numbers[:2])
        x, y, z = frame_about(-normal)
        sine, cosine = dr.sincos(2.0 * math.pi * numbers[4])
        radius, height = dr.sqrt(numbers[3]), dr.sqrt(dr.fmax(1.0 - numbers[3], 0.0))
        way = dr.normalize(radius * cosine * x + radius * sine * y + height * z)
        return way, math.pi * self.materials.read(material, FAR_BODY), seen

    def _clear(
        self, material: UInt, axis: Array3f, to_eye: Array3f, numbers: Sequence[Float]
    ) -> tuple[Array3f, Float, Float, Bool]:
        """A direction of clear light: one of the two lobes, an angle along the fibre, a ray at any offset across it.

        The angle is drawn by a Gaussian about the middle of the lobe, the azimuth by one about that of the ray.
        """
        u, v, choice, offset, _ = numbers
        n = self.materials.read(material, "n")
        first = choice < STRAIGHT
        width = dr.select(first, *(self.materials.read(material, width) for width in CLEAR_WIDTHS))
        radius, (sine, cosine) = dr.sqrt(-2.0 * dr.log(1.0 - u)), dr.sincos(2.0 * math.pi * v)
        cos_eye = clip(dr.dot(axis, to_eye), -1.0, 1.0)
        mirrored = dr.acos(-cos_eye)
        alpha = dr.fma(width * radius, cosine, mirrored)
        good = (alpha > 0.0) & (alpha < math.pi)
        middle = 0.5 * (dr.cos(alpha) - cos_eye)
        cos_middle = dr.sqrt(dr.fmax(1.0 - middle * middle, 0.0))
        across = dr.fma(2.0, offset, -1.0)
        azimuth = dr.select(first, *turned_by(across, cos_middle, n)) + width * radius * sine
        passed = dr.select(first, *passed_at(dr.sqrt(dr.fmax(1.0 - across * across, 0.0)), cos_middle, n))
        density = dr.exp(-0.5 * dr.square(radius * cosine)) / (math.sqrt(2.0 * math.pi) * width)
        weight = along_fibre(alpha, mirrored, width) * dr.sin(alpha) / dr.fmax(density, 1e-30)
        weight *= passed * self.materials.read(material, CLEAR_SHARE)
        weight *= dr.select(first, 1.0 / STRAIGHT, 1.0 / (1.0 - STRAIGHT))
        longer = longer_way(middle, n)
        once = dr.select(first, 1.0 - longer, 0.0)
        ahead = to_eye - axis * cos_eye
        ahead = ahead * dr.rsqrt(dr.fmax(dr.squared_norm(ahead), 1e-12))
        turned = ahead * dr.cos(azimuth) + dr.cross(axis, ahead) * dr.sin(azimuth)
        way = dr.normalize(axis * dr.cos(alpha) + turned * dr.sin(alpha))
        return way, weight * once, weight * (1.0 - once), good

    def _reflected(
        self, material: UInt, axis: Array3f, to_eye: Array3f, numbers: Sequence[Float], gamma: Float | None
    ) -> tuple[Array3f, Weights, Bool]:
        """As `drawn`, of what an element reflects."""
        normal, seen = self.visible_normal(material, axis, to_eye, *numbers[:2])
        frame = frame_about(normal)
        view = local(frame, to_eye)
        to_lamp = to_lamp_by_lobes(view, self._shares(material, gamma), *numbers[2:])
        density = self.density(material, to_lamp, view, gamma)
        whole = self.plane(material, to_lamp, view, gamma)
        good = seen & (density > 0.0) & (to_lamp.z > 0.0)
        scale = dr.select(good, dr.rcp(dr.fmax(density, 1e-30)), 0.0)
        out = to_lamp.x * frame[0] + to_lamp.y * frame[1] + to_lamp.z * frame[2]
        return dr.normalize(out), Weights(whole.body * scale, whole.interface * scale), good

    def visible_normal(
        self, material: UInt, axis: Array3f, to_eye: Array3f, u: Float, v: Float
    ) -> tuple[Array3f, Bool]:
        """A normal of the element, drawn by the area that the eye sees of it; whether it sees any."""
        jit, kind = arrays(), self.materials.read(material, "element")
        normal, seen = axis, jit.Bool(True)
        for name in self.materials.elements:
            if name == "plane":
                here, visible = axis, dr.dot(axis, to_eye) > 0.0
            elif name == "cylinder":
                here, visible = _cylinder_normal(axis, to_eye, u), jit.Bool(True)
            else:
                here, visible = _sphere_normal(to_eye, u, v), jit.Bool(True)
            own = kind == ELEMENTS.index(name)
            normal, seen = dr.select(own, here, normal), dr.select(own, visible, seen)
        return normal, seen

    def density(self, material: UInt, to_lamp: Array3f, view: Array3f, gamma: Float | None = None) -> Float:
        """Probability density of a direction for one normal, +z of the local axes [1/sr]."""
        return density_of_lobes(to_lamp, view, self._shares(material, gamma))

    def plane(self, material: UInt, to_lamp: Array3f, view: Array3f, gamma: Float | None = None) -> Weights:
        """f of the plane with normal +z: its body and its interface weight, of all lobes [1/sr]."""
        normal, read = type(view)(0, 0, 1), self.materials.read
        alpha, n = read(material, "alpha"), read(material, "n")
        body, interface = arrays().Float(0), arrays().Float(0)
        for k in range(self.lobes):
            _, beta, width = self._lobe(material, k, gamma)
            here = torrance_sparrow(normal, to_lamp, view, alpha, beta, width, n, self._nu(material, k))
            body, interface = here.body, interface + here.interface
        factor = self.materials.body_law(material).body_factor(to_lamp.z, view.z, dr.dot(to_lamp, view))
        return Weights(body if is_number(factor, 1.0) else body * factor, interface)

    def _shares(self, material: UInt, gamma: Float | None) -> list[LobeShare]:
        """Share of the samples, γ and ν of each lobe."""
        lobes = ((self._lobe(material, k, gamma), self._nu(material, k)) for k in range(self.lobes))
        return [(share, width, nu) for (share, _, width), nu in lobes]

    def _nu(self, material: UInt, lobe: int) -> Float:
        """Exponent of a lobe's tails; only the first has any."""
        return GAUSSIAN if lobe else self.materials.read(material, "nu")


def _lobe_row(r: Reflectance, count: int) -> list[float]:
    """Share, β and γ of `count` lobes, the missing ones with β = 0."""
    lobes = [(r.beta, r.gamma), *r.lobes]
    row = [[share, beta, g] for share, (beta, g) in zip(r.lobe_shares(), lobes, strict=True)]
    return [number for lobe in (row + [[0.0, 0.0, 1.0]] * count)[:count] for number in lobe]


def _passed_shares(r: Reflectance) -> list[float]:
    """Shares of the samples for far-side body light and for clear light, by what passes of light that is reflected."""
    far, clear = math.pi * r.far_body, r.clear_share
    reflected = r.body_albedo + r.interface_albedo
    whole = far + clear + reflected
    if whole <= 0.0:
        return [0.0, 0.0]
    shares = [max(part / whole, LEAST_SHARE) if part > 0.0 else 0.0 for part in (far, clear)]
    most = 1.0 - LEAST_SHARE if reflected > 0.0 else 1.0
    return [share * min(most / sum(shares), 1.0) if sum(shares) > 0.0 else 0.0 for share in shares]


def _cylinder_normal(axis: Array3f, to_eye: Array3f, u: Float) -> Array3f:
    """Across the tangent `axis`: by the cosine to the eye, whose turn has the sine 2u − 1."""
    ahead = to_eye - axis * dr.dot(axis, to_eye)
    ahead = ahead * dr.rsqrt(dr.fmax(dr.squared_norm(ahead), 1e-12))
    sine = 2.0 * u - 1.0
    return ahead * dr.sqrt(dr.fmax(1.0 - sine * sine, 0.0)) + dr.cross(axis, ahead) * sine


def _sphere_normal(to_eye: Array3f, u: Float, v: Float) -> Array3f:
    """Anywhere on the half that faces the eye, by the cosine to it."""
    x, y, z = frame_about(to_eye)
    sine, cosine = dr.sincos(2.0 * math.pi * v)
    radius = dr.sqrt(u)
    return dr.normalize(radius * cosine * x + radius * sine * y + dr.sqrt(dr.fmax(1.0 - u, 0.0)) * z)
