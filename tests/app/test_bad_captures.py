"""Photographs and captures that tell nothing are refused, and the message says why."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from hagoromo.files.png import write_png
from hagoromo.files.record import read_json, write_json


def test_photographs_of_different_sizes_are_refused(refused, tmp_path):
    for name, height in (("a", 31), ("b", 37)):
        write_png(tmp_path / f"{name}.png", np.zeros((height, 41), np.uint8))
    said = refused(
        *("calibrate", "camera", tmp_path / "a.png", tmp_path / "b.png"),
        *("--board", "9x6", "--square", "0.025", "--out", tmp_path / "camera.json"),
    )
    assert "different sizes" in said and "41x31" in said and "41x37" in said


def with_images(capture: Path, *images: np.ndarray, **frame) -> Path:
    """The capture with other images, and `frame` in each of its frames."""
    record = read_json(capture / "transforms.json")
    for k, image in enumerate(images):
        write_png(capture / f"{k}.png", image)
        record["frames"][k] |= {"file_path": f"{k}.png", **frame}
    write_json(capture / "transforms.json", record)
    return capture


def test_photographs_of_different_sizes_in_a_capture_are_refused(refused, capture, tmp_path):
    with_images(capture, *(np.full((height, 61, 3), 900, np.uint16) for height in (47, 43)))
    assert "1.png" in refused("measure", capture, "--out", tmp_path / "measured")


def test_photographs_that_are_all_saturated_are_refused(refused, capture, tmp_path):
    with_images(capture, *[np.full((47, 61, 3), 4095, np.uint16)] * 2)
    refused("measure", capture, "--out", tmp_path / "measured")


def test_photographs_that_are_all_masked_are_refused(refused, capture, tmp_path):
    write_png(capture / "mask.png", np.zeros((47, 61), np.uint8))
    with_images(capture, *[np.full((47, 61, 3), 900, np.uint16)] * 2, mask_path="mask.png")
    refused("measure", capture, "--out", tmp_path / "measured")


@pytest.mark.parametrize("name", ["transforms.json", "normals.exr", "images"])
def test_a_capture_with_a_missing_part_is_refused(refused, capture, tmp_path, name):
    path = capture / name
    shutil.rmtree(path) if path.is_dir() else path.unlink()
    refused("measure", capture, "--out", tmp_path / "measured")


@pytest.mark.parametrize("name", ["transforms.json", "normals.exr", "canon_eos_300d.csv"])
def test_a_capture_with_a_truncated_part_is_refused(refused, capture, tmp_path, name):
    data = (capture / name).read_bytes()
    (capture / name).write_bytes(data[: len(data) // 2 - 3])
    refused("measure", capture, "--out", tmp_path / "measured")


def test_a_capture_that_reaches_out_of_its_folder_is_refused(refused, capture, tmp_path):
    record = read_json(capture / "transforms.json")
    record["frames"][0]["file_path"] = "../../secret.png"
    write_json(capture / "transforms.json", record)
    assert "points outside" in refused("measure", capture, "--out", tmp_path / "measured")
