"""Lights: the lights of a scene that walks may also meet by themselves, area lamps, surfaces and an environment.

One of them, or of the other lamps, is drawn at each event, and the direction that a walk goes on in may meet one. Both
are estimates of the same light: each counts by the balance heuristic (Veach & Guibas 1995). The density of the walk's
directions is known for planes only, so that in its place stands f over the albedo, which it follows nearly: any
density, the same in both places, leaves the sum without bias.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Protocol

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup
from hagoromo.light.area_lamp import AreaLamp
from hagoromo.light.environment import Environment
from hagoromo.light.surface_emission import SurfaceEmission
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.crossing import selected
from hagoromo.transport.gamma_rows import GammaRows
from hagoromo.transport.lighting import LampRow
from hagoromo.transport.path.environment_light import EnvironmentLight
from hagoromo.transport.path.free_flight import Random
from hagoromo.transport.path.mesh_light import MeshLight
from hagoromo.transport.path.next_event import LampDrawn
from hagoromo.transport.surface_colours import SurfaceHit

LEAST_ALBEDO = 1e-3


class EventHit(Protocol):
    """Where a walk goes: how far that is [m], infinity for nothing; unit normal of the face of a surface, to the eye;
    and 1 + the number of the emitter whose front it is, else 0.
    """

    distance: Float
    face: Array3f
    emitter: UInt


class EmittingSurface(Protocol):
    """A surface that gives off light."""

    @property
    def surface(self) -> int:
        """Its number among the surfaces."""
        ...

    @property
    def corners(self) -> NDArray[np.float64]:
        """(n, 3, 3) of its triangles [m]."""
        ...

    @property
    def emission(self) -> SurfaceEmission:
        """Its light."""
        ...


class Lights:
    """Area lamps, surfaces that give off light and the environment, beside the other lamps of a scene; places count
    from the scene's origin.
    """

    def __init__(
        self,
        lamps: Sequence[LampRow],
        area_lamps: Sequence[AreaLamp],
        environment: Environment | None,
        emitters: Sequence[EmittingSurface],
        groups: Sequence[int],
        reflectances: Sequence[Reflectance],
        gamma_rows: GammaRows | None = None,
    ) -> None:
        """groups: in the palette, of every area lamp, then of every part of the environment, then of every emitter.
        reflectances: in the order of their materials; those of the surfaces are the last. gamma_rows: of a scene with
        textures of γ.
        """
        self.lamps, self.areas = lamps, [lamp.on_device() for lamp in area_lamps]
        self.emitters = [MeshLight(emitter.corners, emitter.emission) for emitter in emitters]
        last = len(groups) - len(emitters)
        self.area_groups, self.part_groups = list(groups[: len(area_lamps)]), list(groups[len(area_lamps) : last])
        self.emitter_groups = list(groups[last:])
        self.numbers: UInt | None = None
        if emitters:
            numbers = np.zeros(max(emitter.surface for emitter in emitters) + 1, np.uint32)
            numbers[[emitter.surface for emitter in emitters]] = np.arange(len(emitters)) + 1
            self.numbers, self.last_surface = lookup(arrays().UInt, numbers), len(numbers) - 1
        self.environment = None if environment is None else EnvironmentLight(environment)
        self.gamma_rows, every = gamma_rows, gamma_rows.reflectances if gamma_rows else reflectances
        sent = [math.pi * r.alpha + r.interface_albedo + r.transmission for r in every]
        self.albedo = lookup(arrays().Float, np.maximum(np.array(sent, np.float32), LEAST_ALBEDO))

    def spread(self, material: UInt, light: Float, gamma: Float | None = None) -> Float:
        """About the density of the directions that a walk goes on in [1/sr]; light: f there, body and interface.

        gamma: half width of the facets [rad]; default: that of the material.
        """
        kind = arrays().Float
        if gamma is None or self.gamma_rows is None:
            return light / dr.gather(kind, self.albedo, material)
        first, second, share = self.gamma_rows.at(material, gamma)
        low, high = (dr.gather(kind, self.albedo, row) for row in (first, second))
        return light / dr.fma(share, high - low, low)

    def emitter(self, hit: SurfaceHit) -> UInt:
        """1 + the number of the emitter whose front rays hit; 0 for another surface, or a back."""
        jit = arrays()
        if self.numbers is None:
            return jit.UInt(0)
        known = hit.front & (hit.surface <= self.last_surface) & dr.isfinite(hit.distance)
        return dr.gather(jit.UInt, self.numbers, dr.minimum(hit.surface, self.last_surface), known)

    def drawn(self, point: Array3f, groups: int, random: Random) -> tuple[LampDrawn, Random]:
        """A light, drawn about in the share that it has of the irradiance, and a direction to it; groups: how many."""
        jit = arrays()
        choice, u, v, across, down = (random.next_float32() for _ in range(5))
        nothing = jit.Float(0)
        chosen = LampDrawn(jit.Array3f(0, 0, 1), nothing, nothing, jit.UInt(0), [nothing] * groups, nothing)
        each = [lamp.light.arriving(point) for lamp in self.lamps]
        sized, sized_groups = [*self.areas, *self.emitters], self.area_groups + self.emitter_groups
        shares = [light for _, _, light in each] + [light.share(point) for light in sized]
        shares += [] if self.environment is None else [self.environment.share()]
        total, below = sum(shares, nothing), nothing
        for number, share in enumerate(shares):
            above = below + share
            here = (choice * total >= below) & (choice * total < above) & (share > 0.0)
            below, chance, area = above, share / total, number - len(self.lamps)
            if area < 0:
                way, away, _ = each[number]
                new = LampDrawn(
                    way, jit.Float(away), total, jit.UInt(0), _one(self.lamps[number].group, groups), nothing
                )
            elif area < len(sized):
                light = sized[area]
                to_light = light.drawn(point, u, v)
                strength = _over(light.radiance, to_light.density * chance)
                tints = _one(sized_groups[area], groups)
                new = LampDrawn(
                    to_light.to_lamp, to_light.distance, strength, jit.UInt(0), tints, to_light.density * chance
                )
            else:
                assert self.environment is not None
                to_light, pixel = self.environment.drawn(u, v, across, down)
                tints = self._by_groups(self.environment.radiance_of(pixel), groups)
                density = to_light.density * chance
                new = LampDrawn(
                    to_light.to_lamp, to_light.distance, _over(jit.Float(1), density), jit.UInt(0), tints, density
                )
            chosen = LampDrawn(*(selected(here, one, other) for one, other in zip(new, chosen, strict=True)))
        return chosen, random

    def hit(
        self, origin: Array3f, direction: Array3f, event: EventHit, spread: Float, first: Bool, groups: int
    ) -> list[Float]:
        """Radiance of every group that a walk hits on its way to its next event, and there.

        origin: of the walk's event before. spread: as it was there for this direction; infinity where no light could
        have been drawn. first: whether the walk comes from the camera, and sees what is visible.
        """
        jit = arrays()
        shares = [lamp.light.arriving(origin)[2] for lamp in self.lamps]
        shares += [light.share(origin) for light in (*self.areas, *self.emitters)]
        shares += [] if self.environment is None else [self.environment.share()]
        total, light = sum(shares, jit.Float(0)), [jit.Float(0)] * groups
        for area, group, share in zip(self.areas, self.area_groups, shares[len(self.lamps) :], strict=False):
            seen = area.seen(origin, direction)
            counts = _balance(spread, seen.density * share / total, first, area.visible)
            there = seen.there & (seen.distance < event.distance)
            light[group] = light[group] + dr.select(there, area.radiance * counts, 0.0)
        of_emitters = shares[len(self.lamps) + len(self.areas) :]
        for k, (light_of, group, share) in enumerate(
            zip(self.emitters, self.emitter_groups, of_emitters, strict=False)
        ):
            density = light_of.density(event.distance, -dr.dot(direction, event.face))
            counts = _balance(spread, density * share / total, first, True)
            light[group] = light[group] + dr.select(event.emitter == k + 1, light_of.radiance * counts, 0.0)
        if self.environment is not None:
            pixel = self.environment.pixel(direction)
            density = self.environment.density_of(pixel) * shares[-1] / total
            counts = _balance(spread, density, first, self.environment.visible)
            counts = dr.select(dr.isinf(event.distance), counts, 0.0)
            parts = self._by_groups(self.environment.radiance_of(pixel), groups)
            light = [old + counts * new for old, new in zip(light, parts, strict=True)]
        return light

    def _by_groups(self, parts: Sequence[Float], groups: int) -> list[Float]:
        """Radiance of every group from that of every part of the environment."""
        light = [arrays().Float(0)] * groups
        for group, part in zip(self.part_groups, parts, strict=True):
            light[group] = light[group] + part
        return light


def share_of_drawn(lamp: LampDrawn, spread: Float) -> Float:
    """What the light of a drawn lamp counts, where a walk could have hit it, too."""
    return dr.select(lamp.density > 0.0, lamp.density / (lamp.density + spread), 1.0)


def _balance(spread: Float, density: Float, first: Bool, visible: bool) -> Float:
    """What light that a walk hit counts: all of it where it could not be drawn."""
    both = dr.select(dr.isinf(spread), 1.0, spread / dr.fmax(spread + density, 1e-30))
    return dr.select(first, 1.0 if visible else 0.0, both)


def _one(group: int, groups: int) -> list[Float]:
    """1 for one group, 0 for the others."""
    return [arrays().Float(float(k == group)) for k in range(groups)]


def _over(light: Float, density: Float) -> Float:
    """Light over its density; 0 where there is none."""
    return dr.select(density > 0.0, light / dr.fmax(density, 1e-30), 0.0)
