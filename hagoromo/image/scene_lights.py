"""Lights of a scene TOML beside its lamps: [[area_lamp]] and [environment]."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

from hagoromo.camera.pose import turned_about_axes
from hagoromo.errors import described
from hagoromo.files.checks import inside
from hagoromo.files.record import Positive, Record, Vector, about, decode
from hagoromo.light.area_lamp import AreaLamp
from hagoromo.light.environment import Environment
from hagoromo.light.spectrum import SOURCE, Spectrum
from hagoromo.light.surface_emission import SurfaceEmission

AS_IT_IS = (0.0, 0.0, 0.0)


class SceneAreaLamp(Record, frozen=True, kw_only=True):
    """A lamp with a size: a sphere (`radius`) or a rectangle (`edges`). It is light only: it casts no shadow."""

    position: Annotated[Vector, about("middle of the lamp, world axes [m]")]
    radius: Annotated[Positive | None, about("radius of a sphere, which shines outwards [m]")] = None
    edges: Annotated[
        tuple[Vector, Vector] | None,
        about("two sides of a rectangle as vectors at right angles [m]; it shines to the side of their cross product"),
    ] = None
    radiance: Annotated[
        float, about("radiance, alike in all directions [W/(m² sr) times the unit of the spectrum]")
    ] = 1.0
    spectrum: Annotated[
        Any, SOURCE, about("relative spectrum: a name such as D65, a CSV file, a number or a table")
    ] = 1.0
    visible: Annotated[bool, about("whether the camera sees the lamp itself")] = False
    name: Annotated[str, about("name of the lamp")] = ""


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
        spectrum = Spectrum.load(key.spectrum, folder)
        return AreaLamp(key.position, key.radius, key.edges, key.radiance, spectrum, key.name, key.visible)


def environment_from(record: dict[str, Any] | None, folder: Path, where: str) -> Environment | None:
    """The environment of a table [environment] of a file in `folder`; None without one."""
    if record is None:
        return None
    key = decode(record, SceneEnvironment, where)
    with described(where):
        spectrum, turn = Spectrum.load(key.spectrum, folder), turned_about_axes(key.rotation_deg)
        return Environment.from_file(inside(folder, key.file), key.scale, spectrum, turn, key.visible, key.name)
