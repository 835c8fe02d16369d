"""Lit by points: a scene whose area lamps and environment are point lamps and far lamps, as the march takes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.image.emitter_mesh import emitters_of
from hagoromo.image.scene import Scene, check_lamps_outside, check_no_optics
from hagoromo.image.settings import Settings
from hagoromo.light.light_points import LightPoints, area_points, emitter_points, environment_points


def lit_by_points(scene: Scene, settings: Settings) -> tuple[Scene, dict[str, Any]]:
    """The scene under lamps only, as many as `settings.tolerance` asks for, and what metadata say of them.

    `InputError` for a lamp, or a part of one, inside a volume box.
    """
    check_no_optics(scene)
    check_lamps_outside(scene)
    if not scene.has_wide_lights:
        return scene, {}
    if settings.separate_lamps:
        raise InputError(
            "separate_lamps with area lamps, an environment or surfaces that give off light is for mode path: leave it "
            "out, or render by path"
        )
    corners = np.concatenate([thing.corners() for thing in (*scene.boxes, *scene.surfaces)])
    low, high = corners.min(axis=0), corners.max(axis=0)
    parts = [area_points(lamp, low, high, settings.tolerance) for lamp in scene.area_lamps]
    names = [lamp.name or f"area lamp {k + 1}" for k, lamp in enumerate(scene.area_lamps)]
    if scene.environment is not None:
        parts.append(environment_points(scene.environment, settings.tolerance))
        names.append(scene.environment.name)
    for emitter in emitters_of(scene.surfaces):
        parts.append(emitter_points(emitter.corners, emitter.emission, low, high, settings.tolerance))
        names.append(emitter.emission.name)
    lit = scene.with_lamps(*scene.lamps, *(lamp for part in parts for lamp in part.lamps))
    check_lamps_outside(lit)
    return lit, {"light_points": [_record(name, part) for name, part in zip(names, parts, strict=True)]}


def _record(name: str, part: LightPoints) -> dict[str, Any]:
    return {"name": name, "places": part.places, "error": part.error}
