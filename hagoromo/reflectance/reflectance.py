"""Reflectance: the parameters of eq. (3), the colours of eq. (2) and the micro-element that carries them."""

from __future__ import annotations

import math
from dataclasses import MISSING, dataclass, fields
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.backend import Array3f, Float, arrays, lookup
from hagoromo.directions import frame_about, local
from hagoromo.errors import InputError
from hagoromo.light.spectrum import CONSTANT_RANGE, VISIBLE, Spectrum, checked_spectrum
from hagoromo.reflectance.body import body_albedo_ratio
from hagoromo.reflectance.element import ELEMENTS, Element, element_weights
from hagoromo.reflectance.facets import GAUSSIAN, is_gaussian
from hagoromo.reflectance.interface_albedo import VIEWS, interface_albedo
from hagoromo.reflectance.number_arrays import broadcast_directions, numbers_of, vectors_of
from hagoromo.reflectance.parameters import (
    LARGEST_BETA,
    LARGEST_GAMMA,
    MATTE,
    NUMBERS,
    ROWS,
    SMALLEST_GAMMA,
    BodyLaw,
)
from hagoromo.reflectance.sampling import (
    LobeShare,
    density_of_lobes,
    shares_of_lobes,
    to_lamp_by_lobes,
)
from hagoromo.reflectance.torrance_sparrow import Weights
from hagoromo.reflectance.transmission import (
    AllWeights,
    around_fibre,
    clear_albedo,
    clear_lobes,
    facing,
    far_body,
    lobe_widths,
    table_from,
)

NEUTRAL = Spectrum.constant(1.0)  # the interface of a dielectric keeps the lamp's colour
SEEN = {"plane": "seen at {:.0f}° ", "cylinder": "seen at {:.0f}° from across its tangent ", "sphere": ""}
ALWAYS_RECORDED = ("element", "name", "interface_colour")
MOST_LOBES = 4  # further lobes of one reflectance: each is a part of every kernel
Lobe = tuple[float, float]  # β [1/sr] and γ [rad] of a Gaussian lobe
FINEST_STEP = 5.0  # [nm] between values of a body colour that a law of the body changes


@dataclass(frozen=True)
class Reflectance(BodyLaw):
    """Dichromatic Torrance–Sparrow reflectance of a material.

    alpha, beta: weights of body and interface [1/sr]; gamma: half width of the facets at half maximum [rad];
    n: refractive index; body_colour, interface_colour: Spectra without unit; element: plane, cylinder or sphere;
    nu: exponent ν of the facets' tails, D = (1 + (2^{1/ν} − 1) φ²/γ²)^{−ν}, 0.3 or more; infinity: Gaussian facets.
    epsilon, sigma: exponent and roughness of the body, which multiply it by (cosθ_i cosθ_r)^ε (1 + σ s/t), see
    `hagoromo.reflectance.body`; 0: Lambert's law. Only planes have them, and they are given by name, as all parameters
    of `BodyLaw`.
    lobes: further lobes of the interface, such as the narrow spike of a polished coat above its wide haze: β [1/sr] and
    γ [rad] of each, with Gaussian facets, MOST_LOBES at most; they need a beta above 0.
    transmission: share T of the light that passes through an element and leaves by its far side, 0…1, in the
    transmitted_colour c_t (None: the body colour). clearness: share κ of that which keeps its way through a cylinder,
    as in clear fibres; the rest is body light, see `hagoromo.reflectance.transmission`. A plane that transmits is a
    sheet with two sides, which reflect alike.
    Raises `InputError` for values outside their range and for a reflectance that gives back more than it receives.

    >>> matte = hg.Reflectance.matte(0.2, hg.Spectrum.constant(0.5))
    >>> round(matte.body_albedo, 4)  # π · 0.2 · 0.5
    0.3142
    """

    alpha: float
    beta: float
    gamma: float
    n: float
    body_colour: Spectrum
    interface_colour: Spectrum = NEUTRAL
    element: Element = "plane"
    name: str = ""
    nu: float = GAUSSIAN
    lobes: tuple[Lobe, ...] = ()
    transmission: float = 0.0
    transmitted_colour: Spectrum | None = None
    clearness: float = 0.0

    def __post_init__(self) -> None:
        who = f"reflectance {self.name!r}" if self.name else "reflectance"
        for parameter in NUMBERS:
            parameter.check(getattr(self, parameter.name), who)
        if self.element not in ELEMENTS:
            raise InputError(f"{who}: element is {self.element!r}: give one of {', '.join(ELEMENTS)}")
        self._check_lobes(who)
        if not self.has_lambert_body and self.element != "plane":
            given = " and ".join(self.body_departures)
            raise InputError(f"{who}: element is {self.element!r}: give {given} to planes only, or leave it out")
        for key in ("body_colour", "interface_colour"):
            if min(checked_spectrum(getattr(self, key), f"{who}: {key}").values) < 0:
                raise InputError(f"{who}: {key} is below 0 at some wavelength: a colour is 0 or more")
        self._check_transmission(who)
        self._check_energy(who)

    @classmethod
    def matte(cls, alpha: float, body_colour: Spectrum, **further: Any) -> Reflectance:
        """A reflectance without gloss; on its γ and n depends clear light alone. further: parameters by their names.

        >>> hg.Reflectance.matte(0.2, hg.Spectrum.constant(0.5)).beta
        0.0
        """
        stated: dict[str, Any] = {"alpha": alpha, "body_colour": body_colour, **MATTE, **further}
        return cls(**stated)

    def __repr__(self) -> str:
        """What is not as it is by default."""
        return f"Reflectance({', '.join(f'{key}={value!r}' for key, value in self._stated().items())})"

    def weights(self, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> Weights | AllWeights:
        """Weights of f of its element [1/sr], see `element_weights`, of all its lobes; `AllWeights` if it transmits."""
        if not self.transmits:
            return self._reflected(axis, to_lamp, to_eye)
        once, twice = self._transmitted(axis, to_lamp, to_eye)
        if self.element == "plane":
            axis = facing(axis, to_eye)
        return AllWeights(*self._reflected(axis, to_lamp, to_eye), once, twice)

    def evaluate(
        self, axis: ArrayLike, to_lamp: ArrayLike, to_eye: ArrayLike, wavelength_nm: ArrayLike | None = None
    ) -> NDArray[np.float64]:
        """f of eq. (3) [1/sr]: light to the eye for a unit irradiance facing the lamp, cosine of incidence included.

        axis: normal of a plane, tangent of a cylinder, anything for a sphere. Directions are (..., 3), of any length,
        and are broadcast together. Gives (..., W) for W wavelengths [nm], (..., 1) at 550 nm without them. Of what
        transmits, the light that has passed through is in it. In double precision; `InputError` for directions that
        are not finite or 0.

        >>> matte = hg.Reflectance.matte(0.2, hg.Spectrum.constant(0.5))
        >>> matte.evaluate([0, 0, 1], [0, 0, 1], [[0, 0, 1], [0, 1, 1]]).round(3).tolist()
        [[0.1], [0.1]]
        """
        wavelengths = np.atleast_1d(np.asarray(550.0 if wavelength_nm is None else wavelength_nm, np.float64))
        shape, directions = broadcast_directions(axis=axis, to_lamp=to_lamp, to_eye=to_eye)
        parts = [numbers_of(weight) for weight in self.weights(*directions)]
        colours = (self.shown_body_colour, self.interface_colour, *(self.transmitted if self.transmits else ()))
        each = (part[:, None] * colour.at(wavelengths) for part, colour in zip(parts, colours, strict=True))
        return np.broadcast_to(sum(each, np.zeros(1)), (math.prod(shape), wavelengths.size)).reshape(*shape, -1)

    def sample(
        self, axis: ArrayLike, to_eye: ArrayLike, numbers: ArrayLike
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Directions to the lamp, (..., 3), drawn nearly as the plane with normal `axis` sends light; and their `pdf`.

        numbers: (..., 3), independent and uniform in [0, 1): which lobe, and two for the direction. A direction may be
        below the horizon, where f is 0. `InputError` for other elements and what transmits, see `pdf`.

        >>> matte = hg.Reflectance.matte(0.2, hg.Spectrum.constant(0.5))
        >>> to_lamp, density = matte.sample([0, 0, 1], [0, 0, 1], [0.5, 0.0, 0.0])
        >>> to_lamp.round(6).tolist(), round(float(density), 4)
        ([0.0, 0.0, 1.0], 0.3183)
        """
        self._check_plane("sample")
        shape, (axis_, view) = broadcast_directions(axis=axis, to_eye=to_eye, like=numbers)
        uniform = np.broadcast_to(np.asarray(numbers, np.float64), (*shape, 3)).reshape(-1, 3)
        if not ((uniform >= 0.0) & (uniform < 1.0)).all():
            raise InputError("sample: numbers are to be from 0 to below 1, as of numpy.random.Generator.random")
        frame = frame_about(axis_)
        drawn = to_lamp_by_lobes(local(frame, view), self._shares(), *vectors_of(uniform))
        out = drawn.x * frame[0] + drawn.y * frame[1] + drawn.z * frame[2]
        density = density_of_lobes(drawn, local(frame, view), self._shares())
        return np.array(out).T.reshape(*shape, 3), np.broadcast_to(numbers_of(density), len(uniform)).reshape(shape)

    def pdf(self, axis: ArrayLike, to_lamp: ArrayLike, to_eye: ArrayLike) -> NDArray[np.float64]:
        """Density per solid angle [1/sr] with which `sample` gives the directions `to_lamp`: (...).

        Directions are (..., 3). Over all directions it is 1. Only planes have one: of a cylinder and a sphere a normal
        is drawn first. `InputError` for these, and for what transmits.
        """
        self._check_plane("pdf")
        shape, (axis_, lamp, view) = broadcast_directions(axis=axis, to_lamp=to_lamp, to_eye=to_eye)
        frame = frame_about(axis_)
        density = density_of_lobes(local(frame, lamp), local(frame, view), self._shares())
        return np.broadcast_to(numbers_of(density), math.prod(shape)).reshape(shape)

    def lobe_shares(self) -> list[float]:
        """Shares of the samples for the lobes of the interface, by their albedos; what is left is for the body."""
        n, lobes = float(self.n), [(self.beta, self.gamma, self.nu), *((*lobe, GAUSSIAN) for lobe in self.lobes)]
        sent = [beta * float(np.median(interface_albedo(float(gamma), n, float(nu)))) for beta, gamma, nu in lobes]
        return shares_of_lobes(sent, self.body_albedo, both=self.alpha > 0.0 and self.beta > 0.0)

    def _shares(self) -> list[LobeShare]:
        shapes = [(self.gamma, self.nu), *((gamma, GAUSSIAN) for _, gamma in self.lobes)]
        kind = arrays().Float64  # opaque: literals would compile for every material
        return [
            (dr.opaque(kind, share), dr.opaque(kind, gamma), nu if is_gaussian(nu) else dr.opaque(kind, nu))
            for share, (gamma, nu) in zip(self.lobe_shares(), shapes, strict=True)
        ]

    def _check_plane(self, what: str) -> None:
        if self.element != "plane" or self.transmits:
            kind = "what transmits" if self.transmits else f"a {self.element}"
            raise InputError(f"{what} is for planes that only reflect, and this is {kind}: use evaluate")

    def _transmitted(self, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> tuple[Float, Float]:
        """Weights of the light that has passed through once, and twice as far."""
        once, clear = self.far_body * far_body(self.element, axis, to_lamp, to_eye), self.clear_share
        if clear == 0.0:
            return once, 0.0 * once
        kind = type(dr.dot(axis, to_eye))
        table = table_from(lookup(kind, around_fibre(float(self.gamma), float(self.n))))
        widths = lobe_widths(float(self.gamma), float(self.n))
        through, twice = clear_lobes(axis, to_lamp, to_eye, self.n, widths, table)
        return once + clear * through, clear * twice

    def _reflected(self, axis: Array3f, to_lamp: Array3f, to_eye: Array3f) -> Weights:
        shape = self.gamma, self.n, self.nu
        whole = element_weights(self.element, axis, to_lamp, to_eye, self.alpha, self.beta, *shape, self)
        for beta, gamma in self.lobes:
            more = element_weights(self.element, axis, to_lamp, to_eye, 0.0, beta, gamma, self.n)
            whole = Weights(whole.body, whole.interface + more.interface)
        return whole

    def _sends(self) -> str:
        return "sends on" if self.transmits else "reflects"

    def _check_energy(self, who: str) -> None:
        """`InputError` for a reflectance that gives back more than it receives."""
        bare = math.pi * self.alpha * float(self.body_colour.values.max())
        if bare > 1 + 1e-6 and self.shown_body_colour is not self.body_colour:
            raise InputError(
                f"{who} breaks energy conservation: without {' and '.join(self.body_departures)} its body reflects "
                f"{bare:.3f} of the light (π α c_b): lower alpha·body_colour"
            )
        albedo = self.directional_albedo()
        worst = int(np.argmax(albedo))
        if albedo[worst] > 1 + 1e-6:
            seen = SEEN[self.element].format(math.degrees(VIEWS[worst]))
            raise InputError(
                f"{who} breaks energy conservation: {seen}it {self._sends()} "
                f"{albedo[worst]:.3f} of the light: lower alpha·body_colour (π α c_b = {self.body_albedo:.3f}) or beta"
                + (f", or transmission ({self.transmission:g})" if self.transmits else "")
            )

    def _check_transmission(self, who: str) -> None:
        if self.clearness > 0.0 and self.element != "cylinder":
            raise InputError(
                f"{who}: clearness is {self.clearness:g} and element {self.element!r}: give it to cylinders only"
            )
        if self.transmitted_colour is not None:
            checked_spectrum(self.transmitted_colour, f"{who}: transmitted_colour")
        colour = self.transmitted_colour or self.body_colour
        if self.transmits and (min(colour.values) < 0.0 or _largest(colour) > 1.0):
            raise InputError(
                f"{who}: the colour of transmitted light is {_largest(colour):.3g} at some wavelength: give a "
                "transmitted_colour from 0 to 1"
            )

    def _check_lobes(self, who: str) -> None:
        object.__setattr__(self, "lobes", tuple((float(beta), float(gamma)) for beta, gamma in self.lobes))
        if self.lobes and (len(self.lobes) > MOST_LOBES or not self.beta > 0.0):
            raise InputError(f"{who} has {len(self.lobes)} lobes more: give {MOST_LOBES} at most, and a beta above 0")
        for beta, gamma in self.lobes:
            if not (0.0 <= beta <= LARGEST_BETA and SMALLEST_GAMMA <= gamma <= LARGEST_GAMMA):
                raise InputError(
                    f"{who} has a lobe of beta {beta} and gamma {gamma}: give 0 to {LARGEST_BETA:g}, and "
                    f"{SMALLEST_GAMMA:g} to {LARGEST_GAMMA:.4g}"
                )

    @property
    def shown_body_colour(self) -> Spectrum:
        """The colour of the body as it shows, see `shown`: what pictures and `evaluate` have."""
        return self.shown(self.body_colour)

    def shown(self, colour: Spectrum) -> Spectrum:
        """A body colour as the law of the body lets it show, at its own wavelengths and, where light is seen, each
        FINEST_STEP; the same object where the law changes no colours.
        """
        if self.shown_colour(colour.values, self.alpha) is colour.values:
            return colour
        seen = np.arange(*CONSTANT_RANGE, FINEST_STEP) if np.ptp(colour.values) > 0.0 else np.empty(0)
        first, last = colour.wavelengths[[0, -1]]
        wavelengths = np.union1d(colour.wavelengths, seen[(seen > first) & (seen < last)])
        return Spectrum(wavelengths, self.shown_colour(colour.at(wavelengths), self.alpha))

    @property
    def transmits(self) -> bool:
        """Whether light passes through its element."""
        return self.transmission > 0.0

    @property
    def transmitted(self) -> tuple[Spectrum, Spectrum]:
        """Colours of light that has passed through once, c_t, and twice as far, c_t²."""
        colour = self.body_colour if self.transmitted_colour is None else self.transmitted_colour
        return colour, colour * colour

    @property
    def far_body(self) -> float:
        """Weight of body light that leaves by the far side, T (1 − κ)/π [1/sr]."""
        return self.transmission * (1.0 - self.clearness) / math.pi

    @property
    def clear_share(self) -> float:
        """Share T κ of the light that enters a clear fibre and keeps its way."""
        return self.transmission * self.clearness

    @property
    def body_albedo(self) -> float:
        """π α c_b at the wavelength (400–700 nm) where the body reflects most, c_b as it shows."""
        return math.pi * self.alpha * _largest(self.shown_body_colour)

    @property
    def interface_albedo(self) -> float:
        """∫ of the interface part of the element over the lamps' directions, for e = 1.

        Seen along the normal of a plane, across the tangent of a cylinder, from anywhere for a sphere.
        """
        return float(self._interface()[0])

    def directional_albedo(self) -> np.ndarray:
        """∫ f dL of the element over all lamp directions, at the worst wavelength: (13,), see `interface_albedo`."""
        ratio: Any = 1.0
        if not self.has_lambert_body:
            ratio = body_albedo_ratio(self.body_law, tuple(VIEWS.tolist()))
        return (
            self.body_albedo * ratio + self._interface() * _largest(self.interface_colour) + self.transmitted_albedo()
        )

    def transmitted_albedo(self) -> np.ndarray:
        """∫ of the transmitted part over all lamp directions, at the worst wavelength: (13,), as `directional_albedo`.

        Light that has gone twice through a fibre counts as if it had gone once.
        """
        if not self.transmits:
            return np.zeros(VIEWS.size)
        albedo = np.full(VIEWS.size, math.pi * self.far_body)
        if self.clear_share > 0.0:
            albedo += self.clear_share * clear_albedo(float(self.gamma), float(self.n), tuple(VIEWS.tolist()))
        return albedo * _largest(self.transmitted[0])

    def _interface(self) -> np.ndarray:
        albedo = self.beta * interface_albedo(float(self.gamma), float(self.n), float(self.nu), self.element)
        for beta, gamma in self.lobes:
            albedo = albedo + beta * interface_albedo(gamma, float(self.n), GAUSSIAN, self.element)
        return albedo

    def record(self) -> dict[str, Any]:
        """Plain figures; `reflectance_from_record` reads them back. What is as it is by default has no key, but
        for those of ALWAYS_RECORDED, nor has what says how light passes through where none does.
        """
        stated = self._stated() | {key: getattr(self, key) for key in ALWAYS_RECORDED}
        passes = self.transmits
        return {key: _recorded(value) for key, value in stated.items() if passes or ROWS[key].part != "through"}

    def _stated(self) -> dict[str, Any]:
        """Parameters that are not as they are by default, by name; those of the law of the body last."""
        every = sorted(fields(self), key=lambda each: bool(each.kw_only))
        values = {each.name: (getattr(self, each.name), each.default) for each in every}
        return {key: value for key, (value, plain) in values.items() if plain is MISSING or value != plain}


def _recorded(value: Any) -> Any:
    """A value as records hold it: spectra as tables, lobes as lists."""
    if isinstance(value, tuple):
        return [list(each) for each in value]
    return value.record() if isinstance(value, Spectrum) else value


def _largest(colour: Spectrum) -> float:
    """Largest value between 400 and 700 nm; a piecewise linear spectrum has it at a knot or at a limit."""
    lo, hi = VISIBLE
    inside = [w for w in colour.wavelengths if lo < w < hi]
    return float(np.max(colour.at(np.array([lo, hi, *inside]))))
