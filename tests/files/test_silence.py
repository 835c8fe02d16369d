"""Damaged files are refused in one line, and nothing is printed, nor is standard error taken from other threads."""

import os
import threading
from pathlib import Path

import cv2
import numpy as np
import pytest
import tifffile

from fuzz import pictures
from hagoromo.errors import LONGEST, InputError, one_line
from hagoromo.files.exr import read_exr
from hagoromo.files.jpeg import read_jpeg
from hagoromo.files.mesh import read_mesh
from hagoromo.files.png import read_png
from hagoromo.files.raw import read_raw
from hagoromo.files.reading import tifffile_silenced
from hagoromo.files.tiff import read_tiff

CORPUS = Path(__file__).resolve().parents[2] / "fuzz" / "corpus"
READERS = {
    "exr": (pictures.exr, read_exr), "tiles.exr": (pictures.exr_tiles, read_exr), "png": (pictures.png, read_png),
    "palette.png": (pictures.png_kinds, read_png), "jpg": (pictures.jpeg, read_jpeg), "tif": (pictures.tiff, read_tiff),
    "packed.tif": (pictures.tiff_packed, read_tiff), "dng": (pictures.dng, read_raw),
}  # fmt: skip


@pytest.mark.parametrize("name", READERS)
def test_no_library_prints(tmp_path, capfd, name):
    """Whole, cut off, and with bytes changed anywhere: what the C libraries print would be in `capfd`."""
    write, read = READERS[name]
    path, random = tmp_path / f"a.{name}", np.random.default_rng(5)
    write(path)
    whole = path.read_bytes()
    read(path)
    for k in range(12 if name not in ("dng", "tiles.exr") else 3):
        data = bytearray(whole if k % 3 else whole[: len(whole) - 40])
        for at in random.integers(8, len(data), 3 * (k % 3)):
            data[at] ^= 1 << k % 8
        path.write_bytes(data)
        try:
            read(path)
        except InputError as error:
            assert str(error).isprintable()
    assert capfd.readouterr() == ("", "")


def test_other_threads_may_print_while_a_file_is_read(capfd):
    """Standard error is never redirected: what another thread writes meanwhile arrives."""
    with tifffile_silenced():
        other = threading.Thread(target=os.write, args=(2, b"from another thread"))
        other.start()
        other.join()
    assert capfd.readouterr().err == "from another thread"


def test_jpeg_has_the_pixels_of_opencv(tmp_path):
    """Two decoders of one library: progressive, baseline with subsampled colour, grey."""
    image = cv2.GaussianBlur(np.random.default_rng(2).integers(0, 256, (61, 83, 3)).astype(np.uint8), (0, 0), 2)
    for settings in ([cv2.IMWRITE_JPEG_PROGRESSIVE, 1], [cv2.IMWRITE_JPEG_SAMPLING_FACTOR, 0x411111]):
        cv2.imwrite(str(tmp_path / "a.jpg"), image, settings)
        np.testing.assert_array_equal(read_jpeg(tmp_path / "a.jpg")[..., ::-1], cv2.imread(str(tmp_path / "a.jpg")))
    cv2.imwrite(str(tmp_path / "a.jpg"), image[..., 0])
    assert read_jpeg(tmp_path / "a.jpg").shape == (61, 83)


def test_a_mesh_that_is_damaged_is_logged_nowhere(caplog):
    """trimesh would print a traceback about the normals of an STL, which are not read."""
    read_mesh(CORPUS / "mesh-text.stl" / "normals.stl")
    assert not caplog.records


def test_a_tiff_of_two_bits_is_refused(tmp_path):
    tifffile.imwrite(tmp_path / "a.tif", np.zeros((5, 8), np.uint8), extratags=[])
    data = (tmp_path / "a.tif").read_bytes()
    tag = data.index(b"\x02\x01\x03\x00\x01\x00\x00\x00")  # BitsPerSample
    (tmp_path / "a.tif").write_bytes(data[: tag + 8] + b"\x02\x00" + data[tag + 10 :])
    with pytest.raises(InputError, match="2 bits a sample"):
        read_tiff(tmp_path / "a.tif")


def test_messages_are_one_line():
    assert one_line("a\nb\x1b[31m\u2028c\ud800") == "a b\\x1b[31m c\\ud800"
    assert len(one_line("x" * 10**6)) <= LONGEST
    assert len(one_line(" " * 10**6 + "\x1b")) <= LONGEST  # in steps of its length, not of its square
    assert str(InputError("a\r\n b")) == "a b"
