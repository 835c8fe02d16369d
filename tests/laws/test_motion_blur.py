"""Laws of motion while the shutter is open: ramps of moving edges, the mean of pictures, and what is refused."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals

import hagoromo as hg
from hagoromo.app.cli import BAD_INPUT, DONE, main
from hagoromo.errors import InputError
from hagoromo.files.content import content_with_named
from hagoromo.files.png import write_png
from hagoromo.image.film.film import FilmOrder, frame_image
from hagoromo.image.film.shutter import scene_with_shutter
from hagoromo.image.scene.motion import read_motion
from hagoromo.image.scene.moving import INSTANTS, MovingScene
from hagoromo.image.scene.read_once import read_once
from hagoromo.image.scene.scene_file import scene_from_tables
from tests.judges import blocks_agree

SIDE, WAY, AWAY = 0.16, 0.1, 10.0  # [m] of a cube, how far it moves, from the camera
WIDE, TALL, FOCAL = 80, 7, 4000.0
GREY = hg.Reflectance(0.1, 0.0, 0.3, 1.5, hg.Spectrum.constant(1.0), element="sphere")


def cube():
    """Opaque within a hundredth of a pixel."""
    axes = np.zeros((16, 16, 16, 3), np.float32)
    axes[..., 1] = -1.0
    return hg.VolumeBox.from_arrays(np.ones((16, 16, 16), np.float32), axes, 0.01, 5000.0, [GREY])


def moved(pose, shifts):
    """(instants, 4, 4): a pose moved along x."""
    poses = np.repeat(pose[None], len(shifts), axis=0)
    poses[:, 0, 3] += shifts
    return poses


def moving_cube(way, camera_moves=False):
    middle = 0.5 * SIDE
    camera = hg.Camera(WIDE, TALL, (FOCAL, FOCAL), (0.5 * WIDE, 0.5 * TALL))
    camera = camera.look_at((middle, -AWAY, middle), (middle, 0.0, middle))
    box, shifts = cube(), (np.arange(INSTANTS) + 0.5) / INSTANTS * way
    still = np.zeros(INSTANTS)
    moving = MovingScene(
        moved(camera.world_to_camera, shifts if camera_moves else still),
        moved(box.pose, still if camera_moves else shifts)[:, None],
    )
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0)),), (box,), moving=moving)


def moving_surface(way):
    """The same of a square in the place of the front of the cube, before another that is too far below to be seen."""
    scene = moving_cube(way)
    pose = np.array([[0.5 * SIDE, 0, 0, 0.5 * SIDE], [0, 0, 1.0, 0], [0, -0.5 * SIDE, 0, 0.5 * SIDE], [0, 0, 0, 1.0]])
    square = hg.Surface(replace(GREY, element="plane"), "rectangle", pose=pose)
    below = replace(square, pose=square.pose - np.eye(4)[:, 2:3] @ np.eye(4)[3:] * 20.0)
    assert scene.moving is not None
    poses = moved(pose, scene.moving.boxes[:, 0, 0, 3] - scene.boxes[0].pose[0, 3])
    moving = MovingScene(scene.moving.cameras, np.zeros((INSTANTS, 0, 4, 4)), {1: poses})
    return replace(scene, boxes=(), surfaces=(below, square), moving=moving)


def coverage(scene, samples=256):
    return hg.render(scene, hg.Settings(samples=samples), mode="path").alpha


def test_a_moving_edge_is_a_ramp():
    """Share of the time in which the cube covers a pixel: linear over the way of each edge, in closed form.

    To four standard deviations of independent walks, and an eighth of the change in a pixel, at the ends of a ramp.
    """
    at = (np.arange(WIDE) + 0.5 - 0.5 * WIDE) / FOCAL * AWAY + 0.5 * SIDE  # [m] on the front of the cube
    expected = np.clip(np.minimum(at / WAY, (SIDE + WAY - at) / WAY), 0.0, 1.0)
    of_surface = coverage(moving_surface(WAY)).mean(axis=0)
    seen = coverage(moving_cube(WAY)).mean(axis=0)
    noise = np.sqrt(expected * (1.0 - expected) / (256 * TALL))
    for each in (seen, of_surface):
        assert (np.abs(each - expected) <= 4.0 * noise + AWAY / FOCAL / WAY / 8.0).all()
        assert np.abs(each - expected).mean() < 4e-3
    standing = coverage(moving_cube(1e-9)).mean(axis=0)
    assert ((standing < 0.01) | (standing > 0.99)).mean() > 0.95 and 0.2 < ((seen > 0.01) & (seen < 0.99)).mean()


def test_a_camera_that_moves_is_matter_that_moves_the_other_way():
    """The same walks: the cube to the right, or the camera to the left."""
    to_the_right, to_the_left = (coverage(moving_cube(WAY, each), 16) for each in (False, True))
    assert np.abs(to_the_right - to_the_left).mean() < 1e-3  # a walk at an edge may round to the other side


SCENE = """
[camera]
size = [24, 16]
focal = [40.0, 40.0]
eye = [0.0, -0.10, 0.05]
target = [0.0, 0.0, 0.004]
[[lamp]]
position = [-0.1, -0.1, 0.2]
intensity = 0.03
[[box]]
name = "cube"
file = "cube.zarr"
[[surface]]
shape = "rectangle"
scale = [0.06, 0.06, 1.0]
reflectance = {alpha = 0.2, beta = 0.0, gamma = 0.25, n = 1.5, body_colour = 0.6}
[motion]
between = "linear"
seconds = 1.0
"""
TURN = """
shutter_open = 0.1
shutter_close = 0.3
[[motion.box]]
box = "cube"
time = 0.0
position = [-0.01, 0.0, 0.002]
rotation_deg = [0.0, 0.0, 0.0]
[[motion.box]]
box = "cube"
time = 0.4
position = [0.01, 0.0, 0.004]
rotation_deg = [0.0, 40.0, 90.0]
[[motion.camera]]
time = 0.0
eye = [0.0, -0.10, 0.05]
[[motion.camera]]
time = 0.4
eye = [0.004, -0.10, 0.05]
"""


@pytest.fixture
def scene_file(tmp_path):
    """A plank that flies, turns, and casts a shadow before a camera that moves."""
    density = np.zeros((9, 13, 17), np.float32)
    density[2:7, 3:10, 1:16] = 1.0
    axes = np.zeros((*density.shape, 3), np.float32)
    axes[..., 2] = 1.0
    hg.VolumeBox.from_arrays(density, axes, 0.001, 3000.0, [GREY]).save(tmp_path / "cube.zarr")

    def write(more, things=""):
        (tmp_path / "scene.toml").write_text(SCENE.replace("[motion]", f"{things}[motion]") + more)
        return tmp_path / "scene.toml"

    return write


def mean_of_several(path):
    """A picture of the open shutter, and the mean of 48 with the same blocks in their noise; one picture has others."""
    blurred = hg.render(path, hg.Settings(samples=768, seed=3), mode="path")
    several = hg.render(path, hg.Settings(samples=16, seed=103), mode="path", times=48)
    one = hg.render(path, hg.Settings(samples=768, seed=10), mode="path", times=1)
    y, other, sharp = (image.xyz()[..., 1] for image in (blurred, several, one))
    noise, *others = (np.asarray(image.variance) for image in (blurred, several, one))
    assert blocks_agree(other, y, noise + others[0], 4)
    assert not blocks_agree(sharp, y, noise + others[1], 4)
    return blurred, several


def test_a_picture_is_the_mean_of_those_at_several_times(scene_file):
    """Blocks of 4 × 4 pixels in their noise, of all orders: 48 pictures, whose steps are a tenth of a pixel."""
    blurred, several = mean_of_several(scene_file(TURN))
    assert several.metadata["times"] == 48 and blurred.metadata["scene"]["moving"] == {"instants": INSTANTS}


PYRAMID = """
[[surface]]
name = "pyramid"
mesh = "pyramid.ply"
position = [0.02, 0.0, 0.0]
reflectance = {alpha = 0.2, beta = 0.3, gamma = 0.2, n = 1.5, body_colour = 0.6}
normal_texture = {file = "normals.png"}
"""
TURN_OF_PYRAMID = """
[[motion.surface]]
surface = "pyramid"
time = 0.0
position = [0.02, 0.0, 0.002]
[[motion.surface]]
surface = "pyramid"
time = 0.4
position = [-0.01, 0.01, 0.004]
rotation_deg = [0.0, 30.0, 80.0]
"""


@pytest.fixture
def scene_with_pyramid(scene_file, tmp_path):
    """Beside the plank a pyramid with a map of normals and gloss, which flies and turns."""
    corners = 0.008 * np.array([[-1.0, -1, 0], [1, -1, 0], [1, 1, 0], [-1, 1, 0], [0, 0, 1.5]])
    faces = np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4], [0, 2, 1], [0, 3, 2]])
    visual = TextureVisuals(uv=0.5 + corners[:, :2] / 0.016)
    (tmp_path / "pyramid.ply").write_bytes(trimesh.Trimesh(corners, faces, process=False, visual=visual).export(
        file_type="ply"))  # fmt: skip
    x = np.linspace(-0.4, 0.4, 8)
    normals = np.stack([*np.meshgrid(x, x), np.ones((8, 8))], axis=-1)
    normals = 0.5 + 0.5 * normals / np.linalg.norm(normals, axis=-1, keepdims=True)
    write_png(tmp_path / "normals.png", np.round(255.0 * normals).astype(np.uint8))
    return scene_file(TURN + TURN_OF_PYRAMID, PYRAMID)


@pytest.mark.nightly
def test_a_surface_that_moves_is_the_mean_of_those_at_several_times(scene_with_pyramid):
    """Blocks in their noise, of all orders: its shadow and its relief turn with it."""
    blurred, _ = mean_of_several(scene_with_pyramid)
    assert blurred.metadata["scene"]["moving"] == {"instants": INSTANTS, "surfaces": [1]}


def test_times_are_the_middles_of_parts_of_the_open_shutter(scene_file):
    """In mode march, to the bit: the mean of the two pictures at 0.15 s and 0.25 s."""
    path = scene_file(TURN)
    motion, mean = read_motion(path), hg.render(path, times=2)
    stills = [scene_from_tables(motion.at(time), path.parent, path, read_once()) for time in (0.15, 0.25)]
    each = [hg.render(scene, settings).weights.astype(np.float64) for scene, settings in stills]
    np.testing.assert_allclose(mean.weights, np.mean(each, axis=0), rtol=1e-6)
    assert mean.metadata["times"] == 2 and mean.metadata["mode"] == "march"


def test_a_frame_of_a_film_has_the_shutter_of_its_time(scene_file):
    """The first frame is the picture of the scene, a later one is another."""
    path, settings = scene_file(TURN), hg.Settings(samples=4)
    order = FilmOrder(str(path), content_with_named(path, quick=True), settings, None, 10, 10.0, "path")
    np.testing.assert_array_equal(frame_image(order, 0).weights, hg.render(path, settings, mode="path").weights)
    first, later = (frame_image(order, number).xyz()[..., 1] for number in (0, 2))
    assert np.abs(later - first).max() > 0.3 * first.max()


def test_what_stands_still_has_the_same_bits_without_a_shutter(scene_file):
    """Poses that do not change are those that they are without instants."""
    scene, settings = scene_with_shutter(path := scene_file(TURN), read_motion(path))
    still = replace(scene, moving=None)
    poses = np.repeat(np.array([box.pose for box in still.boxes])[None], 5, axis=0)
    standing = replace(still, moving=MovingScene(np.repeat(still.camera.world_to_camera[None], 5, axis=0), poses))
    settings = replace(settings, samples=8)
    one, other = (hg.render(each, settings, mode="path").weights for each in (still, standing))
    np.testing.assert_allclose(one, other, rtol=1e-5, atol=1e-7)


@pytest.mark.nightly
def test_workers_give_the_bits_of_one_process(scene_with_pyramid):
    """Of what moves while the shutter is open: a plank, a surface and the camera."""
    pytest.importorskip("distributed", reason="needs Dask")
    settings = hg.Settings(samples=6, seed=5)
    here = hg.render(scene_with_pyramid, settings, mode="path")
    there = hg.render(scene_with_pyramid, settings, mode="path", scheduler=2)
    np.testing.assert_array_equal(there.weights, here.weights)
    np.testing.assert_array_equal(there.alpha, here.alpha)
    assert there.metadata["scene"] == here.metadata["scene"]


LAMP = "".join(f"[[motion.lamp]]\nlamp = 0\ntime = {t}\nintensity = {1.0 + t}\n" for t in (0.0, 0.4))


def test_a_camera_alone_may_move(tmp_path):
    """Before a surface without any box: a picture blurred along its way, of the mean brightness of a sharp one."""
    ends = ((0.0, -0.01), (0.4, 0.01))
    keys = (f"time = {t}\neye = [{x}, -0.10, 0.05]\ntarget = [{x}, 0.0, 0.004]\n" for t, x in ends)
    tables = SCENE.replace('[[box]]\nname = "cube"\nfile = "cube.zarr"\n', "").replace("0.06, 0.06", "0.01, 0.01")
    camera = "".join(f"[[motion.camera]]\n{key}" for key in keys)
    (tmp_path / "scene.toml").write_text(f"{tables}shutter_close = 0.4\n{camera}")
    blurred = hg.render(tmp_path / "scene.toml", hg.Settings(samples=64), mode="path")
    sharp = hg.render(tmp_path / "scene.toml", hg.Settings(samples=64), mode="path", times=1)
    edges = [np.abs(np.diff(image.alpha, axis=1)).max() for image in (blurred, sharp)]
    assert edges[0] < 0.5 < edges[1]
    assert blurred.alpha.mean() == pytest.approx(sharp.alpha.mean(), rel=0.05)


@pytest.mark.parametrize(
    ("more", "words", "said"),
    [
        (TURN, [], "mode march shows single instants: render by mode path, or the mean"),
        (TURN, ["--mode", "full"], "mode full shows single instants"),
        (TURN, ["--mode", "path", "--layers"], "have no layers"),
        (TURN, ["--times", "2", "--scheduler", "2"], "has no workers"),
        (TURN, ["--times", "0"], "give 1 to 1024"),
        ("", ["--times", "4"], "has no shutter"),
        (TURN + LAMP, ["--mode", "path"], "a lamp moves or changes while the shutter is open"),
        (TURN.replace("0.3\n", "0.05\n", 1), ["--mode", "path"], "shutter_close is before shutter_open"),
    ],
)
def test_what_cannot_be_is_one_line(scene_file, tmp_path, capsys, more, words, said):
    out = tmp_path / "a.exr"
    assert main(["render", str(scene_file(more)), *words, "--out", str(out)]) == BAD_INPUT
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1 and not out.exists()


@pytest.mark.parametrize(
    ("more", "said"), [('optics = "glass"', "is glass, and moves"), ("emission = {radiance = 1.0}", "gives off light")]
)
def test_surfaces_that_walks_cannot_follow_are_one_line(scene_file, capsys, tmp_path, more, said):
    ball = f"""[[surface]]
name = "ball"
shape = "sphere"
scale = 0.005
reflectance = {{alpha = 0.2, beta = 0.0, gamma = 0.25, n = 1.5, body_colour = 0.6}}
{more}
"""
    path = scene_file(TURN + TURN_OF_PYRAMID.replace("pyramid", "ball"), ball)
    assert main(["render", str(path), "--mode", "path", "--out", str(tmp_path / "a.exr")]) == BAD_INPUT
    error = capsys.readouterr().err
    assert said in error and error.count("\n") == 1


def test_films_by_other_modes_and_turns_are_refused(scene_file, tmp_path):
    path = scene_file(TURN)
    with pytest.raises(InputError, match="film it by mode path"):
        hg.film(path, tmp_path / "film")
    with pytest.raises(InputError, match="a turn shows single instants"):
        hg.film(path, tmp_path / "film", turn=hg.Turn(4, True, False), mode="path")


def test_the_command_writes_a_blurred_picture(scene_file, tmp_path):
    words = ["render", str(scene_file(TURN)), "--mode", "path", "--samples", "4"]
    assert main([*words, "--out", str(tmp_path / "a.exr")]) == DONE
    assert main([*words[:2], "--times", "2", "--out", str(tmp_path / "b.exr")]) == DONE
    seen = [hg.read_image(tmp_path / name) for name in ("a.exr", "b.exr")]
    assert [one.metadata.get("times") for one in seen] == [None, 2]
