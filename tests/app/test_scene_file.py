"""A scene file gives the scene it describes; photographs of it carry what is true."""

import numpy as np
import pytest

from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.record import write_json
from hagoromo.image.picture.image import read_image
from hagoromo.image.render import render
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.simulate import simulate
from hagoromo.matter.build import build
from hagoromo.photograph.capture import load_capture
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.box_store import save_box
from tests.ball_scene import KEY, ball_scene

SUN = '\n[[lamp]]\nname = "sun"\nto_lamp = [-1.0, -1.0, 0.0]\nspectrum = "D65"\n'
SCENE = ball_scene((53, 37), 90.0, (KEY, SUN), "cie1931").replace(
    "scale = 0.15", "scale = 0.15\nposition = [0.0, 0.2, 0.0]"
)
SCENE += "\n[render]\nseed = 7\n"


@pytest.fixture
def scene_path(tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


def test_a_scene_file_gives_the_scene_it_describes(scene_path):
    scene, settings = load_scene(scene_path)
    assert (scene.camera.width, scene.camera.height, scene.camera.focal) == (53, 37, (90.0, 90.0))
    np.testing.assert_allclose(scene.camera.position, (0, -1, 0), atol=1e-12)  # rounding of the inverse pose
    assert [lamp.name for lamp in scene.lamps] == ["key", "sun"]
    assert scene.surfaces[0].name == "ball"
    np.testing.assert_allclose(scene.surfaces[0].pose[:3, 3], (0.0, 0.2, 0.0))
    assert settings == Settings(seed=7)


def test_a_preset_is_binned_and_posed(scene_path):
    scene_path.write_text(SCENE.replace("size = [53, 37]\nfocal = [90.0, 90.0]", PRESET))
    camera = load_scene(scene_path)[0].camera
    assert (camera.width, camera.height) == (384, 256)
    np.testing.assert_allclose(camera.focal[0], 85.0 * 384 / 22.7)


PRESET = 'preset = "canon_eos_kiss_digital"\nfocal_mm = 85.0\nbinning = 8'


def test_boxes_meshes_and_calibrated_cameras_are_found_beside_the_file(scene_path):
    import trimesh

    density = np.ones((5, 3, 7), np.float32)
    up = np.broadcast_to(np.array([0, 0, 1], np.float32), (*density.shape, 3))
    reflectance = load_scene(scene_path)[0].surfaces[0].reflectance
    box = VolumeBox.from_arrays(density, up, 0.01, 100.0, [reflectance], name="slab")
    save_box(box, scene_path.parent / "slab.zarr")
    trimesh.creation.box().export(scene_path.parent / "cube.ply")
    lens = {"w": 53, "h": 37, "fl_x": 91.0, "fl_y": 92.0, "cx": 26.0, "cy": 18.0}
    write_json(scene_path.parent / "camera.json", lens | dict.fromkeys(("k1", "k2", "p1", "p2", "k3"), 0.0))
    more = SCENE.replace("size = [53, 37]", 'file = "camera.json"').replace("focal = [90.0, 90.0]\n", "")
    more = more.replace('shape = "sphere"', 'mesh = "cube.ply"')
    other = "{alpha = 0.1, beta = 0.1, gamma = 0.3, n = 1.4, body_colour = 1.0, element = 'sphere'}"
    place = "position = [0.0, 0.0, 0.3]\nrotation_deg = [0.0, 0.0, 90.0]"
    scene_path.write_text(f'{more}[[box]]\nfile = "slab.zarr"\ntau = 7.0\nmaterials = [{other}]\n{place}\n')
    scene, _ = load_scene(scene_path)
    slab = scene.boxes[0]
    assert scene.camera.focal == (91.0, 92.0) and slab.name == "slab" and slab.tau == 7.0
    assert slab.materials[0].element == "sphere"
    np.testing.assert_allclose(slab.pose @ (1, 0, 0, 1), (0.0, 1.0, 0.3, 1.0), atol=1e-12)  # rounding of cos 90°
    faces = scene.surfaces[0].faces
    assert faces is not None and faces.shape == (12, 3)


def test_a_box_is_built_from_its_recipe(scene_path):
    figures = "alpha = 0.1\nbeta = 0.1\ngamma = 0.3\nn = 1.5\nbody_colour = 1.0"
    recipe = f'kind = "solid"\nvoxel_mm = 4.0\nshape = {{form = "sphere", radius_mm = 30.0}}\n[material]\n{figures}\n'
    (scene_path.parent / "ball.toml").write_text(recipe)
    scene_path.write_text(SCENE + '[[box]]\nrecipe = "ball.toml"\nposition = [0.0, 0.0, 0.2]\nname = "here"\n')
    box = load_scene(scene_path)[0].boxes[0]
    assert box.name == "here" and box.voxel_size == 0.004
    moved = box.pose - build(scene_path.parent / "ball.toml").pose
    np.testing.assert_allclose(moved[:3, 3], (0.0, 0.0, 0.2))
    scene_path.write_text(SCENE + '[[box]]\nrecipe = "ball.toml"\nfile = "ball.zarr"\n')
    with pytest.raises(InputError, match="box 1: give either file"):
        load_scene(scene_path)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("size = [53, 37]", "", "one of preset"),
        ("eye = [0.0, -1.0, 0.0]", "", "either eye"),
        ("size = [53, 37]", "size = [53, 37]\nzoom = 2", "unknown key 'zoom'.* known are preset"),
        ("intensity = 3.0", "intensty = 3.0", "unknown key 'intensty'"),
        ('shape = "sphere"', 'shape = "blob"', "must be one of"),
        ('shape = "sphere"', "", "either shape"),
        ("alpha = 0.2", "alpha = 0.9", "energy conservation"),
        ("scale = 0.15", "scale = [1, 2]", "3 finite numbers"),
        ("scale = 0.15", "scale = 0.0", "invertible"),
        ("[0.0, 0.2, 0.0]", "[0.0, -3.0, 0.0]", "looks at nothing"),
        ('"cie1931"', '"../secret.csv"', "points outside"),
        ('shape = "sphere"', 'mesh = "absent.ply"', "does not exist"),
        ("seed = 7", 'shadows = "soft"', "one of map, march, none"),
        ("[render]", "[rendering]", "unknown key 'rendering': known are camera, lamp"),
    ],
)
def test_a_bad_scene_is_refused(scene_path, old, new, said):
    assert old in SCENE
    scene_path.write_text(SCENE.replace(old, new))
    with pytest.raises(InputError, match=said) as refused:
        load_scene(scene_path)
    assert "scene.toml" in str(refused.value) and "\n" not in str(refused.value)


def test_a_capture_has_a_photograph_per_lamp_and_the_true_shape(scene_path):
    """Points lie on the sphere to float32 rays: 1e-6 of the distance. Values: 6 standard deviations as stated."""
    simulate(scene_path).save(scene_path.parent / "ball")
    scene, _ = load_scene(scene_path)
    capture = load_capture(scene_path.parent / "ball")
    assert [p.name for p in capture.photographs] == ["key", "sun"] and capture.truth is not None
    points, normals = capture.points, capture.normals
    assert points is not None and normals is not None
    seen = np.linalg.norm(normals, axis=2) > 0
    centre = np.array([0.0, 0.2, 0.0])
    np.testing.assert_allclose(np.linalg.norm(points[seen] - centre, axis=1), 0.15, atol=2e-6)
    np.testing.assert_allclose(normals[seen] * 0.15, points[seen] - centre, atol=5e-6)
    for photograph, lamp in zip(capture.photographs, scene.lamps, strict=True):
        truth = render(scene.with_lamps(lamp)).expose(Response.load("cie1931"))
        valid = photograph.mask & seen
        deviation = (photograph.values - truth)[valid] / np.sqrt(photograph.variance[valid])
        assert np.abs(deviation).max() < 6
    assert capture.truth["surfaces"][0]["reflectance"]["n"] == 1.5


def test_a_rendered_scene_file_is_its_scene_rendered(scene_path):
    image = render(scene_path)
    scene, settings = load_scene(scene_path)
    paths = image.save(scene_path.parent / "a.exr", scene.camera.response)
    assert [path.name for path in paths] == ["a.exr", "a.png"]
    np.testing.assert_array_equal(read_image(paths[0]).weights, render(scene, settings).weights)
    with pytest.raises(InputError, match=r"a\.exr exists"):
        image.save(paths[0])


IES = """IESNA:LM-63-2002
TILT=NONE
1 -1 1 3 2 1 2 0 0 0
1 1 40
0 40 90
0 180
900 600 10
900 300 0
"""
SPOTS = """
axis = [-0.2, 1.0, -0.5]
axis_power = 8.0

[[lamp]]
name = "flood"
position = [0.1, 0.1, 0.9]
profile = "flood.ies"
roll_deg = 90.0
intensity = 0.5
candela_from_profile = true
spectrum = "A"
"""


def test_a_scene_file_has_spots_and_measured_profiles(scene_path):
    """The flood's plane C = 0 is turned to +y, where its file has twice the light of −y at 40°; 450 cd on its axis."""
    from hagoromo.light.colour import colour_matching
    from hagoromo.light.spectrum import Spectrum, integrate_product

    (scene_path.parent / "flood.ies").write_text(IES)
    scene_path.write_text(SCENE.replace("intensity = 3.0\n", "intensity = 3.0" + SPOTS))
    scene, _ = load_scene(scene_path)
    spot, flood, _ = scene.lamps
    assert spot.axis_power == 8.0
    np.testing.assert_allclose(np.array(spot.axis), np.array([-0.2, 1.0, -0.5]) / np.sqrt(1.29))
    s, c = np.sin(np.radians(40.0)), np.cos(np.radians(40.0))
    np.testing.assert_allclose(
        flood.relative_intensity([[0, 0, -1], [0, s, -c], [0, -s, -c], [0, 0, 1]]), [1, 2 / 3, 1 / 3, 0], atol=1e-12
    )
    bright = integrate_product(Spectrum.named("A"), colour_matching()[1], lo=360.0, hi=830.0)
    assert 683.0 * np.array(flood.intensity) * bright == pytest.approx(450.0, rel=1e-12)
    assert "profile 'flood'" in repr(flood)


def test_photographs_under_spots_and_profiles_keep_their_lamps(scene_path, tmp_path):
    """transforms.json holds the table, so that the capture needs no IES file; light falls off as in the scene."""
    (scene_path.parent / "flood.ies").write_text(IES)
    scene_path.write_text(SCENE.replace("intensity = 3.0\n", "intensity = 3.0" + SPOTS))
    scene, _ = load_scene(scene_path)
    simulate(scene_path).save(tmp_path / "capture")
    lamps = [shot.lamps[0] for shot in load_capture(tmp_path / "capture").photographs]
    points = np.random.default_rng(3).uniform(-0.3, 0.3, (17, 3))
    for lamp, true in zip(lamps, scene.lamps, strict=True):
        ours, theirs = (one.direction_and_irradiance(points)[1] for one in (lamp, true))
        np.testing.assert_allclose(ours, theirs, rtol=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ('"flood.ies"', '"../flood.ies"', "points outside"),
        ('"flood.ies"', '"none.ies"', "does not exist"),
        ('"flood.ies"', "7", "a profile is an IES file"),
        ('profile = "flood.ies"\nroll_deg = 90.0\n', "", "candela_from_profile needs a profile"),
        ("roll_deg = 90.0", 'axis_power = 3.0', "leave axis_power out"),
        ('"flood.ies"', "{lateral = [0], vertical = [0, 90], intensity = [[1, 2], [3]]}", "rows of different lengths"),
        ('"flood.ies"', "{lateral = [0], vertical = [0, 90], intensity = [[1, 2]]}", "states no candela"),
    ],
)  # fmt: skip
def test_wrong_lamps_of_a_scene_are_refused(scene_path, old, new, said):
    (scene_path.parent / "flood.ies").write_text(IES)
    scene_path.write_text(SCENE.replace("intensity = 3.0\n", "intensity = 3.0" + SPOTS.replace(old, new)))
    with pytest.raises(InputError, match=said):
        load_scene(scene_path)
