"""The viewer without a browser: its state, its pictures, who is let in, and what a viewer that leaves frees."""

import http.client
import os
import signal
import subprocess
import sys
import threading
from contextlib import ExitStack, closing, contextmanager
from importlib.metadata import version
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.exr import write_exr
from hagoromo.image import preview
from hagoromo.image.picture.shown import DisplayTransform
from hagoromo.image.render import render
from hagoromo_page.view_verb import LOOPBACK
from hagoromo_page.viewer import development, gate
from hagoromo_page.viewer.browser import Browser, field_of_view, in_window, pose_from_viser
from hagoromo_page.viewer.open_desk import open_desk
from hagoromo_page.viewer.photographs import LARGEST_DIFFERENCE, photographs_of, through
from hagoromo_page.viewer.scene_files import opened
from hagoromo_page.viewer.watcher import Desk, Watcher
from tests.app.started import STARTED
from tests.ball_scene import ball_scene

ACES_VIEW = "ACES 2.0 - SDR 100 nits (Rec.709)"
SMALL = ball_scene(size=(31, 23), focal=45.0)
AREA_LAMP = "[[area_lamp]]\nposition = [0.3, -1.0, 0.9]\nradius = 0.1\nradiance = 50.0\n"


@pytest.fixture
def desk(tmp_path):
    (tmp_path / "ball.toml").write_text(SMALL)
    return Desk(*opened(tmp_path / "ball.toml"))


def last_picture(watcher):
    """The picture at rest."""
    shown = None
    while (better := watcher.next()) is not None:
        shown = better
    assert shown is not None and shown.last
    return shown.picture


def test_the_picture_at_rest_is_that_of_the_scene_written_bit_by_bit(desk, box):
    desk.edit(desk.state.with_value(("box",), [{"file": "slab.zarr", "position": [0.1, 0.0, 0.0]}]), "box")
    desk.edit(desk.state.with_value(("lamp", 0, "position"), [0.3, -2.0, 1.1]), "lamp")
    watcher = Watcher(desk)
    watcher.look_from(Camera(3, 3, (3, 3), (1, 1)).look_at((0.31, -1.2, 0.17), (0, 0, 0)).world_to_camera)
    last_picture(watcher)
    written = desk.files.write(watcher.state())
    assert watcher.image is not None
    rendered = render(written, desk.settings)
    assert np.array_equal(watcher.image.weights, rendered.weights)
    assert np.array_equal(watcher.image.alpha, rendered.alpha)


def test_viewers_at_one_desk_look_from_where_they_are_and_see_each_others_edits(desk):
    one, other = Watcher(desk), desk.watcher()
    other.look_from(Camera(3, 3, (3, 3), (1, 1)).look_at((0.5, -0.9, 0.1), (0, 0, 0)).world_to_camera)
    before = [last_picture(each) for each in (one, other)]
    assert not np.array_equal(before[0], before[1])
    desk.edit(desk.state.with_value(("lamp", 0, "intensity"), 0.1), "strength")
    for watcher, picture in zip((one, other), before, strict=True):
        assert not np.array_equal(last_picture(watcher), picture)
    assert one.pose is None and other.pose is not None


def test_strengths_and_spectra_of_lamps_march_nothing(desk, monkeypatch):
    watcher = Watcher(desk)
    before = last_picture(watcher)
    marched = []
    film = preview.Film
    monkeypatch.setattr(preview, "Film", lambda *some, **more: marched.append(some) or film(*some, **more))
    desk.edit(desk.state.with_value(("lamp", 0, "intensity"), 0.5), "strength")
    desk.edit(desk.state.with_value(("lamp", 1, "spectrum"), "A"), "spectrum")
    after = last_picture(watcher)
    assert not marched and (after != before).any()
    fresh = Watcher(Desk(desk.files, desk.state))
    fresh.desk.factor = desk.factor
    assert np.abs(last_picture(fresh).astype(int) - after).max() <= 1  # rounding of 8 bits
    assert marched


def test_a_lamp_that_was_marched_at_no_strength_is_marched_when_it_is_lit(desk):
    desk.edit(desk.state.with_value(("lamp", 0, "intensity"), 0.0), "off")
    watcher = Watcher(desk)
    dark = last_picture(watcher)
    desk.edit(desk.state.with_value(("lamp", 0, "intensity"), 3.0), "on")
    assert (last_picture(watcher).astype(int) > dark).sum() > 100


LIT_BY = {
    "a lamp with a size beside lamps": ball_scene(size=(31, 23), focal=45.0) + AREA_LAMP,
    "a lamp with a size": ball_scene(size=(31, 23), focal=45.0, lamps=()) + AREA_LAMP,
    "an environment": ball_scene(size=(31, 23), focal=45.0, lamps=()) + '[environment]\nfile = "sky.exr"\n',
    "a surface": ball_scene(size=(31, 23), focal=45.0, lamps=()) + "[surface.emission]\nradiance = 2.0\n",
}


@pytest.mark.by_night("a surface", "a lamp with a size beside lamps")
@pytest.mark.parametrize("light", LIT_BY)
def test_a_scene_under_any_light_is_shown_in_its_layers_and_gets_a_lamp(light, tmp_path):
    """One layer each of those of light, of shadows and of matter. Scenes under other lights than lamps were refused."""
    write_exr(tmp_path / "sky.exr", dict.fromkeys("RGB", np.ones((4, 8), np.float32)))
    (tmp_path / "lit.toml").write_text(LIT_BY[light])
    desk = Desk(*opened(tmp_path / "lit.toml"))
    watcher, names = Watcher(desk), [control.name for control in desk.controls(desk.state)]
    assert sum(name.endswith("strength") for name in names) == len(desk.scene.lamps)
    assert last_picture(watcher).any() and watcher.image is not None
    assert np.array_equal(watcher.image.weights, render(tmp_path / "lit.toml").weights)
    for layer in ("body", "shadow", "normals"):
        desk.edit(desk.state.developed(layer=layer), layer)
        last_picture(watcher)
    strength = desk.strength_of_first_light()
    assert 0.1 < strength < 50.0
    desk.edit(desk.state.developed(layer="picture").with_lamp({"to_lamp": [0, -1, 0], "intensity": strength}), "add")
    last_picture(watcher)
    desk.edit(desk.state.without_lamp(len(desk.scene.lamps) - 1), "remove")
    assert np.array_equal(last_picture(watcher), last_picture(Watcher(Desk(desk.files, desk.state))))


def test_edits_are_taken_back_and_made_again(desk):
    first = desk.state
    desk.edit(first.with_value(("lamp", 0, "intensity"), 1.0), "a")
    desk.edit(desk.state.with_value(("lamp", 0, "intensity"), 2.0), "a")  # of the same drag
    desk.history.close()
    desk.edit(desk.state.with_lamp({"to_lamp": [0, 0, 1]}), "b")
    assert len(desk.scene.lamps) == 3 and list(desk.history) == ["a", "b"]
    assert [desk.undo(), desk.undo(), desk.undo()] == ["b", "a", None]
    assert desk.state is first and desk.scene.lamps[0].intensity == 3.0
    assert [desk.redo(), desk.redo(), desk.redo()] == ["a", "b", None]
    desk.edit(desk.state.without_lamp(0), "c")
    assert desk.redo() is None and [lamp.name for lamp in desk.scene.lamps] == ["fill", ""]
    assert first.at("lamp", 0, "intensity") == 3.0, "an earlier state was changed in place"


@pytest.mark.parametrize(
    ("steps", "value"),
    [(("lamp", 0, "intensity"), -1.0), (("lamp", 0, "colour"), "red"), (("lamp",), []), (("surface",), [])],
)
def test_an_edit_that_makes_no_scene_is_refused_and_changes_nothing(desk, steps, value):
    before = desk.state, desk.scene
    with pytest.raises(InputError):
        desk.edit(desk.state.with_value(steps, value), "wrong")
    assert (desk.state, desk.scene) == before and desk.undo() is None


def test_a_viewer_that_looks_away_is_told_once_and_keeps_its_picture(desk):
    watcher = Watcher(desk)
    last_picture(watcher)
    watcher.look_from(Camera(3, 3, (3, 3), (1, 1)).look_at((0, -1, 0), (0, -2, 0)).world_to_camera)
    with pytest.raises(InputError, match="looks at nothing"):
        watcher.next()
    assert watcher.next() is None and watcher.image is not None


def test_pose_from_viser_is_the_inverse_of_the_cameras_place():
    turn = Rotation.from_rotvec([0.3, -1.1, 0.7])
    pose = pose_from_viser(2.0 * turn.as_quat(scalar_first=True), np.array([1.0, 2.0, 3.0]))
    assert np.allclose(pose[:3, :3], turn.as_matrix().T, atol=1e-14)
    assert np.allclose(pose @ [1.0, 2.0, 3.0, 1.0], [0, 0, 0, 1], atol=1e-14)


@pytest.mark.parametrize(("aspect", "height"), [(2.0, 24), (0.5, 64)])
def test_the_whole_picture_stands_in_a_window_of_any_shape(aspect, height):
    camera = Camera(32, 24, (40.0, 40.0), (16.0, 12.0))
    assert np.isclose(np.tan(field_of_view(camera, aspect) / 2), height / 2 / 40.0)
    padded = in_window(np.full((24, 32, 3), 255, np.uint8), aspect)
    assert padded.shape[:2] == (height, round(height * aspect)) and (padded == 255).all(2).sum() == 24 * 32


def test_a_picture_is_held_against_the_photograph_of_its_camera(photographed):
    """Of a simulated photograph ΔE00 is noise; of other matter it is seen. The photograph stands left of the wipe."""
    photographs = photographs_of(photographed)
    assert [one.name for one in photographs] == ["key", "fill"]
    files, state = opened(photographed.parent / "scene.toml")
    desk = Desk(files, state.with_value(("lamp", 1, "intensity"), 0.0), photographs)
    desk.edit(through(desk.state, photographs[0].camera), "camera")
    assert np.array_equal(desk.scene.camera.matrix, photographs[0].camera.matrix)
    watcher = Watcher(desk)
    plain = last_picture(watcher)
    assert watcher.image is not None
    ball = watcher.image.alpha > 0.99
    watcher.against, watcher.differs = photographs[0], True
    alike = last_picture(watcher)[ball][:, 0].mean() / 255 * LARGEST_DIFFERENCE
    watcher.against = photographs[1]
    other = last_picture(watcher)[ball][:, 0].mean() / 255 * LARGEST_DIFFERENCE
    assert alike < 2.0 < 6.0 < other, (alike, other)
    watcher.against, watcher.differs, watcher.wipe = photographs[1], False, 0.5
    wiped = last_picture(watcher)
    middle = plain.shape[1] // 2 + 1
    assert np.array_equal(wiped[:, middle:], plain[:, middle:]) and not np.array_equal(
        wiped[:, :middle], plain[:, :middle]
    )
    watcher.against, watcher.wipe = photographs[0], 1.0
    assert np.abs(last_picture(watcher)[ball].astype(int) - plain[ball]).mean() < 4.0
    assert np.isclose(watcher.brightness, 1.0, rtol=0.02), "both are in units of eq. (10)"


def asked(browser, path="/", **headers):
    """Status, headers and text of a request."""
    place = urlsplit(browser.address)
    link = http.client.HTTPConnection(place.hostname, place.port, timeout=10)
    with closing(link):
        link.request("GET", path, headers=headers)
        answer = link.getresponse()
        return answer.status, dict(answer.getheaders()), answer.read()


@contextmanager
def served(desk):
    pytest.importorskip("viser", reason="viser is not installed")
    browser = Browser(desk, LOOPBACK, 0)
    try:
        yield browser
    finally:
        browser.stop()


def test_nobody_is_let_in_without_the_token(desk):
    from websockets.exceptions import InvalidStatus
    from websockets.sync.client import connect

    with served(desk) as browser:
        place = urlsplit(browser.address)
        token, home = place.query, f"{place.hostname}:{place.port}"
        for path in ("/", "/?token=", "/?token=x", f"/{place.query}"):
            assert asked(browser, path)[0] == 403
        status, headers, text = asked(browser, f"/?{token}")
        assert (status, headers["Location"], text) == (302, "/", b"")
        assert "HttpOnly" in headers["Set-Cookie"] and "SameSite=Strict" in headers["Set-Cookie"]
        cookie = headers["Set-Cookie"].partition(";")[0]
        status, headers, text = asked(browser, Cookie=cookie)
        assert status == 200 and b"<html" in text and headers["Cache-Control"] == "no-store"
        for other in ("", cookie[:-1], cookie + "x", "hagoromo=1; " + cookie.upper()):
            assert asked(browser, Cookie=other)[0] == 403

        def refused(**more: Any) -> int:
            with pytest.raises(InvalidStatus) as refusal, connect(f"ws://{home}/", **more):
                pass
            return refusal.value.response.status_code

        assert refused() == 403
        assert refused(origin=f"http://{home}") == 403
        assert refused(additional_headers={"Cookie": cookie}) == 403
        assert refused(origin="http://evil.example", additional_headers={"Cookie": cookie}) == 403
        known: Any = {
            "origin": f"http://{home}", "subprotocols": [f"viser-v{version('viser')}"],
            "additional_headers": {"Cookie": cookie},
        }  # fmt: skip
        with ExitStack() as stack:
            for _ in range(gate.MOST_VIEWERS):
                stack.enter_context(connect(f"ws://{home}/", **known))
            assert refused(origin=f"http://{home}", additional_headers={"Cookie": cookie}) == 503


def test_what_cannot_be_done_is_said_and_the_viewer_goes_on(desk):
    with served(desk) as browser:

        def refuses():
            raise InputError("the lamp is out")

        browser.events.put(refuses)
        assert not browser.step() and browser.panel.message.content == "not done: the lamp is out"


def test_viser_does_not_publish_the_viewer_elsewhere(desk):
    with served(desk) as browser:
        from viser import _messages

        handlers = browser.server._websock_server._incoming_handlers
        assert handlers, "viser keeps its handlers elsewhere now"
        assert not {_messages.ShareUrlRequest, _messages.ShareUrlDisconnect} & set(handlers)


@pytest.mark.parametrize(
    ("more", "said"),
    [
        (["--host", "no such host"], "cannot listen on"),
        (["--host", "192.0.2.1"], "cannot listen on"),
        (["--port", "65536"], "port is 65536"),
    ],
)
def test_an_address_that_cannot_be_listened_on_is_refused(refused, scene, more, said):
    pytest.importorskip("viser", reason="viser is not installed")
    assert said in refused("view", scene(), *more)


def test_what_is_neither_scene_nor_box_is_refused(refused, tmp_path, whole_file_of):
    refused("view", whole_file_of("toml"), "--against", tmp_path / "absent")
    for path in (tmp_path / "absent.toml", tmp_path / "absent.zarr", whole_file_of("png"), tmp_path):
        refused("view", path)


def test_a_scene_that_is_wrong_is_refused_before_anything_is_served(refused, scene):
    assert "alpha" in refused("view", scene("alpha = 0.2", "alpha = -2"))


@pytest.mark.nightly
def test_a_viewer_ends_in_one_line(scene):
    pytest.importorskip("viser", reason="viser is not installed")
    command = [sys.executable, "-c", STARTED, "view", str(scene())]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True) as viewer:
        watchdog = threading.Timer(60.0, viewer.kill)
        watchdog.start()
        assert viewer.stdout is not None and viewer.stderr is not None
        line = viewer.stdout.readline()
        assert line.startswith("open http://127.0.0.1:") and "?token=" in line
        os.kill(viewer.pid, signal.SIGINT)
        said, rest = viewer.stderr.read(), viewer.stdout.read()
        watchdog.cancel()
    assert viewer.returncode == 130 and rest == ""
    assert said == "hagoromo: interrupted: nothing was written\n"


def test_a_view_of_opencolorio_is_a_tone_curve_and_nothing_is_marched_for_it(desk, tmp_path, monkeypatch):
    """Of ACES by default, of a configuration by --ocio, where the first view is chosen: the picture is what it says."""
    pytest.importorskip("PyOpenColorIO", reason="views need opencolorio")
    watcher = desk.watcher()
    last_picture(watcher)
    (tone,) = (control for control in desk.controls(desk.state) if control.name == "tone")
    assert tone.kind.names[:3] == ("clipped", "shoulder", ACES_VIEW)
    monkeypatch.setattr(preview, "Film", None)
    desk.edit(tone.put(desk.state, ACES_VIEW), "tone")
    shown = last_picture(watcher)
    assert watcher.image is not None and desk.factor is not None
    linear = development.linear_picture(watcher.image, desk.state.development, desk.scene.camera.response)
    assert np.array_equal(shown, DisplayTransform(ACES_VIEW).numbers(linear * desk.factor))
    place = "ocio://cg-config-latest"
    other = open_desk(tmp_path / "ball.toml", ocio=place)
    assert other.state.development.tone == ACES_VIEW and other.state.development.ocio == place
    with pytest.raises(InputError, match="is no configuration of OpenColorIO"):
        open_desk(tmp_path / "ball.toml", ocio="ocio://none")


def test_without_opencolorio_the_curves_are_our_own(desk, monkeypatch):
    development.tones.cache_clear()
    monkeypatch.setattr(development, "find_spec", lambda _: None)
    (tone,) = (control for control in desk.controls(desk.state) if control.name == "tone")
    development.tones.cache_clear()
    assert tone.kind.names == ("clipped", "shoulder")
