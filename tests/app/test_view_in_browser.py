"""The viewer in Chromium: what is seen there is the picture, and the drag of a lamp changes the right pixels."""

import gc
import io
import time
import weakref

import numpy as np
import pytest
from PIL import Image as Picture

from hagoromo.image.render import render
from hagoromo_page.view_verb import LOOPBACK
from hagoromo_page.viewer.browser import Browser
from hagoromo_page.viewer.open_desk import open_desk
from hagoromo_page.viewer.scene_files import opened
from hagoromo_page.viewer.watcher import Desk
from tests.ball_scene import BALL, lamp

pytest.importorskip("viser", reason="viser is not installed")
SIZE = (960, 480)  # of the window: the panel beside the picture
PATIENCE_S = 300.0
CAMERA = """
[camera]
size = [160, 120]
focal = [150.0, 150.0]
eye = [0.0, -1.0, 0.0]
"""


class ViewedPage:
    """A viewer's page, and the desk behind it."""

    def __init__(self, chromium, desk):
        self.browser = Browser(desk, LOOPBACK, 0)
        self.page = chromium.new_page(viewport={"width": SIZE[0], "height": SIZE[1]})
        self.page.set_default_timeout(1e3 * PATIENCE_S)
        self.asked, self.faults = [], []
        self.page.on("request", lambda one: self.asked.append(one.url))
        self.page.on("pageerror", lambda one: self.faults.append(str(one)))
        self.page.goto(self.browser.address)
        self.until(lambda: self.browser.watchers)

    def until(self, holds):
        """Serve until something holds."""
        end = time.monotonic() + PATIENCE_S
        while not holds():
            assert time.monotonic() < end, "it never came"
            self.browser.step()
            time.sleep(0.02) if self.page.is_closed() else self.page.wait_for_timeout(20)

    def rest(self):
        """Serve until no better picture comes and the window stands still; the window's pixels."""
        before, now, quiet = np.zeros(1), self._window(), 0
        while quiet < 10 or not np.array_equal(before, now):
            quiet = 0 if self.browser.step() else quiet + 1
            self.page.wait_for_timeout(50)
            if quiet >= 10 and quiet % 5 == 0:
                before, now = now, self._window()
        return now

    def _window(self):
        return np.asarray(Picture.open(io.BytesIO(self.page.screenshot())).convert("RGB")).astype(int)

    @property
    def watcher(self):
        return next(iter(self.browser.watchers.values()))[1]

    def place(self, point):
        """Where in the window a point of the scene is."""
        desk = self.browser.desk
        assert isinstance(desk, Desk)
        return (desk.scene.camera.project(point) * self.scale + self.corner).tolist()

    @property
    def canvas(self):
        """Width and height of what the panel leaves of the window."""
        camera = next(iter(self.browser.watchers.values()))[0].client.camera
        return np.array([camera.image_width, camera.image_height])

    @property
    def scale(self):
        """Pixels of the window for one of the picture, which is 160 × 120."""
        return float((self.canvas / (160, 120)).min())

    @property
    def corner(self):
        """Where in the window the picture begins."""
        return (self.canvas - self.scale * np.array([160, 120])) / 2

    def picture_of(self, pixels):
        """The window's pixels at the middles of those of the picture."""
        columns, rows = (
            np.round(self.corner[k] + self.scale * (np.arange(n) + 0.5)).astype(int) for k, n in enumerate((160, 120))
        )
        return pixels[np.ix_(rows, columns)]


@pytest.fixture
def scene(tmp_path):
    text = CAMERA + lamp("key", 0.2, -0.3, 0.0, intensity="intensity = 0.3\n") + BALL
    (tmp_path / "ball.toml").write_text(text)
    return tmp_path / "ball.toml"


@pytest.fixture
def look(browser):
    """Opens a desk in Chromium."""
    every = []

    def at(desk) -> ViewedPage:
        every.append(ViewedPage(browser, desk))
        return every[-1]

    yield at
    for shown in every:
        shown.page.close()
        shown.browser.stop()


def halves(picture):
    """Mean display value of the left and the right half of the ball, below its middle."""
    return picture[62:75, 60:80].mean(), picture[62:75, 80:100].mean()


def test_a_viewer_sees_the_picture_drags_a_lamp_and_leaves(look, scene, caplog):
    seen = look(Desk(*opened(scene)))
    pixels = seen.picture_of(seen.rest())
    picture = seen.watcher._developed(seen.watcher.image).astype(int)
    assert np.abs(pixels - picture)[55:110].mean() < 2.0, "another picture than that of the desk"
    left, right = halves(pixels)
    assert right > 2 * left, "the lamp stands on the right"

    arrow = seen.place((0.2 + 0.08, -0.3, 0.0))  # its gizmo's x axis
    seen.page.mouse.move(*arrow)
    seen.page.mouse.down()
    for aside in range(0, 360, 30):
        seen.page.mouse.move(arrow[0] - aside, arrow[1])
        seen.browser.step()
    seen.page.mouse.up()
    left, right = halves(seen.picture_of(seen.rest()))
    assert seen.browser.desk.scene.lamps[0].position[0] < -0.1
    assert left > 2 * right, "the lamp stands on the left now"
    assert list(seen.browser.desk.history) == ["Lamp 1 key position"], "one drag is one edit"

    seen.page.get_by_role("button", name="undo").click()
    seen.until(lambda: not list(seen.browser.desk.history))
    left, right = halves(seen.picture_of(seen.rest()))
    assert right > 2 * left

    seen.browser.panel.say("not done: {globalThis.ran = 1} <b>bold</b> a.toml")
    seen.until(lambda: seen.page.get_by_text("not done: {globalThis.ran = 1} <b>bold</b> a.toml").count())
    assert seen.page.evaluate("() => globalThis.ran") is None, "a name in a message ran as a program"

    assert not [one for one in caplog.records if one.name.startswith("hagoromo_page.viewer")], (
        "a hand's message is refused"
    )

    held = weakref.ref(seen.watcher)
    assert held() is not None
    seen.page.close()
    seen.until(lambda: not seen.browser.watchers)
    gc.collect()
    assert held() is None, "a viewer that left keeps its pictures"
    assert not seen.faults
    assert {url.partition("/?")[0].rstrip("/") for url in seen.asked if url.startswith("http")} == {
        seen.browser.address.partition("/?")[0]
    }


def test_an_image_fills_the_window_undistorted_is_probed_and_seen_nearer(look, scene):
    image = render(scene)
    image.save(scene.with_suffix(".exr"))
    seen = look(open_desk(scene.with_suffix(".exr")))
    picture = image.display().astype(int)
    assert np.abs(seen.picture_of(seen.rest()) - picture)[55:110].mean() < 2.0
    seen.page.mouse.click(*(seen.corner + seen.scale * np.array([90.5, 70.5])), delay=60)
    own, watcher = next(iter(seen.browser.watchers.values()))
    seen.until(lambda: own.last is not None)
    assert (own.last.column, own.last.row) == (90, 70) and "pixel 90, 70 of 160 × 120" in own.said.content
    seen.page.mouse.wheel(0, -600)
    seen.until(lambda: watcher.seen[1].stop - watcher.seen[1].start < 120)
    near = seen.rest()
    middle = (seen.canvas / 2).round().astype(int)
    shown = picture[watcher.seen].reshape(-1, 3)
    assert np.abs(near[middle[1], middle[0]] - picture[60, 80]).max() < 12
    assert np.abs(near[: int(seen.canvas[1]), : int(seen.canvas[0])].mean() - shown.mean()) < 12
    assert not seen.faults
