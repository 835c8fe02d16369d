"""Emitting surface: the triangles of a surface that gives off light, which rays hit and walks draw places on."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cached_property

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays, check_entries, lookup, opaque_vector
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.light.light_points import (
    COUNTS,
    FINE,
    LightPoints,
    PointSources,
    error_of_points,
    light_at,
    probes_between,
)
from hagoromo.light.spectrum import Spectrum, checked_spectrum
from hagoromo.light.wide_light import LightDrawn, LightHit, RayEnd, interval_of, shares_before

R2 = (0.7548776662466927, 0.5698402909980532)  # steps that fill a square evenly (Roberts 2018)
TURN = 0.25  # width of a patch, in sizes of its surface, that counts as much as a turn of its normal by 1 rad
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class EmittingSurface:
    """A surface that gives off light. surface: its number among the surfaces. emission: its light, with a name.
    triangles: makes its corners (n, 3, 3) [m], world, when they are asked for.
    """

    surface: int
    emission: SurfaceEmission
    triangles: Callable[[], Array]
    what = "surface"
    visible = True

    @cached_property
    def triangle_corners(self) -> Array:
        """(n, 3, 3) [m], world; triangles without an area are left out."""
        corners = self.triangles()
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        return corners[np.linalg.norm(across, axis=1) > 0.0]

    @property
    def name(self) -> str:
        """That of its light."""
        return self.emission.name

    @property
    def parts(self) -> tuple[SurfaceEmission]:
        """Its light."""
        return (self.emission,)

    @property
    def stands_at(self) -> Array:
        """(0, 3): it is a surface."""
        return np.empty((0, 3))

    def corners(self) -> Array:
        """(0, 3): it is a surface."""
        return self.stands_at

    def points(self, low: Array, high: Array, tolerance: float) -> LightPoints:
        """Point lamps in its place, see `WideLight`."""
        return emitter_points(self.triangle_corners, self.emission, low, high, tolerance)

    def on_device(self) -> DrawnMeshLight:
        """Its light in kernels, with tables of its triangles."""
        return DrawnMeshLight(self.surface, self.emission, self.triangle_corners)

    def seen_on_device(self) -> MeshLight:
        """The same as the surface that rays hit, without its triangles."""
        return MeshLight(self.surface, self.emission)

    def mitsuba(self) -> tuple[None, list[str]]:
        """None: the surface is written without its light."""
        return None, [f"surface {self.name!r}: the light that it gives off"]

    def gltf(self) -> tuple[None, list[str]]:
        """None: as of Mitsuba."""
        return self.mitsuba()

    def usd(self) -> tuple[None, list[str]]:
        """None: as of Mitsuba."""
        return self.mitsuba()


class MeshLight:
    """Triangles (n, 3, 3) [m] that shine from their fronts; rays hit them as the surface of their number."""

    visible = True

    def __init__(self, surface: int, emission: SurfaceEmission) -> None:
        jit = arrays()
        self.front, self.radiance = dr.opaque(jit.UInt, surface + 1), dr.opaque(jit.Float, emission.radiance)

    def hit(self, origin: Array3f, direction: Array3f, end: RayEnd) -> LightHit:
        """What rays meet that end at its front, of a light whose directions are not drawn."""
        return LightHit(end.front == self.front, arrays().Float(0))


class DrawnMeshLight(MeshLight):
    """The same, with directions to it, drawn evenly over its area."""

    def __init__(self, surface: int, emission: SurfaceEmission, corners: Array) -> None:
        super().__init__(surface, emission)
        jit = arrays()
        check_entries(12 * len(corners), f"the triangles of {emission.name!r}")
        across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        double = np.linalg.norm(across, axis=1)
        self.count, self.shares = len(corners), lookup(jit.Float, shares_before(double))
        sides = np.stack([corners[:, 0], corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]], axis=1)
        rows = np.concatenate([sides.reshape(-1, 9), across / double[:, None]], axis=1)
        self.rows = lookup(jit.Float, rows.astype(np.float32))
        self.middle = opaque_vector((double[:, None] * corners.mean(axis=1)).sum(axis=0) / double.sum())
        self.area = dr.opaque(jit.Float, 0.5 * float(double.sum()))
        dr.eval(self.shares, self.rows)

    def share(self, point: Array3f) -> Float:
        """About the irradiance that it gives on what faces it, without shadows."""
        squared = dr.squared_norm(self.middle - point)
        return 2.0 * math.pi * self.radiance * self.area / (self.area + 2.0 * math.pi * squared)

    def drawn(self, point: Array3f, u: Float, v: Float, *further: Float) -> LightDrawn:
        """A direction by two uniform numbers."""
        jit = arrays()
        face = interval_of(self.shares, self.count, u, jit.UInt(0))
        below, above = (dr.gather(jit.Float, self.shares, face + k) for k in (0, 1))
        again = dr.fmin(dr.fmax((u - below) / dr.fmax(above - below, 1e-30), 0.0), 1.0)
        first, second, third, normal = (
            jit.Array3f(*(dr.gather(jit.Float, self.rows, face * 12 + (3 * k + j)) for j in range(3))) for k in range(4)
        )
        root = dr.sqrt(again)
        away = first + second * (root * (1.0 - v)) + third * (root * v) - point
        distance = dr.norm(away)
        way = away / dr.fmax(distance, 1e-30)
        return LightDrawn(way, distance, self.density(distance, -dr.dot(way, normal)))

    def hit(self, origin: Array3f, direction: Array3f, end: RayEnd) -> LightHit:
        """What rays meet that end at its front."""
        return LightHit(end.front == self.front, self.density(end.distance, -dr.dot(direction, end.face)))

    def density(self, distance: Float, cosine: Float) -> Float:
        """Of directions to a place on it, at a distance, that is seen at a cosine from its normal [1/sr]."""
        return dr.select(cosine > 0.0, distance * distance / (self.area * dr.fmax(cosine, 1e-30)), 0.0)


def emitter_points(corners: Array, emission: SurfaceEmission, low: Array, high: Array, tolerance: float) -> LightPoints:
    """Point lamps in place of triangles (n, 3, 3) [m] whose fronts give off light, as `WideLight.points` has them."""
    places, normals, area = spread_over(corners, FINE)
    probes = probes_between(low, high)
    whole = PointSources(places, normals, np.full(FINE, emission.radiance * area / FINE))
    truth = [light_at(probe, whole) for probe in probes]
    for count in COUNTS:
        patches = _patches(places, normals, count)
        middles = np.array([_middle(places[patch], normals[patch]) for patch in patches])
        sums = np.array([normals[patch].sum(axis=0) for patch in patches])
        length = np.maximum(np.linalg.norm(sums, axis=1), 1e-12)
        axes, strengths = sums / length[:, None], emission.radiance * area / FINE * length
        error = error_of_points(PointSources(middles, axes, strengths), truth, probes)
        if error <= tolerance:
            break
    lamps = [
        Lamp(place, intensity=float(strength), spectrum=emission.spectrum, name=emission.name, axis=axis)
        for place, axis, strength in zip(middles, axes, strengths, strict=True)
    ]
    return LightPoints(lamps, len(lamps), error)


def spread_over(corners: Array, count: int) -> tuple[Array, Array, float]:
    """`count` places on triangles (n, 3, 3), spread evenly over their area; the normals there; and the area."""
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * np.linalg.norm(across, axis=1)
    sums = np.cumsum(areas)
    share = (np.arange(count) + 0.5) / count * sums[-1]
    face = np.minimum(np.searchsorted(sums, share, side="right"), len(areas) - 1)
    u, v = np.modf(np.outer(np.arange(count) + 0.5, R2))[0].T
    root = np.sqrt(u)
    weights = np.stack([1.0 - root, root * (1.0 - v), root * v], axis=-1)
    places = (weights[:, :, None] * corners[face]).sum(axis=1)
    return places, (across / (2.0 * areas[:, None]))[face], float(sums[-1])


def _patches(places: Array, normals: Array, count: int) -> list[NDArray[np.intp]]:
    """Numbers of places in `count` patches of equal size, each halved where it is widest, in place or normal."""
    size = max(float(np.ptp(places, axis=0).max()), 1e-30)
    both = np.concatenate([places / size, TURN * normals], axis=1)
    patches = [np.arange(len(places))]
    while len(patches) < count:
        halves = []
        for patch in patches:
            widest = int(np.argmax(both[patch].var(axis=0)))
            order = patch[np.argsort(both[patch, widest], kind="stable")]
            halves += [order[: len(order) // 2], order[len(order) // 2 :]]
        patches = halves
    return patches


def _middle(places: Array, normals: Array) -> Array:
    """The middle of a patch; where it is bent the place on it that is nearest, which nothing of it hides."""
    middle = places.mean(axis=0)
    if (np.ptp(normals, axis=0) < 1e-9).all():
        return middle
    return places[np.argmin(np.sum((places - middle) ** 2, axis=1))]


@dataclass(frozen=True)
class SurfaceEmission:
    """radiance: [W/(m² sr) times the unit of `spectrum`], the same all over the front of a surface and into all
    directions (Lambert's law). spectrum: relative spectrum. name: in pictures; empty: that of the surface.

    The front is where the corners of a face go round counterclockwise; that of a shape is outside, or +z. The surface
    reflects light besides. `InputError` for a radiance that is not above 0.
    """

    radiance: float
    spectrum: Spectrum = field(default_factory=lambda: Spectrum.constant(1.0))
    name: str = ""

    def __post_init__(self) -> None:
        if not (np.isfinite(self.radiance) and self.radiance > 0.0):
            raise InputError(f"the radiance of an emission is {self.radiance!r:.60}: give a finite number above 0")
        checked_spectrum(self.spectrum, "emission: spectrum")
        if not (self.spectrum.values >= 0.0).all() or not self.spectrum.values.any():
            raise InputError("the spectrum of an emission is below 0 somewhere, or 0 everywhere: give one of light")

    def record(self) -> dict[str, object]:
        """The emission as plain values, as a scene file states it."""
        return {"radiance": self.radiance, "spectrum": self.spectrum.record(), "name": self.name}
