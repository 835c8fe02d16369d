"""Findings: what was found about a material, in sentences, and which photograph would determine what is not known."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from hagoromo.measurement.photometric.term import TermEstimate
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.parameters import FITTED_BODY_LAW

SHARP, SOFT = math.radians(3.0), math.radians(12.0)  # half widths of highlights that are called sharp and soft
SIGNIFICANT = 2.0  # standard errors from 0
MOST_ALBEDO = 1.1  # of a body that is said in per cent: no body scatters more light than it receives, but for errors
BODY_RELATIVE = (
    "How much light its body scatters is not known, because the strength of the lamps is not: only ratios between "
    "materials hold. A photograph that would show it: a white of known reflectance in place of the object."
)
# parameter: its name, why photographs do not determine it, and which photograph would
MISSING = {
    "alpha": (
        "weight of the body α",
        "the surface is hardly lit outside its highlights",
        "the lamp high above the surface and away from the highlight",
    ),
    "beta": (
        "strength of the highlight β",
        "no photograph shows enough of a highlight",
        "the lamp where a mirror in place of the surface would show it",
    ),
    "gamma": (
        "width of the highlight γ",
        "no photograph shows the highlight from its middle to its edge",
        "several, the lamp in steps of a few degrees around the highlight",
    ),
    "n": (
        "refractive index n",
        "all highlights are seen at much the same angle between lamp and camera, where n and β do the same",
        "the lamp opposite the camera, so that light grazes the surface (beyond 60° from its normal)",
    ),
    "nu": (
        "exponent ν of the tails of the highlight",
        "the faint skirt of the highlight is lost in the body's light or in noise",
        "a bracket of exposures, the lamp 10° to 30° beside the highlight",
    ),
    "interface_colour": (
        "colour of the highlight",
        "too few unclipped highlights stand out from the body",
        "a shorter exposure of the highlight",
    ),
}


@dataclass(frozen=True)
class Findings:
    """name of the material. sentences: what was found. missing: what these photographs do not determine, why, and what
    photograph would.
    """

    name: str
    sentences: tuple[str, ...]
    missing: tuple[str, ...]


def findings(material: MaterialEstimate, pixels: int) -> Findings:
    """What was found about `material`, of an object of so many `pixels`."""
    share = 100.0 * material.pixels / max(pixels, 1)
    sentences = [f"It covers {material.pixels:,} pixels ({share:.0f} % of the object).".replace(",", "\u202f")]
    absolute = math.pi * material.alpha <= MOST_ALBEDO
    sentences += [*_body(material, absolute), *_variation(material), _highlight(material, absolute)]
    absent = [
        f"The {name} is not determined by these photographs: {why}. A photograph that would: {photograph}."
        for key, (name, why, photograph) in MISSING.items()
        if not material.identifiable.get(key, True) and not _beside_the_point(material, key)
    ]
    return Findings(material.name, tuple(sentences), tuple(absent))


def findings_of_terms(terms: Mapping[str, TermEstimate]) -> list[Findings]:
    """What all photographs have in common, as one finding; none where nothing of it was estimated."""
    said = tuple(f"{one.sentence[0].upper()}{one.sentence[1:]}." for one in terms.values() if one.sentence)
    return [Findings("all photographs together", said, ())] if said else []


def missing(found: Sequence[Findings]) -> list[str]:
    """What is not determined, once each, with the names of the materials unless it is so of all."""
    names: dict[str, list[str]] = {}
    for one in found:
        for sentence in one.missing:
            names.setdefault(sentence, []).append(one.name)
    return [
        sentence if len(of) == len(found) else f"{', '.join(of)}: {sentence[0].lower()}{sentence[1:]}"
        for sentence, of in names.items()
    ]


def _body(material: MaterialEstimate, absolute: bool) -> list[str]:
    """How much light the body scatters, and whether by Lambert's law."""
    error = material.standard_error.get("alpha")
    spread = "" if not isinstance(error, float) else f" ± {100.0 * math.pi * error:.2g}"
    share = (
        f"Its body scatters {100.0 * math.pi * material.alpha:.3g}{spread} % of the light, the mean of the channels."
    )
    departs = any(
        abs(getattr(material, key)) > SIGNIFICANT * (material.standard_error.get(key) or 0.0)
        for key in FITTED_BODY_LAW
        if getattr(material, key) != 0.0
    )
    law = ["Its body departs from Lambert's law, as the table says."] if departs else []
    return [share if absolute else BODY_RELATIVE, *law]


def _variation(material: MaterialEstimate) -> list[str]:
    """Whether colour and gloss are maps."""
    maps = [
        word
        for word, record in (("colour", material.texture), ("gloss", material.gloss))
        if record is not None and record.get("per_pixel")
    ]
    return [f"Its {' and '.join(maps)} varies from place to place and is measured for every pixel."] if maps else []


def _highlight(material: MaterialEstimate, absolute: bool) -> str:
    if material.beta <= 0.0 or not material.identifiable.get("gamma", False):
        return "No highlight of it was measured: it is shown as these photographs allow."
    kind = "sharp" if material.gamma < SHARP else "soft" if material.gamma > SOFT else "satin"
    error = material.standard_error.get("gamma")
    spread = f" ± {math.degrees(error):.1g}" if isinstance(error, float) else ""
    tails = "" if math.isinf(material.nu) else ", with a faint skirt around it"
    share = 100.0 * material.specular_albedo
    width = f"{math.degrees(material.gamma):.3g}{spread}° from its middle to half its height"
    strength = f"; it reflects {share:.2g} % of light that comes straight on" if absolute else ""
    return f"Its highlight is {kind}: {width}{tails}{strength}."


def _beside_the_point(material: MaterialEstimate, key: str) -> bool:
    """Tails and colour of a highlight that is not there."""
    return key in ("nu", "interface_colour") and not material.identifiable.get("gamma", False)
