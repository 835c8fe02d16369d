"""Motion in USD: keyframes of a scene file out as time samples, which usd-core evaluates, and back."""

import numpy as np
import pytest
import trimesh

import hagoromo as hg
from hagoromo.app.cli import DONE, main
from hagoromo.image.film.shutter import scene_with_shutter
from hagoromo.image.scene.motion import read_motion

pytest.importorskip("pxr", reason="needs usd-core: pip install 'hagoromo[usd]'")

SCENE = """
[camera]
size = [40, 30]
focal = [50.0, 50.0]
eye = [0.0, -0.10, 0.05]
target = [0.0, 0.0, 0.004]
name = "eye"
[[lamp]]
position = [-0.1, -0.1, 0.2]
intensity = 0.03
[[surface]]
name = "floor"
shape = "rectangle"
scale = [0.06, 0.06, 1.0]
reflectance = {alpha = 0.2, beta = 0.0, gamma = 0.25, n = 1.5, body_colour = 0.6}
[[surface]]
name = "pyramid"
mesh = "pyramid.ply"
smooth = false
scale = [1.0, 2.0, 1.0]
position = [0.02, 0.0, 0.0]
reflectance = {alpha = 0.2, beta = 0.0, gamma = 0.25, n = 1.5, body_colour = 0.9}
[[surface]]
name = "cube"
shape = "cube"
scale = [0.004, 0.006, 0.005]
reflectance = {alpha = 0.3, beta = 0.0, gamma = 0.25, n = 1.5, body_colour = 0.9}
[motion]
between = "linear"
frames_per_second = 10.0
seconds = 1.0
shutter_open = 0.1
shutter_close = 0.3
[[motion.camera]]
time = 0.0
eye = [0.0, -0.10, 0.05]
[[motion.camera]]
time = 1.0
eye = [0.02, -0.10, 0.05]
[[motion.surface]]
surface = "pyramid"
time = 0.05
position = [0.02, 0.0, 0.002]
rotation_deg = [10.0, 0.0, -30.0]
[[motion.surface]]
surface = "pyramid"
time = 0.95
position = [-0.01, 0.01, 0.004]
rotation_deg = [30.0, 120.0, 420.0]
[[motion.surface]]
surface = "cube"
time = 0.0
position = [-0.02, 0.0, 0.01]
[[motion.surface]]
surface = "cube"
time = 0.8
position = [-0.02, 0.02, 0.02]
rotation_deg = [0.0, 0.0, 90.0]
"""
TIMES = (0.0, 0.05, 0.13, 0.5, 0.77, 0.95, 1.0)


@pytest.fixture
def scene_file(tmp_path):
    corners = 0.008 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 1.5]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]])
    (tmp_path / "pyramid.ply").write_bytes(trimesh.Trimesh(corners, faces, process=False).export(file_type="ply"))
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def moving(path, times):
    """Where the camera is, and the corners of each surface, at times [s]: by pictures of an instant each."""
    motion, found = read_motion(path), []
    for time in times:
        motion.shutter = time - 1e-9, time + 1e-9
        scene, _ = scene_with_shutter(path, motion)
        corners = []
        for number, surface in enumerate(scene.surfaces):
            assert scene.moving is not None
            pose = scene.moving.surfaces.get(number, surface.pose[None])[0]
            vertices, faces = surface.triangles()
            corners.append(np.sort((vertices[faces].reshape(-1, 3) @ pose[:3, :3].T + pose[:3, 3]), axis=0))
        assert scene.moving is not None
        found.append((scene.moving.cameras[0], {s.name: c for s, c in zip(scene.surfaces, corners, strict=True)}))
    return found


@pytest.mark.by_night("a.usdc")
@pytest.mark.parametrize("name", ["a.usda", "a.usdc"])
def test_keyframes_go_out_and_come_back(scene_file, tmp_path, name):
    """Camera and corners at times at and between keyframes and frames, to 1e-6 m; the camera between its samples to the
    chord of a frame. Vertices are in single precision.
    """
    assert main(["convert", str(scene_file), "--out", str(tmp_path / name)]) == DONE
    assert main(["convert", str(tmp_path / name), "--out", str(tmp_path / "again")]) == DONE
    before, after = (moving(path, TIMES) for path in (scene_file, tmp_path / "again" / "scene.toml"))
    for (camera, corners), (camera_again, corners_again) in zip(before, after, strict=True):
        np.testing.assert_allclose(camera_again, camera, atol=2e-4)
        for surface, wanted in corners.items():
            np.testing.assert_allclose(corners_again[surface], wanted, atol=2e-6, err_msg=surface)
    assert np.abs(before[0][1]["pyramid"] - before[3][1]["pyramid"]).max() > 0.01
    motion = read_motion(tmp_path / "again" / "scene.toml")
    assert motion.shutter == pytest.approx((0.1, 0.3)) and motion.rate == 10.0 and motion.seconds == 1.0


def test_usd_itself_has_the_same_places(scene_file, tmp_path):
    """Transforms that usd-core evaluates at 5.0 frames, on and between samples."""
    usd, geometry = (pytest.importorskip(f"pxr.{each}") for each in ("Usd", "UsdGeom"))
    assert main(["convert", str(scene_file), "--out", str(tmp_path / "a.usda")]) == DONE
    stage = usd.Stage.Open(str(tmp_path / "a.usda"))
    assert stage.GetTimeCodesPerSecond() == 10.0 and stage.GetEndTimeCode() == 10.0
    prims = {prim.GetDisplayName(): prim for prim in stage.Traverse()}
    camera = geometry.Camera(prims["eye"])
    assert (camera.GetShutterOpenAttr().Get(), camera.GetShutterCloseAttr().Get()) == pytest.approx((1.0, 3.0))
    for time in (0.3, 0.55):
        ((pose, _),) = moving(scene_file, [time])
        cache = geometry.XformCache(usd.TimeCode(10.0 * time))
        seen = np.array(cache.GetLocalToWorldTransform(prims["eye"])).T @ np.diag([1.0, -1, -1, 1])
        np.testing.assert_allclose(np.linalg.inv(seen), pose, atol=2e-4)
        motion = read_motion(scene_file)
        turn = np.eye(4)
        record = motion.at(time)["surface"][1]
        for axis, angle in enumerate(np.radians(record["rotation_deg"])):
            one, (i, j) = np.eye(4), ((axis + 1) % 3, (axis + 2) % 3)
            one[[i, i, j, j], [i, j, i, j]] = np.cos(angle), -np.sin(angle), np.sin(angle), np.cos(angle)
            turn = one @ turn
        turn[:3, 3] = record["position"]
        found = np.array(cache.GetLocalToWorldTransform(prims["pyramid"])).T
        np.testing.assert_allclose(found, turn @ np.diag([1.0, 2.0, 1.0, 1.0]), atol=1e-6)


OTHERS = """#usda 1.0
(
    metersPerUnit = 0.01
    upAxis = "Y"
    timeCodesPerSecond = 24
)
def Xform "above" {
    double3 xformOp:translate.timeSamples = { 1: (0, 0, 0), 13: (6, 0, 0) }
    uniform token[] xformOpOrder = ["xformOp:translate"]
    def Mesh "square" {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    }
    def Mesh "grows" {
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4]
        int[] faceVertexIndices = [0, 1, 2, 3]
        point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
        double3 xformOp:scale.timeSamples = { 1: (1, 1, 1), 13: (2, 2, 2) }
        uniform token[] xformOpOrder = ["xformOp:scale"]
    }
    def SphereLight "lamp" {
        float inputs:radius.timeSamples = { 1: 0.1, 13: 0.2 }
    }
}
"""


def test_what_others_move_is_read_and_the_rest_is_said(tmp_path, capsys):
    """6 cm in 12 codes of 24 a second, in metres and z up; a scale over time, lamps and other attributes are lines."""
    (tmp_path / "a.usda").write_text(OTHERS)
    assert main(["convert", str(tmp_path / "a.usda"), "--out", str(tmp_path / "scene")]) == DONE
    said = "".join(capsys.readouterr())
    assert "'grows': its motion, which is not of shifts and turns alone" in said
    assert "its inputs:radius changes" in said and "lamp 'lamp': its motion" in said
    motion = read_motion(tmp_path / "scene" / "scene.toml")
    assert motion.seconds == pytest.approx(0.5) and [*motion.surfaces] == [0]
    places = [motion.at(time)["surface"][0]["position"] for time in (0.0, 0.25, 0.5)]
    np.testing.assert_allclose(places, [[0.0, 0, 0], [0.03, 0, 0], [0.06, 0, 0]], atol=1e-9)


def test_a_box_is_an_empty_place_that_moves(scene_file, tmp_path, capsys):
    """For the .vdb of the box, which has no place of its own."""
    usd, geometry = (pytest.importorskip(f"pxr.{each}") for each in ("Usd", "UsdGeom"))
    grey = hg.Reflectance(0.1, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="sphere")
    axes = np.zeros((3, 4, 5, 3), np.float32)
    axes[..., 2] = 1.0
    hg.VolumeBox.from_arrays(np.ones((3, 4, 5), np.float32), axes, 0.001, 3000.0, [grey]).save(tmp_path / "b.zarr")
    keys = (f"time = {t}\nposition = [0.0, {t}, 0.01]\nrotation_deg = [0.0, 0.0, {90.0 * t}]\n" for t in (0.0, 1.0))
    moved = "".join(f"[[motion.box]]\nbox = 0\n{key}" for key in keys)
    box = '[[box]]\nname = "cloth"\nfile = "b.zarr"\n[motion]'
    scene_file.write_text(SCENE.replace("[motion]", box) + moved)
    assert main(["convert", str(scene_file), "--out", str(tmp_path / "a.usda")]) == DONE
    assert "write each as .vdb" in "".join(capsys.readouterr())
    stage = usd.Stage.Open(str(tmp_path / "a.usda"))
    (prim,) = (each for each in stage.Traverse() if each.GetDisplayName() == "cloth")
    motion = read_motion(scene_file)
    for time in (0.0, 0.5):
        motion.shutter = time - 1e-9, time + 1e-9
        scene, _ = scene_with_shutter(scene_file, motion)
        assert scene.moving is not None
        found = np.array(geometry.XformCache(usd.TimeCode(10.0 * time)).GetLocalToWorldTransform(prim)).T
        np.testing.assert_allclose(found, scene.moving.boxes[0, 0], atol=1e-6)


def test_other_formats_say_that_motion_is_lost(scene_file, tmp_path, capsys):
    assert main(["convert", str(scene_file), "--out", str(tmp_path / "a.glb")]) == DONE
    assert "motion" in "".join(capsys.readouterr())


def test_it_is_blurred_as_the_scene_that_went_out(scene_file, tmp_path):
    """Blocks of 5 × 5 pixels of the picture while the shutter is open, in their noise."""
    from tests.judges import blocks_agree

    assert main(["convert", str(scene_file), "--out", str(tmp_path / "a.usdc")]) == DONE
    assert main(["convert", str(tmp_path / "a.usdc"), "--out", str(tmp_path / "again")]) == DONE
    settings = (hg.Settings(samples=64, seed=seed) for seed in (1, 2))
    paths = scene_file, tmp_path / "again" / "scene.toml"
    one, other = (hg.render(path, each, mode="path") for path, each in zip(paths, settings, strict=True))
    noise = np.asarray(one.variance) + np.asarray(other.variance)
    assert blocks_agree(one.xyz()[..., 1], other.xyz()[..., 1], noise, 5)
