"""Write: a scene as a folder that Mitsuba 3 loads: scene.xml, a PLY for each mesh, volumes, the map of light."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import mitsuba_from_opencv
from hagoromo.files.exr import write_exr
from hagoromo.files.whole import scratch_folder, whole_folder, write_text
from hagoromo.image.nesting import Glass
from hagoromo.image.scene import Scene
from hagoromo.image.surface import Surface
from hagoromo.light.area_lamp import AreaLamp
from hagoromo.light.environment import Environment
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo_formats.mitsuba.bsdf import NAME, numbers_of
from hagoromo_formats.mitsuba.medium import box_shape
from hagoromo_formats.mitsuba.textures import is_coloured, ply_of, textures_of
from hagoromo_formats.mitsuba.xml_text import VERSION, Element, plugin, text_of

ENVIRONMENT_FROM_MITSUBA = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])  # axes of our map from those of `envmap`
WIDEST_BEAM = 89.0  # degrees, of a spot
BLACK = Spectrum.constant(0.0)


def write_mitsuba(scene: Scene, out: str | Path, force: bool = False) -> list[str]:
    """Write a scene as a folder with scene.xml, for `mitsuba.load_file` after `hagoromo_formats.mitsuba.register()`.

    Surfaces keep their reflectance, by the plugin `hagoromo`. Returns what is lost, a line each. `InputError` for a
    folder that is there, without `force`.
    """
    with whole_folder(out, force) as folder:
        return _fill(scene, folder)


def load_into_mitsuba(scene: Scene) -> Any:
    """The scene as `mitsuba.Scene`, in the variant that Mitsuba has: as `write_mitsuba` writes it."""
    import mitsuba as mi

    from hagoromo_formats.mitsuba.plugin import register

    register()
    with scratch_folder() as folder:
        _fill(scene, folder)
        return mi.load_file(str(folder / "scene.xml"))


def _fill(scene: Scene, folder: Path) -> list[str]:
    root, lost = Element("scene", {"version": VERSION}), []
    seen = [lamp.visible for lamp in scene.area_lamps] + ([scene.environment.visible] if scene.environment else [])
    kind = "volpath" if scene.boxes or any(s.optics == "glass" for s in scene.surfaces) else "path"
    root.append(plugin("integrator", kind, max_depth=-1, hide_emitters=not any(seen)))
    root.append(_sensor(scene.camera))
    root.extend(_lamp(lamp) for lamp in scene.lamps)
    root.extend(_area_lamp(lamp) for lamp in scene.area_lamps)
    if scene.environment:
        root.extend(_environment(scene.environment, folder))
    around = _around_glass(scene.surfaces)
    for number, surface in enumerate(scene.surfaces):
        root.append(_surface(surface, folder, number + 1, around.get(number, 1.0)))
    for number, box in enumerate(scene.boxes):
        shape, missing = box_shape(box, folder, f"box_{number + 1}")
        root.append(shape)
        lost += missing
    write_text(folder / "scene.xml", text_of(root))
    return [*lost, *_lost(scene, seen)]


def _lost(scene: Scene, seen: list[bool]) -> Iterator[str]:
    camera = scene.camera
    if any(camera.distortion):
        yield "the distortion of the lens"
    if abs(camera.focal[0] / camera.focal[1] - 1.0) > 1e-6:
        yield "pixels that are not square: the vertical focal length"
    for lamp in scene.lamps:
        if lamp.axis is not None and _cone(lamp) is None:
            yield f"lamp {lamp.name!r}: its fall-off or profile; here it falls linearly, as a spot"
        if isinstance(lamp.intensity, tuple):
            yield f"lamp {lamp.name!r}: its intensity by channel, of which the mean stands"
    for surface in scene.surfaces:
        if surface.absorption is not None:
            yield f"surface {surface.name!r}: the absorption within its glass, which is clear"
        if surface.emission is not None:
            yield f"surface {surface.name!r}: the light that it gives off"
        if is_coloured(surface.body_texture):
            yield f"surface {surface.name!r}: the spectra of its body_texture: Mitsuba has its linear sRGB under D65"
    if scene.area_lamps:
        yield "area lamps hide what is behind them: Mitsuba's are bodies"
    if any(seen) and not all(seen):
        yield "which lights the camera sees: it sees all"
    if scene.environment:
        yield "the edges between pixels of the environment: Mitsuba interpolates; each pixel stands as 2 × 2 or more"
        yield "the spectrum of the environment: in spectral variants Mitsuba takes white for D65"
    if any(s.shape == "mesh" and s.smooth for s in scene.surfaces):
        yield "nothing of smooth meshes but at outlines, where shaded normals turn away from the eye"


def _sensor(camera: Camera) -> Element:
    """Pinhole or thin lens; Mitsuba counts the principal point from the middle to the left and up, in film sizes."""
    film = plugin(
        "film", "hdrfilm", parts=[plugin("rfilter", "box")], width=camera.width, height=camera.height,
        component_format="float32", pixel_format="rgb",
    )  # fmt: skip
    lens: dict[str, Any] = {}
    if camera.aperture:
        focus = camera.focus if math.isfinite(camera.focus) else 1e6
        lens = {"aperture_radius": 0.5 * camera.aperture, "focus_distance": focus}
    (x0, y0), size = camera.principal, (camera.width, camera.height)
    return plugin(
        "sensor", "thinlens" if camera.aperture else "perspective", parts=[film, plugin("sampler", "independent")],
        fov=2.0 * math.degrees(math.atan(0.5 * size[0] / camera.focal[0])), fov_axis="x",
        principal_point_offset_x=0.5 - x0 / size[0], principal_point_offset_y=0.5 - y0 / size[1],
        near_clip=1e-4, far_clip=1e6, to_world=mitsuba_from_opencv(camera.camera_to_world), **lens,
    )  # fmt: skip


def _lamp(lamp: Lamp) -> Element:
    light = lamp.spectrum * float(np.mean(lamp.intensity))
    if lamp.position is None:
        return plugin("emitter", "directional", direction=-np.asarray(lamp.to_lamp), irradiance=light)
    if lamp.axis is None:
        return plugin("emitter", "point", position=lamp.position, intensity=light)
    beam, edge = _cone(lamp) or _nearest_cone(lamp)
    return plugin(
        "emitter", "spot", to_world=_turned_z_to(lamp.axis, lamp.position), intensity=light, cutoff_angle=edge,
        beam_width=beam,
    )  # fmt: skip


def _cone(lamp: Lamp) -> tuple[float, float] | None:
    """Where a spot begins to fall and where it ends [°], of a profile that is even and then linear to nothing."""
    if lamp.profile is None:
        return None
    angles, values = lamp.profile.vertical, lamp.profile.intensity
    one = np.array([1.0, 1.0, 0.0] if len(angles) == 3 else [1.0, 0.0])
    if len(angles) not in (2, 3) or angles[0] != 0.0 or not (values == one).all():
        return None
    return float(angles[-2]), float(angles[-1])


def _nearest_cone(lamp: Lamp) -> tuple[float, float]:
    """As `_cone`, of any lamp with an axis: it is half as bright in the middle of the two."""
    angles = np.radians(np.arange(0.0, 180.0, 0.05))
    assert lamp.axis is not None
    side = lamp.frame[0]
    around = np.cos(angles)[:, None] * lamp.axis + np.sin(angles)[:, None] * side
    below = np.flatnonzero(lamp.relative_intensity(around) < 0.5)
    half = math.degrees(angles[below[0]]) if below.size else 180.0
    edge = min(2.0 * half, WIDEST_BEAM)
    return max(min(2.0 * half - edge, 0.99 * edge), 0.0), edge


def _turned_z_to(direction: NDArray[np.float64], place: NDArray[np.float64]) -> NDArray[np.float64]:
    """A pose whose third axis is `direction`, unit."""
    pose = np.eye(4)
    side = np.cross((0.0, 1.0, 0.0) if abs(direction[1]) < 0.9 else (1.0, 0.0, 0.0), direction)
    side /= np.linalg.norm(side)
    pose[:3, :3] = np.stack([side, np.cross(direction, side), direction], axis=1)
    pose[:3, 3] = place
    return pose


def _area_lamp(lamp: AreaLamp) -> Element:
    light = plugin("emitter", "area", radiance=lamp.spectrum * lamp.radiance)
    parts = [plugin("bsdf", "diffuse", reflectance=BLACK), light]
    kind, values = lamp.shape.mitsuba(lamp.position)
    return plugin("shape", kind, parts=parts, **values)


def _environment(environment: Environment, folder: Path) -> Iterator[Element]:
    """The map, its pixels as 2 × 2 or more, of one colour; R, G, B as they are."""
    values = np.asarray(environment.values, np.float32)
    values = values[..., None] if values.ndim == 2 else values
    times = max(2, math.ceil(256 / values.shape[0]))
    values = np.repeat(np.repeat(values, times, axis=0), times, axis=1)
    tint = environment.spectrum
    scale = environment.scale * (float(tint.values[0]) if np.ptp(tint.values) == 0.0 else tint.mean())
    channels = {c: np.ascontiguousarray(values[..., k if values.shape[2] == 3 else 0]) for k, c in enumerate("RGB")}
    write_exr(folder / "environment.exr", channels)
    pose = np.eye(4)
    pose[:3, :3] = environment.rotation @ ENVIRONMENT_FROM_MITSUBA
    yield plugin("emitter", "envmap", filename="environment.exr", scale=scale, to_world=pose)


def _around_glass(surfaces: Sequence[Surface]) -> dict[int, float]:
    """Refractive index around each glass that lies in other glass, by its number."""
    if sum(surface.optics == "glass" for surface in surfaces) < 2:
        return {}
    around = Glass(surfaces, np.zeros(3)).around
    return {one: float(surfaces[outer].reflectance.n) for one, outer in around.items() if outer is not None}


def _surface(surface: Surface, folder: Path, number: int, around: float) -> Element:
    textures, columns = textures_of(surface, folder, number)
    parts = [_optics(surface, around) if surface.optics else _reflecting(surface, textures)]
    if surface.shape != "mesh":
        return plugin("shape", surface.shape, parts=parts, to_world=np.asarray(surface.pose, float))
    import trimesh

    assert surface.vertices is not None and surface.faces is not None
    placed = surface.vertices @ surface.pose[:3, :3].T + surface.pose[:3, 3]
    if surface.smooth:
        normals = np.asarray(trimesh.Trimesh(placed, surface.faces, process=False).vertex_normals)
        columns |= dict(zip(("nx", "ny", "nz"), normals.T, strict=True))
    if surface.uv is not None:
        columns |= dict(zip("uv", np.asarray(surface.uv).T, strict=True))
    file = f"mesh_{number}.ply"
    (folder / file).write_bytes(ply_of(placed, surface.faces, columns))
    return plugin("shape", "ply", parts=parts, filename=file, face_normals=not surface.smooth)


def _reflecting(surface: Surface, textures: Sequence[Element]) -> Element:
    """The BSDF of a surface. textures: stand in place of the parameters that they are named as."""
    made, placed = surface.reflectance, {texture.get("name") for texture in textures}
    values = {**numbers_of(made), "body_colour": made.body_colour, "interface_colour": made.interface_colour}
    plain = {key: value for key, value in values.items() if key not in placed}
    return plugin("bsdf", NAME, parts=textures, **plain)


def _optics(surface: Surface, around: float) -> Element:
    made = surface.reflectance
    if surface.optics == "mirror":
        return plugin("bsdf", "conductor", material="none", specular_reflectance=made.interface_colour)
    colour = made.interface_colour
    return plugin(
        "bsdf",
        "dielectric",
        int_ior=float(made.n),
        ext_ior=around,
        specular_reflectance=colour,
        specular_transmittance=colour,
    )
