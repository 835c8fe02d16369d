"""Files that are missing, cut off, damaged or of another kind are refused by name."""

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png

KINDS = ("exr", "png", "jpg", "csv", "json", "toml")


@pytest.mark.parametrize("kind", KINDS)
def test_a_missing_file_is_named(refused, tmp_path, kind):
    assert f"a.{kind} does not exist" in refused("info", tmp_path / f"a.{kind}")


@pytest.mark.parametrize("kind", KINDS)
def test_a_truncated_file_is_refused(refused, tmp_path, kind, whole_file_of):
    """Cut in the middle, for text in the middle of a value: a table that ends with a whole row cannot be told."""
    path = whole_file_of(kind)
    decode = ["--decode"] if kind in ("exr", "png", "jpg") else []
    assert main(["info", str(path), *decode]) == 0
    data = path.read_bytes()
    path.write_bytes(data[: data.rindex(b",")] if kind == "csv" else data[: len(data) // 2])
    assert str(path) in refused("info", path, *decode)


@pytest.mark.parametrize("kind", KINDS)
def test_a_file_of_another_kind_is_refused(refused, tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    path.write_bytes(np.random.default_rng(2).bytes(4099))
    assert str(path) in refused("info", path)


def test_a_folder_of_no_known_kind_is_refused(refused, tmp_path):
    assert "neither a capture" in refused("info", tmp_path)


def test_images_that_cannot_be_compared_are_refused(refused, tmp_path):
    write_png(tmp_path / "a.png", np.zeros((31, 41, 3), np.uint8))
    write_png(tmp_path / "b.png", np.zeros((37, 41, 3), np.uint8))
    write_exr(tmp_path / "c.exr", {"R": np.zeros((31, 41), np.float32)})
    assert "equal sizes" in refused("compare", tmp_path / "a.png", tmp_path / "b.png")
    assert "cannot be compared" in refused("compare", tmp_path / "a.png", tmp_path / "c.exr")
    assert "equal sizes" in refused("compare", tmp_path / "a.png", tmp_path / "a.png", "--mask", tmp_path / "b.png")
