"""Gloss from place to place: which half widths γ and factors on β occur together on a surface with textures of them.

A wide lobe of facets may be as high as a narrow one only where it gives back no more light than it takes. At the same
β, it gives back the more the wider it is; so of all places count those with the largest β of their γ or wider ones.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.image.scene.surface_texture import SurfaceTexture
from hagoromo.reflectance.reflectance import LARGEST_GAMMA, SMALLEST_GAMMA, Reflectance
from hagoromo.transport.gamma_rows import STEP, gammas_between

CHECKED_STEP = 1.05  # between the γ for which the light that is given back is checked
LEAST_FACTOR = 1e-6  # on β, of a row of tables
# What was found of two images, as long as they are there: a surface is made anew for every picture
_IMAGES: WeakKeyDictionary[SurfaceTexture, WeakKeyDictionary[SurfaceTexture, list[GlossBounds]]] = WeakKeyDictionary()


class GlossBounds(NamedTuple):
    """A half width γ [rad], and the largest factor on β that goes with it."""

    gamma: float
    factor: float

    def of(self, reflectance: Reflectance) -> Reflectance:
        """A reflectance with this γ, and its β and those of further lobes by the factor. `InputError` as there."""
        lobes = tuple((beta * self.factor, gamma) for beta, gamma in reflectance.lobes)
        return replace(reflectance, gamma=self.gamma, beta=reflectance.beta * self.factor, lobes=lobes)


def gloss_rows(gamma: SurfaceTexture, beta: SurfaceTexture | None) -> list[GlossBounds]:
    """Each γ at steps of STEP, with the largest factor that places from there to the next one have."""
    gammas = gammas_between(*ends(gamma), STEP)
    if beta is None or not alike(gamma, beta):
        return [GlossBounds(one, _overall(beta)) for one in gammas]
    first = np.searchsorted(gammas, gamma.values.ravel(), side="right") - 1
    factors = _largest(first, beta.values.ravel(), len(gammas))
    for k in reversed(range(len(gammas) - 1)):  # γ that only lie between two places
        factors[k] = factors[k] or factors[k + 1]
    return [GlossBounds(*each) for each in zip(gammas, np.maximum(factors, LEAST_FACTOR).tolist(), strict=True)]


def widest_glosses(gamma: SurfaceTexture, beta: SurfaceTexture | None, corners: ArrayLike | None) -> list[GlossBounds]:
    """Those that give back at least as much light as any place, also between pixels or vertices, to CHECKED_STEP.

    corners: (faces, 3) numbers of vertices, of textures of these.
    """
    largest = ends(gamma)[1]
    if beta is None or not alike(gamma, beta):
        return [GlossBounds(largest, _overall(beta))]
    if gamma.of == "vertices":
        return _widest(gamma, beta, corners)
    known = _IMAGES.setdefault(gamma, WeakKeyDictionary())
    if beta not in known:
        known[beta] = _widest(gamma, beta, None)
    return known[beta]


def _widest(gamma: SurfaceTexture, beta: SurfaceTexture, corners: ArrayLike | None) -> list[GlossBounds]:
    edges = gammas_between(*ends(gamma), CHECKED_STEP)
    width, factor = (_around(texture, corners) for texture in (gamma, beta))
    factors = _largest(np.searchsorted(edges, width.ravel()), factor.ravel(), len(edges))
    wider = np.append(np.maximum.accumulate(factors[::-1])[::-1][1:], 0.0)
    return [GlossBounds(edges[k], float(factors[k])) for k in np.flatnonzero(factors > wider).tolist()]


def _overall(beta: SurfaceTexture | None) -> float:
    """The largest factor on β of all places."""
    return 1.0 if beta is None else max(float(beta.values.max()), LEAST_FACTOR)


def alike(one: SurfaceTexture | None, other: SurfaceTexture | None) -> bool:
    """Whether two textures are there and have their values at the same places."""
    if one is None or other is None:
        return False
    return (one.of, one.smooth) == (other.of, other.smooth) and one.values.shape[:-1] == other.values.shape[:-1]


def ends(gamma: SurfaceTexture) -> tuple[float, float]:
    """The least and the largest γ [rad] of a texture; single precision may lie beyond what a reflectance takes."""
    least, largest = (float(end) for end in (gamma.values.min(), gamma.values.max()))
    return max(least, SMALLEST_GAMMA), min(largest, LARGEST_GAMMA)


def _largest(number: NDArray[np.intp], values: NDArray[np.float32], count: int) -> NDArray[np.float64]:
    """The largest value of each number 0 … count − 1; 0 of those that there are none of."""
    most = np.zeros(count)
    np.maximum.at(most, np.clip(number, 0, count - 1), values)
    return most


def _around(texture: SurfaceTexture, corners: ArrayLike | None) -> NDArray[np.float32]:
    """The largest value that may lie around each place, by the interpolation of the texture."""
    values = texture.values[..., 0]
    if texture.of == "vertices":
        return values[np.asarray(corners)].max(axis=1)
    if texture.smooth:
        for axis in (0, 1):
            values = np.maximum(values, np.roll(values, -1, axis))
    return values
