"""Lights of a scene TOML beside its lamps: [[area_lamp]] and [environment]."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.pose import turned_about_axes
from hagoromo.errors import described
from hagoromo.files.checks import inside
from hagoromo.files.record import Record, Vector, about, decode, with_optional
from hagoromo.image.scene.scene import Scene
from hagoromo.light.area_lamp import AreaLamp
from hagoromo.light.emitting_surface import SurfaceEmission
from hagoromo.light.environment import Environment
from hagoromo.light.shapes import KEYS
from hagoromo.light.spectrum import SOURCE, Spectrum

AS_IT_IS = (0.0, 0.0, 0.0)


class _SceneAreaLamp(Record, frozen=True, kw_only=True):
    """A lamp with a size, of the shape that its keys say. It is light only: it casts no shadow."""

    position: Annotated[Vector, about("middle of the lamp, world axes [m]")]
    radiance: Annotated[
        float, about("radiance, alike in all directions [W/(m² sr) times the unit of the spectrum]")
    ] = 1.0
    spectrum: Annotated[
        Any, SOURCE, about("relative spectrum: a name such as D65, a CSV file, a number or a table")
    ] = 1.0
    visible: Annotated[bool, about("whether the camera sees the lamp itself")] = False
    name: Annotated[str, about("name of the lamp")] = ""


SceneAreaLamp: Any = with_optional("SceneAreaLamp", _SceneAreaLamp, KEYS)


class SceneEnvironment(Record, frozen=True, kw_only=True):
    """Light from all around, infinitely far away: a map of the sphere, twice as wide as high."""

    file: Annotated[str, about("EXR (channels R, G, B, or Y) or Radiance picture (.hdr), linear sRGB")]
    scale: Annotated[float, about("radiance of the value 1 [W/(m² sr) times the unit of the spectrum]")] = 1.0
    spectrum: Annotated[
        Any, SOURCE, about("spectrum of a grey pixel: a name such as D65, a CSV file, a number or a table")
    ] = 1.0
    rotation_deg: Annotated[
        Vector, about("turns of the map about x, then y, then z [°]; its middle lies towards +x, its top is +z")
    ] = AS_IT_IS
    visible: Annotated[bool, about("whether the camera sees it behind all matter")] = False
    name: Annotated[str, about("name of the environment; default: that of the file")] = ""


class EmissionRecord(Record, frozen=True, kw_only=True):
    """Light that the front of a surface gives off, alike in all directions; it reflects light besides."""

    radiance: Annotated[float, about("radiance [W/(m² sr) times the unit of the spectrum]")]
    spectrum: Annotated[
        Any, SOURCE, about("relative spectrum: a name such as D65, a CSV file, a number or a table")
    ] = 1.0
    name: Annotated[str, about("name of the light; default: that of the surface")] = ""


def emission_from(record: dict[str, Any] | None, folder: Path, where: str) -> SurfaceEmission | None:
    """The emission of a table [[surface]] of a file in `folder`; None without one."""
    if record is None:
        return None
    key = decode(record, EmissionRecord, f"{where} emission")
    with described(f"{where} emission"):
        return SurfaceEmission(key.radiance, Spectrum.load(key.spectrum, folder), key.name)


def area_lamp_from(record: dict[str, Any], folder: Path, where: str) -> AreaLamp:
    """The lamp of a table [[area_lamp]] of a file in `folder`."""
    key = decode(record, SceneAreaLamp, where)
    with described(where):
        spectrum, shape = Spectrum.load(key.spectrum, folder), {name: getattr(key, name) for name in KEYS}
        return AreaLamp(
            key.position, radiance=key.radiance, spectrum=spectrum, name=key.name, visible=key.visible, **shape
        )


def environment_from(record: dict[str, Any] | None, folder: Path, where: str) -> Environment | None:
    """The environment of a table [environment] of a file in `folder`; None without one."""
    if record is None:
        return None
    key = decode(record, SceneEnvironment, where)
    with described(where):
        spectrum, turn = Spectrum.load(key.spectrum, folder), turned_about_axes(key.rotation_deg)
        return Environment.from_file(inside(folder, key.file), key.scale, spectrum, turn, key.visible, key.name)


def turned_tables(
    tables: Mapping[str, Any], scene: Scene, turn: NDArray[np.float64], middle: NDArray[np.float64]
) -> dict[str, Any]:
    """The tables of the lights of a scene, `tables`, turned by a rotation (3, 3) about the vertical axis through
    `middle` (3,) [m]: those that change. A surface that gives off light is matter, and stays.
    """
    changed: dict[str, Any] = {}
    for key, lamps in (("lamp", scene.lamps), ("area_lamp", scene.area_lamps)):
        if lamps:
            pairs = zip(tables[key], lamps, strict=True)
            changed[key] = [table | lamp.turned_record(turn, middle) for table, lamp in pairs]
    if scene.environment is not None:
        x, y, z = tables["environment"].get("rotation_deg", AS_IT_IS)
        angle = math.degrees(math.atan2(turn[1, 0], turn[0, 0]))  # z is the last axis that a map is turned about
        changed["environment"] = tables["environment"] | {"rotation_deg": [x, y, z + angle]}
    return changed
