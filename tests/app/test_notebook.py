"""In a notebook every record has a short text, and those that can be looked at have a picture."""

import numpy as np
import pytest

import hagoromo as hg

PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def records():
    """One of each record that a user meets, by name."""
    glaze = hg.Reflectance(0.1, 0.6, 0.2, 1.5, hg.Spectrum([400, 700], [0.5, 1.0]), name="glaze")
    camera = hg.Camera.preset("canon_eos_kiss_digital", binning=64).look_at((0.0, -0.3, 0.0), (0.0, 0.0, 0.0))
    density, axis = np.ones((5, 7, 11)), np.zeros((5, 7, 11, 3))
    axis[..., 2] = 1.0
    box = hg.VolumeBox.from_arrays(density, axis, 0.001, 200.0, [glaze], name="block")
    ball, lamp = hg.Surface.sphere((0.0, 0.0, 0.0), 0.03, glaze, "ball"), hg.Lamp(to_lamp=(0.3, -1.0, 0.2), name="key")
    scene = hg.Scene(camera, (lamp,), (), (ball,))
    capture = hg.simulate(scene, name="ball")
    every = (
        glaze, camera, box, ball, lamp, scene, capture, capture.photographs[0], hg.render(scene),
        hg.Spectrum.named("D65"), camera.response,
    )  # fmt: skip
    return {type(record).__name__: record for record in every}


def test_the_text_of_every_record_is_short_and_says_its_kind(records):
    for name, record in records.items():
        assert repr(record).startswith(f"{name}(") and len(repr(record)) < 300, repr(record)[:400]


def test_what_can_be_looked_at_is_a_picture(records):
    for name in ("Capture", "Photograph", "Image", "Spectrum", "Response"):
        assert records[name]._repr_png_().startswith(PNG)
    assert "<table>" in records["VolumeBox"]._repr_html_()


def test_a_scene_is_shown_with_a_lamp_to_move(records):
    """The page stands whole in the frame, which may run its script and nothing else."""
    import html
    import re

    shown = records["Scene"].show(lamps=8)
    assert shown.page.startswith("<!doctype html>") and "Content-Security-Policy" in shown.page
    cell = re.fullmatch(
        r'<iframe sandbox="allow-scripts" style="[^"]*" srcdoc="([^"]*)"></iframe>', shown._repr_html_()
    )
    assert cell is not None and html.unescape(cell[1]) == shown.page
    assert repr(shown).startswith("Shown(page of")


def test_a_scene_without_a_response_is_exposed_by_another_or_refused_in_one_line(records):
    with pytest.raises(hg.InputError, match="no response: give one"):
        records["Image"].expose(None)
    assert records["Image"].expose(hg.Response.load("cie1931")).shape[2] == 3
