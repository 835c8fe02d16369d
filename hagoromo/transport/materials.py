"""Materials: the reflectances of a scene on the device, and their weights for directions to lamp and eye (MODEL §2)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import NamedTuple

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Float, UInt, arrays, lookup
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.element import ELEMENTS, element_weights, graded_place, sphere_body, sphere_table
from hagoromo.reflectance.parameters import PLAIN_BODY, ROWS, BodyLaw
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
FAR_BODY, CLEAR_SHARE = "weight of far-side body light", "share of clear light"
CLEAR_WIDTHS = "width of the first lobe of clear light", "width of its second lobe"
FIGURES = "alpha", "beta", "gamma", "n", "nu"


class Figures(NamedTuple):
    """What `element_weights` takes of a material."""

    alpha: Float
    beta: Float
    gamma: Float
    n: Float
    nu: Float
    body_law: BodyLaw


class Materials:
    """Reflectances as rows of numbers that kernels read, by the names of `columns`.

    First stand the parameters that always have a column (see `Parameter.column`), then coefficients on the palette,
    then β and γ of further lobes, as many as the reflectance with most of them has; they are those of planes and
    cylinders, a sphere's are in its table. Parameters from whose plain value some reflectance departs follow. Others
    have no column: kernels compute with the number itself, so Lambert's law and Gaussian facets cost nothing. Where
    some transmit, the weight of far-side body light, the share of clear light and the widths of its two lobes are last;
    only then do kernels hold anything of transmission.
    """

    def __init__(self, reflectances: Sequence[Reflectance], palette: Palette) -> None:
        jit, self.palette, self.count = arrays(), palette, len(reflectances)
        self.elements = tuple(sorted({r.element for r in reflectances}))
        self.lobes = max(len(r.lobes) for r in reflectances)
        self.transmit = any(r.transmits for r in reflectances)
        always, departing = columns_of(reflectances)
        rows = [_row(r, palette, self.lobes, always, departing, self.transmit) for r in reflectances]
        self.columns = {name: place for place, name in enumerate(rows[0])}
        self.width, self.have_tails = len(self.columns), "nu" in self.columns
        self.rows = lookup(jit.Float, np.array([list(row.values()) for row in rows], np.float32))
        tables = [_sphere_table(r, self.have_tails) for r in reflectances if r.element == "sphere"]
        self.spheres = lookup(jit.Float, np.concatenate(tables)) if tables else None
        order = np.cumsum([r.element == "sphere" for r in reflectances]) - 1
        self.sphere_of = lookup(jit.UInt, np.maximum(order, 0).astype(np.uint32))
        clear = [around_fibre(float(r.gamma), float(r.n)) for r in reflectances if r.clear_share > 0.0]
        self.fibres = lookup(jit.Float, np.stack(clear).astype(np.float32)) if clear else None
        order = np.cumsum([r.clear_share > 0.0 for r in reflectances]) - 1
        self.fibre_of = lookup(jit.UInt, np.maximum(order, 0).astype(np.uint32)) if clear else None
        dr.eval(self.rows, self.spheres, self.sphere_of, self.fibres, self.fibre_of)

    def read(self, material: UInt, name: str) -> Float:
        """One number of `material` (UInt): that of a column, or the plain value of a parameter that has none."""
        if name not in self.columns:
            return ROWS[name].plain
        return dr.gather(arrays().Float, self.rows, material * self.width + self.columns[name])

    def coefficients(self, material: UInt) -> list[Float]:
        """Coefficients of a material's body and interface colours on the palette."""
        return [self.read(material, _colour(j)) for j in range(len(self.palette.colours))]

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
        sheet = (self.read(material, "element") == ELEMENTS.index("plane")) & (self.read(material, FAR_BODY) > 0.0)
        return dr.select(sheet, facing(axis, to_eye), axis)

    def _transmitted(self, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> tuple[Float, Float]:
        """Weights of light that has passed through once, and twice as far."""
        element, body = self.read(material, "element"), arrays().Float(0)
        for name in self.elements:
            body = dr.select(element == ELEMENTS.index(name), far_body(name, axis, to_lamp, to_eye), body)
        once, share = self.read(material, FAR_BODY) * body, self.read(material, CLEAR_SHARE)
        if self.fibres is None:
            return once, arrays().Float(0)
        table = table_from(self.fibres, dr.gather(arrays().UInt, self.fibre_of, material))
        first, second = (self.read(material, width) for width in CLEAR_WIDTHS)
        through, twice = clear_lobes(axis, to_lamp, to_eye, self.read(material, "n"), (first, second), table)
        return dr.fma(share, through, once), share * twice

    def _reflected(
        self, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f, gamma: Float | None
    ) -> Weights:
        alpha, beta, own, n, nu, element = (self.read(material, name) for name in (*FIGURES, "element"))
        figures = Figures(alpha, beta, own if gamma is None else gamma, n, nu, self.body_law(material))
        chosen: Weights | None = None
        for name in self.elements:
            weights = self._element(name, material, axis, to_lamp, to_eye, figures)
            if chosen is None:
                chosen = weights
            else:
                here = element == ELEMENTS.index(name)
                chosen = Weights(*(dr.select(here, new, old) for new, old in zip(weights, chosen, strict=True)))
        assert chosen is not None
        return self._with_lobes(chosen, material, axis, to_lamp, to_eye)

    def body_law(self, material: UInt) -> BodyLaw:
        """The law of a material's body, with plain numbers where all materials have them."""
        return BodyLaw(**{name: self.read(material, name) for name in PLAIN_BODY})

    def _with_lobes(
        self, weights: Weights, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f
    ) -> Weights:
        """`weights` and what the further lobes of `material` add; a lobe that a material lacks has β = 0."""
        n, element, interface = self.read(material, "n"), self.read(material, "element"), weights.interface
        for k in range(self.lobes):
            beta, gamma = (self.read(material, column) for column in _lobe(k))
            for name in self.elements:
                if name != "sphere":
                    more = element_weights(name, axis, to_lamp, to_eye, 0.0, beta, gamma, n).interface
                    interface = interface + dr.select(element == ELEMENTS.index(name), more, 0.0)
        return Weights(weights.body, interface)

    def _element(
        self, name: str, material: UInt, axis: Array3f, to_lamp: Array3f, to_eye: Array3f, figures: Figures
    ) -> Weights:
        """As `element_weights`, with the sphere's facets from its table."""
        if name != "sphere":
            return element_weights(name, axis, to_lamp, to_eye, *figures)
        cos_phase = dr.dot(to_lamp, to_eye)
        mirror = figures.beta * fresnel(cos_deviation(cos_phase), figures.n)
        return Weights(figures.alpha * sphere_body(cos_phase), mirror * self._sphere(material, cos_phase))

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


def columns_of(reflectances: Sequence[Reflectance]) -> tuple[list[str], list[str]]:
    """Parameters that have a column on the device: those that always have one, and those from whose plain value some
    of the reflectances departs.
    """
    every = [ROWS[each.name] for each in fields(Reflectance)]
    departing = [row for row in every if row.column == "departing"]
    departs = [row.name for row in departing if any(getattr(r, row.name) != row.plain for r in reflectances)]
    return [row.name for row in every if row.column == "always"], departs


def _colour(number: int) -> str:
    """Column of a coefficient on the palette."""
    return f"colour {number}"


def _lobe(number: int) -> tuple[str, str]:
    """Columns of β and γ of a further lobe."""
    return f"beta of lobe {number}", f"gamma of lobe {number}"


def _lobes(r: Reflectance, count: int) -> dict[str, float]:
    """β and γ of `count` further lobes; those that `r` lacks, and those of a sphere, have β = 0."""
    own = [] if r.element == "sphere" else list(r.lobes)
    lobes = (own + [(0.0, 1.0)] * count)[:count]
    return {name: number for k, lobe in enumerate(lobes) for name, number in zip(_lobe(k), lobe, strict=True)}


def _sphere_table(r: Reflectance, graded: bool) -> np.ndarray:
    """The facets of a sphere, of all lobes together, in units of β."""
    table = sphere_table(r.gamma, SPHERE_ENTRIES, nu=r.nu, graded=graded)
    for beta, gamma in r.lobes:
        table = table + np.float32(beta / r.beta) * sphere_table(gamma, SPHERE_ENTRIES, graded=graded)
    return table


def _row(
    r: Reflectance, palette: Palette, lobes: int, always: Sequence[str], departing: Sequence[str], passes: bool
) -> dict[str, float]:
    """The numbers of a material by the names of their columns; passes: with those of light that passes through."""
    own = _one(r.shown_body_colour, palette.bodies) + _one(r.interface_colour, palette.interfaces)
    own += _one(r.transmitted[0] if r.transmits else None, palette.transmitted)
    own += _one(r.transmitted[1] if r.clear_share > 0.0 else None, palette.twice)
    row = _numbers(r, always) | {_colour(j): share for j, share in enumerate(own)}
    row |= _lobes(r, lobes) | _numbers(r, departing)
    return row | (_passed(r) if passes else {})


def _numbers(r: Reflectance, names: Sequence[str]) -> dict[str, float]:
    """Parameters as numbers: the element by its place in ELEMENTS."""
    held = {name: getattr(r, name) for name in names}
    return {name: ELEMENTS.index(value) if name == "element" else float(value) for name, value in held.items()}


def _one(colour: Spectrum | None, among: Sequence[Spectrum]) -> list[float]:
    """Coefficients of a colour on some spectra: 1 on its own, and 0; all 0 for None."""
    place = -1 if colour is None else position_of(colour, among)
    return [float(j == place) for j in range(len(among))]


def _passed(r: Reflectance) -> dict[str, float]:
    """What kernels know of light that passes through."""
    first, second = lobe_widths(float(r.gamma), float(r.n))
    return {FAR_BODY: r.far_body, CLEAR_SHARE: r.clear_share, CLEAR_WIDTHS[0]: first, CLEAR_WIDTHS[1]: second}
