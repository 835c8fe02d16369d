"""What a browser tells the viewer, over a real web socket: whatever is wrong is a line in the log and nothing else."""

import contextlib
import dataclasses
import logging
import math
import socket
import time
from urllib.parse import urlsplit

import msgspec
import numpy as np
import pytest

pytest.importorskip("viser", reason="viser is not installed")

from fuzz import viewer
from fuzz.readers import READERS
from fuzz.viewer_session import camera_message, click_message, set_message
from fuzz.worker import sample_of, written
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo_page.view_verb import LOOPBACK
from hagoromo_page.viewer import gate
from hagoromo_page.viewer.browser import Browser, in_window
from hagoromo_page.viewer.messages import KINDS, LARGEST_WINDOW
from hagoromo_page.viewer.open_desk import open_desk
from hagoromo_page.viewer.watcher import LONGEST_SIDE, Desk
from hagoromo_page.viewer.wire import MOST_LINES, MOST_WAITING

NAN = math.nan
GIZMO = {"name": "/lamps/0", "owner": ""}
MOVED = {"type": "TransformControlsUpdateMessage", **GIZMO, "wxyz": [1, 0, 0, 0], "position": [1, 2, 3]}
WRONG = {
    "a window of height 0": (camera_message(0, image_height=0), "image_height must be a whole number from 1 to"),
    "a window of 1e9 px": (camera_message(0, image_width=10**9), "image_width must be a whole number"),
    "a quaternion of zeros": (camera_message(0, wxyz=[0, 0, 0, 0]), "wxyz must have length 1"),
    "a quaternion of NaN": (camera_message(0, wxyz=[NAN] * 4), "must be a finite number: given nan"),
    "a place of two numbers": (camera_message(0, position=[1.0, 2.0]), "position must be a list of 3 numbers"),
    "text for a place": (camera_message(0, look_at="here"), "look_at must be a list of 3 numbers"),
    "no way up": (camera_message(0, up_direction=[0, 0, 0]), "up_direction must have a length"),
    "an unknown choice": (set_message("layer", "unknown"), "must be one of picture, body"),
    "a vector of two": (set_message("place [m]", [1.0, 2.0]), "must be a list of 3 numbers"),
    "text for a number": (set_message("exposure [stops]", "bright"), "must be a number from -8 to 8: given 'bright'"),
    "true for a number": (set_message("exposure [stops]", True), "must be a number"),
    "a number beyond its slider": (set_message("α body [1/sr]", 1e300), "must be a number from 0 to 0.318"),
    "no colour": (set_message("body colour", [-1, 0, 300]), "3 whole numbers from 0 to 255"),
    "a button that is not there": (set_message("", "publish"), "must be one of undo, redo, add a lamp"),
    "a button that is not pressed": (set_message("look from there", False), "must be one of True"),
    "another property of a widget": (
        set_message("layer", 0) | {"updates": {"value": "picture", "uuid": "x"}}, "has the unknown key 'uuid'",
    ),
    "a widget that is not there": (set_message("no label", 1), "which is not there"),
    "a click nowhere": (click_message(0, 0) | {"screen_pos": []}, "screen_pos"),
    "a click at a text": (click_message(0, 0) | {"screen_pos": [["a", "b"]]}, "screen_pos"),
    "a gizmo at two numbers": (MOVED | {"position": [1, 2]}, "position must be a list of 3 numbers"),
    "a gizmo that is not there": (MOVED | {"name": "/WorldAxes"}, "drags '/WorldAxes', which is not there"),
    "a gizmo of another scope": (MOVED | {"owner": "1"}, "owner"),
    "an upload of a file": (
        {"type": "FileTransferStartUpload", "source_component_uuid": "x", "transfer_uuid": "y", "filename": "a",
         "mime_type": "b", "part_count": 1 << 40, "size_bytes": 1 << 40}, "type must be one of",
    ),
    "an answer to no request": (
        {"type": "GetRenderResponseMessage", "payload": b"\x89PNG", "render_uuid": "x"}, "type must be one of",
    ),
    "a link through a relay": ({"type": "ShareUrlRequest"}, "type must be one of"),
    "no kind": ({}, "lacks the key 'type'"),
    "a text": ("hello", "a frame of text"),
    "no MessagePack": (b"\xc1", "is no message"),
    "lists 20,000 deep": (b"\x91" * 20_000, "is no message"),
    "a key twice": (b"\x82\xa4type\xa1a\xa4type\xb3ViewerCameraMessage", "lacks the key"),
}  # fmt: skip


@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_message_is_one_line_and_the_viewer_goes_on(what):
    """`sent` has another browser get a picture afterwards, and fails where the viewer has a fault of its own."""
    frame, said = WRONG[what]
    with pytest.raises(InputError) as line:
        viewer.sent([frame])
    assert "not heeded: " in str(line.value) and said in str(line.value)


@pytest.mark.by_night("view-scene.session-8", "view-scene.session-24")
@pytest.mark.parametrize(
    ("name", "count"), [("view-scene.session", 8), ("view-image.session", 12), ("view-scene.session", 24)]
)
def test_spoilt_sessions_are_heeded_or_refused(tmp_path, name, count):
    """Of fixed seeds; `make fuzz` tries more."""
    reader = READERS[name]
    sample = sample_of(reader)
    refused = 0
    reader.read(written(reader, sample, -1, tmp_path))
    for seed in range(count):
        try:
            reader.read(written(reader, sample, seed, tmp_path))
        except InputError:
            refused += 1
    assert refused > count // 2, "hardly anything was spoilt"


def test_what_viser_takes_of_a_kind_is_what_is_checked():
    """A viser whose messages have other fields is found here."""
    from viser import _messages

    for record in KINDS:
        theirs = getattr(_messages, str(record.__struct_config__.tag))
        assert record.__struct_fields__ == tuple(field.name for field in dataclasses.fields(theirs))


def test_a_good_session_is_heeded_whole():
    """Every kind of message and widget does what it says."""
    at = viewer.served("scene.toml")
    frames = msgspec.msgpack.decode(sample_of(READERS["view-scene.session"]).files["view-scene.session"])
    with viewer.lines() as said:
        at.attend(frames)
    desk = at.browser.desk
    assert isinstance(desk, Desk) and not said
    assert list(desk.history)[-5:] == [
        "stops", "layer", "surface 0 alpha", "surface 0 body_colour", "Lamp 1 key position",
    ]  # fmt: skip
    np.testing.assert_allclose(np.array(desk.scene.lamps[0].position), [0.4, -1.5, 0.9], atol=1e-9)
    assert desk.scene.surfaces[0].reflectance.alpha == 0.1 and desk.state.development.stops == 1.5
    at.reset()


@contextlib.contextmanager
def served(tmp_path):
    (tmp_path / "scene.toml").write_text(viewer.SCENE)
    browser = Browser(open_desk(tmp_path / "scene.toml"), LOOPBACK, 0)
    visitor = viewer.Visitor(browser.address)
    try:
        visitor.send(camera_message(0.0))
        until(browser, lambda: browser.watchers and visitor.listen() is None and "layer" in visitor.widgets)
        yield browser, visitor
    finally:
        visitor.close()
        browser.stop()


def until(browser, holds):
    end = time.monotonic() + viewer.PATIENCE_S
    while not holds():
        assert time.monotonic() < end, "it never came"
        browser.step(0.01)


def test_widgets_that_are_set_at_once_are_all_heeded(tmp_path):
    """Each has the value that it was set to, although what the first changes sets the others anew."""
    with served(tmp_path) as (browser, visitor):
        for label, value in (("exposure [stops]", 2.0), ("tone curve", "shoulder"), ("white", "D50")):
            visitor.send(set_message(label, value))
        until(browser, lambda: browser.events.qsize() >= 3 or len(list(browser.desk.history)) >= 3)
        until(browser, lambda: len(list(browser.desk.history)) >= 3)
        made = browser.desk.state.development
        assert (made.stops, made.tone, made.white) == (2.0, "shoulder", "D50")
        assert list(browser.desk.history) == ["stops", "tone", "white"], "what the viewer sets itself is no edit"


def test_a_flood_waits_at_the_socket_and_is_no_flood_of_lines(tmp_path):
    with served(tmp_path) as (browser, visitor), viewer.lines() as said:
        for k in range(4 * MOST_WAITING):
            visitor.send(camera_message(0.001 * k))
        end = time.monotonic() + viewer.PATIENCE_S
        while browser.events.qsize() < MOST_WAITING:  # nothing is heeded meanwhile
            assert time.monotonic() < end, "it never came"
            time.sleep(0.01)
        for _ in range(10):
            time.sleep(0.02)
            assert browser.events.qsize() <= MOST_WAITING + 1
        for _ in range(MOST_LINES + 5):
            visitor.send("wrong")
        visitor.send(camera_message(0.7, image_width=77))
        (watcher,) = (watcher for _, watcher in browser.watchers.values())
        until(browser, lambda: watcher._window[0] == 77)
    assert len(said) == MOST_LINES + 1 and "further" in said[-1].getMessage()


def test_a_click_before_the_picture_with_a_new_lamp_is_answered(tmp_path):
    (tmp_path / "scene.toml").write_text(viewer.SCENE)
    desk = open_desk(tmp_path / "scene.toml")
    assert isinstance(desk, Desk)
    watcher = desk.watcher()
    while watcher.next() is not None:
        pass
    desk.edit(desk.state.with_lamp({"to_lamp": [0.0, -1.0, 0.0]}), "add a lamp")
    assert watcher.probe(0.5, 0.5) is not None
    desk.edit(desk.state.without_lamp(0), "remove a lamp")
    assert watcher.probe(0.5, 0.5) is not None


def fails():
    raise ZeroDivisionError


def test_a_fault_in_what_one_viewer_asked_for_does_not_end_the_others(tmp_path):
    with served(tmp_path) as (browser, visitor), viewer.lines() as said:
        browser.events.put(fails)
        next(iter(browser.watchers.values()))[1].next = lambda: {}["none"]
        browser.step()
        for _ in range(3):
            browser.step()
        visitor.send(set_message("exposure [stops]", 1.0))
        until(browser, lambda: list(browser.desk.history) == ["stops"])
    faults = [one for one in said if one.levelno == logging.ERROR]
    assert {"ZeroDivisionError", "KeyError"} <= {str(one.args).split("'")[1] for one in faults}


def test_a_viewer_that_leaves_before_its_picture_is_no_fault(tmp_path, monkeypatch):
    """Viser warns of what is sent to a connection that is closed, and tests make errors of warnings."""
    with served(tmp_path) as (browser, visitor), viewer.lines() as said:
        visitor.close()
        end = time.monotonic() + viewer.PATIENCE_S
        while not browser.events.qsize():  # nobody hears yet that the viewer left
            assert time.monotonic() < end, "it never left"
            time.sleep(0.01)
        ((_, watcher),) = browser.watchers.values()
        watcher.fit(70, 50)
        monkeypatch.setattr(browser, "_heed", lambda seconds: None)
        assert browser.step(), "no picture was due"
    assert not said


def test_a_picture_that_is_queued_leaves_what_waits_in_the_loop_alone(tmp_path):
    """Viser wakes its senders from any thread, which fails now and then where the loop changes them at that time."""
    with served(tmp_path) as (browser, _):
        sockets = browser.server._websock_server
        buffers = [sockets._broadcast_buffer, *(one.message_buffer for one in sockets._client_state_from_id.values())]
        assert [type(one.message_event) for one in buffers] == [gate.Woken] * 2
        loop = browser.server._event_loop
        event = gate.Woken(loop)
        event.set()
        assert not event.is_set(), "another thread set it"
        loop.call_soon_threadsafe(event.set)
        until(browser, event.is_set)


@pytest.mark.parametrize(
    "request_line",
    [
        b"\x16\x03\x01\x02\x00\x01\x00", b"GET //[ HTTP/1.1", b"GET / HTTP/1.0", b"POST / HTTP/1.1",
        b"GET /" + b"a" * 5000 + b" HTTP/1.1", b"GET /%00 HTTP/1.1", b"GET /%2e%2e/%2e%2e/etc/passwd HTTP/1.1",
    ],
)  # fmt: skip
def test_a_request_that_is_none_says_nothing_on_the_terminal(request_line, capfd):
    with viewer.lines() as said:
        at = viewer.served("scene.toml")
        place = urlsplit(at.browser.address)
        cookie = f"Cookie: hagoromo-{place.port}={place.query.partition('=')[2]}"
        with socket.create_connection((place.hostname, place.port)) as link:
            link.settimeout(2.0)
            link.sendall(request_line + f"\r\nHost: a\r\n{cookie}\r\n\r\n".encode())
            link.shutdown(socket.SHUT_WR)
            with contextlib.suppress(OSError):
                assert not link.recv(4000).startswith(b"HTTP/1.1 2")
        at.check()
    assert not [one for one in said if one.levelno > logging.INFO]
    assert capfd.readouterr() == ("", "")


def test_a_picture_is_not_padded_without_bound():
    picture = np.zeros((LONGEST_SIDE, LONGEST_SIDE, 3), np.uint8)
    for aspect in (LARGEST_WINDOW, 1.0 / LARGEST_WINDOW):
        assert in_window(picture, aspect).nbytes <= 9 * picture.nbytes


def test_a_camera_anywhere_gives_a_picture_or_a_line(tmp_path):
    """Far, near and turned to the ends of what a message may say."""
    (tmp_path / "scene.toml").write_text(viewer.SCENE)
    desk = open_desk(tmp_path / "scene.toml")
    watcher = desk.watcher()
    for place in ((0.0, 0.0, 0.0), (1e12, -1e12, 1e12), (0.0, -1e-300, 0.0)):
        watcher.look_from(Camera(3, 3, (3, 3), (1, 1)).look_at((0, -1, 0), (0, 0, 0)).world_to_camera)
        pose = watcher.pose if watcher.pose is not None else np.eye(4)
        watcher.look_from(np.c_[pose[:, :3], [*place, 1.0]])
        with contextlib.suppress(InputError):
            assert watcher.next() is not None
