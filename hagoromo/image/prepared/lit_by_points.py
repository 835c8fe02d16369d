"""Lit by points: a scene whose wide lights are point lamps and far lamps, as the march takes them."""

from __future__ import annotations

from typing import Any

import numpy as np

from hagoromo.errors import InputError
from hagoromo.image.scene.scene import Scene, check_lamps_outside, check_no_optics
from hagoromo.image.scene.settings import Settings
from hagoromo.light.light_points import LightPoints


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
    parts = [light.points(low, high, settings.tolerance) for light in scene.wide_lights]
    names = [light.name or f"{light.what} {number + 1}" for number, light in enumerate(scene.wide_lights)]
    lit = scene.with_lamps(*scene.lamps, *(lamp for part in parts for lamp in part.lamps))
    check_lamps_outside(lit)
    return lit, {"light_points": [_record(name, part) for name, part in zip(names, parts, strict=True)]}


def _record(name: str, part: LightPoints) -> dict[str, Any]:
    return {"name": name, "places": part.places, "error": part.error}
