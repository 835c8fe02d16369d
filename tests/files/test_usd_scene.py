"""Scenes of USD: cameras, lamps, meshes and materials where the file has them, and a scene as others find it."""

import math

import numpy as np
import pytest

from fuzz.usd_scenes import SCENE
from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.files.mesh import read_mesh
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import colour_matching
from hagoromo.light.spectrum import Spectrum, integrate_product
from hagoromo_formats.curves.curve_file import read_curves
from hagoromo_formats.scenes.usd_out import usd_from_scene
from hagoromo_formats.scenes.usd_scene import scene_from_usd
from tests.ball_scene import ball_scene
from tests.files.blender import in_blender

pytest.importorskip("pxr", reason="needs usd-core: pip install 'hagoromo[usd]'")

SPOT = "[[lamp]]\nposition = [0.5, -1.0, 2.0]\naxis = [0.0, 0.6, -0.8]\naxis_power = 3.0\nintensity = 7.0\n"
FAR = "[[lamp]]\nto_lamp = [0.0, -0.6, 0.8]\nintensity = 2.0\n"
AREAS = """[[area_lamp]]
position = [0.0, 0.0, 2.0]
edges = [[0.0, 0.2, 0.0], [0.3, 0.0, 0.0]]
radiance = 10.0
spectrum = "D65"
[[area_lamp]]
position = [1.0, 0.0, 2.0]
radius = 0.1
radiance = 4.0
"""
MESH = """[[surface]]
name = "roof é"
mesh = "roof.ply"
smooth = false
reflectance = {alpha = 0.2, beta = 0.0, gamma = 0.2, n = 1.5, body_colour = 0.5}
"""


def read(tmp_path, text=SCENE):
    (tmp_path / "a.usda").write_text(text)
    lost = scene_from_usd(tmp_path / "a.usda", tmp_path / "scene")
    return load_scene(tmp_path / "scene" / "scene.toml")[0], lost


def test_units_axes_and_transforms_are_honoured(tmp_path):
    """Centimetres, y up: (x, y, z) cm is (x, −z, y) / 100 m; the parent scales by 2 and moves by 100 along x."""
    scene, _ = read(tmp_path)
    table = next(s for s in scene.surfaces if s.name == "table")
    vertices = np.asarray(table.vertices)
    low, high = vertices.min(axis=0), vertices.max(axis=0)
    assert low == pytest.approx([1.0, -0.2, 0.0]) and high == pytest.approx([1.2, 0.0, 0.2])
    ball = next(s for s in scene.surfaces if s.shape == "sphere")
    assert ball.pose[:3, 3] == pytest.approx([0.0, 0.0, 0.5]) and np.linalg.norm(ball.pose[:3, 0]) == pytest.approx(0.1)
    camera = scene.camera
    assert camera.camera_to_world[:3, 3] == pytest.approx([0.0, -3.0, 0.5])
    assert camera.camera_to_world[:3, 2] == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)  # towards −z of the file
    assert camera.camera_to_world[:3, 1] == pytest.approx([0.0, 0.0, -1.0], abs=1e-12)


def test_a_camera_has_its_lens_shift_and_focus(tmp_path):
    """f = 50, aperture 25 × 12.5 tenths of a centimetre, 400 × 200 px; shift 2.5 of 25 to the right is 40 px left."""
    camera = read(tmp_path)[0].camera
    assert (camera.width, camera.height) == (400, 200)
    assert camera.focal == pytest.approx((800.0, 800.0)) and camera.principal == pytest.approx((160.0, 100.0))
    assert camera.aperture == pytest.approx(50e-3 / 4.0) and camera.focus == pytest.approx(3.0)


def test_lamps_give_the_light_that_usd_states(tmp_path):
    scene, _ = read(tmp_path)
    lamps, areas = {each.name: each for each in scene.lamps}, {each.name: each for each in scene.area_lamps}
    sun = lamps["sun"]  # normalised: 3 · 2^1 is the irradiance
    assert sun.intensity == pytest.approx(6.0) and sun.to_lamp == pytest.approx([0.0, 0.0, 1.0], abs=1e-12)
    disc = lamps["disc"]  # radiance 1000 of a disc of 1°
    assert disc.intensity == pytest.approx(1000.0 * math.pi * math.sin(math.radians(0.5)) ** 2)
    point = lamps["point"]  # radiant intensity of a sphere of radius 10 cm and radiance 5: π r² L
    assert point.intensity == pytest.approx(math.pi * 0.01 * 5.0) and point.position == pytest.approx([0.0, -1.0, 2.0])
    spot = lamps["spot"]
    assert spot.axis == pytest.approx([0.0, 1.0, 0.0], abs=1e-12)
    inside, middle, outside = (
        float(spot.relative_intensity([math.sin(a), math.cos(a), 0.0])) for a in np.radians([19, 30, 41])
    )
    assert inside == pytest.approx(1.0, abs=1e-3) and middle == pytest.approx(0.5, abs=0.01) and outside == 0.0
    panel = areas["panel"]  # power 8 over 20 × 40 units of the file
    assert panel.radiance == pytest.approx(8.0 / 800.0) and panel.normal == pytest.approx([0.0, 1.0, 0.0], abs=1e-9)
    assert panel.area == pytest.approx(0.08)
    assert areas["bulb"].radius == pytest.approx(0.05) and areas["bulb"].radiance == pytest.approx(7.0)
    assert scene.environment is not None and scene.environment.radiance_from([0.0, 0.6, 0.8])[0] == pytest.approx(0.25)


def test_materials_become_matt_glossy_metal_and_glass(tmp_path):
    scene, lost = read(tmp_path)
    surfaces = {surface.name: surface for surface in scene.surfaces}
    red = surfaces["table"].reflectance
    assert red.body_colour.at(650.0) > 3.0 * red.body_colour.at(450.0)
    at_normal = red.beta * ((red.n - 1.0) / (red.n + 1.0)) ** 2  # n is raised: the body leaves little at grazing angles
    assert at_normal == pytest.approx(0.04 / (4.0 * math.pi * 0.4**4), rel=1e-6) and red.n > 1.5
    assert surfaces["ball"].optics == "glass" and surfaces["ball"].reflectance.n == pytest.approx(1.33)
    assert surfaces["box"].reflectance.body_colour.at(550.0) == pytest.approx(0.4)  # its displayColor
    assert not surfaces["table"].smooth
    said = "\n".join(lost)
    for word in (
        "clipping range",
        "a Cone",
        "lamp 'disc': its size",
        "lamp 'spot': its size",
        "how its gloss dims",
        "how its gloss rises",
    ):
        assert word in said
    assert "hidden" not in surfaces and not any("hidden" in line for line in lost)


def test_the_map_of_a_dome_lies_as_openexr_says(tmp_path):
    """Middle towards +z of the file, a quarter to its left towards +x, top +y; in our axes −y, +x and +z."""
    values = np.full((8, 16), 0.25, np.float32)
    values[3:5, 7:9], values[3:5, 3:5], values[0] = 1.0, 2.0, 3.0
    write_exr(tmp_path / "sky.exr", dict.fromkeys("RGB", values))
    map_of = 'def DomeLight "sky" { asset inputs:texture:file = @sky.exr@\n'
    scene, _ = read(tmp_path, SCENE.replace('def DomeLight "sky" { float inputs:intensity = 0.25', map_of))
    assert scene.environment is not None
    for towards, radiance in (([0, -1, 0], 1.0), ([1, 0, 0], 2.0), ([0, 0, 1], 3.0), ([-1, 0, 0], 0.25)):
        near = np.add(towards, (1e-3, 2e-3, 1e-3))
        assert scene.environment.radiance_from(near / np.linalg.norm(near))[0] == pytest.approx(radiance)


def a_scene(tmp_path, more=""):
    roof = "ply\nformat ascii 1.0\nelement vertex 4\nproperty float x\nproperty float y\nproperty float z\n"
    roof += "element face 2\nproperty list uchar int vertex_indices\nend_header\n0 0 1\n1 0 1\n1 1 1\n0 1 2\n3 0 1 2\n"
    (tmp_path / "roof.ply").write_text(roof + "3 0 2 3\n")
    (tmp_path / "scene.toml").write_text(ball_scene((60, 40), 90.0, [SPOT, FAR, AREAS, MESH]) + more)
    return load_scene(tmp_path / "scene.toml")[0]


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_a_scene_that_is_written_comes_back(tmp_path, suffix):
    scene, path = a_scene(tmp_path), tmp_path / f"b{suffix}"
    lost = usd_from_scene(scene, path)
    assert any("spectra" in each for each in lost) and any("tails" in each for each in lost)
    scene_from_usd(path, tmp_path / "again")
    again, _ = load_scene(tmp_path / "again" / "scene.toml")
    assert again.camera.world_to_camera == pytest.approx(scene.camera.world_to_camera, abs=1e-6)
    assert (again.camera.width, again.camera.height) == (60, 40)
    assert again.camera.focal == pytest.approx(scene.camera.focal, rel=1e-6)
    assert again.camera.principal == pytest.approx(scene.camera.principal, abs=1e-4)
    for old, new in zip(scene.lamps, again.lamps, strict=True):
        points = [[0.1, 0.2, 0.3], [0.0, -0.5, 0.1]]
        for one, two in zip(old.direction_and_irradiance(points), new.direction_and_irradiance(points), strict=True):
            assert two == pytest.approx(one, rel=1e-5, abs=1e-6)
    for old, new in zip(scene.area_lamps, again.area_lamps, strict=True):
        assert new.position == pytest.approx(old.position) and new.area == pytest.approx(old.area, rel=1e-6)
        assert new.radiance * new.spectrum.at(550.0) == pytest.approx(old.radiance * old.spectrum.at(550.0), rel=0.02)
    assert again.area_lamps[0].normal == pytest.approx(scene.area_lamps[0].normal, abs=1e-6)
    names, were = ({surface.name: surface for surface in each.surfaces} for each in (again, scene))
    assert names["roof é"].corners() == pytest.approx(were["roof é"].corners(), abs=1e-6)
    assert not names["roof é"].smooth and names["roof é"].reflectance.beta == 0.0
    assert names["roof é"].reflectance.body_colour.at(500.0) == pytest.approx(0.5 * 0.2 * math.pi, rel=1e-5)
    assert names["ball"].pose == pytest.approx(were["ball"].pose, abs=1e-6)
    assert names["ball"].reflectance.gamma == pytest.approx(were["ball"].reflectance.gamma, rel=1e-5)
    assert len(read_mesh(path).faces) == 2


@pytest.mark.parametrize("suffix", [".usda", ".usdc"])
def test_another_reader_finds_the_same(tmp_path, suffix):
    """tinyusdz, which shares no code with usd-core: objects, lens, light, points and materials."""
    tiny = pytest.importorskip("tinyusdz", reason="needs tinyusdz, another reader of USD")
    scene = a_scene(tmp_path)
    usd_from_scene(scene, tmp_path / f"b{suffix}")
    found = tiny.tydra.convert_to_render_scene(tiny.load(str(tmp_path / f"b{suffix}")))
    (camera,) = found.cameras()
    assert camera.focal_length / camera.horizontal_aperture == pytest.approx(90.0 / 60.0, rel=1e-5)
    assert camera.focal_length / camera.vertical_aperture == pytest.approx(90.0 / 40.0, rel=1e-5)
    d65, y = Spectrum.named("D65"), colour_matching()[1]
    luminance = 10.0 * integrate_product(d65, d65, y) / integrate_product(d65, y)
    strengths = {"rect": [luminance], "sphere": [28.0, 4.0], "distant": [2.0]}
    for kind, expected in strengths.items():
        got = [light.intensity * np.array(light.color) for light in found.lights() if light.type == kind]
        assert [float(each @ (0.2126, 0.7152, 0.0722)) for each in got] == pytest.approx(expected, rel=1e-3)
    (roof,) = (mesh for mesh in found.meshes() if mesh.display_name == "roof é")
    np.testing.assert_allclose(np.array(roof.points), np.asarray(scene.surfaces[0].vertices))
    faces = np.asarray(scene.surfaces[0].faces)
    np.testing.assert_array_equal(np.array(roof.face_vertex_indices).reshape(-1, 3), faces)
    looks = {each.name: each.preview_surface for each in found.materials()}
    assert any(look["diffuse_color"]["value"][1] == pytest.approx(0.1 * math.pi) for look in looks.values())


def test_blender_finds_the_camera_the_lamps_and_the_mesh(tmp_path):
    scene = a_scene(tmp_path)
    usd_from_scene(scene, tmp_path / "b.usda")
    found = in_blender(tmp_path, "b.usda")
    camera = next(e for e in found.values() if e["type"] == "CAMERA")
    assert np.array(camera["matrix"])[:3, 3] == pytest.approx(scene.camera.camera_to_world[:3, 3], abs=1e-5)
    assert camera["ratio"] == pytest.approx(90.0 / 60.0, rel=1e-5)
    lights = [e for e in found.values() if e["type"] == "LIGHT"]
    assert len(lights) == 4
    area = next(e for e in lights if e["kind"] == "AREA")
    assert sorted(area["sizes"]) == pytest.approx([0.2, 0.3], rel=1e-5)
    roof = next(e for e in found.values() if e["type"] == "MESH" and len(e["points"]) == 4)
    assert np.array(roof["points"]) == pytest.approx(np.asarray(scene.surfaces[0].vertices), abs=1e-5)


BAD = {
    "a sublayer": ("#usda 1.0\n(\n subLayers = [@./b.usda@]\n)\n", "names other files"),
    "a payload": ('#usda 1.0\ndef "a" (payload = @/etc/passwd@</a>) {}\n', "names other files"),
    "clips": ('#usda 1.0\ndef "a" (clips = {dictionary default = {asset[] assetPaths = [@b.usda@]}}) {}\n', "in clips"),
    "a map elsewhere": ('#usda 1.0\n(\nupAxis="Z"\n)\ndef Sphere "s" {}\n'
                        'def DomeLight "d" {asset inputs:texture:file = @../b.exr@\n}\n', "outside|not in"),
    "no surface": ('#usda 1.0\ndef Xform "a" {}\n', "no mesh and no shape"),
    "points that are not there": ('#usda 1.0\ndef Mesh "a" {int[] faceVertexCounts = [3]\n'
                                  "int[] faceVertexIndices = [0, 1, 7]\npoint3f[] points = [(0,0,0),(1,0,0)]\n}\n",
                                  "does not have"),
    "no USD": ("#usda 1.0\ndef {", "cannot be read"),
}  # fmt: skip


@pytest.mark.parametrize("name", BAD)
def test_what_names_other_files_or_is_damaged_is_refused(tmp_path, name):
    text, said = BAD[name]
    with pytest.raises(InputError, match=said):
        read(tmp_path, text)
    assert not (tmp_path / "scene").exists()


def test_references_that_multiply_are_refused(tmp_path):
    """Each of 20 levels holds the one before ten times: 10^20 objects of a file of 20 lines."""
    levels = ['class "l0" {\ndef Sphere "s" {}\n}\n']
    for k in range(1, 21):
        each = "".join(f'def "c{j}" (references = </l{k - 1}>) {{}}\n' for j in range(10))
        levels.append(f'class "l{k}" {{\n{each}}}\n')
    (tmp_path / "a.usda").write_text("#usda 1.0\n" + "".join(levels) + 'def "a" (references = </l20>) {}\n')
    with pytest.raises(InputError, match="objects, 100000 at most"):
        read_mesh(tmp_path / "a.usda")
    with pytest.raises(InputError, match="objects, 100000 at most"):
        read_curves(tmp_path / "a.usda")


def test_the_command_converts_both_ways_and_info_knows_it(tmp_path, capsys):
    (tmp_path / "a.usda").write_text(SCENE)
    assert main(["convert", str(tmp_path / "a.usda"), "--out", str(tmp_path / "scene")]) == 0
    assert main(["convert", str(tmp_path / "scene" / "scene.toml"), "--out", str(tmp_path / "b.usdc")]) == 0
    assert main(["convert", str(tmp_path / "b.usdc"), "--out", str(tmp_path / "c.ply")]) == 0
    assert main(["convert", str(tmp_path / "c.ply"), "--out", str(tmp_path / "d.usda")]) == 0
    assert "lost: spectra" in capsys.readouterr().out
    assert read_mesh(tmp_path / "d.usda").area == pytest.approx(read_mesh(tmp_path / "c.ply").area, rel=1e-6)
    assert main(["info", str(tmp_path / "a.usda")]) == 0
    said = capsys.readouterr().out
    assert "sun" in said and "eye" in said and "table" in said
