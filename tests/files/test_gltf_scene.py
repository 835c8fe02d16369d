"""Scenes of glTF: cameras, lamps and meshes where the file has them, and a scene as VTK and trimesh find it."""

import json
import math

import numpy as np
import pytest

from fuzz.meshes import ARRAYS, CORNERS, TURN, gltf_record
from hagoromo.app.cli import main
from hagoromo.camera.formats.camera_file import read_views
from hagoromo.errors import InputError
from hagoromo.files.mesh import read_mesh
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import linear_colour
from hagoromo.light.spectrum import Spectrum
from hagoromo_formats.scenes.gltf_scene import LIGHTS, gltf_from_scene, scene_from_gltf
from tests.ball_scene import ball_scene

HALF = math.sqrt(0.5)
SPOT = "[[lamp]]\nposition = [0.5, -1.0, 2.0]\naxis = [0.0, 0.6, -0.8]\naxis_power = 3.0\nintensity = 7.0\n"
FAR = "[[lamp]]\nto_lamp = [0.0, -0.6, 0.8]\nintensity = 2.0\n"


def write(folder, more=()):
    """The mesh of the fuzzer, at two places; a camera that a parent turns and moves; three lamps."""
    record = gltf_record("a.bin")
    record["materials"] = [
        {"name": "red", "pbrMetallicRoughness": {"baseColorFactor": [1.0, 0.0, 0.0, 1.0], "metallicFactor": 0.0}}
    ]
    for primitive in record["meshes"][0]["primitives"]:
        primitive["material"] = 0
    record["cameras"] = [{"type": "perspective", "perspective": {"yfov": 0.8, "aspectRatio": 1.5, "znear": 0.1}}]
    lights = [
        {"type": "point", "intensity": 5.0, "color": [1.0, 1.0, 1.0]},
        {"type": "directional", "intensity": 2.0},
        {"type": "spot", "intensity": 3.0, "spot": {"innerConeAngle": 0.2, "outerConeAngle": 0.6}},
    ]
    record["extensions"] = {LIGHTS: {"lights": lights}}
    turn = {"rotation": [HALF, 0.0, 0.0, HALF]}
    record["nodes"] += [
        {"translation": [1.0, 2.0, 3.0], "rotation": [0.0, HALF, 0.0, HALF], "scale": [2.0, 2.0, 2.0], "children": [3]},
        {"translation": [0.0, 0.0, 0.5], "camera": 0, "name": "eye"},
        *(turn | {"translation": [0.0, float(k), 0.0], "extensions": {LIGHTS: {"light": k}}} for k in range(3)),
    ]
    record["scenes"] = [{"nodes": [0, 2, 4, 5, 6]}]
    for change in more:
        change(record)
    (folder / "a.gltf").write_text(json.dumps(record))
    (folder / "a.bin").write_bytes(ARRAYS)
    return folder / "a.gltf"


def test_surfaces_are_called_as_their_nodes(tmp_path):
    """Those without a name by their numbers."""

    def called(record):
        record["nodes"][0]["name"] = "vase"

    scene_from_gltf(write(tmp_path, [called]), tmp_path / "scene")
    names = [surface.name for surface in load_scene(tmp_path / "scene" / "scene.toml")[0].surfaces]
    assert sorted(names) == ["mesh 3", "mesh 4", "vase", "vase"]  # the mesh has two parts, at two places


def test_cameras_lamps_and_meshes_stand_where_the_file_says(tmp_path):
    """A turn by 90° about y takes z to x: the camera is at (1, 2, 3) + 2 · 0.5 along x and looks along −x.

    A turn by 90° about x takes z to −y: lamps shine along y.
    """
    assert scene_from_gltf(write(tmp_path), tmp_path / "scene") == []
    scene, _ = load_scene(tmp_path / "scene" / "scene.toml")
    place = scene.camera.camera_to_world
    assert place[:3, 3] == pytest.approx([2.0, 2.0, 3.0])
    assert place[:3, 2] == pytest.approx([-1.0, 0.0, 0.0], abs=1e-12)  # OpenCV: z is forwards
    assert place[:3, 1] == pytest.approx([0.0, -1.0, 0.0], abs=1e-12)  # and y down
    assert scene.camera.width == 1080 and 2 * math.atan(360 / scene.camera.focal[1]) == pytest.approx(0.8)
    point, far, spot = scene.lamps
    assert point.position == pytest.approx([0.0, 0.0, 0.0]) and point.intensity == 5.0
    assert far.to_lamp == pytest.approx([0.0, -1.0, 0.0], abs=1e-12) and far.intensity == 2.0
    assert spot.axis == pytest.approx([0.0, 1.0, 0.0], abs=1e-12) and spot.position == pytest.approx([0.0, 2.0, 0.0])
    assert spot.relative_intensity([math.sin(0.4), math.cos(0.4), 0.0]) == pytest.approx(0.5)
    assert read_views(tmp_path / "scene" / "cameras.json").keys() == {"eye"}
    vertices = np.concatenate([np.asarray(surface.vertices) for surface in scene.surfaces])
    outer = np.reshape(TURN, (4, 4)).T
    expected = [outer @ [*corner, 1.0] for corner in CORNERS]
    expected += [outer @ [*(corner + np.array([0.0, 2.0, 0.0])), 1.0] for corner in CORNERS]
    for corner in np.array(expected)[:, :3]:
        assert np.abs(vertices - corner).max(axis=1).min() < 1e-6
    red = scene.surfaces[0].reflectance.body_colour
    assert linear_colour(red, Spectrum.named("D65")) == pytest.approx([1.0, 0.0, 0.0], abs=1e-3)


def test_a_file_without_camera_or_lamp_gets_them_and_says_so(tmp_path):
    def bare(record):
        record["scenes"] = [{"nodes": [0]}]

    made = scene_from_gltf(write(tmp_path, [bare]), tmp_path / "scene")
    assert len(made) == 2 and "no camera" in made[0] and "no lamp" in made[1]
    scene, _ = load_scene(tmp_path / "scene" / "scene.toml")
    corners = np.concatenate([np.asarray(surface.vertices) for surface in scene.surfaces])
    seen = np.c_[corners, np.ones(len(corners))] @ scene.camera.world_to_camera.T
    assert (seen[:, 2] > 0).all() and (np.abs(1000 * seen[:, :2] / seen[:, 2:3]) < 480).all()


def a_scene(tmp_path):
    (tmp_path / "scene.toml").write_text(ball_scene((60, 40), 90.0, [SPOT, FAR]))
    return load_scene(tmp_path / "scene.toml")[0]


def test_a_scene_that_is_written_comes_back(tmp_path):
    """Camera and lamps as they were, but for pixels; the ball as a mesh whose corners lie on it."""
    scene = a_scene(tmp_path)
    lost = gltf_from_scene(scene, tmp_path / "a.glb")
    assert any("spectra" in each for each in lost)
    scene_from_gltf(tmp_path / "a.glb", tmp_path / "again")
    again, _ = load_scene(tmp_path / "again" / "scene.toml")
    assert again.camera.world_to_camera == pytest.approx(scene.camera.world_to_camera, abs=1e-6)
    old, new = (2 * math.atan(0.5 * c.height / c.focal[1]) for c in (scene.camera, again.camera))
    assert new == pytest.approx(old) and again.camera.width / again.camera.height == pytest.approx(1.5)
    spot, far = again.lamps
    assert spot.position == pytest.approx([0.5, -1.0, 2.0]) and spot.axis == pytest.approx([0.0, 0.6, -0.8])
    assert far.to_lamp == pytest.approx([0.0, -0.6, 0.8])
    assert spot.axis_power == pytest.approx(3.0, rel=1e-6)
    for before, after in zip(scene.lamps, again.lamps, strict=True):
        old, new = (float(np.mean(lamp.intensity) * lamp.spectrum.at(550.0)) for lamp in (before, after))
        strength = new / old
        assert strength == pytest.approx(1.0, rel=0.1)  # the green of a smooth spectrum
    ball = scene.surfaces[0]
    inside = (np.asarray(again.surfaces[0].vertices) - ball.pose[:3, 3]) @ np.linalg.inv(ball.pose[:3, :3]).T
    assert np.linalg.norm(inside, axis=1) == pytest.approx(1.0, abs=1e-5)


def test_vtk_finds_the_camera_the_lamps_and_the_mesh(tmp_path):
    importers = pytest.importorskip("vtkmodules.vtkIOImport")
    rendering = pytest.importorskip("vtkmodules.vtkRenderingCore")
    pytest.importorskip("vtkmodules.vtkRenderingOpenGL2")
    scene = a_scene(tmp_path)
    gltf_from_scene(scene, tmp_path / "a.glb")
    importer, window = importers.vtkGLTFImporter(), rendering.vtkRenderWindow()
    renderer = rendering.vtkRenderer()
    window.SetOffScreenRendering(1)
    window.AddRenderer(renderer)
    importer.SetRenderWindow(window)
    importer.SetFileName(str(tmp_path / "a.glb"))
    importer.SetCamera(0)
    importer.Update()
    camera, place = renderer.GetActiveCamera(), scene.camera.camera_to_world
    assert camera.GetPosition() == pytest.approx(place[:3, 3], abs=1e-5)
    assert camera.GetDirectionOfProjection() == pytest.approx(place[:3, 2], abs=1e-5)
    far, spot = renderer.GetLights()  # VTK lays its lamps 1 behind the node, along z
    assert spot.GetTransformedFocalPoint() == pytest.approx([0.5, -1.0, 2.0]) and spot.GetPositional()
    along = np.subtract(spot.GetTransformedFocalPoint(), spot.GetTransformedPosition())
    assert along == pytest.approx([0.0, 0.6, -0.8], abs=1e-6)
    towards = np.subtract(far.GetTransformedPosition(), far.GetTransformedFocalPoint())
    assert towards == pytest.approx([0.0, -0.6, 0.8], abs=1e-6) and not far.GetPositional()
    ball = scene.surfaces[0].corners()
    bounds = np.reshape(renderer.ComputeVisiblePropBounds(), (3, 2)).T
    assert bounds == pytest.approx(np.stack([ball.min(axis=0), ball.max(axis=0)]), abs=1e-3)


def test_a_scene_that_is_written_is_a_mesh_too(tmp_path):
    gltf_from_scene(a_scene(tmp_path), tmp_path / "a.glb")
    assert len(read_mesh(tmp_path / "a.glb").faces) == 20 * 4**5


def loop(record):
    record["nodes"][3]["children"] = [2]


BAD = {
    "a loop": (loop, "a.gltf.*within themselves"),
    "a node that is not there": (lambda record: record["scenes"][0]["nodes"].append(99), "a.gltf"),
    "a view without an angle": (lambda record: record["cameras"][0].pop("perspective"), "a.gltf"),
    "a matrix of nine": (lambda record: record["nodes"][0].update(matrix=[1.0] * 9), "a.gltf"),
}


@pytest.mark.parametrize("name", BAD)
def test_a_damaged_scene_is_refused(tmp_path, name):
    change, said = BAD[name]
    path = write(tmp_path, [change])
    with pytest.raises(InputError, match=said):
        scene_from_gltf(path, tmp_path / "scene")
    assert not (tmp_path / "scene").exists()


def test_the_command_converts_both_ways(tmp_path, capsys):
    assert main(["convert", str(write(tmp_path)), "--out", str(tmp_path / "scene")]) == 0
    assert main(["convert", str(tmp_path / "scene" / "scene.toml"), "--out", str(tmp_path / "b.glb")]) == 0
    assert "lost: spectra" in capsys.readouterr().out


def test_a_scene_without_meshes_is_refused(tmp_path):
    def bare(record):
        record["scenes"] = [{"nodes": []}]

    with pytest.raises(InputError, match="no mesh in its scene"):
        scene_from_gltf(write(tmp_path, [bare]), tmp_path / "scene")
