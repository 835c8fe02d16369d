"""Lights, textures and films that cannot be are refused in one line: what is wrong, where, and what to give."""

import numpy as np
import OpenEXR
import pytest

IES = "IESNA:LM-63-2002\nTILT=NONE\n1 1000 1 3 2 1 2 0 0 0\n1 1\n"  # 12 numbers of 13 and more


def exr(path, width=16, spoilt=1.0):
    """An EXR of ones, 8 high, `spoilt` in row 2 and column 3 of red; by OpenEXR, as ours writes no NaN."""
    ones = np.ones((8, width), np.float32)
    red = ones.copy()
    red[2, 3] = spoilt
    header = {"compression": OpenEXR.NO_COMPRESSION, "type": OpenEXR.scanlineimage}
    with OpenEXR.File(header, {"R": red, "G": ones.copy(), "B": ones.copy()}) as file:
        file.write(str(path))


@pytest.mark.parametrize(
    ("width", "spoilt", "said"),
    [
        (15, 1.0, "is 15 × 8 × 3: give a map twice as wide as high"),
        (16, np.nan, "has light that is not finite in 1 values, first in row 2, column 3"),
        (16, -1.0, "has light below 0 in 1 values, first in row 2, column 3"),
    ],
)
def test_a_map_that_is_no_environment_is_refused(refused, scene, tmp_path, width, spoilt, said):
    exr(tmp_path / "sky.exr", width, spoilt)
    assert said in refused("render", scene(more='[environment]\nfile = "sky.exr"\n'), "--out", tmp_path / "a.exr")


def test_lamps_that_cannot_be_are_refused(refused, scene, tmp_path):
    out = "--out", tmp_path / "a.exr"
    (tmp_path / "broken.ies").write_text(IES)
    lamp = scene("intensity = 3.0", 'intensity = 3.0\nprofile = "broken.ies"')
    assert "broken.ies has 12 numbers after TILT=" in refused("render", lamp, *out)
    inside = scene("position = [0.5, -2.0, 1.0]", "position = [0.0, 0.0, 0.0]", 'optics = "glass"\n')
    assert "lamp 'key' stands within the glass of surface 'ball'" in refused("render", inside, *out, "--mode", "path")
    glass = scene(more='optics = "glass"\n')
    assert "only mode path follows it" in refused("render", glass, *out, "--mode", "full")


@pytest.mark.parametrize(
    ("file", "said"),
    [
        ("none.png", "does not exist"),
        ("cut.png", "is cut off"),
        ("../out.png", "points outside"),
        ("below.exr", "1 values outside 0…100, first -1 in row 2, column 3"),
        ("nan.exr", "first nan in row 2, column 3"),
    ],
)
def test_textures_that_are_broken_are_refused(refused, scene, tmp_path, file, said):
    exr(tmp_path / "below.exr", spoilt=-1.0)
    exr(tmp_path / "nan.exr", spoilt=np.nan)
    (tmp_path / "cut.png").write_bytes(b"\x89PNG\r\n\x1a\n and no more")
    for key in ("body_texture", "gamma_texture"):
        textured = scene(more=f'{key} = {{file = "{file}"}}\n')
        assert said in refused("render", textured, "--out", tmp_path / "a.exr")


@pytest.mark.parametrize(
    ("options", "said"),
    [
        (("--mode", "path", "--error", "1e-9"), "error is 1e-09: give a number from 1e-4 to 1"),
        (("--mode", "path", "--error", "nan"), "error is nan: give a number"),
        (("--error", "0.01"), "error is for mode path and full, and the mode is march"),
        (("--mode", "path", "--time", "0"), "give a time above 0"),
        (("--turntable", "4"), "a film is written as .mp4, .webm, .gif"),
    ],
)
def test_pictures_that_cannot_be_asked_for_are_refused(refused, scene, tmp_path, options, said):
    assert said in refused("render", scene(), "--out", tmp_path / "a.exr", *options)


@pytest.mark.parametrize(
    ("options", "more", "said"),
    [
        (("--turntable", "0"), "", "a film of 0 frames: give 1 to 100000"),
        (("--turntable", "4", "--fps", "0"), "", "a film of 0 frames a second: give 1 to 240"),
        (("--turntable", "4", "--lamp-orbit", "3"), "", "ask for two films: give one of them"),
        (("--turntable", "4", "--resume"), "", "leave --resume"),
        ((), "", "does not move: give it a table [motion]"),
        ((), "[motion]\nseconds = -1\n", "seconds must be a number above 0"),
        ((), "[motion]\nseconds = 1e9\n", "a film of 24000000000 frames"),
    ],
)
def test_films_that_cannot_be_are_refused(refused, scene, tmp_path, options, more, said):
    pytest.importorskip("av")
    assert said in refused("render", scene(more=more), "--out", tmp_path / "a.mp4", *options)
