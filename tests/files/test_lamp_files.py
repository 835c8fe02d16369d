"""Dome files: .lp, Relight's info.json; what they say of lamps, and how lamps and photographs find each other."""

from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.files.record import write_json
from hagoromo.photograph.capture_folder import lamp_remarks
from hagoromo.photograph.lamp_files import lamp_of_each


def test_an_lp_is_read_with_folders_spaces_and_other_ends_of_lines(tmp_path):
    text = "3\r\nC:\\dome\\IMG 1.jpg 0 0.6 0.8\r\n\r\n./shots/b.tif 0 0 2\r\nc.dng -1e-1 0.5 .7\r\n"
    (tmp_path / "dome.lp").write_bytes(text.encode())
    lamps = hg.load_lamps(tmp_path / "dome.lp")
    assert [Path(lamp.name).name for lamp in lamps] == ["IMG 1.jpg", "b.tif", "c.dng"]
    np.testing.assert_allclose(np.array(lamps[0].to_lamp), (0.0, 0.6, 0.8))
    np.testing.assert_allclose(np.array(lamps[1].to_lamp), (0.0, 0.0, 1.0))


def test_an_lp_is_written_as_it_is_read(tmp_path):
    lamps = [hg.Lamp(to_lamp=(0.1 * k, 0.3, 0.9), name=f"{k}.jpg") for k in range(5)]
    again = hg.load_lamps(hg.write_lp(tmp_path / "dome.lp", lamps))
    for one, other in zip(lamps, again, strict=True):
        assert one.name == other.name
        np.testing.assert_allclose(np.array(one.to_lamp), np.array(other.to_lamp), atol=1e-8)
    with pytest.raises(hg.InputError, match="is near"):
        hg.write_lp(tmp_path / "near.lp", [hg.Lamp(position=(0, 0, 1), name="a")])


def test_the_lights_of_relight_are_lamps(tmp_path):
    write_json(tmp_path / "info.json", {"type": "ptm", "lights": [[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]]})
    assert len(hg.load_lamps(tmp_path / "info.json")) == 2


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("", "the number of photographs in its first line"),
        ("a.jpg 0 0 1\n", "the number of photographs in its first line"),
        ("3\na 0 0 1\nb 0 1 1\n", "states 3 photographs and lists 2"),
        ("1\na 0 0\n", "line 2 is 'a 0 0': it must be a name and x y z"),
        ("1\na 0 0 nan\n", "not all 0"),
        ("1\na 0 0 0\n", "not all 0"),
        ("99999999999\n", "the number of photographs in its first line"),
    ],
)
def test_an_lp_that_is_none_is_refused(tmp_path, text, said):
    (tmp_path / "a.lp").write_text(text)
    with pytest.raises(hg.InputError, match=said):
        hg.load_lamps(tmp_path / "a.lp")


def test_a_fitted_picture_holds_no_lamps(tmp_path):
    (tmp_path / "a.ptm").write_bytes(b"PTM_1.2\nPTM_FORMAT_LRGB\n")
    with pytest.raises(hg.InputError, match=r"give the \.lp"):
        hg.load_lamps(tmp_path / "a.ptm")


def test_lamps_and_photographs_find_each_other_by_name_or_in_order():
    lamps = [hg.Lamp(to_lamp=(k, 0.0, 3.0), name=f"IMG_{k}.jpg") for k in range(4)]
    paths = [Path(f"img_{k}.dng") for k in (2, 0, 3, 1)]
    found, how = lamp_of_each(lamps, paths)
    assert [lamp.name for lamp in found] == ["IMG_2.jpg", "IMG_0.jpg", "IMG_3.jpg", "IMG_1.jpg"] and how == "by name"
    assert lamp_of_each(lamps, [Path(f"{k}.png") for k in range(4)])[0] == lamps
    with pytest.raises(hg.InputError, match=r"no lamp has the name of x\.dng, and no photograph that of IMG_1\.jpg"):
        lamp_of_each(lamps, [*paths[:3], Path("x.dng")])
    with pytest.raises(hg.InputError, match=r"3 photographs and 4 lamps \(IMG_1\.jpg without its match\)"):
        lamp_of_each(lamps, paths[:3])


def test_lamps_on_one_side_are_remarked_and_a_dome_is_not():
    camera = hg.Camera(30, 20, (600.0, 600.0), (15.0, 10.0)).with_pose(np.diag([1.0, -1.0, -1.0, 1.0]))
    turns = np.radians([0, 40, 80, 120, 160])
    half = [hg.Lamp(to_lamp=(np.cos(t), np.sin(t), 1.0)) for t in turns]
    whole = [hg.Lamp(to_lamp=(np.cos(1.8 * t), np.sin(1.8 * t), 1.0)) for t in turns]
    assert "from the bottom of the picture, over 200°" in lamp_remarks(half, camera)[0]
    assert lamp_remarks(whole, camera) == () and lamp_remarks(half[:2], camera) == ()
