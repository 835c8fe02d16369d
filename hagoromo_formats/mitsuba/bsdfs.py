"""BSDFs of Mitsuba as our reflectance, where it can hold them, each loss in one line; others are refused by name."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.light.environment import upsampled
from hagoromo.light.spectrum import Spectrum, read_spectrum_file
from hagoromo.reflectance.facets import HALF_OF_GGX, TAILS_OF_GGX
from hagoromo.reflectance.parameters import MATTE
from hagoromo.reflectance.reflectance import LARGEST_BETA, Reflectance
from hagoromo.reflectance.torrance_sparrow import fresnel
from hagoromo_formats.mitsuba.bsdf_numbers import NAME, PLACED, TAKEN
from hagoromo_formats.mitsuba.textures import Values, linear_bitmap, written_bitmap

Table = Mapping[str, Any]
GREY, WHITE = Spectrum.constant(0.5), Spectrum.constant(1.0)
IORS = {"vacuum": 1.0, "air": 1.000277, "water": 1.333, "water ice": 1.31, "polypropylene": 1.49, "bk7": 1.5046,
        "acrylic glass": 1.49, "fused quartz": 1.458, "pyrex": 1.47, "pet": 1.575, "diamond": 2.419,
        "sodium chloride": 1.544, "amber": 1.55, "ethanol": 1.361, "silicone oil": 1.52045}  # fmt: skip
# Linear sRGB, 1 at most, of what metals reflect at normal incidence under D65, by the n and k that Mitsuba 3.9 has
METALS = {"none": (1.0, 1.0, 1.0), "Ag": (0.971, 0.960, 0.915), "Al": (0.913, 0.922, 0.924), "Au": (1.0, 0.782, 0.343),
          "Be": (0.539, 0.538, 0.537), "Cr": (0.635, 0.662, 0.704), "Cu": (0.955, 0.638, 0.538),
          "Hg": (0.781, 0.780, 0.778), "Ir": (0.701, 0.693, 0.656)}  # fmt: skip
MIRROR = {"alpha": 0.0, **MATTE, "body_colour": 1.0}
SMOOTH_COAT = 0.02  # roughness that stands for a smooth coat
CONDUCTOR_N = 10.0  # the largest index: its Fresnel curve is flatter than that of any other
HALVINGS = 10  # of the span of indices
SMALL = 1e-6  # a β whose light is asked


AIR, SAME_INDEX = 1.000277, 1e-3  # refractive index, and how near two are alike


class Converter:
    """Turns BSDFs into tables [surface.reflectance] of a scene.toml. `lost` grows by a line for each loss.

    folder: of the scene's files. out: of the images that are written; None: means stand for them. on_top: whether
    images lie with their first row at v = 1 on the surface that is read; None for one without UVs: means stand, too.
    """

    def __init__(self, folder: Path, lost: list[str], out: Path | None = None) -> None:
        self.folder, self.lost, self.out = folder, lost, out
        self.on_top: bool | None = None
        self.images = 0
        self.glass: list[tuple[dict[str, Any], float, float, str]] = []  # reflectance, index inside, around; whose

    def surface(self, bsdf: Table | None, who: str) -> dict[str, Any] | None:
        """The keys reflectance and optics of a surface; None for one that is not there (null)."""
        if bsdf is None:
            return {"reflectance": self.lambert(GREY)}
        kind = bsdf["type"]
        if kind == "null":
            return None
        if kind in WRAPPERS:
            inner = [part for part in bsdf.values() if isinstance(part, Mapping) and part["type"] in ALL_KINDS]
            made = self.surface(inner[0] if inner else None, who)
            if kind != "twosided" and not self.relief(bsdf, made, who):
                self.say(f"{who}: its {kind}; what it wraps stands alone")
            return made
        if kind not in KINDS:
            raise InputError(
                f"{who} has a bsdf {kind!r}, which is not read: give one of {', '.join(sorted(ALL_KINDS))}"
            )
        return KINDS[kind](self, bsdf, who)

    def say(self, line: str) -> None:
        """Add a line to what is lost, once."""
        if line not in self.lost:
            self.lost.append(line)

    def lambert(self, colour: Spectrum) -> dict[str, Any]:
        """A matt reflectance, whose albedo is the colour."""
        return {**MIRROR, "alpha": 1.0 / math.pi, "body_colour": colour.record()}

    def colour(self, part: Any, default: Spectrum, who: str) -> Spectrum:
        """A texture or number as a spectrum: R, G, B by the basis of Mallett & Yuksel 2019, pictures by their mean."""
        if part is None:
            return default
        if isinstance(part, (int, float)):
            return Spectrum.constant(float(part))
        kind, value = part["type"], part.get("value")
        if kind in ("rgb", "srgb", "uniform", "rawconstant", "spectrum", "constant") and value is not None:
            if kind == "spectrum" and isinstance(value, list) and value and isinstance(value[0], tuple):
                return Spectrum([w for w, _ in value], [v for _, v in value])
            flat = np.broadcast_to(np.asarray(value, float).ravel()[:3], 3)
            return Spectrum.constant(float(flat[0])) if np.ptp(flat) == 0.0 else upsampled(flat)
        if kind == "spectrum" and "filename" in part:
            return read_spectrum_file(inside(self.folder, str(part["filename"])))
        if kind in ("irregular", "regular"):
            return _listed(part)
        if kind == "d65":
            return Spectrum.named("D65") * float(part.get("scale", 1.0))
        if kind == "bitmap":
            self.say(f"{who}: its texture {part.get('filename', '')!r}, of which the mean colour stands")
            linear = linear_bitmap(part, self.folder)
            return upsampled(np.broadcast_to(linear.reshape(-1, linear.shape[2]).mean(axis=0), 3))
        if kind == "mesh_attribute":
            self.say(f"{who}: its values by vertex, {part.get('name', '')!r}, for which half their scale stands")
            return Spectrum.constant(0.5 * float(part.get("scale", 1.0)))
        if kind == "checkerboard":
            self.say(f"{who}: its checkerboard, of which the mean colour stands")
            both = (
                self.colour(part.get(key), Spectrum.constant(x), who) for key, x in (("color0", 0.4), ("color1", 0.2))
            )
            return _mean(*both)
        raise InputError(
            f"{who} has a texture {kind!r}, which is not read: give rgb, a spectrum, bitmap or checkerboard"
        )

    def body(
        self, part: Any, default: Spectrum, who: str, sent: Callable[[Values], Values] = np.asarray
    ) -> tuple[Spectrum, dict[str, Any]]:
        """The body colour of what a base reflects, and the key body_texture of a bitmap on UVs; its colour is then the
        brightest. sent: what the surface sends on of the light that its base reflects.
        """
        if not self.is_placed(part):
            base = _reflecting(self.colour(part, default, who))
            return Spectrum(base.wavelengths, sent(base.values)), {}
        values = sent(np.clip(linear_bitmap(part, self.folder), 0.0, 1.0))
        return Spectrum.constant(float(values.max())), {"body_texture": self.image(values, part)}

    def is_placed(self, part: Any) -> bool:
        """Whether a texture is a bitmap that lies on the UVs of the surface as our images do."""
        if not (isinstance(part, Mapping) and part["type"] == "bitmap" and self.out and self.on_top is not None):
            return False
        return "to_uv" not in part and part.get("wrap_mode", "repeat") == "repeat"

    def relief(self, bsdf: Table, made: dict[str, Any] | None, who: str) -> bool:
        """Whether `made` could take the image of a normalmap or bumpmap."""
        bitmap = next((part for part in bsdf.values() if self.is_placed(part)), None)
        if bitmap is None or not made or made.get("optics"):
            return False
        values = linear_bitmap({"raw": True, **bitmap}, self.folder)
        if bsdf["type"] == "normalmap" and values.shape[-1] == 3:
            made["normal_texture"] = self.image(values, bitmap)
        elif bsdf["type"] == "bumpmap":
            height = float(bsdf.get("scale", 1.0)) * float(bitmap.get("scale", 1.0))
            made["bump_texture"] = self.image(values[..., :1], bitmap) | {"height_mm": 1e3 * height}
        return f"{bsdf['type'].removesuffix('map')}_texture" in made

    def image(self, values: Values, part: Table) -> dict[str, Any]:
        """The table of a texture whose image, of the values of a bitmap, is written."""
        assert self.out is not None
        self.images += 1
        return written_bitmap(values, part, bool(self.on_top), self.out / f"texture_{self.images}.exr")

    def diffuse(self, bsdf: Table, who: str) -> dict[str, Any]:
        """Exact, but for the other side: here both reflect."""
        colour, texture = self.body(bsdf.get("reflectance"), GREY, who)
        return {"reflectance": self.lambert(colour), **texture}

    def plastic(self, bsdf: Table, who: str) -> dict[str, Any]:
        """Body: Lambert's with the light that a diffuse base below the coat sends out; gloss: the coat's facets."""
        n = max(_ior(bsdf.get("int_ior"), 1.49, who) / _ior(bsdf.get("ext_ior"), AIR, who), 1.0)
        out = diffuse_fresnel(n)
        within = 1.0 - (1.0 - out) / (n * n)

        def sent(base: Values) -> Values:
            values = base * (1.0 - out)
            return values * (1.0 - within) / (1.0 - base * within) if bsdf.get("nonlinear", False) else values

        body, texture = self.body(bsdf.get("diffuse_reflectance"), GREY, who, sent)
        rough = bsdf["type"] == "roughplastic"
        self.say(
            f"{who}: how its coat dims the body at grazing angles" + ("" if rough else "; its coat has facets of 0.7°")
        )
        width = float(bsdf.get("alpha", 0.1)) if rough else SMOOTH_COAT
        coat = self.colour(bsdf.get("specular_reflectance"), WHITE, who)
        made = {"alpha": 1.0 / math.pi, "n": n, "body_colour": body.record()}
        return {"reflectance": self.conserving(made | self.facets(bsdf, width, 1.0, who), coat, who), **texture}

    def conductor(self, bsdf: Table, who: str) -> dict[str, Any]:
        """Smooth: a mirror; rough: facets without a body."""
        colour = self.metal(bsdf, who) * self.colour(bsdf.get("specular_reflectance"), WHITE, who)
        if bsdf["type"] == "conductor":
            return {"reflectance": {**MIRROR, "interface_colour": colour.record()}, "optics": "mirror"}
        self.say(f"{who}: the Fresnel curve of its metal")
        width = math.sqrt(
            float(bsdf.get("alpha_u", bsdf.get("alpha", 0.1))) * float(bsdf.get("alpha_v", bsdf.get("alpha", 0.1)))
        )
        facets = self.facets(bsdf, width, 1.0 / float(fresnel(1.0, CONDUCTOR_N)), who)
        return {
            "reflectance": self.conserving({"alpha": 0.0, "n": CONDUCTOR_N, "body_colour": 1.0} | facets, colour, who)
        }

    def metal(self, bsdf: Table, who: str) -> Spectrum:
        """Colour of a metal at normal incidence."""
        if "eta" in bsdf and "k" in bsdf:
            eta, k = (self.colour(bsdf[key], WHITE, who).mean() for key in ("eta", "k"))
            self.say(f"{who}: eta and k by wavelength, of which the means stand")
            return Spectrum.constant(((eta - 1) ** 2 + k * k) / ((eta + 1) ** 2 + k * k))
        name = str(bsdf.get("material", "Cu"))
        if name not in METALS:
            raise InputError(f"{who} is of {name!r}: give eta and k, or one of {', '.join(METALS)}")
        return WHITE if name == "none" else _reflecting(upsampled(METALS[name]))

    def dielectric(self, bsdf: Table, who: str) -> dict[str, Any]:
        """Glass."""
        own, around = _ior(bsdf.get("int_ior"), 1.5046, who), _ior(bsdf.get("ext_ior"), AIR, who)
        if bsdf["type"] == "roughdielectric":
            self.say(f"{who}: its roughness: it is clear glass")
        colours = [self.colour(bsdf.get(key), WHITE, who) for key in ("specular_reflectance", "specular_transmittance")]
        reflectance = {**MIRROR, "n": own / around, "interface_colour": colours[1].record()}
        self.glass.append((reflectance, own, around, who))
        return {"reflectance": reflectance, "optics": "glass"}

    def nest_glass(self) -> None:
        """Give glass whose surroundings have the index of other glass here its own index: it lies within that."""
        for reflectance, own, around, who in self.glass:
            others = [index for _, index, _, _ in self.glass if abs(index - around) < SAME_INDEX]
            if others and abs(around - AIR) > SAME_INDEX:
                reflectance["n"] = own
            n = reflectance["n"]
            if not 1.0 <= n <= 10.0:
                raise InputError(f"{who} is glass of index {n:g} against what is around: give 1 to 10")

    def own(self, bsdf: Table, who: str) -> dict[str, Any]:
        """Our own plugin: as it is."""
        if "file" in bsdf:
            raise InputError(f"{who} names a materials file: give its parameters, or name the file in the scene.toml")
        record: dict[str, Any] = {}
        textures: dict[str, Any] = {}
        for key in TAKEN:
            given = bsdf.get(key)
            if key in PLACED and self.is_placed(given):
                assert isinstance(given, Mapping)
                values = linear_bitmap({**given, "raw": True}, self.folder)[..., :1]
                record[key] = float(values.max()) if key == "beta" else float(values.mean())
                factor = max(record[key], 1e-9) if key == "beta" else 1.0
                textures[f"{key}_texture"] = self.image(values / factor, given)
            elif given is not None:
                record[key] = float(self.colour(given, WHITE, who).mean() if isinstance(given, Mapping) else given)
        if bsdf.get("lobes"):
            record["lobes"] = [[float(x) for x in pair.split()] for pair in str(bsdf["lobes"]).split(",")]
        body, texture = self.body(bsdf.get("body_colour"), WHITE, who)
        interface = self.colour(bsdf.get("interface_colour"), WHITE, who)
        record |= {"body_colour": body.record(), "interface_colour": interface.record()}
        return {"reflectance": record, **textures, **texture}

    def facets(self, bsdf: Table, width: float, factor: float, who: str) -> dict[str, Any]:
        """β and γ of facets of roughness `width`: at the peak D F G / 4 cosθ_r is that of Mitsuba's."""
        width = min(max(width, 1e-3), 1.0)
        record: dict[str, Any] = {"beta": factor / (4.0 * math.pi * width * width)}
        if bsdf.get("distribution", "beckmann") == "ggx":
            return record | {"gamma": math.atan(width * HALF_OF_GGX), "nu": TAILS_OF_GGX}
        return record | {"gamma": math.atan(width * math.sqrt(math.log(2.0)))}

    def conserving(self, record: dict[str, Any], colour: Spectrum, who: str) -> dict[str, Any]:
        """With the colour of its gloss, and so much of it that the surface gives back no more than it receives.

        First its rise at grazing angles is made less, by a larger n with the same light along the normal.
        """
        record = self.flattened(record | {"interface_colour": colour.record()}, colour, who)
        most = largest_beta(record, record["body_colour"], colour)
        part = min(most / max(record["beta"], 1e-30), 1.0)
        if part < 1.0:
            self.say(
                f"{who}: {1.0 - part:.0%} of its gloss, which would give back more than it receives at grazing angles"
            )
        return record | {"beta": part * record["beta"]}

    def flattened(self, record: dict[str, Any], colour: Spectrum, who: str) -> dict[str, Any]:
        """With the least index, its own or above, at which facets as bright along the normal give back no more light
        than the surface receives; CONDUCTOR_N where there is none.
        """
        at_normal = record["beta"] * fresnel(1.0, record["n"])
        if not at_normal > 0.0:
            return record

        def at(n: float) -> dict[str, Any]:
            return record | {"n": n, "beta": at_normal / float(fresnel(1.0, n))}

        def fits(n: float) -> bool:
            return largest_beta(at(n), record["body_colour"], colour) >= at(n)["beta"]

        low, high = float(record["n"]), CONDUCTOR_N
        if low >= high or fits(low):
            return record
        for _ in range(HALVINGS):
            middle = math.sqrt(low * high)
            low, high = (low, middle) if fits(middle) else (middle, high)
        why = f"where it would give back more than it receives: as of n = {high:.3g}"
        self.say(f"{who}: how its gloss rises towards grazing angles, {why}")
        return at(high)


KINDS: dict[str, Callable[[Converter, Table, str], dict[str, Any]]] = {
    "diffuse": Converter.diffuse, "plastic": Converter.plastic, "roughplastic": Converter.plastic,
    "conductor": Converter.conductor, "roughconductor": Converter.conductor, "dielectric": Converter.dielectric,
    "roughdielectric": Converter.dielectric, NAME: Converter.own,
}  # fmt: skip
WRAPPERS = ("twosided", "bumpmap", "normalmap", "mask")
ALL_KINDS = {*KINDS, *WRAPPERS, "null"}


def largest_beta(numbers: Table, body_colour: Any, colour: Spectrum) -> float:
    """The largest β with which a surface gives back no more light than it receives.

    numbers: alpha, gamma, n and nu. body_colour: a number or the record of a spectrum.
    """
    body = body_colour if isinstance(body_colour, float) else Spectrum(**body_colour)
    body = Spectrum.constant(body) if isinstance(body, float) else body
    keys = {key: numbers[key] for key in ("alpha", "gamma", "n")} | {"nu": numbers.get("nu", math.inf)}
    left = 1.0 - Reflectance(beta=0.0, body_colour=body, **keys).body_albedo
    glossy = Reflectance(beta=SMALL, body_colour=Spectrum.constant(0.0), interface_colour=colour, **keys)
    return min(SMALL * left / max(float(glossy.directional_albedo().max()), 1e-30), LARGEST_BETA)


def diffuse_fresnel(n: float) -> float:
    """Share of even light from outside that a dielectric of index n reflects: 2 ∫ F(μ) μ dμ."""
    nodes, weights = np.polynomial.legendre.leggauss(64)
    cosines = 0.5 * (nodes + 1.0)
    return float(np.sum(weights * cosines * np.array([fresnel(c, n) for c in cosines.tolist()])))


def _reflecting(colour: Spectrum) -> Spectrum:
    """A reflectance of 0…1: upsampled colours may go a little beyond."""
    return Spectrum(colour.wavelengths, np.clip(colour.values, 0.0, 1.0))


def _ior(value: Any, default: float, who: str) -> float:
    if value is None:
        return default
    if isinstance(value, str):
        if value not in IORS:
            raise InputError(
                f"{who} is of {value!r}, whose index is not known: give a number, or one of {', '.join(IORS)}"
            )
        return IORS[value]
    return float(value)


def _listed(part: Table) -> Spectrum:
    """irregular and regular spectra, whose numbers are texts."""
    values = [float(x) for x in str(part["values"]).replace(",", " ").split()]
    if part["type"] == "regular":
        low, high = (float(part[key]) for key in ("wavelength_min", "wavelength_max"))
        return Spectrum(np.linspace(low, high, len(values)), values)
    return Spectrum([float(x) for x in str(part["wavelengths"]).replace(",", " ").split()], values)


def _mean(one: Spectrum, two: Spectrum) -> Spectrum:
    waves = np.union1d(one.wavelengths, two.wavelengths)
    return Spectrum(waves, 0.5 * (one.held(waves[0], waves[-1]).at(waves) + two.held(waves[0], waves[-1]).at(waves)))
