"""A file that states more pixels than its bytes can hold is refused by its header, before anything is decoded."""

import io
import struct
import zlib
from typing import Any

import numpy as np
import pytest
from PIL import Image

from hagoromo.errors import InputError
from hagoromo.files import apart
from hagoromo.files.hdr import read_hdr, write_hdr
from hagoromo.files.jpeg import read_jpeg
from hagoromo.files.picture import picture_size
from hagoromo.files.png import read_png, write_png
from hagoromo.files.tiff import read_tiff

SIDE = 20_000  # px


@pytest.fixture
def nothing_is_decoded(monkeypatch):
    asked = apart._asked

    def headers_alone(helper, task, seconds):
        if b"pixels_by" in task:
            raise AssertionError("a decoder was asked")
        return asked(helper, task, seconds)

    monkeypatch.setattr(apart, "_asked", headers_alone)


def jpeg(path, stated: int = 0, progressive: bool = False) -> None:
    held = io.BytesIO()
    Image.fromarray(np.zeros((64, 48), np.uint8)).save(held, "JPEG", progressive=progressive)
    data = bytearray(held.getvalue())
    if stated:
        at = data.index(b"\xff\xc2" if progressive else b"\xff\xc0") + 5
        data[at : at + 4] = struct.pack(">HH", stated, stated)
    path.write_bytes(data)


@pytest.mark.parametrize("progressive", [False, True])
def test_a_jpeg(tmp_path, nothing_is_decoded, progressive):
    jpeg(tmp_path / "a.jpg", SIDE, progressive)
    for read in (read_jpeg, picture_size):
        with pytest.raises(InputError, match=r"states 20000 × 20000 pixels and has \d+ bytes, too few"):
            read(tmp_path / "a.jpg")


def test_a_png(tmp_path, nothing_is_decoded):
    write_png(tmp_path / "a.png", np.zeros((64, 48), np.uint8))
    data = bytearray((tmp_path / "a.png").read_bytes())
    data[16:24] = struct.pack(">II", SIDE, SIDE)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    (tmp_path / "a.png").write_bytes(data)
    for read in (read_png, picture_size):
        with pytest.raises(InputError, match=r"states 20000 × 20000 pixels and has \d+ bytes, too few"):
            read(tmp_path / "a.png")


def test_a_tiff(tmp_path, nothing_is_decoded):
    Image.fromarray(np.zeros((64, 48), np.uint8)).save(tmp_path / "a.tif", compression="tiff_lzw")
    data = (tmp_path / "a.tif").read_bytes()
    for tag, held in ((256, 48), (257, 64), (278, 64)):  # width, height, rows of a strip
        for kind in (3, 4):
            data = data.replace(struct.pack("<HHII", tag, kind, 1, held), struct.pack("<HHII", tag, 4, 1, SIDE))
    (tmp_path / "a.tif").write_bytes(data)
    with pytest.raises(InputError, match=r"states an image of \(20000, 20000\) and has \d+ bytes, too few"):
        read_tiff(tmp_path / "a.tif")


def test_a_picture_of_radiance(tmp_path, nothing_is_decoded):
    write_hdr(tmp_path / "a.hdr", np.ones((64, 48, 3), np.float32))
    data = (tmp_path / "a.hdr").read_bytes().replace(b"-Y 64 +X 48", b"-Y 20000 +X 20000")
    (tmp_path / "a.hdr").write_bytes(data)
    with pytest.raises(InputError, match=r"states 20000 × 20000 pixels and has \d+ bytes, too few"):
        read_hdr(tmp_path / "a.hdr")


@pytest.mark.parametrize("value", [0, 255])
def test_the_emptiest_real_pictures_are_read(tmp_path, value):
    """One colour, packed as tightly as each library can: what cameras write is hundreds of times less dense."""
    grey = np.full((1200, 1600), value, np.uint8)
    made: dict[str, dict[str, Any]] = {
        "a.jpg": {"progressive": True, "optimize": True, "quality": 5}, "a.png": {"compress_level": 9},
        "a.tif": {"compression": "tiff_adobe_deflate"}, "b.tif": {"compression": "tiff_lzw"},
        "c.tif": {"compression": "packbits"}, "b.png": {"bits": 1},
    }  # fmt: skip
    for name, settings in made.items():
        Image.fromarray(grey).convert("1" if name == "b.png" else "L").save(tmp_path / name, **settings)
        read = {"jpg": read_jpeg, "png": read_png, "tif": read_tiff}[name[2:]]
        lost = 8 if name == "a.jpg" else 0
        assert np.abs(read(tmp_path / name).astype(int) - grey).max() <= lost, name
    write_hdr(tmp_path / "a.hdr", np.full((60, 8001, 3), value, np.float32))
    assert read_hdr(tmp_path / "a.hdr").shape == (60, 8001, 3)
