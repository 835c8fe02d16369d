"""Films: frames are the pictures of the scene's tables at their times, whoever renders them and whatever interrupts."""

from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.cache import cache
from hagoromo.files.exr import write_exr
from hagoromo.files.png import read_png
from hagoromo.files.record import read_json, read_toml
from hagoromo.files.toml_text import toml_text
from hagoromo.image.film import film as filming
from hagoromo.image.film.film import FilmOrder, Turn, chosen, film, frame_image, frame_tables, sheet
from hagoromo.image.picture.shown import DisplayTransform, DisplayView
from hagoromo.image.prepared import prepared_scene
from hagoromo.image.render import render
from hagoromo.image.scene.motion import Motion, turned
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.image.scene.settings import Settings
from hagoromo.image.scene.surface import Surface
from hagoromo.light.lamp import Lamp
from hagoromo.light.lamp_profile import LampProfile
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.field.solve import Solver
from tests.ball_scene import camera

SCENE = """
[camera]
size = [31, 23]
focal = [45.0, 45.0]
eye = [0.1, -1.0, 0.3]

[[lamp]]
name = "key"
position = [0.5, -2.0, 1.0]
intensity = 3.0

[[lamp]]
name = "far"
to_lamp = [1.0, 0.0, 1.0]
intensity = 0.5

[[box]]
file = "slab.zarr"
name = "slab"
position = [0.02, 0.0, -0.05]
"""
MOTION = """
[motion]
seconds = 2.0
frames_per_second = 2.0
between = "linear"

[[motion.camera]]
time = 0.0
eye = [0.1, -1.0, 0.3]
[[motion.camera]]
time = 2.0
eye = [0.5, -1.0, 0.1]

[[motion.lamp]]
lamp = "key"
time = 0.5
intensity = 2.0
spectrum = "A"
[[motion.lamp]]
lamp = 0
time = 1.5
intensity = 4.0
spectrum = 1.0

[[motion.box]]
box = "slab"
time = 0.0
rotation_deg = [0.0, 0.0, 0.0]
[[motion.box]]
box = "slab"
time = 2.0
rotation_deg = [0.0, 0.0, 720.0]
"""


@pytest.fixture
def turning(box, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE)
    return tmp_path / "scene.toml"


@pytest.fixture
def moving(box, tmp_path):
    (tmp_path / "scene.toml").write_text(SCENE + MOTION)
    return tmp_path / "scene.toml"


def order_of(path, turn=None):
    return filming._ordered(path, None, turn, None)


def test_values_go_from_one_keyframe_to_the_next(moving):
    motion = Motion(read_toml(moving), moving.parent, "scene")
    assert (motion.seconds, motion.rate) == (2.0, 2.0) and "motion" not in motion.at(0.0)
    assert np.allclose(motion.at(0.5)["camera"]["eye"], [0.2, -1.0, 0.25])
    assert [motion.at(t)["lamp"][0]["intensity"] for t in (0.0, 0.5, 1.0, 1.5, 2.0)] == [2.0, 2.0, 3.0, 4.0, 4.0]
    assert motion.at(0.25)["lamp"][0]["spectrum"] == "A" and motion.at(1.75)["lamp"][0]["spectrum"] == 1.0
    mixed = Spectrum.load(motion.at(1.0)["lamp"][0]["spectrum"])
    assert np.allclose(mixed.at([450.0, 560.0]), 0.5 * Spectrum.named("A").at([450.0, 560.0]) + 0.5)
    assert motion.at(1.0)["box"][0]["rotation_deg"] == [0.0, 0.0, 360.0]
    assert motion.at(1.0)["lamp"][1] == read_toml(moving)["lamp"][1], "what has no keyframe stands still"


def test_smooth_motion_rests_at_keyframes_and_stays_between_them(moving):
    tables = read_toml(moving)
    motion = Motion({**tables, "motion": tables["motion"] | {"between": "smooth"}}, moving.parent, "scene")
    eyes = np.array([motion.at(t)["camera"]["eye"][0] for t in np.linspace(0.0, 2.0, 201)])
    assert np.isclose(eyes[100], 0.3) and (np.diff(eyes) > 0).all() and np.diff(eyes)[[0, -1]].max() < 1e-4
    assert (eyes[0], eyes[-1]) == (0.1, 0.5)


def test_a_frame_is_the_picture_of_its_tables_bit_by_bit(moving, tmp_path):
    """Also after other frames: what is kept from one to the next changes nothing."""
    order = order_of(moving)
    assert order.count == 4
    frames = {number: frame_image(order, number) for number in (2, 0, 3, 1)}
    for number, image in frames.items():
        (tmp_path / "frame.toml").write_text(toml_text(frame_tables(order, number)))
        assert np.array_equal(render(tmp_path / "frame.toml").weights, image.weights), number
    assert not np.array_equal(frames[0].weights, frames[2].weights)


def test_a_turntable_turns_the_matter_before_camera_and_lamps(turning):
    """Against the scene whose box is turned the other way about the same axis."""
    scene, settings = load_scene(turning)
    angle = 2.0 * np.pi / 5
    corners = scene.boxes[0].corners()
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    turn = np.eye(4)
    turn[:3, :3] = Rotation.from_rotvec([0.0, 0.0, -angle]).as_matrix()
    turn[:3, 3] = middle - turn[:3, :3] @ middle
    box = scene.boxes[0].with_pose(turn @ scene.boxes[0].pose)
    expected = render(replace(scene, boxes=(box,)), settings).weights
    frame = frame_image(order_of(turning, Turn(5, camera=True, lamps=True)), 1).weights
    assert np.abs(frame - expected).max() < 2e-3 * expected.max()
    still = frame_image(order_of(turning, Turn(5, camera=True, lamps=True)), 0).weights
    assert np.array_equal(still, render(turning).weights), "the first frame is the scene's picture"


LIGHTS = {
    "sphere": "[[area_lamp]]\nposition = [0.5, -0.4, 0.9]\nradius = 0.1\n",
    "rectangle": "[[area_lamp]]\nposition = [0.5, -0.4, 0.9]\nedges = [[0.0, 0.3, 0.0], [0.4, 0.0, 0.2]]\n",
    "tube": "[[area_lamp]]\nposition = [0.5, -0.4, 0.9]\nradius = 0.02\nalong = [0.6, 0.3, 0.1]\n",
    "environment": '[environment]\nfile = "sky.exr"\nrotation_deg = [10.0, 20.0, 30.0]\n',
}


@pytest.mark.parametrize("light", LIGHTS)
def test_a_turntable_turns_matter_before_lights_with_a_size_too(light, tmp_path):
    """Against the matter turned the other way: of a scene without a lamp, which ended in a traceback; those with one
    had their other lights turn with the matter. Single precision: 1e-4 of the brightest.
    """
    sky = np.random.default_rng(3).random((8, 16)).astype(np.float32)
    write_exr(tmp_path / "sky.exr", dict.fromkeys("RGB", sky))
    cube = """[[surface]]
shape = "cube"
scale = [0.1, 0.16, 0.07]
rotation_deg = [0.0, 0.0, {turn}]
reflectance = {{alpha = 0.2, beta = 0.5, gamma = 0.2, n = 1.5, body_colour = 0.8}}
[render]
tolerance = 0.3
"""
    for name, turn in (("scene", 20.0), ("turned", 20.0 - 72.0)):
        text = camera((31, 23), focal=60.0) + LIGHTS[light] + cube.format(turn=turn)
        (tmp_path / f"{name}.toml").write_text(text.replace("eye = [0.0, -1.0, 0.0]", "eye = [0.2, -1.0, 0.5]"))
    order = order_of(tmp_path / "scene.toml", Turn(5, camera=True, lamps=True))
    expected = render(tmp_path / "turned.toml").weights
    off, lit = np.abs(frame_image(order, 1).weights - expected).max(axis=-1), expected.max(axis=-1) > 0.0
    assert lit.sum() > 50 and (off[lit] < 1e-4 * expected.max()).mean() > 0.95  # but rays that pass an edge of the cube
    assert np.array_equal(frame_image(order, 0).weights, render(tmp_path / "scene.toml").weights)


def test_the_axis_of_a_turn_stands_in_the_boxes_whatever_background_there_is(turning):
    tables = read_toml(turning)
    alone, _ = load_scene(turning)
    wall = Surface.sphere((3.0, 9.0, 0.0), 4.0, Reflectance(0.2, 0.0, 0.2, 1.5, Spectrum.constant(0.5)))
    before_wall = replace(alone, surfaces=(wall,))
    assert turned(tables, alone, 1.0, True, True) == turned(tables, before_wall, 1.0, True, True)


def test_a_lamp_with_a_profile_turns_with_it():
    profile = LampProfile.load(
        {"lateral": [0.0, 90.0, 180.0, 270.0, 360.0], "vertical": [0.0, 90.0],
         "intensity": [[1.0, 0.1], [1.0, 0.9], [1.0, 0.4], [1.0, 0.6], [1.0, 0.1]]}, None,
    )  # fmt: skip
    for axis, roll in (((0.0, 0.0, -1.0), 0.3), ((0.6, 0.3, -0.7), -0.8)):
        lamp = Lamp((0.3, -1.0, 0.5), axis=axis, profile=profile, roll=roll)
        ball = Surface.sphere((0, 0, 0), 0.1, Reflectance(0.2, 0.0, 0.2, 1.5, Spectrum.constant(0.5)))
        scene = Scene(load_camera(), (lamp,), surfaces=(ball,))
        table = turned({"camera": {}, "lamp": [{}]}, scene, 1.1, camera=False, lamps=True)["lamp"][0]
        again = Lamp(table["position"], axis=table["axis"], profile=profile, roll=np.radians(table["roll_deg"]))
        turn = Rotation.from_rotvec([0.0, 0.0, 1.1]).as_matrix()
        ways = np.random.default_rng(1).normal(size=(50, 3))
        ways /= np.linalg.norm(ways, axis=1, keepdims=True)
        assert np.allclose(again.relative_intensity(ways @ turn.T), lamp.relative_intensity(ways), atol=1e-9)
        assert np.allclose(table["position"], turn @ (0.3, -1.0, 0.5))


def load_camera():
    from hagoromo.camera.camera import Camera

    return Camera(5, 5, (5.0, 5.0), (2.5, 2.5)).look_at((0, -1, 0), (0, 0, 0))


def test_frames_build_nothing_twice(turning, tmp_path, monkeypatch):
    """In an orbit of the camera: one medium, one set of shadow maps of full size, one reading of the box."""
    from hagoromo.image.scene import scene_file

    built = []
    begin = prepared_scene.Medium.__init__
    monkeypatch.setattr(prepared_scene.Medium, "__init__", lambda *some: built.append("Medium") or begin(*some))
    for where, name in ((prepared_scene, "mapped_attenuation"), (scene_file, "load_box")):
        make = getattr(where, name)
        monkeypatch.setattr(where, name, lambda *some, make=make, name=name: built.append(name) or make(*some))
    made = film(turning, tmp_path / "orbit", turn=Turn(3, camera=True, lamps=False))
    assert made.count == made.rendered == 3 and made.film is None
    assert sorted(built) == ["Medium", "load_box", "mapped_attenuation", "mapped_attenuation"]  # one for the exposure


@pytest.mark.by_night("full")
@pytest.mark.parametrize("mode", ["full", "path"])
def test_a_film_has_all_orders_of_light_and_solves_them_once_for_all_cameras(turning, tmp_path, monkeypatch, mode):
    """Of a grey slab, so that there is one band; each frame is what render gives of its tables."""
    turning.write_text(SCENE + 'extinction = "projected"\n')
    solved, settings = [], Settings(samples=4, walks=0)
    solve = Solver.solved
    monkeypatch.setattr(Solver, "solved", lambda *some, **more: solved.append(some) or solve(*some, **more))
    turn = Turn(3, camera=True, lamps=False)
    made = film(turning, tmp_path / "orbit", settings, turn, mode=mode)
    once = len(solved)
    order = filming._ordered(turning, settings, turn, None, mode)
    (tmp_path / "frame.toml").write_text(toml_text(frame_tables(order, 2)))
    alone = render(tmp_path / "frame.toml", settings, mode=mode)
    assert once == len(solved) - once == (mode == "full"), "solved again for another camera, or for the exposure"
    assert np.array_equal(read_png(made.frames / filming.frame_name(2)), alone.display(made.exposure))
    assert alone.palette.bands
    assert 150 < max(read_png(made.frames / filming.frame_name(k)).max() for k in range(3)) <= 255


@pytest.mark.nightly
def test_frames_read_the_light_that_another_process_solved_where_it_is_theirs(turning, tmp_path, monkeypatch):
    """A process is one whose reel is empty. Light of lamps that turn is that of one frame, and is not kept."""
    monkeypatch.setenv("HAGOROMO_CACHE", str(tmp_path / "cache"))
    turning.write_text(SCENE + 'extinction = "projected"\n')
    solved, settings, images = [], Settings(walks=0), []
    solve = Solver.solved
    monkeypatch.setattr(Solver, "solved", lambda *some, **more: solved.append(some) or solve(*some, **more))
    for camera_turns, frame in ((True, 0), (True, 1), (False, 1), (False, 1)):
        filming._held.clear()
        order = filming._ordered(turning, settings, Turn(3, camera_turns, not camera_turns), None, "full")
        images.append(frame_image(order, frame))
    assert len(solved) == 3 and len(list(cache().entries())) == 1
    assert images[2].weights.tobytes() == images[3].weights.tobytes() != images[0].weights.tobytes()


def test_a_film_goes_on_where_it_was_interrupted(turning, tmp_path, monkeypatch):
    turn = Turn(3, camera=False, lamps=True)
    whole = film(turning, tmp_path / "whole", turn=turn)
    write, written = filming.write_bytes, []

    def fails(path, data):
        if len(written) == 2:
            raise OSError(28, "No space left on device")
        written.append(path)
        write(path, data)

    monkeypatch.setattr(filming, "write_bytes", fails)
    with pytest.raises(InputError, match="the same command resumes it"):
        film(turning, tmp_path / "again", turn=turn)
    assert not (tmp_path / "again").exists()
    monkeypatch.setattr(filming, "write_bytes", write)
    made = film(turning, tmp_path / "again", turn=turn)
    assert (made.rendered, made.count) == (1, 3)
    names = sorted(path.name for path in whole.frames.iterdir() if path.name != ".hagoromo")
    assert names == ["film.json", "frame_00000.png", "frame_00001.png", "frame_00002.png", "sheet.png", "strip.png"]
    for name in names:
        assert (made.frames / name).read_bytes() == (whole.frames / name).read_bytes(), name


def test_frames_are_put_in_order_whoever_is_done_first(turning, tmp_path, monkeypatch):
    turn = Turn(3, camera=True, lamps=False)
    whole = film(turning, tmp_path / "whole", turn=turn)

    class Backwards:
        def results(self, work, tasks, keep_errors=False):
            for number, task in reversed(list(enumerate(tasks))):
                yield number, work(*task)

    @contextmanager
    def backwards(_):
        yield Backwards()

    monkeypatch.setattr(filming, "here_or_on", backwards)
    again = film(turning, tmp_path / "again", turn=turn, scheduler="elsewhere")
    for number in range(3):
        name = filming.frame_name(number)
        assert (again.frames / name).read_bytes() == (whole.frames / name).read_bytes()


@pytest.mark.parametrize("suffix", [".mp4", ".webm"])
def test_a_film_is_read_back_by_opencv_as_its_frames(turning, tmp_path, suffix):
    import cv2

    pytest.importorskip("av", reason="PyAV is not installed")
    out = tmp_path / f"turn{suffix}"
    words = ["render", str(turning), "--camera-orbit", "3", "--fps", "12", "--out", str(out)]
    assert main(words) == 0
    reader = cv2.VideoCapture(str(out))
    assert reader.get(cv2.CAP_PROP_FPS) == 12.0
    frames = []
    while (read := reader.read())[0]:
        frames.append(read[1][..., ::-1])
    assert len(frames) == 3
    for number, frame in enumerate(frames):
        kept = read_png(tmp_path / "turn_frames" / filming.frame_name(number))
        assert frame.shape == (24, 32, 3), "one row and column more: sizes of films are even"
        assert np.abs(frame[:23, :31].astype(float) - kept).mean() < 8.0, number
    assert main(words) == 2, "nothing is overwritten"
    assert main([*words, "--force"]) == 0


def test_a_gif_has_all_frames_and_their_time(moving, tmp_path):
    from PIL import Image, ImageSequence

    made = film(moving, tmp_path / "film.gif")
    with Image.open(tmp_path / "film.gif") as picture:
        assert (len(list(ImageSequence.Iterator(picture))), picture.size, picture.info["duration"]) == (
            4,
            (31, 23),
            500,
        )
    assert made.frames == tmp_path / "film_frames"
    record = read_json(made.frames / "film.json")
    assert (record["frames"], record["frames_per_second"], record["exposure"]) == (4, 2.0, made.exposure)


def test_a_film_has_one_exposure_that_burns_nothing(turning, tmp_path):
    made = film(turning, tmp_path / "orbit", turn=Turn(4, camera=False, lamps=True))
    frames = [read_png(made.frames / filming.frame_name(k)) for k in range(4)]
    assert 150 < max(frame.max() for frame in frames) <= 255
    assert np.mean([(frame == 255).any(axis=2).mean() for frame in frames]) < 0.02
    order = order_of(turning, Turn(4, camera=False, lamps=True))
    assert np.array_equal(frames[1], frame_image(order, 1).display(made.exposure))


def test_sheets_show_frames_evenly_in_rows():
    assert chosen(120, 8) == [0, 15, 30, 45, 60, 75, 90, 105] and chosen(3, 8) == [0, 1, 2]
    frames = [np.full((10, 20, 3), k, np.uint8) for k in range(5)]
    made = sheet(frames, columns=3)
    assert made.shape == (2 * 14 + 4, 3 * 24 + 4, 3)
    assert [made[9, 14 + 24 * k, 0] for k in range(3)] == [0, 1, 2] and made[23, 14, 0] == 3 and made[23, 62, 0] == 32


@pytest.mark.parametrize(
    ("more", "said"),
    [
        ("", "does not move"),
        ('[[motion.lamp]]\nlamp = "sun"\ntime = 1.0\nintensity = 1.0\n', "0 are called 'sun': the scene has key, far"),
        ('[[motion.lamp]]\nlamp = "key"\ntime = 0.0\nintensity = 1.0\n', "all keyframes are of time 0"),
        ("[motion]\nseconds = 1e9\n", "give 1 to 100000"),
        ("[motion]\nseconds = 1.0\nframes_per_second = 500.0\n", "give 1 to 240"),
        ('[motion]\nseconds = 1.0\nbetween = "jumps"\n', "jumps"),
        ("[[motion.box]]\nbox = 3\ntime = 1.0\n", "0 are called 3"),
        ("[[motion.camera]]\ntime = -1.0\n", "time"),
        ("[[motion.lamp]]\nlamp = 0\ntime = 1.0\nintensity = 1.0\n" * 2, "two keyframes of intensity are of one time"),
    ],
)
def test_motion_that_is_wrong_is_refused(box, tmp_path, refused, more, said):
    (tmp_path / "scene.toml").write_text(SCENE + more)
    assert said in refused("render", tmp_path / "scene.toml", "--out", tmp_path / "film.gif")


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--turntable", "0"], "0 frames"),
        (["--turntable", "3", "--lamp-orbit", "3"], "two films"),
        (["--turntable", "3", "--mode", "path", "--time", "5"], "give samples, or an error"),
        (["--turntable", "3", "--mode", "full", "--time", "5"], "give samples, or an error"),
        (["--turntable", "3", "--layers"], "has no layers"),
        (["--turntable", "3", "--fps", "0"], "0 frames a second"),
    ],
)
def test_options_that_make_no_film_are_refused(turning, tmp_path, refused, words, said):
    assert said in refused("render", turning, *words, "--out", tmp_path / "frames")


def test_a_film_of_an_unknown_format_is_refused(turning, tmp_path, refused):
    assert ".gif" in refused("render", turning, "--turntable", "3", "--out", tmp_path / "film.avi")


def test_frames_of_another_film_are_not_taken_for_this_one(turning, tmp_path):
    film(turning, tmp_path / "a.gif", turn=Turn(2, camera=True, lamps=False))
    (tmp_path / "a.gif").unlink()
    with pytest.raises(InputError, match="exists"):
        film(turning, tmp_path / "a.gif", turn=Turn(2, camera=False, lamps=True))
    made = film(turning, tmp_path / "a.gif", turn=Turn(2, camera=True, lamps=False))
    assert made.rendered == 0 and isinstance(order_of(turning, Turn(2, True, False)), FilmOrder)
    assert film(turning, tmp_path / "a.gif", Settings(samples=2), Turn(2, True, False), force=True).rendered == 2


def test_frames_are_shown_through_a_look(moving, tmp_path):
    """A view of OpenColorIO's ACES, half a stop darker: what it makes of the linear frame; a wrong name is refused."""
    pytest.importorskip("PyOpenColorIO", reason="needs OpenColorIO")
    look = DisplayView(view="ACES 2.0 - SDR 100 nits (Rec.709)", ocio="ocio://cg-config-latest", exposure=-0.5)
    path = moving
    plain, made = film(path, tmp_path / "plain"), film(path, tmp_path / "made", look=look)
    assert plain.exposure == made.exposure
    order = order_of(path)
    linear = frame_image(order, 1).linear_srgb() * made.exposure * 2.0**-0.5
    shown = read_png(made.frames / "frame_00001.png")
    np.testing.assert_array_equal(shown, DisplayTransform(look).numbers(linear))
    assert np.abs(shown.astype(int) - read_png(plain.frames / "frame_00001.png")).max() > 20
    with pytest.raises(InputError, match="no view 'none'"):
        film(path, tmp_path / "none", look=replace(look, view="none"))
