"""Shadow light: what the light is that lies in the shadows which an object throws on itself.

    value_k(p) = u own_k(p) + r body(p) + g mean_k

own is light from the object itself as its photographs let expect it, body the same light from all around in all
photographs, as of a room, and mean_k the mean of photograph k, of which a lens scatters a share over the whole picture.
u, r and g follow from all pixels that turn away from a lamp, and their errors from the residuals of tiles of the image.
Light that is not in the fit of the body moves bodies of pixels, too, so body is once that of the pixel and once the
median of its material: what fits better counts, and the difference is part of the errors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.views import Array
from hagoromo.measurement.photometric.terms.glare import change
from hagoromo.photograph.capture import Capture

SHADOW_COSINE = -0.05  # of normal and lamp: below, a pixel turns away from the lamp although the normal is a bit off
TILES = 4  # across the image: the light in shadows is compared over independent parts of it
FEWEST_TILES = 4
LEAST_DIFFERENT = 1e-9  # least eigenvalue of the correlations of sources, above which rounding is not all
OPEN_ERROR = 0.25  # of the light in shadows: a source that is known no better is open
AS_GOOD = 4.0  # times the least χ²: a version of the body that leaves no more may be the true one
SIGNIFICANT = 3.0  # standard errors
NOTABLE = 0.005  # of the light where a lamp shines: with less in shadows nothing is said
OWN, ROOM, GLARE = range(3)
WORDS = ("light from the object itself", "light of the room", "veiling glare of the lens")
ADVICE = (
    "--own-light subtract takes it out",
    "take a photograph with all lamps off, and subtract it",
    "--estimate glare takes it out",
)


class SourceStrengths(NamedTuple):
    """Strengths (k,) of sources and their covariance; explained: fall of χ²; mean: (k,) in shadows, of strength 1."""

    strength: Array
    covariance: Array
    explained: float
    mean: Array

    @property
    def error(self) -> Array:
        """(k,) standard errors."""
        return np.sqrt(np.diagonal(self.covariance))


@dataclass(frozen=True, eq=False)
class ShadowLight:
    """Normal equations of the sources OWN, ROOM and GLARE by T tiles: square (V, T, 3, 3) and towards (V, T, 3), of V
    versions of the body. power: (T,) sum of the squares of what is explained. mean: (V, 3) of a source of strength 1 in
    the shadows; dark, lit: mean values there, and where a lamp shines.
    """

    square: Array
    towards: Array
    power: Array
    mean: Array
    dark: float
    lit: float

    def shown(self, source: int) -> NDArray[np.bool_]:
        """(T,) tiles in whose shadows there would be light of a source."""
        there = self.square[0, :, source, source]
        return there > 1e-3 * there.max(initial=0.0)

    def solved(self, sources: Sequence[int]) -> SourceStrengths | None:
        """The strengths of some sources, without the others; None where they look the same, or too few tiles show the
        first.
        """
        tiles = self.shown(sources[0])
        if tiles.sum() < max(FEWEST_TILES, len(sources) + 1):
            return None
        found = [
            _least_squares(square[tiles][:, sources][:, :, sources], towards[tiles][:, sources], mean[sources])
            for square, towards, mean in zip(self.square, self.towards, self.mean, strict=True)
        ]
        versions = [one for one in found if one is not None]
        if len(versions) < len(found):
            return None
        best, power = max(versions, key=lambda one: one.explained), float(self.power[tiles].sum())
        covariance, least = best.covariance.copy(), power - best.explained
        for one in versions:
            away = one.strength - best.strength
            if power - one.explained < AS_GOOD * least:
                covariance += np.outer(away, away)
        return best._replace(covariance=covariance)

    @property
    def glares(self) -> bool:
        """Whether there is veiling glare beside what light of the object and of the room explain."""
        others = [one for one in (OWN, ROOM) if self.shown(one).sum() >= FEWEST_TILES]
        found = self.solved([*others, GLARE])
        return found is not None and bool(found.strength[-1] > SIGNIFICANT * found.error[-1])

    @property
    def sentence(self) -> str:
        """What the light in the shadows is, with standard errors, and what cannot be separated; "" where it is little.

        Shares are of the light where a lamp shines.
        """
        if not self.dark > NOTABLE * self.lit:
            return ""
        sources = [one for one in (OWN, ROOM, GLARE) if self.shown(one).sum() >= FEWEST_TILES]
        found = self.solved(sources) if sources else None
        if found is None:
            return f"{self._dark_words}: what it is cannot be separated here"
        light, error = found.strength * found.mean, found.error * found.mean
        if (light < -SIGNIFICANT * error).any():  # no light is negative: a source that is not among these
            return f"{self._dark_words}: no sum of the sources known explains it"
        is_open = error > OPEN_ERROR * self.dark
        known = [
            f"{WORDS[one]} {100 * light[i] / self.lit:z.2f} ± {100 * error[i] / self.lit:z.2f} %"
            + (f" ({ADVICE[one]})" if light[i] > max(SIGNIFICANT * error[i], NOTABLE * self.lit) else "")
            for i, one in enumerate(sources)
            if not is_open[i]
        ]
        if is_open.any():
            together = np.where(is_open, found.mean, 0.0)
            total, spread = found.strength @ together, float(together @ found.covariance @ together) ** 0.5
            names = " and ".join(WORDS[one] for one, left in zip(sources, is_open, strict=True) if left)
            known.append(
                f"{names}, which cannot be separated here, {100 * total / self.lit:z.2f} ± "
                f"{100 * spread / self.lit:z.2f} % together (a photograph with all lamps off shows that of the room)"
            )
        return f"{self._dark_words}: {'; '.join(known)}"

    @property
    def _dark_words(self) -> str:
        return f"shadows hold {100 * self.dark / self.lit:.2g} % of the light where a lamp shines"


def _least_squares(square: Array, towards: Array, mean: Array) -> SourceStrengths | None:
    """Of tiles (T, k, k) and (T, k), with errors by their residuals, at least those by noise."""
    whole = square.sum(axis=0)
    size = np.sqrt(np.diagonal(whole))
    if not (size > 0.0).all() or np.linalg.eigvalsh(whole / np.outer(size, size))[0] <= LEAST_DIFFERENT:
        return None
    inverse = np.linalg.inv(whole)
    strength = inverse @ towards.sum(axis=0)
    off = towards - square @ strength
    covariance = len(off) / (len(off) - len(strength)) * inverse @ (off.T @ off) @ inverse
    # tiles may agree by chance, beyond what noise allows
    wider = np.sqrt(np.maximum(np.diagonal(inverse) / np.maximum(np.diagonal(covariance), 1e-300), 1.0))
    return SourceStrengths(strength, covariance * np.outer(wider, wider), float(strength @ towards.sum(axis=0)), mean)


def shadow_light(capture: Capture, normal_map: NormalMap, own: Sequence[NDArray[np.floating]]) -> ShadowLight:
    """The light in the shadows of `capture`; own: what light of the object adds to each photograph (h, w, C)."""
    views, fit = normal_map.views, normal_map.fit
    incidence = np.einsum("kpi,pi->kp", views.to_lamp, fit.normals)
    tile = (views.rows * TILES // views.shape[0]) * TILES + views.columns * TILES // views.shape[1]
    place = views.rows, views.columns
    body = normal_map.body[place].mean(axis=1)
    bodies = np.stack([body, _of_materials(body, normal_map.fit.labels)])
    towards, square = np.zeros((2, TILES**2, 3)), np.zeros((2, TILES**2, 3, 3))
    power = np.zeros(TILES**2)
    total, dark_sum, dark_count, lit_sum, lit_count = np.zeros((2, 3)), 0.0, 0, 0.0, 0
    for k, (photograph, part) in enumerate(zip(capture.photographs, own, strict=True)):
        known = photograph.mask[place]
        dark, lit = (incidence[k] < SHADOW_COSINE) & known, (incidence[k] > -SHADOW_COSINE) & known
        value = photograph.values[place].mean(axis=1)
        level = float(np.mean(change(photograph).added))
        weight, grey = 1.0 / photograph.variance[place][dark].mean(axis=1), part[place][dark].mean(axis=1)
        power += np.bincount(tile[dark], weight * value[dark] ** 2, TILES**2)
        for version, one in enumerate(bodies):
            of = np.stack([grey, one[dark], np.full(len(grey), level)])
            for i in range(3):
                towards[version, :, i] += np.bincount(tile[dark], weight * of[i] * value[dark], TILES**2)
                for j in range(3):
                    square[version, :, i, j] += np.bincount(tile[dark], weight * of[i] * of[j], TILES**2)
            total[version] += of.sum(axis=1)
        dark_sum, dark_count = dark_sum + float(value[dark].sum()), dark_count + int(dark.sum())
        lit_sum, lit_count = lit_sum + float(value[lit].sum()), lit_count + int(lit.sum())
    count = max(dark_count, 1)
    return ShadowLight(square, towards, power, total / count, dark_sum / count, lit_sum / max(lit_count, 1))


def _of_materials(body: Array, labels: NDArray[np.intp]) -> Array:
    """(P,) median body of the material of each pixel."""
    medians = np.zeros(int(labels.max(initial=0)) + 1)
    for label in np.unique(labels):
        medians[label] = np.median(body[labels == label])
    return medians[labels]
