"""OpenPBR: the surface of that model for a measured material, and how far its light is off.

OpenPBR 1.1 (Academy Software Foundation), of which a dielectric over a rough diffuse base is used here:
f = e F D G₂ / (4 cosθ_i cosθ_r) + (1 − E(θ_r)) f_EON, with the facets of GGX and the masking of Heitz (2014),
α = roughness², F of an index whose reflectance along the normal is specular_weight times that of specular_ior, E the
albedo of the interface, and f_EON of Portsmouth, Kutz and Hill, "EON: A Practical Energy-Preserving Rough Diffuse
BRDF" (2024). Light between facets, which some renderers add, is left out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.torrance_sparrow import normal_fresnel
from hagoromo_formats.relightable.measured_brdf import CHANNELS, FAINT, measured_brdf
from hagoromo_formats.relightable.mesh import roughness
from hagoromo_page.publication.lit import three_channels

Array = NDArray[np.float64]
POLAR, ROUND = 256, 96  # half vectors of the integrals: over √θ, and over half a turn
LAMPS = (0.0, 30.0, 60.0)  # [°] from the normal, under which the difference is stated
ALBEDO_ANGLES = np.radians(np.linspace(0.0, 89.0, 24))
LARGEST_F0 = 0.99999
EVEN = 2.0 / 3.0 - 28.0 / (15.0 * np.pi)  # of s/t under even light: mean of what roughness adds to Lambert's law


class EyeDirections(NamedTuple):
    """Directions to the eye for one to the lamp, over half vectors: cosines (N,), L·V, and solid angles [sr]."""

    lamp: float
    eye: Array
    half: Array
    deviation: Array
    weight: Array
    to_eye: Array


@dataclass(frozen=True)
class OpenPbr:
    """The parameters of OpenPBR that a measured material has; the others are as they are by default."""

    base_color: tuple[float, float, float]
    base_diffuse_roughness: float
    specular_weight: float
    specular_color: tuple[float, float, float]
    specular_roughness: float
    specular_ior: float

    def brdf(self, pairs: EyeDirections, albedo: Callable[[Array], Array]) -> Array:
        """f (N, 3) [1/sr]. albedo: of the interface, of the cosine to the eye."""
        gloss = self.interface(pairs)
        shared = 1.0 - albedo(pairs.eye)
        return gloss[:, None] * np.array(self.specular_color) + shared[:, None] * self._eon(pairs)

    def interface(self, pairs: EyeDirections) -> Array:
        """F D G₂ / (4 cosθ_i cosθ_r) (N,), without its colour."""
        alpha = self.specular_roughness**2
        tan2 = 1.0 / np.maximum(pairs.half, 1e-9) ** 2 - 1.0
        density = 1.0 / (np.pi * alpha**2 * np.maximum(pairs.half, 1e-9) ** 4 * (1.0 + tan2 / alpha**2) ** 2)
        slopes = [0.5 * (np.sqrt(1.0 + alpha**2 * (1.0 / cosine**2 - 1.0)) - 1.0) for cosine in (pairs.lamp, pairs.eye)]
        masking = 1.0 / (1.0 + slopes[0] + slopes[1])
        return density * masking * _fresnel(pairs.deviation, self._index()) / (4.0 * pairs.lamp * pairs.eye)

    def albedo(self) -> Callable[[Array], Array]:
        """Albedo of the interface, of the cosine between normal and eye."""
        sent = []
        for angle in ALBEDO_ANGLES:
            pairs = directions(float(angle))
            sent.append(float((self.interface(pairs) * pairs.eye * pairs.weight).sum()))
        table = np.minimum(sent, 1.0)
        return lambda cosine: np.interp(np.arccos(np.clip(cosine, -1.0, 1.0)), ALBEDO_ANGLES, table)

    def _index(self) -> float:
        """The index with `specular_weight` times the reflectance along the normal."""
        root = np.sqrt(min(self.specular_weight * normal_fresnel(self.specular_ior), LARGEST_F0))
        return float((1.0 + root) / (1.0 - root))

    def _eon(self, pairs: EyeDirections) -> Array:
        r, colour = self.base_diffuse_roughness, np.array(self.base_color)
        a, mean = _single(r)
        s = 2.0 * pairs.deviation**2 - 1.0 - pairs.lamp * pairs.eye
        single = a * (1.0 + r * s / np.where(s > 0.0, np.maximum(pairs.lamp, pairs.eye), 1.0)) / np.pi
        rest = (1.0 - _rough_albedo(np.array([pairs.lamp]), r, a)) * (1.0 - _rough_albedo(pairs.eye, r, a))
        again = colour**2 * mean / (1.0 - colour * (1.0 - mean)) / np.pi
        return single[:, None] * colour + (rest / max(1.0 - mean, 1e-9))[:, None] * again


def open_pbr(material: MaterialEstimate) -> OpenPbr:
    """The surface with the material's n, half width and peak of the highlight, and with its body under even light.

    What is beyond the range of a parameter is cut off; `difference` says what that costs.
    """
    rough, width = float(np.clip(material.sigma, 0.0, 1.0)), roughness(material)
    colour = three_channels(np.array(material.interface_colour))
    bright = float(colour.max())
    # D(0)/4 of GGX is 1/(4 π α²): β F₀ e = weight F₀ e/max(e) / (4 π α²)
    weight = 4.0 * np.pi * width**4 * material.beta * bright if material.beta > 0.0 else 0.0
    tint = tuple(float(one) for one in (colour / bright if bright > 0.0 else np.ones(3)))
    bare = OpenPbr((0.0, 0.0, 0.0), rough, float(weight), tint, width, material.n)  # type: ignore[arg-type]
    albedo, cosine = bare.albedo(), np.linspace(0.005, 0.995, 100)
    kept = 1.0 - 2.0 * float((albedo(cosine) * cosine).mean())  # of even light, by the interface to the body
    even = (
        np.pi * material.alpha * three_channels(np.array(material.body_colour)) * (1.0 + EVEN * rough) / max(kept, 1e-6)
    )
    _, mean = _single(rough)
    base = tuple(float(one) for one in np.clip(even / (mean + even * (1.0 - mean)), 0.0, 1.0))
    return OpenPbr(base, rough, bare.specular_weight, bare.specular_color, width, material.n)  # type: ignore[arg-type]


def difference(material: MaterialEstimate, surface: OpenPbr) -> tuple[float, ...]:
    """Σ |f − f'| cosθ_r over Σ f cosθ_r, over all eyes and channels, for each of the lamps at `LAMPS`."""
    made, albedo = measured_brdf(material, None, None).reflectance, surface.albedo()
    found = []
    for angle in np.radians(LAMPS):
        pairs = directions(float(angle))
        to_lamp = np.array([np.sin(angle), 0.0, np.cos(angle)])
        ours = made.evaluate([0.0, 0.0, 1.0], to_lamp, pairs.to_eye, CHANNELS) / (FAINT * pairs.lamp)
        weight = (pairs.eye * pairs.weight)[:, None]
        off = np.abs(surface.brdf(pairs, albedo) - ours)
        found.append(float((off * weight).sum() / max((ours * weight).sum(), 1e-300)))
    return tuple(found)


def directions(angle: float) -> EyeDirections:
    """All directions to the eye, for a lamp at `angle` [rad] from the normal, even over half vectors in √θ and φ."""
    u, turn = (np.arange(POLAR) + 0.5) / POLAR, np.pi * (np.arange(ROUND) + 0.5) / ROUND
    polar = (0.5 * np.pi * u**2)[:, None]
    half = np.stack([np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar) + 0.0 * turn], -1)
    half = half.reshape(-1, 3)
    lamp = np.array([np.sin(angle), 0.0, np.cos(angle)])
    deviation = half @ lamp
    eye = 2.0 * deviation[:, None] * half - lamp
    # dω_r = 4 cosθ_Q dω_m, dω_m = sinθ dθ dφ, dθ = π u du; both halves of the turn are alike
    patch = 2.0 * (np.pi / ROUND) * (np.sin(polar) * np.pi * u[:, None] / POLAR + 0.0 * turn).ravel()
    seen = (eye[:, 2] > 1e-4) & (deviation > 0.0)
    weight = 4.0 * deviation * patch
    return EyeDirections(float(np.cos(angle)), eye[seen, 2], half[seen, 2], deviation[seen], weight[seen], eye[seen])


def _fresnel(c: Array, n: float) -> Array:
    g = np.sqrt(n**2 + c**2 - 1.0)
    return 0.5 * ((g - c) / (g + c)) ** 2 * (1.0 + ((c * (g + c) - 1.0) / (c * (g - c) + 1.0)) ** 2)


def _single(r: float) -> tuple[float, float]:
    """Factor on Lambert's law of the single scattering of EON, and its albedo for white under even light."""
    a = 1.0 / (1.0 + (0.5 - 2.0 / (3.0 * np.pi)) * r)
    return a, a * (1.0 + EVEN * r)


def _rough_albedo(cosine: Array, r: float, a: float) -> Array:
    """Albedo of the single scattering of EON for white, of the cosine to the normal."""
    angle, sine = np.arccos(np.clip(cosine, -1.0, 1.0)), np.sqrt(np.maximum(1.0 - cosine**2, 0.0))
    g = sine * (angle - sine * cosine) + 2.0 / 3.0 * (sine / np.maximum(cosine, 1e-9) * (1.0 - sine**3) - sine)
    return a * (1.0 + r * g / np.pi)
