"""Parameters: the table of all parameters of a reflectance: what each is, its range, and which formats lose it.

A row for each field of `Reflectance` and of `MaterialEstimate`. Records, schemas, checks, fits, tables for people and
exports take from the rows what they say of a parameter. What writes a reflectance somewhere asks `lost` what of it has
no place there, and says so; a test changes each parameter and sees that the output changes or names it.

Enters: a reflectance or an estimate, by its fields. Leaves: ranges, descriptions, and lines for people.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any, Literal

import numpy as np
from msgspec import Meta

from hagoromo.errors import InputError
from hagoromo.files.record import about
from hagoromo.reflectance.body import EPSILON_RANGE, SIGMA_RANGE, RoughBody
from hagoromo.reflectance.facets import GAUSSIAN, LEAST_NU, TAILS_OF_GGX
from hagoromo.reflectance.varnish import VARNISH_DEPTH_RANGE, VARNISH_N_RANGE, Varnish

PLANES = ("png", "tiff", "exr")  # maps of a measured surface
PICTURES = ("ptm", "hsh", "relight")  # relightable images
VOLUMES = ("vdb", "vti", "nrrd", "vol")  # of a volume box
PBR = ("gltf", "usd")  # scenes for programs that render by roughness and metallic
EXPORTS = (*PLANES, "glb", "ply", *PICTURES, "csv", "materialx", "openpbr", "rgl", "openmaterial")
FORMATS = ("page", *EXPORTS, "mitsuba", "mitsuba medium", *PBR, *VOLUMES)
SMALLEST_GAMMA, LARGEST_GAMMA = 1e-4, math.pi / 2  # [rad]
LARGEST_BETA = 1e4  # [1/sr]
ANY = object()  # of a parameter that has an effect whatever its value
EVIDENCE = "standard errors, intervals and tests of the fit, which are in materials.json"
Part = Literal["body", "interface", "through", "element", "label", "evidence"]
Column = Literal["always", "departing"]


@dataclass(frozen=True, kw_only=True)
class BodyLaw(RoughBody, Varnish):
    """How the body of a plane departs from Lambert's law: all laws of it are bases, and have a row each parameter."""

    @property
    def body_law(self) -> BodyLaw:
        """This law, without what the class of a reflectance has beside it."""
        return BodyLaw(**self._values())

    @property
    def body_departures(self) -> dict[str, Any]:
        """Parameters of the law that differ from Lambert's law, by their names."""
        return {name: value for name, value in self._values().items() if value != PLAIN_BODY[name]}

    @property
    def has_lambert_body(self) -> bool:
        """Whether the body follows Lambert's law."""
        return not self.body_departures

    def _values(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in PLAIN_BODY}


PLAIN_BODY: dict[str, Any] = {each.name: each.default for each in fields(BodyLaw)}  # parameters of the law of the body


@dataclass(frozen=True)
class Coordinate:
    """What a fit moves in place of a parameter, so that its errors are even: coordinate = of(value), value = back(it).

    words: the coordinate. range: of the parameter, admissible in a fit, both ends included.
    """

    words: str
    of: Callable[[float], float]
    back: Callable[[float], float]
    range: tuple[float, float]

    @property
    def bounds(self) -> tuple[float, float]:
        """The least and the largest coordinate."""
        first, last = (self.of(end) for end in self.range)
        return min(first, last), max(first, last)


@dataclass(frozen=True)
class Parameter:
    """name: of the field. words: what is said of it where it is lost. part: of the light that it belongs to; "label":
    no light depends on it, and it may be left out; "evidence": how well the others are known.

    symbol, unit: "" for none. meaning: its description in schemas. range: of a number, both ends admissible; None for
    what is no number. absent: what a file without it means, of a range without end. fitted: how a fit moves it, None
    where it is given or moves with others, as α c_b and β F₀ do. varies: where it may differ from place to place:
    "measurement" (maps of pixels), "scene" (textures of surfaces), "mitsuba" (textures of our BSDF), "box" (voxels).
    plain: a value at which nothing is lost. lost: formats of FORMATS that have no place for it, each with what stands
    there instead, or "". plain_in: format → the value at which nothing is lost there, in place of `plain`.
    column: of the numbers of a material on the device; "departing": only where that of some material is not `plain`.
    """

    name: str
    words: str
    part: Part
    plain: Any = ANY
    symbol: str = ""
    unit: str = ""
    meaning: str = ""
    range: tuple[float, float] | None = None
    absent: str = ""
    fitted: Coordinate | None = None
    varies: tuple[str, ...] = ()
    lost: Mapping[str, str] = field(default_factory=dict)
    plain_in: Mapping[str, Any] = field(default_factory=dict)
    column: Column | None = None

    @property
    def fit(self) -> Coordinate:
        """How a fit moves it, of a parameter that is fitted."""
        assert self.fitted is not None, self.name
        return self.fitted

    @property
    def shown(self) -> str:
        """Its symbol and unit, for tables."""
        return f"{self.symbol} [{self.unit}]" if self.unit else self.symbol

    def check(self, value: Any, who: str) -> None:
        """`InputError`, which begins with `who`, for what is no number of its range."""
        assert self.range is not None
        low, high = self.range
        if not (isinstance(value, (int, float)) and low <= value <= high):
            end = f"to {high:.4g}" if high < math.inf else f"or leave it out for {self.absent}"
            separator = " " if high < math.inf else ", "
            raise InputError(f"{who}: {self.name} is {value}: give a number from {low}{separator}{end}")

    def is_lost(self, form: str, of: Any) -> bool:
        """Whether the format `form` loses this parameter of a reflectance or estimate `of`, and it has an effect."""
        if form not in self.lost or not hasattr(of, self.name):
            return False
        if (self.part == "interface" and not of.beta > 0.0) or (self.part == "through" and not of.transmission > 0.0):
            return False
        value = getattr(of, self.name)
        return not _equal(value, self.plain_in.get(form, self.plain))


def _lost(*forms: str, instead: str = "") -> dict[str, str]:
    return dict.fromkeys(forms, instead)


def _tail(nu: float) -> float:
    return 0.0 if math.isinf(nu) else 1.0 / nu


def _nu(tail: float) -> float:
    return 1.0 / float(tail) if tail > 0.0 else GAUSSIAN


# Below, lamps and pixels are wider than any lobe; above, it is diffuse
LOG_GAMMA = Coordinate("ln γ", np.log, math.exp, (0.001, 1.2))
# Above a gas; dielectrics end at 3, and metals look like 4 to 10: their Fresnel reflectance hardly rises up to 80°
LOG_N1 = Coordinate("ln(n − 1)", lambda n: np.log(n - 1.0), lambda at: 1.0 + math.exp(at), (1.05, 10.0))
TAIL = Coordinate("1/ν", _tail, _nu, (LEAST_NU, math.inf))  # 0 for Gaussian facets, and the density is smooth there
LOG_EXPONENT = Coordinate("ln(1 + ε)", lambda at: np.log(1.0 + at), lambda at: math.exp(at) - 1.0, (-0.7, 1.0))
ROUGHNESS = Coordinate("σ", float, float, (-0.2, 1.0))
OF_SURFACES = (*PLANES, "glb", "ply", "csv", "materialx")
BEYOND_SURFACES = ("mitsuba", "mitsuba medium", *PBR, *VOLUMES)  # these have no light that passes through
PARAMETERS = (
    Parameter("name", "its name", "label", meaning="name of the material"),
    Parameter("pixels", "how many pixels it has", "label", meaning="number of pixels with its label"),
    Parameter("element", "the shape of its micro-elements", "element", "plane",
              meaning="micro-element that carries the facets", column="always",
              lost=_lost("page", *EXPORTS, instead="planes stand instead") | _lost("mitsuba", *PBR, *VOLUMES)),
    Parameter("alpha", "the weight of its body α", "body", 0.0, "α", "1/sr",
              "weight of the body (diffuse) part α [1/sr]", (0, 1), column="always",
              lost=_lost("csv", "nrrd", "vol")),
    Parameter("body_colour", "the colour of its body", "body", symbol="c_b", meaning="body (diffuse) colour",
              varies=("measurement", "scene", "mitsuba", "box"),
              lost=_lost("nrrd", "vol")),
    Parameter("beta", "the strength of its gloss β", "interface", ANY, "β", "1/sr",
              "weight of the interface (specular) part β [1/sr]", (0, LARGEST_BETA), column="always",
              varies=("measurement", "scene", "mitsuba"),
              lost=_lost(*OF_SURFACES, *VOLUMES)),
    Parameter("gamma", "the width of its highlight γ", "interface", ANY, "γ", "rad",
              "half width of the distribution of facets γ [rad]", (SMALLEST_GAMMA, LARGEST_GAMMA), fitted=LOG_GAMMA,
              column="always", varies=("measurement", "scene", "mitsuba"),
              lost=_lost("ply", "csv", *VOLUMES)),
    Parameter("n", "its refractive index n", "interface", ANY, "n", "", "refractive index", (1, 10), fitted=LOG_N1,
              column="always",
              lost=_lost(*PLANES, "glb", "ply", "csv", *VOLUMES)),
    Parameter("nu", "the tails of its facets ν", "interface", GAUSSIAN, "ν", "",
              f"exponent of the facets' tails ν, {LEAST_NU} or more", (LEAST_NU, math.inf), "Gaussian facets", TAIL,
              ("measurement",), column="departing",
              lost=_lost(*PLANES, "glb", "materialx", "openpbr", *PBR, instead="those of GGX stand instead")
              | _lost("ply", "csv", "mitsuba medium", *VOLUMES),
              plain_in=dict.fromkeys(PBR, TAILS_OF_GGX)),
    Parameter("lobes", "its further lobes", "interface", (),
              meaning="further Gaussian lobes of the interface",
              lost=_lost(*OF_SURFACES, "openpbr", *PBR, *VOLUMES)
              | _lost("mitsuba medium", instead="their light has the width of the first")),
    Parameter("interface_colour", "the colour of its gloss", "interface", 1.0, "e",
              meaning="interface (specular) colour", varies=("mitsuba",),
              lost=_lost(*OF_SURFACES, *VOLUMES)),
    Parameter("epsilon", "how its body darkens at grazing angles ε", "body", 0.0, "ε", "",
              "exponent of the body (Minnaert's, less 1); 0: Lambert's law", EPSILON_RANGE, fitted=LOG_EXPONENT,
              column="departing",
              lost=_lost(*OF_SURFACES, "openpbr", "mitsuba medium", *PBR, *VOLUMES)),
    Parameter("sigma", "the roughness of its body σ", "body", 0.0, "σ", "",
              "roughness of the body (Oren and Nayar's); 0: Lambert's law", SIGMA_RANGE, fitted=ROUGHNESS,
              column="departing",
              lost=_lost(*PLANES, "glb", "ply", "csv", "mitsuba medium", *PBR, *VOLUMES)),
    Parameter("varnish_n", "the refractive index of its varnish", "body", 1.0, "n_v", "",
              "refractive index of a clear varnish over the body; 1: none", VARNISH_N_RANGE, column="departing",
              lost=_lost("mitsuba medium", *PBR, *VOLUMES)),
    Parameter("varnish_depth", "the optical depth of its varnish", "body", 0.0, "τ", "",
              "optical depth of the varnish for one passage along the normal, absorption times thickness; 0: clear",
              VARNISH_DEPTH_RANGE, column="departing", lost=_lost("mitsuba medium", *PBR, *VOLUMES)),
    Parameter("transmission", "light that passes through it", "through", 0.0, "T", "",
              "share of the light that passes through an element", (0, 1), lost=_lost(*BEYOND_SURFACES)),
    Parameter("transmitted_colour", "the colour of light that passes through it", "through", None, "c_t",
              meaning="colour of light that has passed through once, 0…1", lost=_lost(*BEYOND_SURFACES)),
    Parameter("clearness", "how clear it is", "through", 0.0, "κ", "",
              "share of the transmitted light that keeps its way", (0, 1), lost=_lost(*BEYOND_SURFACES)),
    *(
        Parameter(name, EVIDENCE, "evidence")
        for name in ("specular_albedo", "standard_error", "interval_95", "correlation", "identifiable", "chi_square",
                     "remarks", "lack_of_fit", "texture", "gloss", "convergence")
    ),
)  # fmt: skip
ROWS = {each.name: each for each in PARAMETERS}
NUMBERS = tuple(each for each in PARAMETERS if each.range is not None)
STATED = tuple(each.name for each in NUMBERS if each.column == "always")  # that every reflectance states: α, β, γ, n
GLOSS = tuple(each.name for each in NUMBERS if each.part == "interface")  # of the interface: β, γ, n, ν
OF_LOBES = ("beta", "gamma")  # numbers that each further lobe has of its own
# What photographs that show no interface leave open of it: all that is admissible in a fit
OPEN_GLOSS = {key: fitted.range if (fitted := ROWS[key].fitted) else (0.0, math.inf) for key in GLOSS}
MATTE = {"beta": 0.0, "gamma": 0.2, "n": 1.5}  # of what has no gloss: on γ and n depends clear light alone
FITTED_BODY_LAW = tuple(name for name in PLAIN_BODY if ROWS[name].fitted)  # what is measured of the law of the body
REFLECTING = tuple(each for each in PARAMETERS if each.part in ("body", "interface", "element"))
MEASURED = tuple(each for each in REFLECTING if each.name not in PLAIN_BODY or each.fitted)  # of a measured material


def meaning(name: str, more: str = "") -> Meta:
    """The description of a parameter in a schema, and what is true of it in that file alone."""
    return about(ROWS[name].meaning + more)


def of_parameter(name: str, more: str = "") -> Meta:
    """The description of a figure about a parameter, such as its error: in its unit."""
    unit = ROWS[name].unit
    return about(f"of {name} [{unit}]{more}" if unit else f"of {name}{more}")


def lost(form: str, of: Any) -> str:
    """What a format of FORMATS loses of a reflectance or estimate, in words; "" where it loses nothing.

    >>> paint = hg.Reflectance(0.2, 0.1, 0.2, 1.5, hg.Spectrum.constant(0.5), nu=2.5)
    >>> lost("usd", paint)
    'the tails of its facets ν (those of GGX stand instead)'
    """
    assert form in FORMATS, form
    parameters = [each for each in PARAMETERS if each.is_lost(form, of)]
    return ", ".join(each.words + (f" ({each.lost[form]})" if each.lost[form] else "") for each in parameters)


def losses(form: str, materials: Iterable[Any]) -> list[str]:
    """What a format loses of materials, a line for each that loses anything."""
    said = [(one.name, lost(form, one)) for one in materials]
    return [f"material {name!r}: {words}" for name, words in said if words]


def _equal(value: Any, plain: Any) -> bool:
    """Whether a value is a plain one; of a colour, whether all of it is."""
    if isinstance(plain, float):
        return bool(np.all(np.asarray(getattr(value, "values", value), float) == plain))
    return plain is not ANY and value == plain
