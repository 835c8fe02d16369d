"""Volumes of other programs: every format against bytes written here by its definition, and against another reader."""

import gzip
import struct
import zlib

import cv2
import numpy as np
import pytest

from hagoromo.app.info import info
from hagoromo.errors import InputError
from hagoromo.files.format import formats_of
from hagoromo.files.volume_file import read_volume, resampled
from hagoromo.volume.store.box_store import load_box
from hagoromo_formats.convert import ConvertOptions, convert
from tests.oracle.dense_field import dense_field

SHAPE = (3, 4, 5)  # z, y, x: all different, so that no two axes can be exchanged
VALUES = np.random.default_rng(7).integers(0, 200, SHAPE).astype(np.uint16)
EDGES, FIRST = (0.5, 0.75, 2.0), (10.0, -20.0, 30.0)  # mm
TURN = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])  # columns: axes of x, y, z in the world
RAW = VALUES.astype("<u2").tobytes()


def matrix_of(edges=EDGES, first=FIRST, turn=TURN) -> np.ndarray:
    matrix = np.eye(4)
    matrix[:3, :3], matrix[:3, 3] = turn * np.array(edges) * 1e-3, np.array(first) * 1e-3
    return matrix


def nrrd(encoding: str = "raw", data: bytes = RAW, more: str = "") -> bytes:
    columns = " ".join(f"({','.join(str(x) for x in TURN[:, k] * EDGES[k])})" for k in range(3))
    return (
        f"NRRD0004\ntype: uint16\ndimension: 3\nsizes: 5 4 3\nspace: left-posterior-superior\nencoding: {encoding}\n"
        f"endian: little\nspace directions: {columns}\nspace origin: (10,-20,30)\n{more}\n"
    ).encode() + data


def metaimage(data: str = "LOCAL", packed: int = 0) -> bytes:
    turn = " ".join(str(x) for x in TURN.T.ravel())
    return (
        f"ObjectType = Image\nNDims = 3\nBinaryData = True\nBinaryDataByteOrderMSB = False\n"
        f"CompressedData = {packed > 0}\n"
        f"CompressedDataSize = {packed}\nTransformMatrix = {turn}\nOffset = 10 -20 30\nElementSpacing = 0.5 0.75 2\n"
        f"DimSize = 5 4 3\nElementType = MET_USHORT\nElementDataFile = {data}\n"
    ).encode()


def nifti() -> bytes:
    """NIfTI-1.1: a header of 348 bytes, four more, numbers with x fastest."""
    head = bytearray(352)
    rows = matrix_of()[:3] * 1e3
    struct.pack_into("<i", head, 0, 348)
    struct.pack_into("<8h", head, 40, 3, 5, 4, 3, 1, 1, 1, 1)
    struct.pack_into("<2h", head, 70, 512, 16)  # uint16
    struct.pack_into("<8f", head, 76, 1.0, *EDGES, 0, 0, 0, 0)
    struct.pack_into("<f", head, 108, 352.0)
    head[123] = 2  # mm
    struct.pack_into("<2h", head, 252, 0, 1)  # the second matrix holds
    struct.pack_into("<12f", head, 280, *rows.ravel())
    head[344:348] = b"n+1\0"
    return bytes(head) + RAW


def vti() -> bytes:
    """Image data whose voxels are numbers in text."""
    turn = " ".join(str(x) for x in TURN.ravel())
    return (
        '<?xml version="1.0"?><VTKFile type="ImageData" version="1.0" byte_order="LittleEndian">'
        f'<ImageData WholeExtent="0 4 0 3 0 2" Origin="10 -20 30" Spacing="0.5 0.75 2" Direction="{turn}">'
        '<Piece Extent="0 4 0 3 0 2"><PointData Scalars="a"><DataArray type="UInt16" Name="a" format="ascii">'
        f"{' '.join(map(str, VALUES.ravel()))}</DataArray></PointData></Piece></ImageData></VTKFile>"
    ).encode()


def vol() -> bytes:
    corners = (0.0, 0.0, 0.0, 0.0025, 0.003, 0.006)
    return struct.pack("<3sB5i6f", b"VOL", 3, 3, 5, 4, 3, 1, *corners) + VALUES.astype(np.uint8).tobytes()


def slc() -> bytes:
    """VolVis: a header, an icon of 2 × 1 pixels, and layers of runs: n | 128 bytes as they are, or n times the next."""
    data = b"11111\n5 4 3 8\n0.5 0.75 2.0\n1 6 0 1\n2 1 X" + bytes(6)
    for layer in VALUES.astype(np.uint8):
        first, *rest = layer.ravel().tolist()
        packed = bytes([1, first, 0x80 | len(rest), *rest, 0])
        data += b"%d X" % len(packed) + packed
    return data


PLACED = matrix_of()
SAMPLES = {
    "a.nrrd": (nrrd(), PLACED),
    "gzip.nrrd": (nrrd("gzip", gzip.compress(RAW)), PLACED),
    "a.mha": (metaimage() + RAW, PLACED),
    "packed.mha": (metaimage(packed=len(zlib.compress(RAW))) + zlib.compress(RAW), PLACED),
    "a.nii": (nifti(), PLACED),
    "a.nii.gz": (gzip.compress(nifti()), PLACED),
    "a.vti": (vti(), PLACED),
    "a.vol": (vol(), matrix_of((0.5, 0.75, 2.0), (0.25, 0.375, 1.0), np.eye(3))),
    "a.slc": (slc(), matrix_of(first=(0.0, 0.0, 0.0), turn=np.eye(3))),
    "head_5x4x3_uint16.raw": (RAW, None),
}


@pytest.mark.parametrize("name", SAMPLES)
def test_a_volume_is_read_as_its_definition_says(tmp_path, name):
    """Bytes written above by the format's definition. NIfTI and .vol keep places as float32."""
    if name.endswith((".vti", ".slc")):
        pytest.importorskip("vtkmodules", reason="VTI and SLC are read by VTK, which is not installed")
    data, matrix = SAMPLES[name]
    (tmp_path / name).write_bytes(data)
    volume = read_volume(tmp_path / name)
    assert np.array_equal(volume.values, VALUES)
    if matrix is None:
        assert volume.matrix is None
    else:
        assert volume.matrix == pytest.approx(matrix, rel=1e-6, abs=1e-9)


def test_numbers_beside_a_header_are_read_and_only_there(tmp_path):
    home = tmp_path / "home"
    home.mkdir()
    (tmp_path / "numbers.raw").write_bytes(RAW)
    (home / "numbers.raw").write_bytes(RAW)
    for name, header in (("a.mhd", metaimage), ("a.nhdr", lambda data: nrrd(data=b"", more=f"data file: {data}\n"))):
        (home / name).write_bytes(header("numbers.raw"))
        assert np.array_equal(read_volume(home / name).values, VALUES)
        (home / name).write_bytes(header("../numbers.raw"))
        with pytest.raises(InputError, match="points outside"):
            read_volume(home / name)


def test_arrays_of_numpy_and_hdf5_are_read(tmp_path):
    h5py = pytest.importorskip("h5py")
    np.save(tmp_path / "a.npy", VALUES)
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["entry/density"] = VALUES
        file["table"] = np.arange(5)
    for name in ("a.npy", "a.h5", "a.h5:entry/density"):
        assert np.array_equal(read_volume(f"{tmp_path}/{name}").values, VALUES)
    with h5py.File(tmp_path / "a.h5", "a") as file:
        file["other"] = VALUES
    with pytest.raises(InputError, match="entry/density, other: name one"):
        read_volume(tmp_path / "a.h5")


def test_what_is_pickled_is_never_read(tmp_path):
    np.save(tmp_path / "a.npy", np.array([[[{"a": 1}]]], object), allow_pickle=True)
    with pytest.raises(InputError, match=r"a\.npy cannot be read"):
        read_volume(tmp_path / "a.npy")


@pytest.mark.parametrize("packing", ["raw", "tiff_lzw", "tiff_deflate"])
def test_a_tiff_stack_is_read_as_pillow_wrote_it(tmp_path, packing):
    from PIL import Image

    pages = [Image.fromarray(page) for page in VALUES]
    pages[0].save(tmp_path / "a.tif", save_all=True, append_images=pages[1:], compression=packing)
    assert np.array_equal(read_volume(tmp_path / "a.tif").values, VALUES)
    for k, page in enumerate(VALUES):
        cv2.imwrite(str(tmp_path / f"slice_{k + 8}.tif"), page)  # 8, 9, 10: by number, not by letter
    (tmp_path / "a.tif").unlink()
    assert np.array_equal(read_volume(tmp_path).values, VALUES)


def by_others(path) -> tuple[np.ndarray, list, list]:
    """Numbers (z, y, x, …), edges and origin as SimpleITK reads them, or VTK its own image data."""
    if path.suffix != ".vti":
        itk = pytest.importorskip("SimpleITK")
        image = itk.ReadImage(str(path))
        return itk.GetArrayFromImage(image), list(image.GetSpacing()), list(image.GetOrigin())
    xml = pytest.importorskip("vtkmodules.vtkIOXML")
    vtk_to_numpy = pytest.importorskip("vtkmodules.util.numpy_support").vtk_to_numpy
    reader = xml.vtkXMLImageDataReader()
    reader.SetFileName(str(path))
    reader.Update()
    image = reader.GetOutput()
    values = vtk_to_numpy(image.GetPointData().GetScalars())
    shape = tuple(reversed(image.GetDimensions()))
    return values.reshape(*shape, *values.shape[1:]), list(image.GetSpacing()), list(image.GetOrigin())


@pytest.mark.parametrize("name", ["a.nrrd", "a.mha", "a.nii", "gzip.nrrd", "packed.mha"])
def test_another_reader_finds_the_same_numbers_and_edges(tmp_path, name):
    """Of NIfTI it turns x and y of places around, as its world is another."""
    (tmp_path / name).write_bytes(SAMPLES[name][0])
    values, spacing, origin = by_others(tmp_path / name)
    assert np.array_equal(values, read_volume(tmp_path / name).values)
    assert spacing == pytest.approx(EDGES)
    assert origin == pytest.approx(np.array(FIRST) * ([-1, -1, 1] if name == "a.nii" else 1))


def a_box(tmp_path, **options):
    """A box of the sample, in even voxels of 0.5 mm, 200 being density 1."""
    (tmp_path / "a.mha").write_bytes(metaimage() + RAW)
    convert(tmp_path / "a.mha", tmp_path / "a.zarr", options=ConvertOptions(scale=1 / 200, **options), force=True)
    return load_box(tmp_path / "a.zarr")


def test_voxels_of_unequal_edges_become_cubes_where_the_file_has_them(tmp_path):
    """A field that is linear in place stays that between the first and the last centres."""
    z, y, x = np.meshgrid(*(np.arange(n) * e for n, e in zip(SHAPE, EDGES[::-1], strict=True)), indexing="ij")
    even = resampled(x + 2.0 * y + 3.0 * z, EDGES, 0.5)
    assert even.shape == (12, 6, 5)
    k, j, i = 5, 3, 2  # centres at (k + 1/2) 0.5 mm from the face
    place = [(n + 0.5) * 0.5 - 0.5 * e for n, e in zip((i, j, k), EDGES, strict=True)]
    assert even[k, j, i] == pytest.approx(place[0] + 2.0 * place[1] + 3.0 * place[2], rel=1e-6)
    box = a_box(tmp_path)
    assert box.voxel_size == pytest.approx(0.0005)
    corner = matrix_of() @ [-0.5, -0.5, -0.5, 1.0]  # of the first voxel
    assert box.pose[:3, 3] == pytest.approx(corner[:3]) and box.pose[:3, :3] == pytest.approx(TURN)


def test_a_left_handed_lattice_is_turned_without_a_mirror(tmp_path):
    """A voxel keeps its place in the world."""
    values = np.zeros(SHAPE, np.float32)
    values[0, 1, 2] = 1.0
    head = nrrd(data=b"").replace(b"uint16", b"float").replace(b"(0.0,0.0,2.0)", b"(0,0,-0.5)")
    head = head.replace(b"(-0.75,0.0,0.0)", b"(-0.5,0,0)")
    (tmp_path / "a.nrrd").write_bytes(head + values.tobytes())
    convert(tmp_path / "a.nrrd", tmp_path / "a.zarr")
    box = load_box(tmp_path / "a.zarr")
    z, y, x = np.argwhere(box.bricks.dense()[0] > 0)[0]
    found = box.pose @ [*(np.array([x, y, z]) + 0.5) * box.voxel_size, 1.0]
    volume = read_volume(tmp_path / "a.nrrd")
    assert np.linalg.det(box.pose) == pytest.approx(1.0) and volume.matrix is not None
    assert found == pytest.approx(volume.matrix @ [2, 1, 0, 1])


@pytest.mark.parametrize("suffix", [".nrrd", ".vti", ".vol"])
@pytest.mark.parametrize("field", ["density", "axis", "colour"])
def test_a_box_that_is_written_is_read_alike_by_us_and_by_others(tmp_path, suffix, field):
    """SimpleITK reads NRRD, VTK VTI, Mitsuba .vol: the very numbers; places to the bits of float32 in .vol."""
    if suffix == ".vti":
        pytest.importorskip("vtkmodules", reason="VTI is read by VTK, which is not installed")
    box = a_box(tmp_path)
    path = tmp_path / f"out{suffix}"
    assert isinstance(convert(tmp_path / "a.zarr", path, options=ConvertOptions(field=field)), list)
    expected, volume = dense_field(box, field), read_volume(path)
    assert np.array_equal(volume.values, expected) and expected.any()
    assert volume.edges == pytest.approx([box.voxel_size] * 3)
    if suffix == ".vol":
        import mitsuba as mi

        mi.set_variant("scalar_rgb")
        other = np.array(mi.VolumeGrid(str(path)))
        assert np.array_equal(other.reshape(expected.shape), expected)
        return
    assert volume.matrix is not None and volume.matrix == pytest.approx(np.linalg.inv(box.lattice_from_world))
    values, spacing, origin = by_others(path)
    assert np.array_equal(values.reshape(expected.shape), expected)
    assert spacing == pytest.approx([1e3 * box.voxel_size] * 3)
    assert origin == pytest.approx(1e3 * volume.matrix[:3, 3])


@pytest.mark.parametrize("suffix", [".nrrd", ".vti", ".vol"])
def test_a_box_is_written_with_the_same_bytes_each_time(tmp_path, suffix):
    a_box(tmp_path)
    for name in "bc":
        convert(tmp_path / "a.zarr", tmp_path / f"{name}{suffix}")
    data = (tmp_path / f"b{suffix}").read_bytes()
    assert data == (tmp_path / f"c{suffix}").read_bytes() and b"# " not in data[:400]  # pynrrd notes the time


def test_the_density_that_was_written_is_the_box_again(tmp_path):
    """Floats need no scale; the box lies where it lay."""
    box = a_box(tmp_path)
    convert(tmp_path / "a.zarr", tmp_path / "b.nrrd")
    convert(tmp_path / "b.nrrd", tmp_path / "b.zarr")
    again = load_box(tmp_path / "b.zarr")
    assert np.array_equal(again.bricks.dense()[0], box.bricks.dense()[0])
    assert again.pose == pytest.approx(box.pose)


def test_info_knows_every_volume(tmp_path):
    (tmp_path / "a.nrrd").write_bytes(nrrd())
    facts = info(tmp_path / "a.nrrd", decode=True)
    assert facts["voxels"] == [5, 4, 3] and facts["range"] == [VALUES.min(), VALUES.max()]
    assert facts["voxel_size"] == pytest.approx([5e-4, 7.5e-4, 2e-3])
    (tmp_path / "without_suffix").write_bytes(nrrd())
    volumes = formats_of("volume")
    assert len({each.name for each in volumes}) == len(volumes)
