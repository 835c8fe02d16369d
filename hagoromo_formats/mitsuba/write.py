"""Write: a scene as a folder that Mitsuba 3 loads: scene.xml, a PLY for each mesh, volumes, the map of light."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import mitsuba_from_opencv
from hagoromo.files.exr import write_exr
from hagoromo.files.whole import scratch_folder, whole_folder, write_text
from hagoromo.image.prepared.nesting import Glass
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.surface import Surface
from hagoromo.light.other_programs import MitsubaPlugin
from hagoromo_formats.mitsuba.bsdf_numbers import NAME, numbers_of
from hagoromo_formats.mitsuba.medium import box_shape
from hagoromo_formats.mitsuba.textures import in_relief, is_coloured, ply_of, textures_of
from hagoromo_formats.mitsuba.xml_text import VERSION, Element, plugin, text_of


def write_mitsuba(scene: Scene, out: str | Path, force: bool = False) -> list[str]:
    """Write a scene as a folder with scene.xml, for `mitsuba.load_file` with `parallel=False`, after
    `hagoromo_formats.mitsuba.register()`.

    Surfaces keep their reflectance, by the plugin `hagoromo`. Returns what is lost, a line each. `InputError` for a
    folder that is there, without `force`.
    """
    with whole_folder(out, force) as folder:
        return _fill(scene, folder)


def load_into_mitsuba(scene: Scene) -> Any:
    """The scene as `mitsuba.Scene`, in the variant that Mitsuba has: as `write_mitsuba` writes it."""
    import drjit as dr
    import mitsuba as mi

    from hagoromo_formats.mitsuba.plugin import register

    register()
    with scratch_folder() as folder:
        _fill(scene, folder)
        threads = dr.thread_count()
        dr.set_thread_count(max(threads, 2))  # Mitsuba waits for ever where it reads an EXR with one, as on one core
        try:
            return mi.load_file(str(folder / "scene.xml"), parallel=False)  # see `register`
        finally:
            dr.set_thread_count(threads)


def _fill(scene: Scene, folder: Path) -> list[str]:
    root, lost = Element("scene", {"version": VERSION}), []
    lamps, wide = ([light.mitsuba() for light in lights] for lights in (scene.lamps, scene.wide_lights))
    seen = [light.visible for light, (form, _) in zip(scene.wide_lights, wide, strict=True) if form is not None]
    kind = "volpath" if scene.boxes or any(s.optics == "glass" for s in scene.surfaces) else "path"
    root.append(plugin("integrator", kind, max_depth=-1, hide_emitters=not any(seen)))
    root.append(_sensor(scene.camera))
    root.extend(_element(form, folder) for form, _ in (*lamps, *wide) if form is not None)
    around = _around_glass(scene.surfaces)
    for number, surface in enumerate(scene.surfaces):
        root.append(_surface(surface, folder, number + 1, around.get(number, 1.0)))
    for number, box in enumerate(scene.boxes):
        shape, missing = box_shape(box, folder, f"box_{number + 1}")
        root.append(shape)
        lost += missing
    write_text(folder / "scene.xml", text_of(root))
    of_lights = dict.fromkeys(line for _, lines in (*lamps, *wide) for line in lines)
    return [*lost, *of_lights, *_lost(scene, seen)]


def _lost(scene: Scene, seen: list[bool]) -> Iterator[str]:
    camera = scene.camera
    if any(camera.distortion):
        yield "the distortion of the lens"
    if abs(camera.focal[0] / camera.focal[1] - 1.0) > 1e-6:
        yield "pixels that are not square: the vertical focal length"
    for surface in scene.surfaces:
        if surface.absorption is not None:
            yield f"surface {surface.name!r}: the absorption within its glass, which is clear"
        if is_coloured(surface.body_texture):
            yield f"surface {surface.name!r}: the spectra of its body_texture: Mitsuba has its linear sRGB under D65"
        if all(surface.reliefs):
            yield f"surface {surface.name!r}: how its heights add to its normals: Mitsuba turns one after the other"
        if surface.bump_texture is not None:
            yield f"surface {surface.name!r}: slopes between pixels of its heights: Mitsuba has those of flat facets"
    if any(seen) and not all(seen):
        yield "which lights the camera sees: it sees all"
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


def _element(light: MitsubaPlugin, folder: Path) -> Element:
    """A light, whose maps become files of the folder."""
    for name, channels in light.maps.items():
        write_exr(folder / name, dict(channels))
    return plugin(light.tag, light.kind, parts=[_element(part, folder) for part in light.parts], **light.values)


def _around_glass(surfaces: Sequence[Surface]) -> dict[int, float]:
    """Refractive index around each glass that lies in other glass, by its number."""
    if sum(surface.optics == "glass" for surface in surfaces) < 2:
        return {}
    around = Glass(surfaces, np.zeros(3)).around
    return {one: float(surfaces[outer].reflectance.n) for one, outer in around.items() if outer is not None}


def _surface(surface: Surface, folder: Path, number: int, around: float) -> Element:
    textures, columns = textures_of(surface, folder, number)
    bsdf = _optics(surface, around) if surface.optics else _reflecting(surface, textures)
    parts = [in_relief(bsdf, surface, folder, number)]
    surface = surface.traced()
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
    plain: dict[str, Any] = {key: value for key, value in values.items() if key not in placed}
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
