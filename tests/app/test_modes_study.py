"""The study of modes, with a small scene: what it keeps, what it does not make twice, its page and its pictures."""

import numpy as np
import pytest

import hagoromo as hg
from hagoromo_matter.demo import figures
from studies import modes, modes_scenes

SOURCES = modes_scenes.SceneFolders(*3 * [modes_scenes.Path("nowhere")])


def scene_of(name, sources):
    """A dense box of grey spheres on a floor."""
    grey = hg.Reflectance(0.3, 0.0, 0.3, 1.5, hg.Spectrum.constant(0.9), element="sphere")
    box = hg.VolumeBox.from_arrays(np.ones((8, 8, 8)), np.zeros((8, 8, 8, 3)), 0.025, 60.0, [grey])
    camera = hg.Camera(16, 8, (40.0, 40.0), (8.0, 4.0)).look_at((0.1, -1.0, 0.1), (0.1, 0.1, 0.1))
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0, -1, 0.5)),), (box,))


@pytest.fixture(autouse=True)
def no_rows_of_other_scenes(monkeypatch, tmp_path):
    monkeypatch.setattr(modes, "ROWS", tmp_path / "kept.json")


@pytest.mark.nightly
def test_a_scene_is_kept_and_shown_on_the_page(monkeypatch, tmp_path):
    monkeypatch.setattr(modes, "scene_of", scene_of)
    modes.rendered("skin", SOURCES, tmp_path, walks=64)
    monkeypatch.setattr(modes, "scene_of", None)
    modes.main(*SOURCES[:2], tmp_path, only=("skin",))  # it is there
    record = hg.read_json(tmp_path / "skin.json")
    assert record["size"] == [16, 8] and record["walks"] == 64 and record["all_over_first"] > 1.1
    assert abs(record["full_over_path"] - 1.0) < 0.1
    page = (tmp_path / "modes.md").read_text(encoding="utf-8")
    assert f"| Skin | 16 × 8 | {record['all_over_first']:.2f} |" in page and "figures/modes/skin.jpg" in page
    assert "figure_8" not in page and (tmp_path / "modes" / "skin.jpg").stat().st_size > 1000


def test_full_may_be_left_out(monkeypatch, tmp_path):
    monkeypatch.setattr(modes, "scene_of", scene_of)
    modes.main(*SOURCES[:2], tmp_path, only=("skin",), walks=16, without_full=True)
    page = (tmp_path / "modes.md").read_text(encoding="utf-8")
    assert "| – | – |" in page and "full" not in hg.read_json(tmp_path / "skin.json")["seconds"]


def test_rows_of_scenes_that_are_not_there_stay_on_the_page(monkeypatch, tmp_path):
    """Also after a second page, made with the rows that the first one left."""
    kept = {
        "figure_8_nun": modes.row_of(
            hg.read_json(modes_scenes.Path(modes.__file__).with_name("modes_rows.json"))["figure_8_nun"]
        )
    }
    hg.write_json(modes.ROWS, kept)
    monkeypatch.setattr(modes, "scene_of", scene_of)
    modes.main(*SOURCES[:2], tmp_path, only=("skin",), walks=16, without_full=True)
    rows = hg.read_json(tmp_path / "modes_rows.json")
    assert list(rows) == ["skin", "figure_8_nun"] and rows["figure_8_nun"] == kept["figure_8_nun"]
    first = (tmp_path / "modes.md").read_text(encoding="utf-8")
    assert "| Skin | 16 × 8 |" in first and "The whole nun" in first
    (tmp_path / "modes_rows.json").rename(modes.ROWS)
    modes.write_page(tmp_path)
    assert (tmp_path / "modes.md").read_text(encoding="utf-8") == first


@pytest.mark.parametrize(("march", "full", "right"), [(0.04, 0.01, "march"), (0.06, 0.04, "full"), (0.3, 0.2, "path")])
def test_the_cheapest_mode_that_is_close_enough_is_right(march, full, right):
    assert modes.right_mode({"march_off_path": march, "full_off_path": full}) == right


def test_every_scene_has_a_title_and_stands_in_the_order_once():
    names = {*modes_scenes.ITEMS, *figures.PAPER_FIGURES}
    assert set(modes_scenes.ORDER) == names and len(modes_scenes.ORDER) == len(names)
    assert modes_scenes.title_of("figure_7_skin") == "Figure 7. Skin: scales, made of planes"
    assert len({modes_scenes.title_of(name) for name in names}) == len(names)


def test_boxes_of_figures_have_the_extinction_that_is_asked_for(monkeypatch):
    """And the cache tells them from others."""
    grey = hg.Reflectance(0.3, 0.0, 0.3, 1.5, hg.Spectrum.constant(0.9))
    asked = []
    monkeypatch.setattr(figures, "kept_box", lambda key, make: asked.append(key) or make())
    for extinction in ("isotropic", "projected"):
        cast = figures.Cast(dict.fromkeys(("skin", "cloth", "feather", "dielectric"), grey), 0.4, 1, (), extinction)
        assert cast.box("nun", "hair").extinction == extinction
    assert asked[0] != asked[1]
