"""Notes on places of a published page, their file, and its scale bar."""

import json
import re

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo_page.publication.notes import LONGEST_NOTE, MOST_CORNERS, Note, read_notes, selector
from hagoromo_page.publication.publish import publish
from tests.app.in_browser import Opened
from tests.app.published_ball import ball


def w3c(*notes, **other):
    """A file of notes as another program may write it."""
    items = [
        {"type": "Annotation", "body": {"type": "TextualBody", "value": text}, "target": target, **other}
        for target, text in notes
    ]
    return json.dumps({"@context": "http://www.w3.org/ns/anno.jsonld", "type": "AnnotationPage", "items": items})


def fragment(value):
    return {"source": "page", "selector": {"type": "FragmentSelector", "value": value}}


@pytest.fixture(scope="module")
def measured(tmp_path_factory):
    """The ball, measured, in its folder."""
    measurement = ball()[1]
    folder = tmp_path_factory.mktemp("notes") / "measured"
    measurement.save(folder)
    return measurement, folder


def svg(shape):
    return {"source": "page", "selector": {"type": "SvgSelector", "value": f"<svg>{shape}</svg>"}}


TRIANGLE = (1.0, 2.0), (30.5, 4.0), (5.0, 6.0)


@pytest.mark.parametrize(
    ("target", "note"),
    [
        (fragment("xywh=pixel:10,20.5,0,0"), Note(((10.0, 20.5),), "a")),
        ("https://x.org/canvas#xywh=3,4,0,2", Note(((3.0, 4.0), (3.0, 4.0), (3.0, 6.0), (3.0, 6.0)), "a", True)),
        (fragment("xywh=3,4,5,2"), Note(((3.0, 4.0), (8.0, 4.0), (8.0, 6.0), (3.0, 6.0)), "a", True)),
        (svg('<polygon points="1,2 30.5,4 5,6"></polygon>'), Note(TRIANGLE, "a", True)),
        (svg("<g><svg:polyline points='1 2, 30.5 4, 5 6'/></g>"), Note(TRIANGLE, "a")),
        (svg('<path class="x" d="M 1,2 L30.5 4 5,6 Z"/>'), Note(TRIANGLE, "a", True)),
        (svg('<path d="M1,2L30.5,4L5,6"/>'), Note(TRIANGLE, "a")),
        (
            {"selector": [fragment("xywh=0,0,9,9")["selector"], svg('<polygon points="1,2 30.5,4 5,6"/>')["selector"]]},
            Note(TRIANGLE, "a", True),
        ),
    ],
)
def test_places_lines_and_areas_are_read(tmp_path, target, note):
    path = tmp_path / "notes.json"
    path.write_text(w3c((target, "a"), id="1"), encoding="utf-8")
    assert read_notes(path, (40, 30)) == (note,)
    path.write_text(w3c(({"selector": selector(note)}, "a")), encoding="utf-8")
    assert read_notes(path, (40, 30)) == (note,)


def test_a_bare_list_of_annotations_with_several_texts_is_read(tmp_path):
    path = tmp_path / "notes.json"
    bodies = [{"type": "TextualBody", "value": text, "purpose": "tagging"} for text in ("crack", "to be filled")]
    path.write_text(json.dumps([{"body": bodies, "target": fragment("xywh=1,2,0,0")}]), encoding="utf-8")
    assert read_notes(path, (40, 30)) == (Note(((1.0, 2.0),), "crack\nto be filled"),)


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (w3c((fragment("xywh=percent:1,2,3,4"), "a")), "note 1 is at 'xywh=percent:1,2,3,4': it must be xywh=x,y,w,h"),
        (w3c((fragment("xywh=50,2,0,0"), "a")), r"at \(50, 2\) px and the photographs are 40 × 30 px"),
        (w3c((fragment("xywh=1,2,0,0"), "a" * (LONGEST_NOTE + 1))), "notes.json"),
        (w3c(*[(fragment("xywh=1,2,0,0"), "a")] * 501), "notes.json"),
        (w3c((svg('<ellipse cx="3" cy="4" rx="1" ry="2"/>'), "a")), "note 1 is drawn as .*straight lines"),
        (w3c((svg('<path d="M1,2c3,4 5,6 7,8"/>'), "a")), "note 1 is drawn as .*straight lines"),
        (w3c((svg('<polygon points="1,2 3"/>'), "a")), "note 1 is drawn as .*straight lines"),
        (w3c((svg('<path d="M1,2 3,4Z M5,6"/>'), "a")), "note 1 is drawn as .*straight lines"),
        (w3c((svg('<g transform="scale(2)"><polygon points="1,2 3,4 5,6"/></g>'), "a")), "drawn with a transform"),
        (w3c((svg('<polygon points="1,2 3,4 55,6"/>'), "a")), r"at \(55, 6\) px and the photographs are 40 × 30 px"),
        (w3c((svg(f'<polygon points="{"1,2 " * (MOST_CORNERS + 1)}"/>'), "a")), "note 1 has 501 corners: 500 at most"),
        (w3c((svg(f'<path d="M{"1 ," * 7000}x"/>'), "a")), "note 1 is drawn as"),
        (json.dumps({"notes": []}), "notes.json"),
        ("no JSON", "notes.json"),
    ],
)
def test_a_file_that_holds_no_notes_of_the_object_is_one_line(tmp_path, text, said):
    path = tmp_path / "notes.json"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match=said):
        read_notes(path, (40, 30))


def test_notes_stand_on_the_page_as_text(measured, tmp_path, capsys):
    hostile = "</script><b>crack & loss"
    (tmp_path / "notes.json").write_text(w3c((fragment("xywh=20,30,0,0"), hostile)), encoding="utf-8")
    out = tmp_path / "page.html"
    command = ["publish", str(measured[1]), "--out", str(out), "--notes", str(tmp_path / "notes.json")]
    assert main(command) == 0
    assert hostile not in out.read_text(encoding="utf-8")
    held = re.search(r'id="hv-data">(.*?)</script>', out.read_text(encoding="utf-8"))
    assert held is not None and json.loads(held[1])["notes"] == [[[[20.0, 30.0]], hostile, False]]
    assert main([*command[:1], "box.zarr", *command[2:], "--force"]) == 2
    assert "no measured object: leave --notes out" in capsys.readouterr().err


@pytest.mark.nightly
def test_a_note_is_written_saved_and_opened_again(browser, measured, tmp_path):
    path = tmp_path / "page.html"
    publish(measured[0], path)
    opened = Opened(browser, path)
    page = opened.page
    page.click("button[data-tool=note]")
    box = page.locator("#hv-canvas").bounding_box()
    page.mouse.click(box["x"] + 0.5 * box["width"], box["y"] + 0.4 * box["height"])
    page.keyboard.type("a crack, n or l")
    assert opened.state("tool") == ["note"] and page.locator("#hv-overlay circle.hv-note").count() == 1
    with page.expect_download() as saved:
        page.click("#hv-save-notes")
    file = tmp_path / "saved.json"
    saved.value.save_as(file)
    data = opened.data()
    height, width = measured[0].labels.shape
    (note,) = read_notes(file, (width, height))
    x, y, scale = opened.state("x", "y", "scale")
    ratio = page.evaluate("() => window.devicePixelRatio")
    there = np.array([x, y - 0.1 * box["height"] * ratio / scale]) * data["pixel"] + data["corner"]
    assert note.text == "a crack, n or l" and np.array(note.corners) == pytest.approx(there[np.newaxis], abs=1.0)
    page.mouse.click(box["x"] + 0.5 * box["width"] + 3, box["y"] + 0.4 * box["height"])
    assert page.locator("#hv-notes-list li").count() == 1  # a click on its mark is no second note
    again = Opened(browser, path)
    again.page.set_input_files("#hv-open-notes", file)
    again.page.wait_for_selector("#hv-notes-list li")
    assert again.page.evaluate("() => hagoromo.notes().items[0].body.value") == note.text
    again.page.set_input_files("#hv-open-notes", {"name": "x.json", "mimeType": "", "buffer": b"{}"})
    again.page.wait_for_function("() => document.getElementById('hv-status').textContent.includes('holds no notes')")
    assert opened.said == again.said == [] and all(one.startswith("file:") for one in opened.asked)


@pytest.mark.nightly
def test_a_stroke_is_a_line_and_one_that_ends_at_its_start_an_area_of_the_right_size(browser, measured, tmp_path):
    """Of a circle on the front of the ball, by the ruler; a line is as long as the ruler says of its parts."""
    path = tmp_path / "page.html"
    publish(measured[0], path)
    opened = Opened(browser, path)
    page = opened.page
    box = page.locator("#hv-canvas").bounding_box()
    ratio = page.evaluate("() => window.devicePixelRatio")
    x, y, scale = opened.state("x", "y", "scale")

    def on_screen(places):
        middle = np.array([box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"]])
        return (np.asarray(places) - [x, y]) * scale / ratio + middle

    def draw(places):
        there = on_screen(places)
        page.mouse.move(*there[0])
        page.mouse.down()
        for one in there[1:]:
            page.mouse.move(*one)
        page.mouse.up()
        page.keyboard.type("drawn")

    turns = np.linspace(0.0, 2.0 * np.pi, 49)
    circle = [x, y] + 8.0 * np.stack([np.cos(turns), np.sin(turns)], axis=1)
    line = np.linspace([x - 15.0, y + 5.0], [x + 15.0, y + 5.0], 30)
    page.click("button[data-tool=note]")
    draw(circle)
    page.click("button[data-tool=note]")
    draw(line)
    height, width = measured[0].labels.shape
    file = tmp_path / "notes.json"
    file.write_text(json.dumps(page.evaluate("() => hagoromo.notes()")), encoding="utf-8")
    area, stroke = read_notes(file, (width, height))
    data = opened.data()
    assert area.closed and 8 < len(area.corners) < 49 and not stroke.closed
    off = np.linalg.norm((np.array(area.corners) - data["corner"]) / data["pixel"] - [x, y], axis=1)
    assert off == pytest.approx(8.0, abs=1.0 / scale * ratio + 0.02)
    assert np.ptp((np.array(stroke.corners) - data["corner"]) / data["pixel"], axis=0) == pytest.approx(
        [30, 0], abs=0.2
    )
    page.wait_for_function("() => document.querySelector('#hv-notes-list output').textContent")
    sizes = page.locator("#hv-notes-list output").all_text_contents()
    across = [
        page.evaluate(f"() => hagoromo.length([{x - 8 * i}, {y - 8 * j}], [{x + 8 * i}, {y + 8 * j}])")
        for i, j in ((1, 0), (0, 1))
    ]
    a, b = (float(one.split()[0]) for one in across)
    assert sizes[0].endswith(" mm²") and float(sizes[0].split()[0]) == pytest.approx(0.25 * np.pi * a * b, rel=0.04)
    chord = page.evaluate(f"() => hagoromo.length([{x - 15}, {y + 5}], [{x + 15}, {y + 5}])")
    assert sizes[1].endswith(" mm long") and float(sizes[1].split()[0]) == pytest.approx(
        float(chord.split()[0]), rel=0.03
    )
    assert opened.said == []


@pytest.mark.nightly
def test_files_that_the_program_refuses_the_page_refuses_too(browser, measured, tmp_path):
    path = tmp_path / "page.html"
    publish(measured[0], path)
    opened = Opened(browser, path)
    good = w3c((svg('<path d="M 31,32 L60.5 40 1,36 Z"/>'), "a"), (fragment("xywh=33,34,15,2"), "b"))
    opened.page.evaluate("(text) => hagoromo.takeNotes(text)", good)
    kept = opened.page.evaluate("() => hagoromo.notes()")
    (tmp_path / "kept.json").write_text(json.dumps(kept), encoding="utf-8")
    (tmp_path / "good.json").write_text(good, encoding="utf-8")
    size = measured[0].labels.shape[::-1]
    assert read_notes(tmp_path / "kept.json", size) == read_notes(tmp_path / "good.json", size)
    for shape in (
        '<ellipse cx="3"/>',
        '<path d="M1,2c3,4 5,6"/>',
        '<polygon points="1,2 3"/>',
        '<path d="M1,2Z M5,6"/>',
    ):
        with pytest.raises(Exception, match="a note"):
            opened.page.evaluate("(text) => hagoromo.takeNotes(text)", w3c((svg(shape), "a")))
    assert opened.page.evaluate("() => hagoromo.notes()") == kept


@pytest.mark.nightly
def test_the_scale_bar_is_as_long_as_the_ruler_says(browser, measured, tmp_path):
    """To 5 %: the bar is at the mean distance, the ruler at that of its ends."""
    path = tmp_path / "page.html"
    publish(measured[0], path)
    opened = Opened(browser, path)
    opened.page.evaluate("() => hagoromo.picture()")
    line = opened.page.locator("#hv-overlay line.hv-bar").first
    length = float(line.get_attribute("x2")) - float(line.get_attribute("x1"))
    said = opened.page.locator("#hv-overlay text.hv-bar").text_content()
    value, unit = said.split()
    x, y, scale = opened.state("x", "y", "scale")
    page_px = length * opened.page.evaluate("() => window.devicePixelRatio") / scale
    ruled = opened.page.evaluate(f"() => hagoromo.length([{x - page_px / 2}, {y}], [{x + page_px / 2}, {y}])")
    assert unit == "mm" and float(value) == pytest.approx(float(ruled.split()[0]), rel=0.05)
    assert opened.said == []
