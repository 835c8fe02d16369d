"""The material that glTF 2.0 and UsdPreviewSurface share, by roughness and metallic, and our reflectance, both ways.

Their facets are GGX with a = roughness² (Walter et al. 2007). Ours are half as dense at γ, tan γ = a √(√2 − 1), and as
bright at the peak: β = s / (4π a²), s the factor on Fresnel's F. The body has 1 − s F0 of the base colour, F0 along the
normal: programs give it the light that the gloss leaves.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.files.exr import write_exr
from hagoromo.files.udim import MARK
from hagoromo.image.scene.surface import Surface
from hagoromo.image.scene.tiled_image import Tiles
from hagoromo.light.colour import linear_colour
from hagoromo.light.environment import upsampled
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.facets import HALF_OF_GGX, TAILS_OF_GGX
from hagoromo.reflectance.parameters import lost
from hagoromo.reflectance.reflectance import LARGEST_BETA
from hagoromo.reflectance.torrance_sparrow import normal_fresnel
from hagoromo_formats.mitsuba.bsdfs import CONDUCTOR_N, Converter, largest_beta

WIDEST = 1.5  # rad, of a tangent
NARROWEST = 2e-4  # a, of maps
MOST_DIELECTRIC = 0.2  # F0 of n = 2.6; what reflects more without a metal is taken to have the n of its F0
CHECKED = 1.06  # γ at which surfaces are checked, over that of a place
NARROW = 0.1  # share of places that may be narrower than what a Fresnel curve is made for
STEPS = 24  # of γ, at which the largest β of maps is asked
Array = NDArray[np.float64]


class PbrMaterial(NamedTuple):
    """base: linear R, G, B, 0…1. n: refractive index. specular: factor on F; None: not stated. tint: factor on F0.

    roughness_map, specular_map: (h, w), 0…1, factors on the UVs. smooth: whether they are interpolated. tiles: those of
    UDIM that they are laid together from. textured: the base colour differs from place to place, and base is the
    largest.
    """

    base: Array
    roughness: float = 1.0
    metallic: float = 0.0
    n: float = 1.5
    specular: float | None = None
    tint: Array = np.ones(3)
    glass: bool = False
    textured: bool = False
    roughness_map: NDArray[Any] | None = None
    specular_map: NDArray[Any] | None = None
    smooth: bool = True
    tiles: Tiles | None = None

    @property
    def mapped(self) -> bool:
        """Whether its gloss differs from place to place."""
        return self.roughness_map is not None or self.specular_map is not None

    @property
    def share(self) -> float:
        """Share of the base colour that the gloss leaves to the body, above 0; on the mean of a map."""
        mean = 1.0 if self.specular_map is None else float(np.mean(self.specular_map))
        taken = mean * min(normal_fresnel(self.n) * float(np.max(self.tint)), 1.0)
        return max(1.0 - (1.0 if self.specular is None else self.specular) * taken, 0.01)


def roughness_of(gamma: ArrayLike) -> Array:
    """Roughness 0…1 of half widths γ [rad] of facets; wider ones than GGX has are 1."""
    return np.sqrt(np.minimum(np.tan(np.minimum(np.asarray(gamma, np.float64), WIDEST)) / HALF_OF_GGX, 1.0))


def pbr_of(surface: Surface, on_uvs: bool = True) -> PbrMaterial:
    """What is nearest to the reflectance of a surface; colours are those under D65.

    on_uvs: whether images of γ and β become maps of 8 bits. The base colour of a body_texture is its factor.
    """
    made, optics = surface.reflectance, surface.optics
    colour = linear(made.interface_colour)
    if optics == "glass":
        return PbrMaterial(np.clip(colour, 0.0, 1.0), 0.0, n=made.n, glass=True)
    if optics:
        return PbrMaterial(np.clip(colour, 0.0, 1.0), 0.0, 1.0)
    gamma, beta = (
        None if each is None or each.of != "image" or not on_uvs else each.values[..., 0]
        for each in (surface.gamma_texture, surface.beta_texture)
    )
    if not made.beta > 0.0:
        gamma = beta = None
    rough = np.asarray(roughness_of(made.gamma) if made.beta > 0.0 else 1.0)
    if gamma is not None:
        rough = np.maximum(np.round(255.0 * roughness_of(gamma)), 1.0) / 255.0
    if gamma is not None and beta is not None and gamma.shape != beta.shape:
        rough, beta = of_one_size(rough, beta)
    strength = specular_of(made.beta if beta is None else made.beta * beta, rough)
    top = float(strength.max())
    maps = {
        "roughness_map": None if gamma is None else rough,
        "specular_map": None if strength.ndim == 0 or not np.ptp(strength) > 0.0 else strength / top,
        "smooth": all(each is None or each.smooth for each in (surface.gamma_texture, surface.beta_texture)),
    }
    fixed = 1.0 if gamma is not None else float(rough)
    found = PbrMaterial(np.ones(3), fixed, 0.0, made.n, min(top, 1.0), colour * max(top, 1.0), **maps)
    body = np.pi * made.alpha * (np.ones(3) if surface.body_texture else linear(made.body_colour)) / found.share
    return found._replace(base=body, textured=surface.body_texture is not None)


def specular_of(beta: ArrayLike, roughness: ArrayLike) -> Array:
    """The factor s on F by which GGX is as bright at its peak as facets of β [1/sr]."""
    return 4.0 * math.pi * np.asarray(roughness, np.float64) ** 4 * np.asarray(beta, np.float64)


def lost_gloss(surfaces: Sequence[Surface], form: str) -> Iterator[str]:
    """What such a material of glTF or USD does not hold of the gloss and body of surfaces, a line each."""
    for surface in surfaces:
        made = surface.reflectance
        if surface.optics:
            continue
        if said := lost(form, made):
            yield f"surface {surface.name!r}: {said}"
        if made.beta > 0.0 and surface.gamma_texture is None and math.tan(min(made.gamma, WIDEST)) > HALF_OF_GGX:
            yield f"surface {surface.name!r}: facets wider than the widest of GGX, 33°"


def linear(spectrum: Spectrum) -> Array:
    """Linear sRGB of a lamp or, under D65, of a reflectance; (1, 1, 1) of a constant spectrum of 1."""
    if np.ptp(spectrum.values) == 0.0:
        return np.full(3, spectrum.values[0])
    return np.clip(linear_colour(spectrum, Spectrum.named("D65")), 0.0, None)


def surface_of(given: PbrMaterial, to: Converter, who: str, folder: Path, name: str) -> dict[str, Any]:
    """The keys reflectance, optics, beta_texture and gamma_texture of a surface; what is lost is said by `to`.

    A textured body keeps the alpha, and its largest colour in place of the texture.
    Maps become files in `folder` whose names begin with `name`.
    """
    numbers = (*given.base, *given.tint, given.roughness, given.metallic, given.n, given.specular or 0.0)
    if not np.isfinite(numbers).all():
        raise ValueError(f"{who} has numbers that are not finite")
    n, rough = min(max(given.n, 1.0), CONDUCTOR_N), min(max(given.roughness, 0.0), 1.0)
    base, metal = np.clip(given.base, 0.0, 1.0), min(max(given.metallic, 0.0), 1.0)
    if given.glass:
        kind = "roughdielectric" if rough else "dielectric"
        glass = {"type": kind, "int_ior": n, "ext_ior": 1.0, "specular_transmittance": rgb(base)}
        return to.surface(glass, who) or {}
    plain = rough >= 1.0 and given.roughness_map is None
    if metal > 0.0 and (given.textured or plain):
        to.say(f"{who}: its metal ({metal:g}), of which the colour is the body's")
        metal = 0.0
    elif metal >= 1.0 and not rough:
        mirror = {"type": "conductor", "material": "none", "specular_reflectance": rgb(base)}
        return to.surface(mirror, who) or {}
    elif metal > 0.0:
        to.say(f"{who}: the Fresnel curve of its metal ({metal:g}), in place of which a dielectric's stands")
    specular = given.specular if given.specular is not None else float(not plain)
    share = 1.0 if given.specular_map is None else float(np.mean(given.specular_map))
    peak = (1.0 - metal) * specular * np.minimum(normal_fresnel(n) * given.tint, 1.0) + metal * base
    top = float(peak.max())
    body = _spectrum(base.max() if given.textured else base)
    if not top * share > 0.0:
        return {"reflectance": {**to.lambert(body), "alpha": (1.0 - metal) / math.pi}}
    if metal > 0.0 or top > MOST_DIELECTRIC:
        n = min((1.0 + math.sqrt(top)) / max(1.0 - math.sqrt(top), 1e-3), CONDUCTOR_N)
    if not metal and top > MOST_DIELECTRIC:
        to.say(f"{who}: its Fresnel curve, in place of which that of n = {n:.3g} stands")
    strength = top / normal_fresnel(n)
    narrowest = max(math.sqrt(strength / (4.0 * math.pi * LARGEST_BETA)), NARROWEST)
    alpha = (1.0 - metal) * max(1.0 - top * share, 0.0) / math.pi
    made = {"alpha": alpha, "n": n, "nu": TAILS_OF_GGX, "body_colour": body.record()}
    to.say(f"{who}: how its gloss dims the body at grazing angles")
    if not given.mapped:
        width = max(rough * rough, narrowest)
        facets = {"beta": strength / (4.0 * math.pi * width**2), "gamma": math.atan(width * HALF_OF_GGX)}
        return {"reflectance": to.conserving(made | facets, _spectrum(peak / top), who)}
    return _mapped(given, made, (strength, narrowest, rough), _spectrum(peak / top), to, who, folder / name)


def _mapped(
    given: PbrMaterial, made: dict[str, Any], numbers: tuple[float, float, float], colour: Spectrum,
    to: Converter, who: str, stem: Path,
) -> dict[str, Any]:  # fmt: skip
    """The keys of a surface with maps. Each place keeps β to what its neighbours, too, may have at its γ."""
    strength, narrowest, rough = numbers
    first, second = of_one_size(given.roughness_map, given.specular_map)
    width = np.maximum((rough * first) ** 2, narrowest)
    gamma, beta = np.arctan(width * HALF_OF_GGX), strength * second / (4.0 * math.pi * width**2)
    around = gamma
    if given.smooth:
        for axis in (0, 1):
            around = np.maximum(around, np.maximum(np.roll(around, 1, axis), np.roll(around, -1, axis)))
    steps = np.geomspace(float(around.min()), float(around.max()) * 1.0001, STEPS)
    one = {"gamma": float(np.quantile(gamma, NARROW)), "beta": float(np.quantile(beta, 1.0 - NARROW))}
    flat = to.flattened(made | one, colour, who)
    made, beta = made | {"n": flat["n"]}, beta * flat["beta"] / one["beta"]
    keys = {"alpha": made["alpha"], "n": made["n"], "nu": made["nu"]}
    most = np.array([largest_beta({**keys, "gamma": CHECKED * x}, made["body_colour"], colour) for x in steps])
    allowed = np.minimum(most[np.minimum(np.searchsorted(steps, around), STEPS - 1)], LARGEST_BETA)
    kept = np.minimum(beta, allowed)
    if (less := 1.0 - float(kept.sum() / max(beta.sum(), 1e-30))) > 1e-3:
        to.say(f"{who}: {less:.0%} of its gloss, which would give back more than it receives at grazing angles")
    top = float(kept.max())
    keys = {"beta": top, "gamma": float(gamma.flat[kept.argmax()]), "interface_colour": colour.record()}
    tables: dict[str, Any] = {"reflectance": made | keys}
    rest = {} if given.smooth else {"smooth": False}
    if np.ptp(gamma) > 0.0:
        tables["gamma_texture"] = {"file": _map(stem, "gamma", gamma, given.tiles), **rest}
    if np.ptp(kept) > 0.0:
        tables["beta_texture"] = {"file": _map(stem, "beta", kept / top, given.tiles), **rest}
    return tables


def of_one_size(rough: NDArray[Any] | None, specular: NDArray[Any] | None) -> tuple[Array, Array]:
    """Both maps, the smaller one enlarged; ones for one that is not there."""
    shapes = [each.shape for each in (rough, specular) if each is not None]
    shape = tuple(np.max(shapes, axis=0).tolist())
    return enlarged(rough, shape), enlarged(specular, shape)


def enlarged(values: NDArray[Any] | None, shape: tuple[int, int]) -> Array:
    """A map (h, w) with that many places, each the nearest one; ones in place of None."""
    if values is None:
        return np.ones(shape)
    rows, columns = (np.arange(new) * old // new for new, old in zip(shape, values.shape, strict=True))
    return values[np.ix_(rows, columns)].astype(np.float64)


def _map(stem: Path, what: str, values: Array, tiles: Tiles | None) -> str:
    name, stored = f"{stem.name}_{what}", np.clip(values, 0.0, None).astype(np.float32)
    file = f"{name}.{MARK}.exr" if tiles else f"{name}.exr"
    for each, part in (tiles.cuts(stored, file) if tiles else {file: stored}).items():
        write_exr(stem.with_name(each), {"Y": part})
    return file


def rgb(colour: Any) -> dict[str, Any]:
    """A colour as a texture of Mitsuba."""
    return {"type": "rgb", "value": np.clip(np.asarray(colour, float), 0.0, 1.0)}


def _spectrum(colour: Any) -> Spectrum:
    """A reflectance 0…1 of linear sRGB; a constant one of greys."""
    flat = np.broadcast_to(np.asarray(colour, float), 3)
    if np.ptp(flat) == 0.0:
        return Spectrum.constant(float(flat[0]))
    made = upsampled(flat)
    return Spectrum(made.wavelengths, np.clip(made.values, 0.0, 1.0))
