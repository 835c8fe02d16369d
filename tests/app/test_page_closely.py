"""Looking closely on a published page: its heights, band and maps are those of the program."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.least_squares.loss import NORMAL_95
from hagoromo.measurement.error_files import SharedErrors
from hagoromo.measurement.inspection.curvature import curvature
from hagoromo.measurement.inspection.seen_surface import seen_surface
from hagoromo.measurement.inspection.stretch import decorrelation_stretch
from hagoromo.measurement.surface.depth import surface_from_normals
from hagoromo_page.publication.publish import publish
from tests.app.in_browser import Opened
from tests.inverse import test_grooves as grooves
from tests.inverse.simulated_relief import SimulatedRelief, relief_camera, relief_measurement
from tests.inverse.test_profile import TURN, shape, shared_turns

SIZE = 96
LINES = (((20, 30), (75, 66)), ((10, 48), (86, 48)), ((48, 40), (60, 40)))


def measured():
    """A relief whose normals have errors of their own and shared ones, integrated."""
    camera, _, normals, inside = shape(SIZE)
    noisy = normals + TURN * np.random.default_rng(2).standard_normal(normals.shape)
    noisy = np.where(inside[..., None], noisy / np.linalg.norm(noisy, axis=2, keepdims=True), 0.0)
    modes = shared_turns(normals, inside)
    own = np.where(inside, 2.0 * TURN**2, 0.0)
    solved = surface_from_normals(noisy, camera, 0.4, np.where(inside, own, 1.0), draws=1, modes=modes)
    shared = SharedErrors(modes.astype(np.float32), np.asarray(solved.modes, np.float32))
    variance = np.where(inside, own + shared.variances[0], np.inf)
    plain = relief_measurement(SimulatedRelief(seed=1), relief_camera(SIZE), 1)
    return replace(
        plain, normals=noisy.astype(np.float32), points=solved.points, normal_variance=variance, shared_errors=shared,
        settings={"distance_m": 0.4},
    )  # fmt: skip


@pytest.fixture(scope="module")
def page(tmp_path_factory):
    """The measurement, and its page."""
    measurement, path = measured(), tmp_path_factory.mktemp("closely") / "page.html"
    publish(measurement, path)
    return measurement, path


def of_page(opened, line):
    """What the page finds along a line of the photograph [px]."""
    data = opened.data()
    corner = data["closely"]["errors"]["x"], data["closely"]["errors"]["y"]
    ends = [[(one[k] - corner[k]) / data["pixel"] for k in (0, 1)] for one in line]
    return opened.page.evaluate(f"() => hagoromo.profile({ends[0]}, {ends[1]})")


@pytest.mark.parametrize("line", LINES)
def test_heights_are_those_of_the_program(browser, page, line):
    """To the steps of the depth, 16 bits of its range, and the band to a fifth: 24 draws know it to 14 %."""
    opened = Opened(browser, page[1])
    found, truth = of_page(opened, line), hg.profile(page[0], *line)
    assert found["unit"] == "mm" and opened.said == []
    np.testing.assert_allclose(found["distance"], truth.distance, atol=2e-3)
    np.testing.assert_allclose(found["height"], truth.height, atol=2e-3)
    ratio = np.array(found["error"])[2:-2] / truth.error[2:-2]
    assert np.sqrt(np.mean(ratio**2)) == pytest.approx(1.0, abs=0.2)


def grooved(width, angle, off, noise=0.002):
    """A measurement of a groove of `width` px that its pixels average, integrated from their noisy normals."""
    plain = relief_measurement(SimulatedRelief(seed=1), relief_camera(grooves.SIZE), 1)
    known, random = plain.labels >= 0, np.random.default_rng(7)
    noisy = grooves.seen_normals(width, 0.3, angle, off)
    noisy = noisy + noise * random.standard_normal(noisy.shape)
    noisy = np.where(known[..., None], noisy / np.linalg.norm(noisy, axis=2, keepdims=True), 0.0)
    own, away = np.where(known, 2.0 * noise**2, 1.0), grooves.FOCAL * grooves.PITCH
    solved = surface_from_normals(noisy, grooves.CAMERA, away, own, draws=1)
    assert plain.photographed is not None
    return replace(
        plain, normals=noisy.astype(np.float32), points=solved.points, normal_variance=np.where(known, own, np.inf),
        photographed=replace(plain.photographed, camera=grooves.CAMERA), settings={"distance_m": away},
    )  # fmt: skip


@pytest.mark.parametrize("width", [3.0, pytest.param(5.0, marks=pytest.mark.nightly),
                                   pytest.param(10.0, marks=pytest.mark.nightly)])  # fmt: skip
def test_the_band_of_grooves_is_that_of_the_program(browser, tmp_path, width):
    """In grooves as in `test_grooves`: to a fifth of the program's, and it holds nine tenths of the true heights."""
    held, ratios = [], []
    for number, (angle, off) in enumerate(((0.0, 0.0), (np.pi / 8, 0.0))):
        measurement, path = grooved(width, angle, off), tmp_path / f"{number}.html"
        publish(measurement, path)
        middle, along = grooves.SIZE / 2, np.array([np.cos(angle), -np.sin(angle)])
        line = [(middle + sign * (grooves.REACH - 0.3) * along).tolist() for sign in (-1.0, 1.0)]
        opened = Opened(browser, path)
        found, program = of_page(opened, line), hg.profile(measurement, *line)
        assert opened.said == []
        away = grooves.across(program.image[:, 0] - middle, middle - program.image[:, 1], angle, off)
        true, share = grooves.groove(away, width, 0.3)[0], np.linspace(0.0, 1.0, len(away))
        true = 1e3 * grooves.PITCH * (true - (1.0 - share) * true[0] - share * true[-1])
        inside = np.abs(away) < 1.5 * width
        error = np.array(found["error"])
        ratios.append(error[inside] / program.error[inside])
        held.append(np.abs(np.array(found["height"]) - true)[inside] <= NORMAL_95 * error[inside])
    assert np.sqrt(np.mean(np.concatenate(ratios) ** 2)) == pytest.approx(1.0, abs=0.2)
    assert np.concatenate(held).mean() >= 0.9


def test_curvature_and_stretched_colours_are_those_of_the_program(browser, page):
    """To the steps of their scales, 1/254 of it, and of the colours of a display."""
    measurement, path = page
    opened = Opened(browser, path)
    data, surface = opened.data(), seen_surface(measurement)
    views = {one["label"]: k for k, one in enumerate(data["views"])}
    x, y = int(data["closely"]["errors"]["x"]), int(data["closely"]["errors"]["y"])
    part = np.s_[y : y + data["height"], x : x + data["width"]]

    def shown(label):
        opened.page.evaluate(f"() => {{ hagoromo.state.view = {views[label]}; hagoromo.redraw(); }}")
        return opened.pixels()[..., :3].astype(float) / 255.0

    bent, picture = curvature(surface).value[part], shown("Curvature")
    low, high = data["scales"]["curvature"]
    t = np.clip((bent - low) / (high - low), 0.0, 1.0)[..., None]
    stops = np.array(data["views"][views["Curvature"]]["stops"])
    wanted = np.where(t < 0.5, stops[0] + 2 * t * (stops[1] - stops[0]), stops[1] + (2 * t - 1) * (stops[2] - stops[1]))
    known = np.isfinite(bent)
    assert known.sum() > 1000
    np.testing.assert_allclose(picture[known], wanted[known], atol=2.5 / 255)
    assert surface.body is not None
    stretch = decorrelation_stretch(surface.body, surface.known)
    np.testing.assert_allclose(
        shown("Stretched colours")[surface.known[part]], stretch.shown[part][surface.known[part]] / 255.0, atol=5 / 255
    )


def test_a_line_is_drawn_by_hand_and_one_beside_the_object_says_so(browser, page):
    opened = Opened(browser, page[1])
    opened.page.keyboard.press("h")
    box = opened.page.locator("#hv-canvas").bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    opened.page.mouse.move(x - 60, y)
    opened.page.mouse.down()
    opened.page.mouse.move(x + 60, y + 20)
    opened.page.mouse.up()
    assert "mm over the chord, known to ±" in opened.page.locator("#hv-heights").text_content()
    opened.page.evaluate("() => hagoromo.profile([-5, -5], [40, 40])")
    assert "both ends must lie on it" in opened.page.locator("#hv-heights").text_content()
    opened.page.keyboard.press("r")
    opened.page.mouse.move(x, y)
    opened.page.mouse.down()
    opened.page.mouse.move(x + 30, y)
    opened.page.mouse.up()
    assert opened.page.locator("#hv-plot").is_hidden() and opened.said == []


def test_a_folder_of_tiles_has_the_same_heights(browser, page, tmp_path):
    publish(page[0], tmp_path / "pages")
    opened = Opened(browser, tmp_path / "pages" / "index.html")
    opened.page.wait_for_function("() => hagoromo.tiles() > 0")
    found = of_page(opened, LINES[0])
    np.testing.assert_allclose(found["height"], hg.profile(page[0], *LINES[0]).height, atol=2e-3)


def test_without_errors_the_page_has_heights_and_no_band(browser, tmp_path):
    plain = replace(page_free(), settings={"distance_m": 0.4})
    publish(plain, tmp_path / "page.html")
    opened = Opened(browser, tmp_path / "page.html")
    data = opened.data()
    assert "errors" not in data["closely"]
    found = opened.page.evaluate("() => hagoromo.profile([20, 20], [60, 50])")
    assert np.isfinite(found["height"]).all() and all(one is None or np.isnan(one) for one in found["error"])
    assert "without a band" in opened.page.locator("#hv-heights").text_content()


def page_free():
    """A measurement without errors."""
    return relief_measurement(SimulatedRelief(seed=1), relief_camera(SIZE), 1, errors=False)
