"""Links: rays from cells and patches to the surfaces that they see, and the light that comes along them.

Each receiver looks along the same set of directions, turned at random for itself. What a ray hits, and how much of its
light passes the matter in between, is found once; the light that is sent may then change from sweep to sweep.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass
from typing import Protocol

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, Int, UInt, arrays, evaluate, lookup, vectors
from hagoromo.files.memory import require
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.cells import Cells
from hagoromo.transport.field.patches import SIDES, Patch, Patches
from hagoromo.transport.field.scattering import REFLECTED, ScatteringTables
from hagoromo.transport.field.second_order import NUMBERS, projected, second_order
from hagoromo.transport.field.sent_light import Numbers, nothing
from hagoromo.transport.field.sweep import Path
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.path.path import SurfaceHits
from hagoromo.transport.sample import Element
from hagoromo.transport.surface_colours import SurfaceColours, SurfaceHit, surface_element

BYTES_PER_RAY = 160  # memory of one ray, its hit and the light along it, about
DEEPEST = 9.0  # a ray ends beyond this optical depth, exp(−9) = 1e-4
THROUGH_SHEETS = range(REFLECTED, REFLECTED + 1)  # parts of the scattering, see `Palette.parts`
LARGEST_SCALE = 4.0  # of the nine numbers of a patch's light, so that their irradiance is that of its rays


class LightAtPatches(Protocol):
    """Smooth light that arrives at the sides of patches."""

    def at(self, patch: Patch) -> list[list[Float]]:
        """Nine numbers of every channel; 0 where no patch is there."""
        ...


@dataclass
class LitSurfaces:
    """The surfaces of a scene, their patches, lamps and colours. first: number of the first surface's material.
    thickness: of sheets, see `surface_element`; None where no surface lets light through.
    """

    surfaces: SurfaceHits
    patches: Patches
    lighting: Lighting
    colours: BandColours
    scattering: ScatteringTables
    first: UInt
    surface_colours: SurfaceColours | None = None
    thickness: Float | None = None

    def coefficients(self, hit: SurfaceHit) -> list[Float]:
        """Coefficients of surfaces on the palette where rays hit them."""
        plain = self.lighting.materials.coefficients(self.first + hit.surface)
        return plain if self.surface_colours is None else self.surface_colours.with_textures(plain, hit)

    def element(self, hit: SurfaceHit) -> Element:
        """Surfaces as elements where rays hit them."""
        return surface_element(self.lighting.materials, self.first, hit, self.surface_colours, self.thickness)

    @property
    def channels(self) -> int:
        """Bands of all groups of lamps."""
        return len(self.lighting.materials.palette.lamps) * self.colours.count

    def direct(self, point: Array3f, element: Element, coefficients: list[Float], to_eye: Array3f) -> list[Float]:
        """Radiance, of every channel, that a surface sends to the eye of the light of the lamps."""
        light: list[Float] = []
        for part in self.lighting.in_parts():
            more = part.in_groups(part.reflected_radiance(point, to_eye, [element], [coefficients])[0])
            dr.eval(more)
            light = [one + other for one, other in zip(light, more, strict=True)] if light else more
        each, bands = len(coefficients), self.colours.count
        values = [self.colours.values_of(band) for band in range(bands)]
        return [
            sum(light[group * each + j] * values[band][j] for j in range(each))
            for group in range(len(light) // each)
            for band in range(bands)
        ]

    def again(
        self, element: Element, coefficients: list[Float], to_eye: Array3f, patch: Patch, light: LightAtPatches
    ) -> list[Float]:
        """Radiance, of every channel, that it sends to the eye of the smooth light at `patch`, where it is there."""
        total = self._sent(element, coefficients, to_eye, range(REFLECTED), light.at(patch))
        if self.thickness is not None:
            through = self._sent(element, coefficients, to_eye, THROUGH_SHEETS, light.at(self.patches.behind(patch)))
            total = [one + other for one, other in zip(total, through, strict=True)]
        return total

    def _sent(
        self, element: Element, coefficients: list[Float], to_eye: Array3f, parts: range, incident: list[list[Float]]
    ) -> list[Float]:
        """What some parts of the scattering, see `Palette.parts`, send of incident light, nine numbers a channel."""
        colours, bands = self.colours.of(coefficients), self.colours.count
        towards = [self.scattering.towards(element.material, j, element.axis, to_eye, element.gamma) for j in parts]
        factors = [
            [sum(colours[j * bands + band] * part[k] for j, part in zip(parts, towards, strict=True))
             for k in range(NUMBERS)]
            for band in range(bands)
        ]  # fmt: skip
        return [
            dr.fmax(sum(f * n for f, n in zip(factors[k % bands], numbers, strict=True)), 0.0)
            for k, numbers in enumerate(incident)
        ]


class SmoothMatter:
    """σ and the light that cells send, both of the second order in direction. A plain object."""

    def __init__(self, cells: Cells, sigma: list[Float], sent: Numbers) -> None:
        self.cells, self.sigma, self.channels = cells, sigma, len(sent)
        self.packed = packed([number for numbers in (sigma, *sent) for number in numbers])

    def at(self, cell: Int, towards: Array3f) -> tuple[Float, list[Float]]:
        """σ [1/m] of a cell along a direction, and the light that it sends from there, over σ."""
        jit, holds = arrays(), self.cells.holds(cell)
        packets = -(-NUMBERS * (1 + self.channels) // 4)
        first = jit.UInt(cell) * packets
        flat = [x for k in range(packets) for x in dr.gather(jit.Array4f, self.packed, first + k, holds)]

        def along(part: int, way: Array3f) -> Float:
            return dr.fmax(second_order(flat[part * NUMBERS : (part + 1) * NUMBERS]).at(way), 0.0)

        sigma = along(0, towards)
        inverse = dr.rcp(dr.fmax(sigma, 1e-30))
        return sigma, [along(1 + k, -towards) * inverse for k in range(self.channels)]


def packed(columns: list[Float]) -> Float:
    """The numbers of each cell together, in whole packets of four."""
    jit, cells = arrays(), dr.width(columns[0])
    each, lane = 4 * -(-len(columns) // 4), dr.arange(jit.UInt, cells)
    values = dr.zeros(jit.Float, each * cells)
    for k, column in enumerate(columns):
        dr.scatter(values, column, lane * each + k)
    dr.eval(values)
    return values


class Links:
    """Rays of some receivers: for each a number of directions, hits of surfaces, and transmittances to them."""

    def __init__(
        self,
        lit: LitSurfaces,
        points: NDArray[np.float64],
        normals: NDArray[np.float64] | None,
        ways: int,
        random: np.random.Generator,
        matter: SmoothMatter | None,
    ) -> None:
        """`points`: (n, 3) of the receivers [m]. `normals`: (n, 3) of patches, which have two sides; None: of cells."""
        jit, self.lit, count = arrays(), lit, len(points)
        require(float(BYTES_PER_RAY * count * ways), "rays between surfaces and matter")
        self.patches, self.weight = normals is not None, 4.0 * math.pi / ways
        receiver = dr.arange(jit.UInt, count * ways) // dr.opaque(jit.UInt, ways)
        towards, cosine = turned_ways(count, ways, random), None
        point = dr.gather(jit.Array3f, vectors(points), receiver)
        if normals is not None:
            normal = dr.gather(jit.Array3f, vectors(normals), receiver)
            cosine = dr.dot(normal, towards)
            point = point + normal * dr.copysign(2.0 * lit.patches.reach, cosine)
        hit, passed = lit.surfaces.hit(point, towards), dr.full(jit.Float, 1.0, count * ways)
        if matter:
            passed = through(matter.cells, matter, point, towards, hit.distance)[1]
        evaluate(towards, cosine, point, hit, passed)
        rays = LinkedRays(towards, cosine, np.arange(count + 1) * ways)
        if self.patches:
            self.point, self.far, self.rays = point, hit.distance, rays
        seen = np.flatnonzero(np.array(dr.isfinite(hit.distance) & (passed > 0.0)))
        self.hits = rays.some(seen, np.bincount(seen // ways, minlength=count))
        index = lookup(jit.UInt, (seen if len(seen) else np.zeros(1)).astype(np.uint32))
        hit = SurfaceHit(*(None if each is None else dr.gather(type(each), each, index) for each in hit))
        self.passed = dr.gather(jit.Float, passed, index)
        self.element, self.coefficients, self.hit = lit.element(hit), lit.coefficients(hit), hit.point
        evaluate(self.hit, self.passed, self.element)
        if lit.surface_colours is not None:
            dr.eval(self.coefficients)
        normal = hit.normal if hit.ground is None else hit.ground
        self.patch: Patch = lit.patches.at(hit.point, normal, dr.full(jit.Bool, True, dr.width(index)))

    def direct(self) -> Numbers:
        """Incident light that surfaces send on of the light of the lamps."""
        away = -self.hits.towards
        return self._from_surfaces(self.lit.direct(self.hit, self.element, self.coefficients, away))

    def again(self, light: Numbers) -> Numbers:
        """Incident light that surfaces send on of the `light` that arrives at the sides of the patches."""
        away = -self.hits.towards
        return self._from_surfaces(self.lit.again(self.element, self.coefficients, away, self.patch, FlatLight(light)))

    def from_matter(self, matter: SmoothMatter) -> Numbers:
        """Incident light that the cells send to patches."""
        light, _ = through(matter.cells, matter, self.point, self.rays.towards, self.far)
        return self._gathered(self.rays, light)

    def _from_surfaces(self, light: list[Float]) -> Numbers:
        return self._gathered(self.hits, [each * self.passed for each in light])

    def _gathered(self, rays: LinkedRays, light: list[Float]) -> Numbers:
        """The nine numbers of light along rays; patches: of their fronts, then of their backs."""
        light = [each * self.weight for each in light]
        dr.eval(light)
        sides = summed(rays.with_light(light), rays.count * (SIDES if self.patches else 1))
        numbers = [self._scaled(*side) for side in sides] if self.patches else [numbers for numbers, _ in sides]
        dr.eval(numbers)
        return numbers

    def _scaled(self, numbers: list[Float], exact: Float) -> list[Float]:
        """Of the sides of patches, so that the irradiance of the second order is the `exact` one of the rays."""
        normals = np.concatenate([self.lit.patches.normals, -self.lit.patches.normals])
        smooth = irradiance(numbers, vectors(normals))
        scale = dr.select(smooth > 0.0, dr.fmin(exact / dr.fmax(smooth, 1e-30), LARGEST_SCALE), 0.0)
        return [number * scale for number in numbers]


class FlatLight:
    """Light at the sides of patches, the same all over each. A plain object: loops do not take its values."""

    def __init__(self, light: Numbers) -> None:
        self.light = light

    def at(self, patch: Patch) -> list[list[Float]]:
        """Nine numbers of every channel."""
        kind = arrays().Float
        return [[dr.gather(kind, number, patch.side, patch.there) for number in numbers] for numbers in self.light]


class LinkedRays:
    """Rays of receivers, one receiver after the other, and light along them. A plain object: loops do not take its
    arrays into their state.

    towards: directions. cosine: to the normals of patches; None: of cells. first: (receivers + 1,) the first ray of
    each, and the number of all.
    """

    def __init__(self, towards: Array3f, cosine: Float | None, first: NDArray) -> None:
        self.towards, self.cosine = towards, cosine
        self.light: Sequence[Float] = ()
        self.count = len(first) - 1
        self.first = lookup(arrays().UInt, first.astype(np.uint32))
        self.receivers = dr.opaque(arrays().UInt, self.count)

    def some(self, rays: NDArray[np.intp], each: NDArray[np.intp]) -> LinkedRays:
        """Some of these rays, in order; each: how many of every receiver. Without any there is one of none."""
        jit = arrays()
        index = lookup(jit.UInt, (rays if len(rays) else np.zeros(1)).astype(np.uint32))
        towards = dr.gather(jit.Array3f, self.towards, index)
        cosine = None if self.cosine is None else dr.gather(jit.Float, self.cosine, index)
        dr.eval(towards, cosine)
        return LinkedRays(towards, cosine, np.concatenate([[0], np.cumsum(each)]))

    def with_light(self, light: Sequence[Float]) -> LinkedRays:
        """The same rays with light of every channel."""
        lit = copy(self)
        lit.light = light
        return lit

    def of(self, lane: UInt) -> tuple[UInt, UInt]:
        """The first ray of a receiver, or of a side of one, and the one behind its last."""
        first, end = (dr.gather(arrays().UInt, self.first, lane % self.receivers + k) for k in (0, 1))
        return first, end

    def added(self, ray: UInt, lane: UInt, sides: list[tuple[list[Float], Float]]) -> list[tuple[list[Float], Float]]:
        """The nine numbers and the irradiance of every channel, with the light of a ray of each receiver."""
        jit = arrays()
        factors = projected(dr.gather(jit.Array3f, self.towards, ray))
        cosine, seen = jit.Float(1), jit.Bool(True)
        if self.cosine is not None:
            cosine = dr.gather(jit.Float, self.cosine, ray) * dr.select(lane < self.receivers, 1.0, jit.Float(-1))
            seen = cosine > 0.0
        arrived = [dr.gather(jit.Float, light, ray, seen) for light in self.light]
        return [
            ([dr.fma(f, new, old) for f, old in zip(factors, numbers, strict=True)], dr.fma(cosine, new, irradiance))
            for new, (numbers, irradiance) in zip(arrived, sides, strict=True)
        ]


@dr.syntax
def summed(rays: LinkedRays, receivers: int) -> list[tuple[list[Float], Float]]:
    """Of every channel, the nine numbers of the light along all rays of each receiver, one after the other, and the
    irradiance; patches: of their fronts, then of their backs.
    """
    jit = arrays()
    zero = dr.zeros(jit.Float, receivers)
    sides = [([zero] * NUMBERS, zero) for _ in rays.light]
    lane = dr.arange(jit.UInt, receivers)
    ray, end = rays.of(lane)
    while ray < end:
        sides = rays.added(ray, lane, sides)
        ray += 1
    return sides


def irradiance(numbers: list[Float], normal: Array3f) -> Float:
    """∫ max(n·ω, 0) L dω of light of the second order (Ramamoorthi & Hanrahan 2001)."""
    light = second_order(numbers)
    along, across = dr.dot(normal, light.v), dr.dot(normal, light.times(normal))
    return math.pi * (light.s + (2.0 / 3.0) * along + 0.25 * across)


@dr.syntax
def through(
    cells: Cells, matter: SmoothMatter, point: Array3f, towards: Array3f, far: Float
) -> tuple[list[Float], Float]:
    """Light that the cells send to points from along rays up to `far` [m], of every channel, and the transmittance."""
    jit, count = arrays(), dr.width(towards)
    path = Path(cells, cells.place(point), towards)
    light = [dr.zeros(jit.Float, count) for _ in range(matter.channels)]
    depth, distance = dr.zeros(jit.Float, count), path.entry()
    far = dr.fmin(far * cells.per_metre, path.exit())
    while (distance < far) & (depth < DEEPEST):
        cell = path.cell_behind(distance)
        there = cells.inside(cell)
        number = cells.find(cell, there)
        end = dr.fmin(path.end(cell, number, distance), far)
        sigma, sources = matter.at(dr.select(there, number, -1), towards)
        step = sigma * (end - distance) * cells.edge
        light = with_step(light, dr.exp(-depth) * (1.0 - dr.exp(-step)), sources)
        depth += step
        distance = end
    return light, dr.select(depth < DEEPEST, dr.exp(-depth), 0.0)


def with_step(light: list[Float], share: Float, sources: list[Float]) -> list[Float]:
    """light + share · source, of every channel."""
    return [dr.fma(share, source, old) for old, source in zip(light, sources, strict=True)]


def turned_ways(receivers: int, ways: int, random: np.random.Generator) -> Array3f:
    """Directions all around, those of a golden spiral, turned at random for each receiver: receiver after receiver."""
    jit, k = arrays(), np.arange(ways) + 0.5
    z, angle = 1.0 - 2.0 * k / ways, math.pi * (1.0 + math.sqrt(5.0)) * k
    r = np.sqrt(1.0 - z * z)
    spiral = np.stack([r * np.cos(angle), r * np.sin(angle), z, 0.0 * z], axis=-1)
    turns = random.normal(size=(receivers, 4))
    turns /= np.linalg.norm(turns, axis=1, keepdims=True)
    table, turn = lookup(jit.Float, spiral.astype(np.float32)), lookup(jit.Float, turns.astype(np.float32))
    lane, each = dr.arange(jit.UInt, receivers * ways), dr.opaque(jit.UInt, ways)
    x, y, z, _ = dr.gather(jit.Array4f, table, lane % each)
    q = dr.gather(jit.Array4f, turn, lane // each)
    way, axis = jit.Array3f(x, y, z), jit.Array3f(q.x, q.y, q.z)
    across = 2.0 * dr.cross(axis, way)
    return dr.normalize(way + q.w * across + dr.cross(axis, across))


def dark(lit: LitSurfaces) -> Numbers:
    """No light at any side of the patches."""
    return nothing(lit.channels, SIDES * lit.patches.count)
