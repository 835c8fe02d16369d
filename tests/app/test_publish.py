"""A published page, driven in a real browser: its pixels are those of the reflectance, and it loads nothing."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.camera.camera import unplaced_camera
from hagoromo.camera.response import Response
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.measurement.photographed import Photographed, photographed
from hagoromo.measurement.surface import solved_surface
from hagoromo.photograph.capture import load_capture
from hagoromo_page.publication import object_page
from hagoromo_page.publication.object_page import page_views, single_page
from hagoromo_page.publication.planes import pack_planes, unpack_planes
from hagoromo_page.publication.publish import has_scale, page_source, publish
from hagoromo_page.publication.quantised import quantised
from tests.app.in_browser import Opened
from tests.app.published_ball import RIDGE, ball, encoded, radiance, ridge

STEPS = 2.0  # of 255: what a page may differ by from the reflectance
HOSTILE = "<script>alert('\"&amp;\"')</script>"


@pytest.fixture(scope="module")
def measured():
    """Far lamps of unknown spectrum."""
    return ball(far=True, name=HOSTILE)


@pytest.fixture(scope="module")
def far_page(measured, tmp_path_factory):
    folder = tmp_path_factory.mktemp("published")
    _, measurement = measured
    measurement.save(folder / "measured")
    assert main(["publish", str(folder / "measured"), "--out", str(folder / "page.html")]) == 0
    return folder / "page.html"


def cropped(whole, known):
    """As `SurfaceMaps.cropped`: two pixels around the object."""
    rows, columns = np.flatnonzero(known.any(axis=1)), np.flatnonzero(known.any(axis=0))
    top, left = max(rows[0] - 2, 0), max(columns[0] - 2, 0)
    return whole[top : rows[-1] + 3, left : columns[-1] + 3]


def assert_shows(opened, linear, known):
    """All pixels of the object are those of `linear` (h, w, 3), linear display values without exposure."""
    shown, wanted = opened.pixels(), encoded(cropped(linear, known) * opened.data()["exposure"])
    inside = cropped(known, known)
    assert shown.shape[:2] == inside.shape
    assert (shown[..., 3] == np.where(inside, 255, 0)).all()
    assert wanted[inside].max() > 200.0 and np.ptp(wanted[inside]) > 150.0
    off = np.abs(shown[..., :3].astype(float) - wanted)[inside]
    assert off.max() <= STEPS


def test_pixels_are_those_of_the_reflectance_under_a_lamp_set_by_hand(browser, far_page, measured):
    opened = Opened(browser, far_page)
    opened.page.uncheck("#hv-shadows")
    before = opened.lamp()["at"]
    pad = opened.page.locator("#hv-pad").bounding_box()
    opened.page.mouse.click(pad["x"] + 0.68 * pad["width"], pad["y"] + 0.40 * pad["height"])
    clicked = opened.lamp()["at"]
    opened.page.locator("#hv-canvas").focus()
    opened.page.keyboard.press("ArrowLeft")
    opened.page.keyboard.press("Shift+ArrowUp")
    pressed = opened.lamp()["at"]
    assert clicked[0] > 0.3 > before[0] and pressed[0] < clicked[0] and pressed[1] > clicked[1] + 0.1
    body, interface, known = radiance(*measured, direction=np.array(pressed[:3]))
    assert_shows(opened, body + interface, known)
    assert opened.said == [] and opened.asked == [far_page.resolve().as_uri()]


def test_dragging_on_the_picture_moves_the_lamp_and_several_lamps_add(browser, far_page, measured):
    opened = Opened(browser, far_page)
    opened.page.uncheck("#hv-shadows")
    canvas = opened.page.locator("#hv-canvas").bounding_box()
    x, y = canvas["x"] + canvas["width"] / 2, canvas["y"] + canvas["height"] / 2
    opened.page.mouse.move(x, y)
    opened.page.mouse.down()
    opened.page.mouse.move(x - 90, y + 60, steps=3)
    opened.page.mouse.up()
    at = opened.lamp()["at"]
    assert at[0] < -0.2 and at[1] < -0.1
    opened.page.get_by_title("Add a lamp").click()
    lamps = opened.page.evaluate("() => hagoromo.light()")
    assert len(lamps) == 2
    total = 0.0
    for one in lamps:
        body, interface, known = radiance(*measured, direction=np.array(one["at"][:3]), irradiance=one["scale"])
        total = total + body + interface
    assert_shows(opened, total, known)
    assert opened.said == []


def test_a_near_lamp_of_the_capture_and_another_spectrum_and_camera_are_exact(browser, tmp_path):
    response, lamp = Response.load("canon_eos_300d"), Spectrum.named("D65")
    capture, measured = ball(spectrum=lamp, response=response, tails=False)  # those of the materials
    publish(measured, tmp_path / "page.html")
    opened = Opened(browser, tmp_path / "page.html")
    opened.page.uncheck("#hv-shadows")
    opened.page.select_option("#hv-photograph", label="lamp 1")
    opened.page.select_option("#hv-spectrum", label="Incandescent (A)")
    opened.page.select_option("#hv-camera", label="Human eye (CIE 1931)")
    opened.page.uncheck("#hv-balance")
    near = opened.lamp()
    assert near["at"][3] == 1
    body, interface, known = radiance(capture, measured, position=np.array(near["at"][:3]), irradiance=near["scale"])
    assert_shows(opened, seen_by_eye(body, interface, response, lamp, Spectrum.named("A")), known)
    assert opened.said == []


def seen_by_eye(body, interface, response, lamp, other):
    """Linear sRGB, D65 as white, of a body known in `response` under `lamp`, lit by `other` as bright to the eye."""
    from hagoromo.reflectance.spectra.body_basis import body_basis

    basis, nm = body_basis(response, lamp), np.arange(360.0, 830.5, 0.5)
    observer = Response.load("cie1931")
    bars = np.stack([observer.curve(k).at(nm) for k in range(3)])
    light, day = other.at(nm), Spectrum.named("D65").at(nm)
    light, day = light / (light @ bars[1]), day / (day @ bars[1])
    held = np.stack([np.interp(nm, one.wavelengths, one.values) for one in basis])
    colour = np.maximum(np.einsum("c,cw->w", np.array([1.2, 1.0, 0.8]), held), 0.0)
    xyz = body @ ((held * light) @ bars.T)
    left = np.arange(body.shape[1])[None, :, None] < body.shape[1] // 2
    weight = np.where(left, interface, interface / np.array([1.2, 1.0, 0.8]))
    xyz = xyz + np.where(left, weight[..., :1] * (bars @ light), weight[..., :1] * (bars @ (light * colour)))
    white = bars @ day
    linear = np.array([[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]])
    return xyz * (np.array([0.95047, 1.0, 1.08883]) / white) @ linear.T


def test_a_ridge_casts_its_shadow_as_far_as_the_lamp_is_low(browser, tmp_path):
    """From the left, θ off the axis, a ridge of h px has a shadow of h tan θ px; to 1.5 px, as its edge is soft."""
    publish(ridge(), tmp_path / "page.html")
    opened = Opened(browser, tmp_path / "page.html")
    columns, high = RIDGE
    for x in (0.5, 0.7):
        opened.page.evaluate(
            f"() => {{ const one = hagoromo.state.lamps[0]; one.x = -{x}; one.y = 0; hagoromo.redraw(); }}"
        )
        row = opened.pixels()[30, :, 0].astype(float)
        dark = np.flatnonzero(row < 0.5 * row[5])
        length = high * np.tan(x * np.pi / 2)
        assert dark.min() - columns.stop <= 1
        assert dark.max() + 1 - columns.stop == pytest.approx(length, abs=1.5)
        assert (row[: columns.start] > 0.95 * row[5]).all() and (row[dark.max() + 4 :] > 0.95 * row[5]).all()
    opened.page.keyboard.press("s")
    assert np.ptp(opened.pixels()[30, :, 0].astype(int)) <= 1


def test_few_wild_pixels_do_not_stretch_the_scale_of_errors():
    """0.5 % of the pixels with errors of 1e10 °, and one without: the scale ends at those of the rest, as it says."""
    _, measurement = ball(far=True)
    known = measurement.labels >= 0
    variance = np.full(known.shape, 1e-4, np.float32)
    rows, columns = np.nonzero(known)
    wild = slice(0, len(rows) // 200)
    variance[rows[wild], columns[wild]], variance[rows[-1], columns[-1]] = 3e16, np.inf
    source = page_source(replace(measurement, normal_variance=variance), None)
    data = single_page(source, 10**6).viewer.data
    (view,) = (one for one in data["views"] if one.get("error") == "normal_error")
    assert np.degrees(data["scales"]["normal_error"]) == pytest.approx([np.degrees(0.01)] * 2, rel=1e-4)
    assert view["high"] == "≥ 0.57°" and "1 % of the pixels lie beyond each end" in view["unit"]
    assert source.maps.normal_error is not None and source.maps.normal_error.max() <= np.pi / 2 + 1e-9
    top = quantised(source.maps).planes["normal_error"].max()
    off = variance[rows[-1], columns[-1]], source.maps.normal_error[source.maps.known][-1]
    assert off == (np.inf, pytest.approx(np.pi / 2)) and top == 255


def test_gloss_that_is_not_determined_has_no_view():
    """Of no material: no view, and the colour's errors in place of the gloss's. Of one: its pixels are grey."""
    _, measurement = ball(far=True)

    def views(*vague):
        materials = tuple(
            replace(one, identifiable=dict(one.identifiable) | {"gamma": one.name not in vague})
            for one in measurement.materials
        )
        data = single_page(page_source(replace(measurement, materials=materials), None), 10**6).viewer.data
        assert [one["grey"] for one in data["materials"]] == [one.name in vague for one in materials]
        return {one["label"]: one for one in data["views"]}

    assert not any("loss" in label for label in views("material 0", "material 1"))
    assert views("material 0", "material 1")["Error: colour"]["error"] == "body_error"
    some = views("material 1")
    for label in ("Gloss: width", "Gloss: strength", "Error: gloss"):
        assert some[label]["gloss"] and some[label]["note"].endswith("(material 1).")
    assert "note" not in views()["Gloss: width"]
    maps = replace(page_source(measurement, None).maps, beta=None, gamma=None)
    width = next(one for one in page_views(maps, {})[0] if one["label"] == "Gloss: width")
    assert width["note"].startswith("One value for each material: material 0 ")


def test_facts_of_the_object_stand_on_the_page(tmp_path, capsys):
    """As text, whatever they hold; one that is none is one line."""
    _, measurement = ball(far=True)
    measurement.save(tmp_path / "measured")
    command = ["publish", str(tmp_path / "measured"), "--out", str(tmp_path / "page.html")]
    assert main([*command, "--fact", "Inventory number=1889.12", "--fact", "Institution=<b>A = B</b>"]) == 0
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "<dt>Inventory number</dt><dd>1889.12</dd>" in text
    assert "<dt>Institution</dt><dd>&lt;b&gt;A = B&lt;/b&gt;</dd>" in text
    assert main([*command, "--force", "--fact", "1889.12"]) == 2
    assert "'1889.12' is no fact: give NAME=TEXT" in capsys.readouterr().err


def test_body_colours_beyond_1_are_shown_by_a_stated_factor(browser, tmp_path):
    """Of a ball five times as bright as white: without it all of it is white."""
    _, measurement = ball(far=True)
    materials = tuple(one.times(5.0) for one in measurement.materials)
    assert measurement.body is not None
    body = replace(measurement.body, value=5.0 * measurement.body.value)
    publish(replace(measurement, materials=materials, body=body), tmp_path / "page.html")
    opened = Opened(browser, tmp_path / "page.html")
    opened.page.get_by_role("button", name="Body colour").click()
    shown = opened.pixels()
    assert (shown[shown[..., 3] > 0][:, :3].max(axis=1) >= 255).mean() < 0.05
    assert "how strong the lamps are was not stated" in opened.page.inner_text("#hv-status")
    assert not opened.said


def test_pixels_without_measured_gloss_are_grey_in_its_views(browser, tmp_path):
    _, measurement = ball(far=True)
    first, second = measurement.materials
    vague = replace(second, identifiable=dict(second.identifiable) | {"gamma": False})
    publish(replace(measurement, materials=(first, vague)), tmp_path / "page.html")
    opened = Opened(browser, tmp_path / "page.html")
    for label in ("Gloss: width", "Gloss: strength", "Error: gloss"):
        opened.page.get_by_role("button", name=label).click()
        shown = opened.pixels()[opened.pixels().shape[0] // 2, :, :3].astype(int)
        assert np.ptp(shown[-10], axis=0) == 0 and abs(shown[-10][0] - 77) <= 1  # of the second material
        assert np.ptp(shown[10]) > 20 and "Grey" in opened.page.inner_text("#hv-status")
    opened.page.get_by_role("button", name="Error: normal").click()
    assert "Grey" not in opened.page.inner_text("#hv-status") and opened.said == []


def test_a_folder_of_tiles_opens_without_a_server(browser, tmp_path, monkeypatch):
    """Four tiles and a coarser one: asked for when they are seen, from the folder alone, and lit as one file is."""
    monkeypatch.setattr(object_page, "TILE_SIDE", 48)
    _, measurement = ball(far=True)
    assert publish(measurement, tmp_path / "pages").reduced == 1.0
    publish(measurement, tmp_path / "page.html")
    names = {path.name for path in (tmp_path / "pages" / "tiles").iterdir()}
    assert len(names) == 5 and "1-0-0.js" in names
    tiled = Opened(browser, tmp_path / "pages" / "index.html")
    tiled.page.click("[data-zoom=one]")
    tiled.page.wait_for_function("() => hagoromo.tiles() === 5")
    tiled.page.uncheck("#hv-shadows")
    part, whole = tiled.pixels(), Opened(browser, tmp_path / "page.html")
    whole.page.uncheck("#hv-shadows")
    assert (part == whole.pixels()[:48, :48]).all()
    folder = (tmp_path / "pages").resolve().as_uri()
    assert tiled.said == [] and all(one.startswith(folder) for one in tiled.asked)


def test_a_page_is_one_file_that_asks_for_nothing_and_runs_nothing_else(measured, tmp_path):
    publish(measured[1], tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    policy = re.search(r'http-equiv="Content-Security-Policy" content="([^"]*)"', text)
    assert policy and policy[1].startswith("default-src 'none'; script-src 'sha256-") and "unsafe" not in policy[1]
    assert HOSTILE not in text and "&lt;script&gt;" in text and not re.search(r'(src|href)="(?!data:)', text)


def test_a_page_is_called_by_the_object_and_not_by_a_folder(tmp_path):
    """By --title, else by the name that the capture states, also when the measurement was saved and read again."""
    capture, measured = ball(far=True, name="Noh mask")

    def heading(source, *options):
        assert main(["publish", str(source), *options, "--out", str(tmp_path / "page.html"), "--force"]) == 0
        return re.findall("<h1>(.*?)</h1>", (tmp_path / "page.html").read_text(encoding="utf-8"))

    measured.save(tmp_path / "measured")
    assert heading(tmp_path / "measured") == ["Noh mask"]
    assert heading(tmp_path / "measured", "--title", "Mask <1>") == ["Mask &lt;1&gt;"]
    lamps = tmp_path / "measured" / "lamps.json"
    lamps.write_text(json.dumps(json.loads(lamps.read_text())["lamps"]))  # a bare list of lamps is read, too
    assert heading(tmp_path / "measured") == ["Measured object"]
    unnamed = replace(capture, name="cap", folder=tmp_path / "cap")
    replace(measured, capture=unnamed).save(tmp_path / "other")
    assert heading(tmp_path / "other") == ["Measured object"]
    assert unnamed.own_name == "" and capture.own_name == "Noh mask"
    unnamed.save(tmp_path / "copy")
    assert load_capture(tmp_path / "copy").own_name == ""


def test_a_capture_that_is_solved_in_tiles_keeps_its_name(tmp_path, monkeypatch):
    capture, _ = ball(far=True, name="Noh mask")
    replace(capture, points=None, normals=None).save(tmp_path / "cap")
    monkeypatch.setattr(solved_surface, "LARGEST_CAPTURE_BYTES", 0.0)
    assert solved_surface.large_source(tmp_path / "cap").name == "Noh mask"  # type: ignore[union-attr]


def test_a_page_keeps_its_limit_and_says_that_it_is_reduced(measured, tmp_path):
    _, measurement = measured
    whole = publish(measurement, tmp_path / "whole.html")
    limit = whole.size - 20_000
    small = publish(measurement, tmp_path / "small.html", limit=limit)
    assert whole.reduced == 1.0 and small.reduced > 1.0 and small.width < whole.width
    assert (tmp_path / "small.html").stat().st_size == small.size <= limit
    assert "reduced" in str(small) and "px of the photographs each" in (tmp_path / "small.html").read_text("utf-8")


def test_lengths_are_millimetres_only_where_the_capture_has_a_scale():
    """Far lamps and a camera that nobody placed say nothing of the size; a distance, or near lamps, do."""
    capture, measurement = ball()
    placed = photographed(capture)
    nowhere = unplaced_camera(placed.camera.width, placed.camera.height, placed.camera.focal[0])
    far = Photographed(nowhere, (Lamp(to_lamp=(0, 0, 1)),))
    assert has_scale(measurement, placed) and not has_scale(measurement, far)
    assert has_scale(replace(measurement, settings={"distance_m": 0.6}), far)
    at_origin = Photographed(replace(placed.camera, world_to_camera=np.eye(4)), far.lamps)
    assert not has_scale(measurement, at_origin)
    assert has_scale(replace(measurement, normal_variance=None), at_origin)  # of a given shape


def test_planes_come_back(tmp_path):
    random = np.random.default_rng(7)
    known = random.uniform(size=(23, 37)) < 0.7
    planes = {
        "label": known.astype(np.uint16),
        "noise": random.integers(0, 65536, known.shape).astype(np.uint16),
        "ramp": np.add.outer(np.arange(23) * 700, np.arange(37) * 900).astype(np.uint16),
    }
    back = unpack_planes(pack_planes(planes, known))
    assert all((back[name][known] == planes[name][known]).all() for name in planes)
    assert (back["label"] == planes["label"]).all()


def test_a_measurement_without_its_camera_is_refused_in_one_line(measured, tmp_path, capsys):
    _, measurement = measured
    measurement.save(tmp_path / "measured")
    for name in ("camera.json", "lamps.json"):
        (tmp_path / "measured" / name).unlink()
    assert main(["publish", str(tmp_path / "measured"), "--out", str(tmp_path / "page.html")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "--capture" in said and not Path(tmp_path / "page.html").exists()


def test_the_capture_of_another_object_is_refused_in_one_line(measured, tmp_path, capsys):
    _, measurement = measured
    measurement.save(tmp_path / "measured")
    other = ridge().capture
    assert other is not None
    other.save(tmp_path / "other")
    given = ["publish", str(tmp_path / "measured"), "--capture", str(tmp_path / "other")]
    assert main([*given, "--out", str(tmp_path / "page.html")]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1 and "113 × 61" in said and not (tmp_path / "page.html").exists()
    assert main(["publish", str(tmp_path), "--out", str(tmp_path / "page.html")]) == 2
    assert capsys.readouterr().err.count("\n") == 1
