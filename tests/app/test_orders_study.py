"""The study of all orders of light, with small boxes: its figures, its page, and the colour that it measures."""

import numpy as np
import pytest

import hagoromo as hg
from studies import orders, orders_colour

ROUGH = {"width_mm": 1.2, "height_mm": 1.2, "voxel_mm": 0.12}
DENSE = 60.0  # [1/m], of a box of 0.2 m


@pytest.mark.nightly
def test_the_study_says_how_far_modes_are_apart(monkeypatch, tmp_path):
    subject = orders.SUBJECTS["linen"]._replace(changed=orders.WHITE_LINEN | ROUGH, field_mm=1.0)
    monkeypatch.setattr(orders, "SUBJECTS", {"linen": subject})
    told, out = [], tmp_path / "out"
    record = orders.orders_study("examples/recipes", out, 16, 64, progress=lambda *now: told.append(now))
    (row,) = record["rows"]
    assert row["all_over_first"] > 1.2 and abs(row["full_over_path"] - 1.0) < 0.1
    assert row["noise_of_blocks"] == row["noise_of_path"] / orders.BLOCK
    assert told == [(0.0, "white linen")]
    page = (out / "orders.md").read_text(encoding="utf-8")
    assert f"{row['all_over_first']:.2f} | {row['full_over_path']:.3f}" in page and "The colour of" not in page
    assert (out / "orders.png").exists() and hg.read_json(out / "results.json")["rows"] == record["rows"]


@pytest.fixture(scope="module")
def scene():
    """A dense box of grey spheres."""
    grey = hg.Reflectance(0.3, 0.0, 0.3, 1.5, hg.Spectrum.constant(0.9), element="sphere")
    axes = np.zeros((8, 8, 8, 3))
    box = hg.VolumeBox.from_arrays(np.ones((8, 8, 8)), axes, 0.025, DENSE, [grey], extinction="projected")
    camera = hg.Camera(8, 8, (40.0, 40.0), (4.0, 4.0)).look_at((0.1, -1.0, 0.1), (0.1, 0.1, 0.1))
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0.5)),), (box,))


@pytest.mark.nightly
def test_by_the_march_a_colour_is_found_that_no_element_may_have(scene):
    """Light of the first order is linear in it."""
    none, some = (
        orders_colour.brightness(hg.render(orders_colour.coloured(scene, c), hg.Settings(4))) for c in (0.0, 0.7)
    )
    for colour in (0.5, 1.4):
        wanted = none + (some - none) * colour / 0.7
        assert orders_colour.solved(scene, "march", wanted) == pytest.approx(colour, rel=1e-4)
    most = orders_colour.coloured(scene, orders_colour.largest(scene)).boxes[0].materials[0]
    assert most.directional_albedo().max() == pytest.approx(1.0, abs=2e-3)


@pytest.mark.nightly
def test_the_colour_of_a_photograph_is_found_where_all_orders_are_taken_into_account(scene):
    """To 5 %; without them it is too bright, and the other photograph is not predicted."""
    behind = scene.with_lamps(hg.Lamp(to_lamp=(0, 1, 0.5)))
    photographs = {
        way: hg.render(each, hg.Settings(600), mode="path") for way, each in (("front", scene), ("behind", behind))
    }
    row, pictures = orders_colour.colour_row(scene, behind, photographs, 0.9)
    assert row["taken"]["colour"] == pytest.approx(0.9, rel=0.05) and row["ignored"]["colour"] > 1.2 * 0.9
    assert row["taken"]["front"] == pytest.approx(1.0, abs=0.01) and row["ignored"]["behind"] < 0.7
    assert set(pictures) == {f"{way}, {of}" for way in photographs for of in ("in life", "ignored", "taken")}
