"""Gloss maps: β and γ of every pixel where the data ask for it, each with its error; n stays its material's.

Enters: a capture of known shape, its materials and their labels. Leaves: maps, and per material what was found of the
variation, in its record; no map where one gloss goes with every material. A pixel that no lamp shows near its
highlight has its material's middle, and the spread over the material as its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.gloss.gloss_difference import WIDTHS, Lobe, glosses_differ
from hagoromo.measurement.gloss.gloss_record import with_gloss
from hagoromo.measurement.gloss.gloss_spread import GlossSpread, gloss_spread
from hagoromo.measurement.gloss.pixel_gloss import PixelFit, PixelGloss
from hagoromo.measurement.material.quantity import theta_of
from hagoromo.measurement.material.segment import interior
from hagoromo.measurement.observations import Observations, Pixels, known_shape, observations, observed
from hagoromo.measurement.sight import Array
from hagoromo.photograph.capture import Capture
from hagoromo.reflectance.material.material_estimate import MaterialEstimate

FEWEST_PHOTOGRAPHS = 6  # β, γ and a body need three angles in each pixel: fewer lamps give them to a few pixels only
MOST_VALUES = 1_000_000  # solved at once: 0.5 GiB
SEED = 0  # of the choice of pixels that the spread is learnt from


@dataclass(frozen=True, eq=False)
class GlossMap:
    """Gloss (h, w), NaN where unknown: β [1/sr] and γ [rad], their standard errors, and α c_b with its own (h, w, C).

    Errors are those of a logarithm times the value: the 95 % interval of β is β exp(±1.96 error/β).
    Those of pixels that are hardly told rest on the law being theirs too: a patch that dims the very gloss it would be
    told by has intervals that are too narrow.
    """

    beta: Array
    gamma: Array
    beta_error: Array
    gamma_error: Array
    body: Array
    body_error: Array

    def channels(self) -> dict[str, NDArray[np.float32]]:
        """As an EXR has it: 0 where unknown."""
        maps = {
            "beta": self.beta, "gamma": self.gamma, "error.beta": self.beta_error, "error.gamma": self.gamma_error,
        }  # fmt: skip
        return {name: np.where(np.isfinite(one), one, 0.0).astype(np.float32) for name, one in maps.items()}


def gloss_map(
    capture: Capture, labels: NDArray[np.integer], materials: Sequence[MaterialEstimate], white: Array | None = None
) -> tuple[tuple[MaterialEstimate, ...], GlossMap | None]:
    """The materials with what was found of their gloss, and the maps where it varies in one of them at least.

    labels: (h, w) index into `materials`. white: (C,) colour of the lamps where it was measured.
    """
    found = [_spread(capture, labels, number, material, white) for number, material in enumerate(materials)]
    told = tuple(
        material if spread is None else with_gloss(material, spread)
        for material, spread in zip(materials, found, strict=True)
    )
    if not any(spread is not None and spread.varies for spread in found):
        return told, None
    shape = (*labels.shape, capture.photographs[0].values.shape[2])
    maps = GlossMap(*(np.full(shape[:2], np.nan) for _ in range(4)), *(np.full(shape, np.nan) for _ in range(2)))
    for number, (material, spread) in enumerate(zip(told, found, strict=True)):
        pixels = Pixels.where(capture, (labels == number) & known_shape(capture))
        if spread is not None and spread.varies:
            _fill(maps, capture, pixels, spread, white)
        else:
            at = pixels.rows, pixels.columns
            for key in ("beta", "gamma"):
                getattr(maps, key)[at] = getattr(material, key)
                getattr(maps, f"{key}_error")[at] = material.standard_error.get(key) or np.nan
    return told, maps


def _spread(
    capture: Capture, labels: NDArray[np.integer], number: int, material: MaterialEstimate, white: Array | None
) -> GlossSpread | None:
    """How the gloss of a material varies; None where too little is seen of it."""
    if len(capture.photographs) < FEWEST_PHOTOGRAPHS or not material.identifiable["gamma"]:
        return None
    region = known_shape(capture) & interior(labels, number)
    seen = observations(capture, region, white, SEED)
    theta = theta_of(np.ones(seen.channels), material.beta, material.gamma, material.n)
    start = np.array([np.log(theta[-3]), theta[-2]])
    found = gloss_spread(seen, start, material.n, is_given=not material.identifiable["n"])
    if found is None or not found.varies:
        return found
    return replace(found, follows_angles=not _is_of_the_pixels(capture, seen, found))


def _is_of_the_pixels(capture: Capture, seen: Observations, spread: GlossSpread) -> bool:
    """Whether pixels of much and of little gloss differ under the same angles too: a lobe of a wrong shape does not.

    `glosses_differ` reads the facets' density off both halves without a model of it; they are parted by β, or by γ.
    """
    fit = PixelFit(seen, spread.n, spread.noise)
    gloss, region = fit.solve(spread.law).gloss, np.zeros(capture.photographs[0].mask.shape, bool)
    region.flat[fit.pixels] = True
    pixels = Pixels.where(capture, region)  # in the order of `fit`
    for quantity in range(2):
        half = (gloss[:, quantity] > np.median(gloss[:, quantity])).astype(np.int64)
        lobes = [_lobe(gloss[half == i].mean(axis=0)) for i in range(2)]
        if glosses_differ(capture, pixels, half, lobes):
            return True
    return False


def _lobe(gloss: Array) -> Lobe:
    return Lobe(int(np.argmin(np.abs(np.log(WIDTHS) - gloss[1]))), float(np.exp(gloss[0])))


def _fill(maps: GlossMap, capture: Capture, pixels: Pixels, spread: GlossSpread, white: Array | None) -> None:
    """Solve `pixels` of one material and put them into `maps`; the error of its n joins theirs."""
    at = pixels.rows, pixels.columns
    mean = np.exp(spread.law.mean) * (spread.beta_per_strength, 1.0)
    error = mean * np.sqrt(np.diag(spread.law.covariance) + spread.variance_by_n)
    for k, key in enumerate(("beta", "gamma")):
        getattr(maps, key)[at], getattr(maps, f"{key}_error")[at] = mean[k], error[k]
    values = len(capture.photographs) * maps.body.shape[2]
    size = max(MOST_VALUES // values, 1)
    for start in range(0, len(pixels), size):
        seen = observed(capture, pixels[np.arange(start, min(start + size, len(pixels)))], white)
        if not seen.used.any():
            continue
        fit = PixelFit(seen, spread.n, spread.noise)
        _put(maps, np.divmod(fit.pixels, maps.beta.shape[1]), fit.solve(spread.law), spread)


def _put(maps: GlossMap, at: tuple[NDArray, NDArray], found: PixelGloss, spread: GlossSpread) -> None:
    value = np.exp(found.gloss) * (spread.beta_per_strength, 1.0)
    error = value * np.sqrt(np.einsum("pii->pi", found.covariance) + spread.variance_by_n)
    maps.beta[at], maps.gamma[at] = value.T
    maps.beta_error[at], maps.gamma_error[at] = error.T
    known = found.body_error > 0.0  # 0 where a channel was not seen
    maps.body[at] = np.where(known, found.body, np.nan)
    maps.body_error[at] = np.where(known, found.body_error, np.nan)
