"""Lights: all lights of a scene, of which walks may also meet some by themselves, see `hagoromo.light.wide_light`.

One of them, or of the other lamps, is drawn at each event, and the direction that a walk goes on in may meet one. Both
are estimates of the same light: each counts by the balance heuristic (Veach & Guibas 1995). The density of the walk's
directions is known for planes only, so that in its place stands f over the albedo, which it follows nearly: any
density, the same in both places, leaves the sum without bias.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup
from hagoromo.light.wide_light import LightOnDevice, RayEnd
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.crossing import selected
from hagoromo.transport.gamma_rows import GammaRows
from hagoromo.transport.lighting import LampRow
from hagoromo.transport.path.free_flight import Random
from hagoromo.transport.path.next_event import LampDrawn
from hagoromo.transport.surface_colours import SurfaceHit

LEAST_ALBEDO = 1e-3


LightOfGroups = tuple[LightOnDevice, Sequence[int]]  # and the group in the palette of each of its parts


class Lights:
    """The lights of a scene, of which some have a size; places count from the scene's origin."""

    def __init__(
        self,
        lamps: Sequence[LampRow],
        wide: Sequence[LightOfGroups],
        reflectances: Sequence[Reflectance],
        gamma_rows: GammaRows | None = None,
    ) -> None:
        """wide: lights beside the lamps. reflectances: in the order of their materials; those of the surfaces are the
        last. gamma_rows: of a scene with textures of γ.
        """
        self.lights: list[LightOfGroups] = [*((lamp.light, [lamp.group]) for lamp in lamps), *wide]
        self.seen = True  # whether walks from the camera bring the lights that it sees themselves
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

    def drawn(self, point: Array3f, groups: int, random: Random) -> tuple[LampDrawn, Random]:
        """A light, drawn about in the share that it has of the irradiance, and a direction to it; groups: how many."""
        jit = arrays()
        choice, *numbers = (random.next_float32() for _ in range(5))
        nothing = jit.Float(0)
        chosen = LampDrawn(jit.Array3f(0, 0, 1), nothing, nothing, jit.UInt(0), [nothing] * groups, nothing)
        shares = [light.share(point) for light, _ in self.lights]
        total, below = sum(shares, nothing), nothing
        for (light, own), share in zip(self.lights, shares, strict=True):
            above = below + share
            here = (choice * total >= below) & (choice * total < above) & (share > 0.0)
            below, chance = above, share / total
            to_light = light.drawn(point, *numbers)
            tints, strength, density = _by_groups(to_light.tints, own, groups), total, nothing
            if to_light.density is not None:
                density = to_light.density * chance
                strength = _over(light.radiance, density)
            new = LampDrawn(to_light.to_lamp, to_light.distance, strength, jit.UInt(0), tints, density)
            chosen = LampDrawn(*(selected(here, one, other) for one, other in zip(new, chosen, strict=True)))
        return chosen, random

    def hit(
        self, origin: Array3f, direction: Array3f, event: RayEnd, spread: Float, first: Bool, groups: int
    ) -> list[Float]:
        """Radiance of every group that a walk hits on its way to its next event, and there.

        origin: of the walk's event before. spread: as it was there for this direction; infinity where no light could
        have been drawn. first: whether the walk comes from the camera, and sees what is visible.
        """
        shares = [light.share(origin) for light, _ in self.lights]
        total, radiances = sum(shares, arrays().Float(0)), [arrays().Float(0)] * groups
        for (light, own), share in zip(self.lights, shares, strict=True):
            hit = light.hit(origin, direction, event)
            if hit is None:
                continue
            counts = _balance(spread, hit.density * share / total, first, light.visible and self.seen)
            for group, tint in zip(own, hit.tints, strict=True):
                radiances[group] = radiances[group] + dr.select(hit.there, light.radiance * counts * tint, 0.0)
        return radiances


def front_of(hit: SurfaceHit) -> UInt:
    """1 + the number of the surface whose front rays hit; 0 for nothing, or a back."""
    return dr.select(hit.front & dr.isfinite(hit.distance), hit.surface + 1, arrays().UInt(0))


def share_of_drawn(lamp: LampDrawn, spread: Float) -> Float:
    """What the light of a drawn lamp counts, where a walk could have hit it, too."""
    return dr.select(lamp.density > 0.0, lamp.density / (lamp.density + spread), 1.0)


def _balance(spread: Float, density: Float, first: Bool, visible: bool) -> Float:
    """What light that a walk hit counts: all of it where it could not be drawn."""
    both = dr.select(dr.isinf(spread), 1.0, spread / dr.fmax(spread + density, 1e-30))
    return dr.select(first, 1.0 if visible else 0.0, both)


def _by_groups(parts: Sequence[Float], own: Sequence[int], groups: int) -> list[Float]:
    """What each of all groups has of the parts of a light; own: the group of each part."""
    light = [arrays().Float(0)] * groups
    for group, part in zip(own, parts, strict=True):
        light[group] = light[group] + part
    return light


def _over(light: Float, density: Float) -> Float:
    """Light over its density; 0 where there is none."""
    return dr.select(density > 0.0, light / dr.fmax(density, 1e-30), 0.0)
