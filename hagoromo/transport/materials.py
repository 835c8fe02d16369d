"""Materials: the reflectances of a scene on the device, and their weights for directions to lamp and eye (MODEL §2)."""

from __future__ import annotations

import math
from collections.abc import Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, UInt, arrays, lookup
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
from hagoromo.transport.palette import Palette, position_of

SPHERE_ENTRIES = 256  # of the table over χ of the sphere's interface part


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

    def weights(
        self, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f, gamma: Float | None = None
    ) -> Weights | AllWeights:
        """Body and interface weights of f for the element of `material` [1/sr]; `AllWeights` where some transmit.

        gamma: half width of the facets of planes [rad]; default: that of the material.
        """
        if not self.transmit:
            return self._reflected(material, axis, to_lamp, to_eye, gamma)
        transmitted = self._transmitted(material, axis, to_lamp, to_eye)
        if "plane" in self.elements:
            axis = self.facing(material, axis, to_eye)
        return AllWeights(*self._reflected(material, axis, to_lamp, to_eye, gamma), *transmitted)

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

    def _reflected(
        self, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f, gamma: Float | None
    ) -> Weights:
        alpha, beta, own, n, element = (self.read(material, entry) for entry in range(5))
        gamma = own if gamma is None else gamma
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
