"""Photographs and cameras that make nothing are refused in one line, and nothing is left behind."""

import numpy as np
import pytest

from hagoromo.files.png import write_png
from tests.inverse.simulated_bracket import numbers, scene, write_dng

RANDOM = np.random.default_rng(5)


def test_develop_refuses_what_it_cannot_develop(refused, tmp_path):
    write_png(tmp_path / "a.png", RANDOM.integers(0, 250, (31, 37, 3)).astype(np.uint8))
    write_dng(tmp_path / "a.dng", numbers(scene(1), 0.2, 1), 0.2)
    (tmp_path / "a.cr2").write_bytes(b"II*\0\x10\0\0\0CR\x02\0 and no more")
    out = ("--out", tmp_path / "o.exr")
    for arguments, said in [
        ((tmp_path / "a.png", *out), "rarely linear: state transfer (--transfer)"),
        ((tmp_path / "a.png", *out, "--transfer", "log"), "no transfer curve is called 'log'"),
        ((tmp_path / "a.png", *out, "--transfer", "estimate"), "state exposures_s (--exposures)"),
        ((tmp_path / "a.dng", "--out", tmp_path / "o.png"), "is not the name of an EXR"),
        ((tmp_path / "a.dng", *out, "--exposures", "1", "2"), "2 exposures for 1 photographs"),
        ((tmp_path / "a.dng", *out, "--gain", "2"), "go together"),
        ((tmp_path / "a.dng", *out, "--gain", "-2", "--read-noise", "3"), "must be above 0"),
        ((tmp_path / "a.dng", tmp_path / "a.png", *out, "--transfer", "srgb"), "of different size or mosaic"),
        ((tmp_path / "a.cr2", *out), "cannot be read as camera RAW"),
        ((tmp_path / "b.dng", *out), "does not exist"),
    ]:
        assert said in refused("develop", *arguments)


def test_a_bracket_that_moved_is_told_by_how_much(refused, tmp_path):
    """To 0.15 px, as behind a mosaic the picture that is compared has half the resolution."""
    write_dng(tmp_path / "a.dng", numbers(scene(1), 0.2, 1), 0.2)
    write_dng(tmp_path / "b.dng", numbers(scene(1, (3.0, -2.0)), 0.8, 2), 0.8)
    said = refused("develop", tmp_path / "a.dng", tmp_path / "b.dng", "--out", tmp_path / "o.exr")
    x, y = (float(word) for word in said.split("by (")[1].split(")")[0].split(","))
    assert (x, y) == (
        pytest.approx(3.0, abs=0.15),
        pytest.approx(-2.0, abs=0.15),
    )  # half the resolution behind a mosaic


def test_convert_and_calibrate_refuse_what_is_no_camera(refused, tmp_path):
    (tmp_path / "a.yml").write_text("%YAML:1.0\n---\nimage_width: 3\n")
    write_png(tmp_path / "a.png", np.zeros((31, 37), np.uint8))
    (tmp_path / "empty").mkdir()
    assert "no camera_matrix" in refused("convert", tmp_path / "a.yml", "--out", tmp_path / "model")
    assert "no COLMAP model" in refused("convert", tmp_path / "empty", "--out", tmp_path / "b.yml")
    assert "contradict" in refused(
        *("convert", tmp_path / "a.yml", "--out", tmp_path / "c", "--images", tmp_path, "--to", "colmap")
    )
    board = ("calibrate", "camera", tmp_path / "a.png", "--out", tmp_path / "c.json", "--square", "0.02")
    assert "found in 0 of 1" in refused(*board, "--board", "7x5")
    assert "choose one of" in refused(*board, "--board", "7x5", "--marker", "0.01", "--dictionary", "9X9")
    assert "below the square's" in refused(*board, "--board", "7x5", "--marker", "0.03")
