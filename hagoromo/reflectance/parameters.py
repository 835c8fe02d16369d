"""Parameters: every parameter of a reflectance, and which files and programs lose it.

A row for each field of `Reflectance` and of `MaterialEstimate`. What writes a reflectance somewhere asks `lost` what of
it has no place there, and says so; a test changes each parameter and sees that the output changes or names it.

Enters: a reflectance or an estimate, by its fields. Leaves: lines for people.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np

from hagoromo.reflectance.facets import GAUSSIAN, TAILS_OF_GGX

PLANES = ("png", "tiff", "exr")  # maps of a measured surface
PICTURES = ("ptm", "hsh", "relight")  # relightable images
VOLUMES = ("vdb", "vti", "nrrd", "vol")  # of a volume box
PBR = ("gltf", "usd")  # scenes for programs that render by roughness and metallic
EXPORTS = (*PLANES, "glb", "ply", *PICTURES, "csv", "materialx")  # of a measured object
FORMATS = ("page", *EXPORTS, "mitsuba", "mitsuba medium", *PBR, *VOLUMES)
ANY = object()  # of a parameter that has an effect whatever its value
EVIDENCE = "standard errors, intervals and tests of the fit, which are in materials.json"
Part = Literal["body", "interface", "through", "element", "label", "evidence"]


@dataclass(frozen=True)
class Parameter:
    """name: of the field. words: what is said of it where it is lost. part: of the light that it belongs to; "label":
    no light depends on it, and it may be left out; "evidence": how well the others are known.

    plain: a value at which nothing is lost. lost: formats of FORMATS that have no place for it, each with what stands
    there instead, or "". plain_in: format → another value at which nothing is lost there.
    """

    name: str
    words: str
    part: Part
    plain: Any = ANY
    lost: Mapping[str, str] = field(default_factory=dict)
    plain_in: Mapping[str, Any] = field(default_factory=dict)

    def is_lost(self, form: str, of: Any) -> bool:
        """Whether the format `form` loses this parameter of a reflectance or estimate `of`, and it has an effect."""
        if form not in self.lost or not hasattr(of, self.name):
            return False
        if (self.part == "interface" and not of.beta > 0.0) or (self.part == "through" and not of.transmission > 0.0):
            return False
        value = getattr(of, self.name)
        return not _equal(value, self.plain) and not _equal(value, self.plain_in.get(form, ANY))


def _lost(*forms: str, instead: str = "") -> dict[str, str]:
    return dict.fromkeys(forms, instead)


OF_SURFACES = (*PLANES, "glb", "ply", "csv", "materialx")
PARAMETERS = (
    Parameter("name", "its name", "label"),
    Parameter("pixels", "how many pixels it has", "label"),
    Parameter("alpha", "the weight of its body α", "body", 0.0, _lost("csv", "nrrd", "vol")),
    Parameter("body_colour", "the colour of its body", "body", ANY, _lost("nrrd", "vol")),
    Parameter("epsilon", "how its body darkens at grazing angles ε", "body", 0.0,
              _lost(*OF_SURFACES, "mitsuba medium", *PBR, *VOLUMES)),
    Parameter("sigma", "the roughness of its body σ", "body", 0.0,
              _lost(*PLANES, "glb", "ply", "csv", "mitsuba medium", *PBR, *VOLUMES)),
    Parameter("beta", "the strength of its gloss β", "interface", ANY, _lost(*OF_SURFACES, *VOLUMES)),
    Parameter("gamma", "the width of its highlight γ", "interface", ANY, _lost("ply", "csv", *VOLUMES)),
    Parameter("n", "its refractive index n", "interface", ANY, _lost(*PLANES, "glb", "ply", "csv", *VOLUMES)),
    Parameter("nu", "the tails of its facets ν", "interface", GAUSSIAN,
              _lost(*PLANES, "glb", "materialx", *PBR, instead="those of GGX stand instead")
              | _lost("ply", "csv", "mitsuba medium", *VOLUMES),
              plain_in=dict.fromkeys(PBR, TAILS_OF_GGX)),
    Parameter("lobes", "its further lobes", "interface", (),
              _lost(*OF_SURFACES, *PBR, *VOLUMES) | _lost("mitsuba medium", instead="their light has the first one's")),
    Parameter("interface_colour", "the colour of its gloss", "interface", 1.0, _lost(*OF_SURFACES, *VOLUMES)),
    Parameter("transmission", "light that passes through it", "through", 0.0,
              _lost("mitsuba", "mitsuba medium", *PBR, *VOLUMES)),
    Parameter("transmitted_colour", "the colour of light that passes through it", "through", None,
              _lost("mitsuba", "mitsuba medium", *PBR, *VOLUMES)),
    Parameter("clearness", "how clear it is", "through", 0.0, _lost("mitsuba", "mitsuba medium", *PBR, *VOLUMES)),
    Parameter("element", "the shape of its micro-elements", "element", "plane",
              _lost("page", *EXPORTS, instead="planes stand instead") | _lost("mitsuba", *PBR, *VOLUMES)),
    *(
        Parameter(name, EVIDENCE, "evidence")
        for name in ("specular_albedo", "standard_error", "interval_95", "correlation", "identifiable", "chi_square",
                     "remarks", "lack_of_fit", "texture", "gloss", "convergence")
    ),
)  # fmt: skip


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
