"""Laws that every light with a size has: what is drawn, hit and stood for by lamps is one light.

A new kind joins `LIGHTS`; nothing else here knows kinds.
"""

import math
import re
from pathlib import Path
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
import pytest

import hagoromo
import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.image.scene.emitter_mesh import emitters_of
from hagoromo.light.shapes import SHAPES

DRAWS = 1 << 16
POINT = np.array([0.05, -0.04, 0.02])
LOW, HIGH = POINT - 0.1, POINT + 0.1
POSE = np.array([[0.2, 0.0, 0.0, 0.1], [0.0, -0.15, 0.0, 0.2], [0.0, 0.0, -1.0, 0.7], [0.0, 0.0, 0.0, 1.0]])
MATTE = hg.Reflectance(0.25, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0))
GLOWING = hg.Surface(MATTE, "rectangle", pose=POSE, emission=hg.SurfaceEmission(5.0), name="panel")
SHAPED = {
    "sphere": hg.AreaLamp((0.3, -0.4, 0.7), radius=0.35, radiance=5.0),
    "rectangle": hg.AreaLamp((0.3, 0.1, 0.6), edges=((0.4, 0.3, 0.0), (0.3, -0.4, 0.0)), radiance=5.0),
    "tube": hg.AreaLamp((0.1, -0.2, 0.6), radius=0.1, along=(0.1, 0.3, 0.2), radiance=3.0),
}
LIGHTS = SHAPED | {
    "environment": hg.Environment(np.random.default_rng(7).random((16, 32, 3)) ** 3, 0.5),
    "surface": emitters_of((hg.Surface.floor(0.0, 1.0, MATTE), GLOWING))[0],
}


class End(NamedTuple):
    distance: object
    face: object
    front: object


def drawn_and_met(light):
    """Directions (n, 3), density (n,), radiance (n, parts) as they are drawn; whether they are hit, density and
    radiance as rays meet it that end behind all lights, or at the surface that shines.
    """
    jit, source = arrays(), light.on_device()
    point = jit.Array3f(*map(float, POINT))
    numbers = (jit.Float(row) for row in np.random.default_rng(8).random((4, DRAWS)).astype(np.float32))
    drawn = source.drawn(point, *numbers)
    distance, front = (jit.Float(math.inf), 0) if light.surface is None else (drawn.distance, light.surface + 1)
    end = End(distance, jit.Array3f(0, 0, -1.0), jit.UInt(front))
    hit = source.hit(point, drawn.to_lamp, end)
    sides = [(drawn.density, drawn.tints), (hit.density, hit.tints)]
    each = [
        (np.broadcast_to(np.array(density), DRAWS).astype(float), radiances(source, tints)) for density, tints in sides
    ]
    return np.array(drawn.to_lamp, np.float64).T, each[0], np.broadcast_to(np.array(hit.there), DRAWS), each[1]


def radiances(source, tints):
    return np.stack([np.broadcast_to(np.array(source.radiance * tint), DRAWS) for tint in tints], axis=1).astype(float)


def test_every_shape_of_lamps_is_looked_at_here():
    assert {type(lamp.shape) for lamp in SHAPED.values()} == set(SHAPES)


@pytest.mark.parametrize("name", LIGHTS)
def test_a_ray_in_a_drawn_direction_meets_the_light_with_that_density(name):
    light = LIGHTS[name]
    _, (density, radiance), there, (again, seen) = drawn_and_met(light)
    assert radiance.shape == (DRAWS, len(light.parts)) and there[density > 0.0].mean() > 0.99  # rounding at the outline
    inner = there & (density > 0.0)
    off = np.abs(again[inner] / density[inner] - 1.0)  # at the outline the cosine is a difference of like numbers
    assert np.median(off) < 1e-4 and np.quantile(off, 0.99) < 0.01
    assert (np.abs(seen[inner] - radiance[inner]).max(axis=1) <= 1e-6 * radiance.max()).mean() > 0.999


@pytest.mark.parametrize("name", LIGHTS)
def test_lamps_in_its_place_light_planes_as_drawn_directions_do(name):
    """Irradiance of planes that face 20 directions, of all parts: root mean square within the tolerance."""
    light, tolerance = LIGHTS[name], 0.03
    ways, (density, radiance), *_ = drawn_and_met(light)
    few = light.points(LOW, HIGH, tolerance)
    assert few.error <= tolerance
    normals = np.random.default_rng(9).normal(size=(20, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    weights = np.where(density > 0.0, radiance.sum(axis=1) / np.maximum(density, 1e-30), 0.0)
    each = np.maximum(ways @ normals.T, 0.0) * weights[:, None]
    lit = np.zeros(20)
    for lamp in few.lamps:
        to_lamp, irradiance = lamp.direction_and_irradiance(POINT)
        lit += np.maximum(normals @ to_lamp, 0.0) * irradiance
    noise = np.linalg.norm(each.std(axis=0)) / math.sqrt(DRAWS)
    assert noise < 0.01 * np.linalg.norm(lit)
    assert np.linalg.norm(each.mean(axis=0) - lit) < tolerance * np.linalg.norm(lit) + 3.0 * noise


@pytest.mark.parametrize("name", LIGHTS)
def test_its_share_is_about_the_irradiance_that_it_gives(name):
    """Within a factor of 4, so that no light is drawn far too rarely."""
    jit, light = arrays(), LIGHTS[name]
    _, (density, radiance), *_ = drawn_and_met(light)
    facing = np.where(density > 0.0, radiance.sum(axis=1) / np.maximum(density, 1e-30), 0.0).mean()
    share = np.array(light.on_device().share(jit.Array3f(*map(float, POINT)))).item()
    assert 0.25 < share / facing < 4.0


@pytest.mark.parametrize("name", LIGHTS)
def test_what_is_only_seen_is_the_same_light(name):
    light = LIGHTS[name]
    seen, whole = light.seen_on_device(), light.on_device()
    assert np.array(seen.radiance).item() == np.array(whole.radiance).item() and seen.visible == whole.visible
    assert seen.visible == light.visible and all(part.spectrum.values.any() for part in light.parts)


@pytest.mark.parametrize("name", LIGHTS)
def test_all_walks_under_it_are_one_kernel(name):
    """The first look at some walks, and all of them: no light keeps an array that becomes a part of the kernel."""
    light, floor = LIGHTS[name], hg.Surface.floor(0.0, 1.0, MATTE)
    place = {"environment": "environment"} | dict.fromkeys(SHAPED, "area_lamps")
    given: dict[str, Any] = {place[name]: (light,) if name in SHAPED else light} if name in place else {}
    view = hg.Camera(9, 7, (9.0, 9.0), (4.5, 3.5)).look_at((0.0, -1.0, 0.8), (0.0, 0.0, 0.0))
    scene = hg.Scene(view, (hg.Lamp((0, 0, 1)),), (), (floor, *(() if given else (GLOWING,))), **given)
    with dr.scoped_set_flag(dr.JitFlag.KernelHistory, True):
        dr.kernel_history_clear()
        hg.render(scene, hg.Settings(samples=2), mode="path")
        walks = [kernel for kernel in dr.kernel_history() if kernel.get("operation_count", 0) > 1000]
    assert len(walks) == 2 and len({kernel["hash"] for kernel in walks}) == 1


@pytest.mark.parametrize("program", ["mitsuba", "gltf", "usd"])
@pytest.mark.parametrize("name", LIGHTS)
def test_other_programs_have_it_or_people_are_told(name, program):
    form, lost = getattr(LIGHTS[name], program)()
    assert form is not None or lost
    assert all(line == line.strip() and len(line) > 10 for line in lost)


KINDS = r"hagoromo\.light\.(area_lamp|environment|environment_light|emitting_surface|shapes|beams|surface_emission)\b"
KNOW_KINDS = {  # each says what a scene consists of, or what its file says
    "image/scene/scene.py", "image/scene/scene_lights.py", "image/scene/emitter_mesh.py", "image/scene/surface.py",
}  # fmt: skip


def test_march_full_path_and_films_know_no_kind_of_light():
    """Files that import one, but for a function of colours."""
    home = Path(hagoromo.__file__).parent
    found = {
        path.relative_to(home).as_posix()
        for room in ("transport", "image")
        for path in (home / room).rglob("*.py")
        for line in path.read_text(encoding="utf-8").splitlines()
        if re.search(KINDS, line) and not line.endswith("import upsampled")
    }
    assert found == KNOW_KINDS


def test_the_page_names_files_and_members_that_there_are():
    """The part "Add a light" of docs/architecture.md."""
    home = Path(hagoromo.__file__).parents[1]
    page = (home / "docs" / "architecture.md").read_text(encoding="utf-8")
    part = page.split("## Add a light")[1].split("\n## ")[0]
    paths = set(re.findall(r"`((?:hagoromo|tests)/[\w/]+(?:\.py)?)", part))
    assert len(paths) > 5 and {path for path in paths if not (home / path).exists()} == set()
    asked = part.split("| asked for |")[1].split("\n\n")[0].splitlines()[2:]
    members = {word for row in asked for word in re.findall(r"`(\w+)(?:\(\))?`", row.split("|")[3])}
    of_device = {"share", "drawn", "hit"}
    assert of_device < members
    for light in LIGHTS.values():
        assert {name for name in members - of_device if not hasattr(light, name)} == set()
        assert {name for name in of_device if not hasattr(light.on_device(), name)} == set()
