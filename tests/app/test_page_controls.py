"""The controls of a published page, by fingers, keys and mouse in a real browser, and photographs by its side."""

import base64
import io
from dataclasses import replace

import numpy as np
import pytest

from hagoromo.light.lamp import Lamp
from hagoromo_page.publication.publish import publish
from tests.app.in_browser import Opened
from tests.app.published_ball import RIDGE, ball, ridge

ASSUMED = {"transfer": "sRGB, as stated", "exposure": "the same for all: no file states its exposure time"}


@pytest.fixture(scope="module")
def near_page(tmp_path_factory):
    """The capture of the ball, with near lamps and a scale, and its page."""
    capture, measurement = ball()
    path = tmp_path_factory.mktemp("controls") / "page.html"
    publish(replace(measurement, assumptions=ASSUMED), path)
    return capture, path


def fingers(opened, *steps):
    """Touches of one or more fingers, each step a list of places in CSS px from the middle of the picture."""
    session = opened.page.context.new_cdp_session(opened.page)
    box = opened.page.locator("#hv-canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    for number, places in enumerate(steps):
        points = [{"x": x + dx, "y": y + dy, "id": k} for k, (dx, dy) in enumerate(places)]
        kind = "touchStart" if number == 0 or len(places) > len(steps[number - 1]) else "touchMove"
        session.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})
    session.send("Input.dispatchTouchEvent", {"type": "touchEnd", "touchPoints": []})


def test_two_fingers_zoom_and_move_and_one_moves_the_lamp(browser, near_page):
    opened = Opened(browser, near_page[1], 390, 844, touch=True)
    opened.page.locator("#hv-canvas").scroll_into_view_if_needed()
    before, lamp = opened.state("scale", "x", "y"), opened.lamp()["at"]
    fingers(opened, [(-30, 0), (30, 0)], [(-45, 0), (45, 0)], [(-60, 0), (60, 0)])
    scale, x, y = opened.state("scale", "x", "y")
    assert scale == pytest.approx(2.0 * before[0], rel=0.02)
    assert (x, y) == pytest.approx(before[1:], abs=1.0) and opened.lamp()["at"] == lamp
    fingers(opened, [(-30, 0), (30, 0)], [(10, 20), (70, 20)])
    moved = opened.state("scale", "x", "y")
    assert moved[0] == pytest.approx(scale, rel=1e-3)
    assert np.subtract((x, y), moved[1:]) * moved[0] == pytest.approx([40.0, 20.0], abs=0.5)
    fingers(opened, [(0, 0)], [(50, -50)])
    at = opened.lamp()["at"]
    assert at[0] > 0.2 and at[1] > 0.2 and opened.said == []


def test_keys_do_what_the_page_says(browser, near_page):
    opened = Opened(browser, near_page[1])
    press = opened.page.keyboard.press
    fitted = opened.state("scale")[0]
    press("+")
    assert opened.state("scale")[0] == pytest.approx(1.25 * fitted)
    press("-")
    press("1")
    assert opened.state("scale")[0] == pytest.approx(1.0)
    press("0")
    assert opened.state("scale")[0] == pytest.approx(fitted)
    for key, name, value in (("m", "tool", "move"), ("r", "tool", "ruler"), ("l", "tool", "light"), ("v", "view", 1)):
        press(key)
        assert opened.state(name) == [value]
    shadows = opened.state("shadows")[0]
    press("s")
    press("]")
    press("p")
    assert opened.state("shadows", "photograph") == [not shadows, 0] and opened.state("stops") == [0]
    press("]")
    assert opened.state("stops") == [0.25]
    press("Shift+ArrowRight")
    moved = opened.state("lamps")[0][0]["x"]
    press("ArrowLeft")
    assert opened.state("lamps")[0][0]["x"] == pytest.approx(moved - 2 / 90) and opened.said == []


def test_the_ruler_measures_through_space(browser, near_page):
    """Oracle: the points of the capture; a place is read to half a pixel of 97 over 30 mm."""
    capture, path = near_page
    opened = Opened(browser, path)
    opened.page.keyboard.press("r")
    scale, x, y = opened.state("scale", "x", "y")
    known = np.argwhere(np.linalg.norm(capture.normals, axis=2) > 0.5)
    corner = np.maximum(known.min(axis=0) - 2, 0)
    ends = [np.array([48, 30]), np.array([70, 60])]  # rows and columns of the photographs
    box = opened.page.locator("#hv-canvas").bounding_box()
    ratio = opened.page.evaluate("() => document.getElementById('hv-canvas').width") / box["width"]
    for number, end in enumerate(ends):
        row, column = end - corner + 0.5
        place = [(column - x) * scale / ratio + box["width"] / 2, (row - y) * scale / ratio + box["height"] / 2]
        opened.page.mouse.move(box["x"] + place[0], box["y"] + place[1])
        if number == 0:
            opened.page.mouse.down()
    opened.page.mouse.up()
    opened.page.wait_for_function("() => document.querySelector('#hv-overlay text:not(.hv-bar)')")
    number, unit = opened.page.locator("#hv-overlay text:not(.hv-bar)").text_content().split()
    true = 1000.0 * np.linalg.norm(np.subtract(*(capture.points[tuple(end)] for end in ends)))
    assert unit == "mm" and float(number) == pytest.approx(true, rel=0.02) and opened.said == []


def test_the_page_says_what_the_measurement_takes_for_given(browser, near_page):
    opened = Opened(browser, near_page[1])
    opened.page.locator("#hv-assumptions summary").click()
    said = opened.page.locator("#hv-assumptions ul").inner_text()
    assert "Transfer: sRGB, as stated." in said and "no file states its exposure time" in said
    assert "Light from one part of it onto another is left out" in said and "camera's channels" in said


def test_a_photograph_with_cast_shadows_looks_like_the_object_beside_it(browser, tmp_path):
    """A photograph of the ridge by its closed form: shadow of h tan θ px. To 8 of 255, JPEG, but for 3 px of the edges.

    Without the shadow the two differ by more than 100 of 255 in it.
    """
    from PIL import Image

    angle = np.radians(50.0)
    measurement = ridge()
    assert measurement.capture is not None
    columns, high = RIDGE
    row = np.full(113, 0.2 * np.cos(angle))
    dark = slice(columns.stop, columns.stop + round(high * np.tan(angle)))
    row[dark] = 0.0
    shot = replace(
        measurement.capture.photographs[0],
        values=np.broadcast_to(row[None, :, None], (61, 113, 3)).copy(),
        lamps=(Lamp(to_lamp=(-np.sin(angle), 0.0, -np.cos(angle))),),
    )
    publish(replace(measurement, capture=replace(measurement.capture, photographs=(shot,))), tmp_path / "page.html")
    opened = Opened(browser, tmp_path / "page.html", 1100, 700)
    opened.page.keyboard.press("p")
    opened.page.keyboard.press("1")
    opened.page.wait_for_function("() => hagoromo.compared()")
    url = opened.page.evaluate("() => hagoromo.picture()")
    picture = np.asarray(Image.open(io.BytesIO(base64.b64decode(url.split(",")[1]))).convert("RGB"), float)
    height, width = picture.shape[:2]
    half, middle = width // 2, height // 2
    panes = [picture[middle, start + half // 2 - 56 : start + half // 2 + 57, 0] for start in (0, half)]
    shadow = np.zeros(113, bool)
    shadow[dark] = True
    clear = ~np.convolve(np.abs(np.diff(shadow, prepend=False)), np.ones(7), "same").astype(bool)
    clear &= ~np.isin(np.arange(113), range(columns.start - 3, columns.stop + 3))
    assert panes[0][~shadow & clear].min() > 100.0 and panes[0][shadow & clear].max() < 40.0
    assert np.abs(panes[0] - panes[1])[clear].max() <= 8.0
    assert opened.state("shadows") == [True] and opened.said == []
