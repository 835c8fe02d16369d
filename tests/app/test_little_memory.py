"""Under a limit of memory a command ends in one line: what is too large is refused before it is taken."""

import json
import struct
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numcodecs import Zstd

pytestmark = pytest.mark.skipif(sys.platform != "linux", reason="other systems do not heed these limits")
LIMIT = 2 << 30  # bytes that the process may take
MOST = 400 << 20  # bytes that it takes at most, its libraries included, before it refuses
# a small process of its own: the system counts the memory of who starts a process as the process's
STARTER = """
import resource, subprocess, sys
limit, said, *command = sys.argv[1:]
resource.setrlimit(resource.RLIMIT_AS, (int(limit), int(limit)))
with open(said, "wb") as file:
    status = subprocess.run(command, stdout=file, stderr=file).returncode
print(status, resource.getrusage(resource.RUSAGE_CHILDREN).ru_maxrss)
"""
MATTER = "[material]\nalpha = 0.2\nbeta = 0.5\ngamma = 0.2\nn = 1.4\nbody_colour = 0.7\n"


def run(folder: Path, *arguments: str, limit: int = LIMIT) -> tuple[int, list[str], int]:
    """Status of the command, the lines it said, and the most memory that it had [byte]."""
    command = [sys.executable, "-c", STARTER, str(limit), "said", sys.executable, "-m", "hagoromo", *arguments]
    status, most = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=True).stdout.split()
    return int(status), (folder / "said").read_text().splitlines(), int(most) * 1024


def exr(folder: Path) -> tuple[str, ...]:
    """A picture of four bytes and a second one of 40 GB in the same file."""
    import OpenEXR

    window = (np.zeros(2, np.int32), np.full(2, 3, np.int32))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "displayWindow": window}
    parts = [OpenEXR.Part(dict(header), {"R": np.zeros((4, 4), np.float32)}, name) for name in ("a", "b")]
    with OpenEXR.File(parts) as file:
        file.write(str(folder / "a.exr"))
    data = (folder / "a.exr").read_bytes()
    place = data.rindex(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 12
    (folder / "a.exr").write_bytes(data[:place] + struct.pack("<ii", 99_999, 99_999) + data[place + 8 :])
    return "info", "a.exr"


def jpeg(folder: Path) -> tuple[str, ...]:
    import cv2

    data = bytearray(cv2.imencode(".jpg", np.zeros((16, 16, 3), np.uint8))[1].tobytes())
    place = data.index(b"\xff\xc0") + 5
    data[place : place + 4] = b"\xff" * 4
    (folder / "a.jpg").write_bytes(data)
    return "info", "a.jpg"


def chunk(folder: Path) -> tuple[str, ...]:
    """A chunk of 1 MB that unpacks to 1 GB; its array says 30 kB."""
    side = [16, 20, 24]
    record = {
        "zarr_format": 3, "node_type": "array", "shape": side, "data_type": "float32", "fill_value": 0,
        "chunk_grid": {"name": "regular", "configuration": {"chunk_shape": side}}, "attributes": {},
        "chunk_key_encoding": {"name": "default", "configuration": {"separator": "/"}},
        "codecs": [
            {"name": "bytes", "configuration": {"endian": "little"}},
            {"name": "zstd", "configuration": {"level": 0, "checksum": False}},
        ],
    }  # fmt: skip
    (folder / "a.zarr/c/0/0").mkdir(parents=True)
    (folder / "a.zarr/zarr.json").write_text(json.dumps(record))
    blocks = 1 << 13  # of 128 KiB of one repeated byte; the frame does not state its size
    block = struct.pack("<I", ((1 << 17) - 1) << 3 | 2)[:3] + b"\0"
    last = struct.pack("<I", 3 | 8)[:3] + b"\0"
    (folder / "a.zarr/c/0/0/0").write_bytes(b"\x28\xb5\x2f\xfd\0\x38" + block * blocks + last)
    assert len(Zstd().decode(b"\x28\xb5\x2f\xfd\0\x38" + block * 8 + last)) == 8 * ((1 << 17) - 1) + 1
    (folder / "a.toml").write_text(
        'kind = "volume"\ndensity = "a.zarr"\nvoxel_mm = 1\nmean_free_path_mm = 1\n' + MATTER
    )
    return "build", "a.toml", "--out", "b.zarr"


def tables(folder: Path) -> tuple[str, ...]:
    (folder / "a.json").write_bytes(b"[" + b"{}," * 30_000_000 + b"{}]")
    return "info", "a.json"


@pytest.mark.by_night("jpeg", "tables")
@pytest.mark.parametrize("attack", [exr, jpeg, chunk, tables])
def test_what_is_too_large_is_refused_before_it_is_taken(tmp_path, attack):
    status, said, most = run(tmp_path, *attack(tmp_path))
    assert status == 2 and len(said) == 1 and said[0].startswith("hagoromo: "), said
    assert most < MOST


@pytest.mark.parametrize("limit", [150 << 20, 400 << 20])
def test_a_limit_too_small_to_start_is_said(tmp_path, limit):
    status, said, _ = run(tmp_path, "info", "a.png", limit=limit)
    assert status == 2 and len(said) == 1 and "GiB of memory to start" in said[0]


def test_a_lack_that_shows_only_when_memory_is_taken_ends_in_one_line(tmp_path):
    """The limit lets the program start, but not its libraries for pictures under it."""
    code = (
        "import resource, sys; from hagoromo.app import cli; import hagoromo as hg\n"
        "def none(*_): raise MemoryError\n"
        "hg.info = none; sys.exit(cli.main(['info', 'a.png']))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == 2 and done.stderr.count("\n") == 1 and "memory is not enough" in done.stderr
