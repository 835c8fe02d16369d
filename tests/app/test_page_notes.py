"""Notes on places of a published page, their file, and its scale bar."""

import json
import re

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo_page.publication.notes import LONGEST_NOTE, Note, read_notes
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


def test_notes_are_read_from_fragments_of_both_forms(tmp_path):
    path = tmp_path / "notes.json"
    path.write_text(
        w3c((fragment("xywh=pixel:10,20.5,4,0"), "a"), ("https://x.org/canvas#xywh=3,4,0,2", "b"), id="1"),
        encoding="utf-8",
    )
    assert read_notes(path, (40, 30)) == (Note(12.0, 20.5, "a"), Note(3.0, 5.0, "b"))


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (w3c((fragment("xywh=percent:1,2,3,4"), "a")), "note 1 is at 'xywh=percent:1,2,3,4': it must be xywh=x,y,w,h"),
        (w3c((fragment("xywh=50,2,0,0"), "a")), r"at \(50, 2\) px and the photographs are 40 × 30 px"),
        (w3c((fragment("xywh=1,2,0,0"), "a" * (LONGEST_NOTE + 1))), "notes.json"),
        (w3c(*[(fragment("xywh=1,2,0,0"), "a")] * 501), "notes.json"),
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
    assert held is not None and json.loads(held[1])["notes"] == [[20.0, 30.0, hostile]]
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
    assert note.text == "a crack, n or l" and np.array(note[:2]) == pytest.approx(there, abs=1.0)
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
