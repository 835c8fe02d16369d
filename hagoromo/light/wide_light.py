"""Wide light: what area lamps, environments and surfaces that give off light have in common.

Each kind is a file of this room. March, full and path, the pictures of lights that are seen, and scenes ask a light for
nothing but this: its light on the device (its share at a point, a direction to it, what a ray meets of it), the lamps
that stand for it, where it stands, and what a palette keeps of it.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple, Protocol

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays
from hagoromo.light.light_points import LightPoints
from hagoromo.light.other_programs import InOtherPrograms
from hagoromo.light.spectrum import Spectrum

Array = NDArray[np.float64]
ONE_PART = (1.0,)


class LightDrawn(NamedTuple):
    """A direction to a light, the distance to it [m], its density [1/sr], and its radiance in each of the light's parts
    over `LightOnDevice.radiance`. Density 0: the point sees none of it; None: all light comes from this one place.
    """

    to_lamp: Array3f
    distance: Float
    density: Float | None
    tints: Sequence[Float] = ONE_PART


class LightHit(NamedTuple):
    """What a ray meets of a light: whether it is there, the density that `drawn` has of this direction [1/sr], and the
    tints, as of `LightDrawn`. distance: to it [m]; None: it is where the ray ends.
    """

    there: Bool
    density: Float
    distance: Float | None = None
    tints: Sequence[Float] = ONE_PART


class RayEnd(Protocol):
    """Where rays end: how far that is [m], infinity for nowhere; unit normal of the face of a surface, to the eye; and
    1 + the number of the surface whose front it is, else 0.
    """

    @property
    def distance(self) -> Float:
        """To there."""
        ...

    @property
    def face(self) -> Array3f:
        """Normal."""
        ...

    @property
    def front(self) -> UInt:
        """Of a surface."""
        ...


class SeenOnDevice(Protocol):
    """A light in kernels, as rays meet it. radiance: of a tint of 1. visible: whether the camera sees it."""

    radiance: Float
    visible: bool

    def hit(self, origin: Array3f, direction: Array3f, end: RayEnd) -> LightHit | None:
        """What rays from `origin` in a unit direction meet of it up to their end; None: rays never meet it."""
        ...


class LightOnDevice(SeenOnDevice, Protocol):
    """A light in kernels, of which directions to it are drawn, too."""

    def share(self, point: Array3f) -> Float:
        """About the irradiance that it gives on what faces it, without shadows; above 0 wherever it is seen."""
        ...

    def drawn(self, point: Array3f, u: Float, v: Float, *further: Float) -> LightDrawn:
        """A direction by four numbers, independent and uniform in [0, 1)."""
        ...


class LightPart(Protocol):
    """Light of one spectrum, and its name in pictures."""

    @property
    def name(self) -> str:
        """Name."""
        ...

    @property
    def spectrum(self) -> Spectrum:
        """Relative spectrum."""
        ...


class WideLight(InOtherPrograms, Protocol):
    """A light that is no point. what: what people call its kind. visible: whether the camera sees it."""

    @property
    def what(self) -> str:
        """Its kind."""
        ...

    @property
    def visible(self) -> bool:
        """Whether the camera sees it."""
        ...

    @property
    def parts(self) -> Sequence[LightPart]:
        """Its light by spectra; one group of lamps of a palette each."""
        ...

    @property
    def surface(self) -> int | None:
        """Number of the surface of a scene that shines; None: it is no surface."""
        ...

    @property
    def stands_at(self) -> Array:
        """(n, 3) places where it stands free [m], world: none of what is far or a surface."""
        ...

    def corners(self) -> Array:
        """(n, 3) places whose bounds hold it [m], world: none of what is far or a surface."""
        ...

    def points(self, low: Array, high: Array, tolerance: float) -> LightPoints:
        """Lamps in its place, which light what is between the corners `low` and `high` (3,) [m], world; see
        `hagoromo.light.light_points` for the error.
        """
        ...

    def on_device(self) -> LightOnDevice:
        """Its light in kernels; its place counts from the origin of the scene."""
        ...

    def seen_on_device(self) -> SeenOnDevice:
        """The same without the tables by which directions are drawn."""
        ...


def shares_before(light: np.ndarray) -> np.ndarray:
    """Shares of the entries of the last axis that stand before each one, and 1: one more than there are entries."""
    sums = np.pad(np.cumsum(light, axis=-1), [(0, 0)] * (light.ndim - 1) + [(1, 0)])
    total = sums[..., -1:]
    even = np.linspace(0.0, 1.0, sums.shape[-1])
    shares = np.where(total > 0.0, sums / np.where(total > 0.0, total, 1.0), even).astype(np.float32)
    shares[..., -1] = 1.0
    return shares


def interval_of(shares: Float, count: int, number: Float, first: UInt) -> UInt:
    """The entry, of `count` whose shares begin at `first`, that a number in [0, 1) falls into."""
    jit = arrays()
    beyond = dr.binary_search(0, count, lambda k: dr.gather(jit.Float, shares, first + jit.UInt(k)) <= number)
    return dr.minimum(dr.maximum(jit.UInt(beyond), 1) - 1, count - 1)
