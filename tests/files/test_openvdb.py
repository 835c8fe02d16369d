"""OpenVDB and NanoVDB: files that OpenVDB wrote are read, and what we write is read by it and by another reader.

`openvdb_samples.zip` was written by OpenVDB 10.0.1 (Debian's Python module and vdb_tool): a region of whole numbers at
(−5, 3, 900), a tile of 8³ voxels at (8, 8, 904), a quarter turn about z; NanoVDB packed by zlib and blosc.
"""

import io
import shutil
import subprocess
import zipfile
from pathlib import Path

import numpy as np
import pytest

from fuzz.volumes import nvdb
from hagoromo.app.info import info
from hagoromo.errors import InputError
from hagoromo.files.volume_file import read_volume
from hagoromo.volume.store.box_store import load_box
from hagoromo_formats.convert import ConvertOptions, convert
from hagoromo_formats.volumes.openvdb_out import write_openvdb
from hagoromo_formats.volumes.sparse_lattice import SparseLattice
from tests.files.test_volume_files import a_box
from tests.oracle.dense_field import dense_field

SAMPLES = Path(__file__).with_name("openvdb_samples.zip")
X, Y, Z = np.meshgrid(np.arange(5), np.arange(4), np.arange(3), indexing="ij")
REGION, TILE = (1 + X + 10 * Y + 100 * Z).astype(np.float32), 7.0
LOW = np.array([-5, 3, 900])
PLACE = np.array([[0.0, -0.5, 0.0, 1.0], [0.5, 0.0, 0.0, 2.0], [0.0, 0.0, 0.5, 3.0], [0.0, 0.0, 0.0, 1.0]])
DEBIAN = "/usr/bin/python3"
BY_OPENVDB = """
import sys, numpy as np, pyopenvdb as vdb
found = {}
for grid in vdb.readAll(sys.argv[1])[0]:
    low, high = (np.array(end) for end in grid.evalActiveVoxelBoundingBox())
    vector = grid.valueTypeName.startswith("vec")
    values = np.zeros((*(high - low + 1), *((3,) if vector else ())), float)
    grid.copyToArray(values, ijk=tuple(int(n) for n in low))
    turned = [grid.transform.indexToWorld(tuple(float(n) for n in low + step)) for step in np.eye(4)[:, :3]]
    found[grid.name], found[grid.name + " places"] = values, np.array(turned)
np.savez(sys.stdout.buffer, **found)
"""


def sample(folder: Path, name: str) -> Path:
    with zipfile.ZipFile(SAMPLES) as held:
        (folder / name).write_bytes(held.read(name))
    return folder / name


@pytest.mark.parametrize("name", ["half.vdb", "vectors.vdb", "float.vdb", "zip.nvdb", "blosc.nvdb"])
def test_what_openvdb_wrote_is_read(tmp_path, name):
    """All values are whole numbers below 2048, which halves hold exactly."""
    volume = read_volume(sample(tmp_path, name))
    values, scale = np.swapaxes(volume.values, 0, 2), np.float32(1.0)
    if name == "vectors.vdb":
        scale = np.array([1.0, 2.0, -1.0], np.float32)
    expected = np.zeros((21, 13, 12, *np.shape(scale)), np.float32)
    expected[:5, :4, :3] = np.multiply.outer(REGION, scale)
    expected[13:, 5:, 4:] = TILE * scale
    assert np.array_equal(values, expected)
    placed = PLACE @ [*LOW, 1.0]
    assert volume.matrix is not None
    assert volume.matrix[:, :3] == pytest.approx(PLACE[:, :3]) and volume.matrix[:, 3] == pytest.approx(placed)
    assert info(tmp_path / name)["voxels"] == [21, 13, 12]


def test_a_grid_is_named_behind_a_colon_and_a_level_set_is_refused(tmp_path):
    path = sample(tmp_path, "float.vdb")
    with pytest.raises(InputError, match="level set"):
        read_volume(f"{path}:ball")
    with pytest.raises(InputError, match="has the grids density, ball: name one"):
        read_volume(f"{path}:smoke")


def test_leaves_without_active_voxels_do_not_widen_the_lattice():
    """They lie before, behind and beside it; one leaf is active from its voxel (1, 2, 3) to (4, 5, 6)."""
    active = np.zeros((8, 8, 8), bool)
    active[1:5, 2:6, 3:7] = True
    values = np.arange(512, dtype=np.float32).reshape(8, 8, 8)
    lattice = SparseLattice("a", "", np.float32, 1, 0.0, np.eye(4))
    lattice.leaves.append((np.array([8, 8, 8]), active, values))
    for other in ([0, 8, 8], [16, 8, 8], [8, 0, 16], [80, -80, 8]):
        lattice.leaves.append((np.array(other), np.zeros((8, 8, 8), bool), values + 1000.0))
    volume = lattice.dense("a")
    assert np.array_equal(np.swapaxes(volume.values, 0, 2), values[1:5, 2:6, 3:7])
    assert volume.matrix is not None and volume.matrix[:3, 3] == pytest.approx([9.0, 10.0, 11.0])


def fields(shape=(19, 29, 143)) -> tuple[dict[str, np.ndarray], np.ndarray]:
    """Sparse fields over several nodes of the tree, in a lattice that is turned, and its matrix."""
    random = np.random.default_rng(3)
    density = random.random(shape, np.float32)
    density[(density < 0.7) | (np.indices(shape)[0] < 8)] = 0.0
    colour = random.random((*shape, 3), np.float32) * (density[..., None] > 0)
    angle, matrix = 0.3, np.eye(4)
    turn = [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    matrix[:3, :3], matrix[:3, 3] = 1e-3 * np.array(turn), (0.1, 0.2, -0.3)
    return {"density": density, "colour": colour}, matrix


def test_what_is_written_is_what_openvdb_reads(tmp_path):
    """Debian's OpenVDB in a Python of its own: numbers, active voxels and places."""
    if subprocess.run([DEBIAN, "-c", "import pyopenvdb"], capture_output=True).returncode:
        pytest.skip("Debian's python3-openvdb is not installed")
    written, matrix = fields()
    write_openvdb(tmp_path / "a.vdb", written, matrix)
    done = subprocess.run([DEBIAN, "-c", BY_OPENVDB, str(tmp_path / "a.vdb")], capture_output=True, check=True)
    found = np.load(io.BytesIO(done.stdout))
    inside = np.argwhere(written["density"])
    low, high = inside.min(0), inside.max(0) + 1
    assert low.tolist() == [8, 0, 0]
    for name, values in written.items():
        part = values[tuple(map(slice, low, high))]
        assert np.array_equal(np.swapaxes(found[name], 0, 2), part)
        ends = [(matrix @ [*(low[::-1] + step), 1.0])[:3] for step in np.eye(4)[:, :3]]
        assert found[f"{name} places"] == pytest.approx(np.array(ends))


def test_what_is_written_is_what_tinyvdb_reads(tmp_path):
    """Within 32³ voxels: of more, tinyvdb 0.9 drops leaves, of OpenVDB's own files as well."""
    tinyvdb = pytest.importorskip("tinyvdb")
    written, matrix = fields((19, 29, 31))
    write_openvdb(tmp_path / "a.vdb", written, matrix)
    with tinyvdb.open(str(tmp_path / "a.vdb")) as file:
        file.read_grids()
        assert [file.grid_name(k) for k in range(file.grid_count)] == ["density", "colour"]
        grid = file.grid(0).to_sparse()
        rows = np.array(file.grid(0).transform["matrix"])
    places = np.frombuffer(grid["coords"], np.int32).reshape(-1, 3)
    found = np.zeros_like(written["density"])
    found[tuple(places.T[::-1])] = np.frombuffer(grid["values"], np.float32)
    assert np.array_equal(found, written["density"]) and rows == pytest.approx(matrix.T)


def test_what_is_written_is_read_and_is_the_same_bytes_each_time(tmp_path):
    written, matrix = fields()
    for name in "ab":
        write_openvdb(tmp_path / f"{name}.vdb", written, matrix)
    assert (tmp_path / "a.vdb").read_bytes() == (tmp_path / "b.vdb").read_bytes()
    for name, values in written.items():
        volume = read_volume(f"{tmp_path / 'a.vdb'}:{name}")
        assert np.array_equal(volume.values, values[8:])
        assert volume.matrix is not None
        assert np.linalg.solve(matrix, volume.matrix[:, 3]) == pytest.approx([0.0, 0.0, 8.0, 1.0], abs=1e-9)
    write_openvdb(tmp_path / "empty.vdb", {"density": np.zeros((3, 4, 5), np.float32)}, matrix)
    with pytest.raises(InputError, match="no active voxels"):
        read_volume(tmp_path / "empty.vdb")


def test_a_box_is_the_same_box_after_openvdb(tmp_path):
    """Density and axes; what has no density around the matter is left out."""
    box = a_box(tmp_path)
    convert(tmp_path / "a.zarr", tmp_path / "b.vdb")
    options = ConvertOptions(axis=Path(f"{tmp_path / 'b.vdb'}:axis"))
    convert(f"{tmp_path / 'b.vdb'}:density", tmp_path / "b.zarr", options=options)
    again, density = load_box(tmp_path / "b.zarr"), dense_field(box, "density")
    low = np.argwhere(density).min(0)
    part = tuple(map(slice, low, low + again.bricks.shape))
    assert np.array_equal(dense_field(again, "density"), density[part])
    assert dense_field(again, "axis") == pytest.approx(dense_field(box, "axis")[part], abs=2e-2)  # axes in bytes
    assert again.pose[:3, 3] == pytest.approx((box.pose @ [*(low[::-1] * box.voxel_size), 1.0])[:3])


def test_openvdb_takes_the_nanovdb_of_the_fuzzer_for_whole(tmp_path):
    """Those bytes were laid out by hand, after NanoVDB.h."""
    if shutil.which("vdb_tool") is None:
        pytest.skip("vdb_tool (Debian's libopenvdb-tools) is not installed")
    nvdb(tmp_path / "a.nvdb")
    done = subprocess.run(["vdb_tool", "-read", str(tmp_path / "a.nvdb"), "-print"], capture_output=True, text=True)
    assert "voxels = 512, dx = 0.001" in done.stdout + done.stderr


def _cut(data: bytes) -> bytes:
    return data[: len(data) // 2]


@pytest.mark.parametrize("name", ["half.vdb", "zip.nvdb", "blosc.nvdb"])
@pytest.mark.parametrize("spoil", [_cut, lambda data: data[:8] + b"\xff" * 8 + data[16:], lambda data: b""])
def test_a_damaged_file_is_refused(tmp_path, name, spoil):
    path = sample(tmp_path, name)
    path.write_bytes(spoil(path.read_bytes()))
    with pytest.raises(InputError, match=name):
        read_volume(path)
