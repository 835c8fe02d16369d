"""EXR: lines are read as OpenEXR's library reads them, and what only it reads is read in a process of its own."""

import numpy as np
import OpenEXR
import pytest

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, read_header, read_layout, write_exr

RANDOM = np.random.default_rng(7)
PIXELS = {
    "A": RANDOM.integers(0, 2**24, (37, 23)).astype(np.uint32),
    "B": RANDOM.normal(size=(37, 23)).astype(np.float16),
    "Z": np.cumsum(RANDOM.normal(size=(37, 23)), axis=1).astype(np.float32),
}
IN_LINES = ("NO", "ZIPS", "ZIP")


@pytest.mark.parametrize("name", [*IN_LINES, "PIZ", "RLE"])
def test_channels_of_every_type_are_read(tmp_path, name):
    """Of 37 rows and an odd width: the last chunk is not full, and bytes are parted unevenly."""
    header = {"compression": getattr(OpenEXR, f"{name}_COMPRESSION"), "type": OpenEXR.scanlineimage, "note": "ä"}
    with OpenEXR.File(header, {key: values.copy() for key, values in PIXELS.items()}) as file:
        file.write(str(tmp_path / "a.exr"))
    assert read_layout((tmp_path / "a.exr").read_bytes()).in_lines == (name in IN_LINES)
    channels, text = read_exr(tmp_path / "a.exr")
    assert list(channels) == ["A", "B", "Z"] and text == {"note": "ä"} == read_header(tmp_path / "a.exr")
    for key, values in PIXELS.items():
        np.testing.assert_array_equal(channels[key], values.astype(np.float32))


def test_missing_lines_are_refused(tmp_path):
    """The offset of a chunk that was never written is 0."""
    write_exr(tmp_path / "a.exr", {"Y": PIXELS["Z"]})
    data = bytearray((tmp_path / "a.exr").read_bytes())
    end = read_layout(bytes(data)).end
    data[end + 8 : end + 16] = bytes(8)
    (tmp_path / "a.exr").write_bytes(data)
    with pytest.raises(InputError, match="lines are missing"):
        read_exr(tmp_path / "a.exr")
