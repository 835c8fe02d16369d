"""Write → read gives the same numbers; a bad file is refused in one line."""

import struct
import zlib
from typing import Annotated, ClassVar

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.files import memory
from hagoromo.files.checks import inside
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.files.jpeg import read_jpeg
from hagoromo.files.png import read_png, write_png
from hagoromo.files.record import Count, Record, Vector, about, decode, one_of, read_json, read_toml, write_json
from hagoromo.files.table import read_table, write_table
from hagoromo.files.tiff import read_tiff
from hagoromo.files.whole import whole_file, whole_folder

RANDOM = np.random.default_rng(7)
READERS = {"exr": read_exr, "png": read_png, "csv": read_table, "json": read_json, "toml": read_toml}


def test_exr_reads_what_was_written(tmp_path):
    channels = {name: RANDOM.normal(size=(5, 7)).astype(np.float32) for name in ("R", "N.X", "alpha")}
    write_exr(tmp_path / "a.exr", channels, {"hagoromo": '{"τ": 1}', "colourSpace": "lin_rec709"})
    read, metadata = read_exr(tmp_path / "a.exr")
    assert sorted(read) == sorted(channels)
    for name, values in channels.items():
        np.testing.assert_array_equal(read[name], values)
    assert metadata["hagoromo"] == '{"τ": 1}' and metadata["colourSpace"] == "lin_rec709"


@pytest.mark.parametrize("shape", [(5, 7), (5, 7, 3), (5, 7, 4)])
@pytest.mark.parametrize("depth", [np.uint8, np.uint16])
def test_png_reads_what_was_written(tmp_path, shape, depth):
    image = RANDOM.integers(0, np.iinfo(depth).max, shape, dtype=depth, endpoint=True)
    write_png(tmp_path / "a.png", image)
    read = read_png(tmp_path / "a.png")
    assert read.dtype == depth
    np.testing.assert_array_equal(read, image)


def test_table_reads_what_was_written(tmp_path):
    columns = {"wavelength_nm": RANDOM.normal(size=5), "R": RANDOM.normal(size=5)}
    write_table(tmp_path / "a.csv", columns)
    read = read_table(tmp_path / "a.csv")
    assert list(read) == list(columns)
    for name, values in columns.items():
        np.testing.assert_array_equal(read[name], values)


def test_json_reads_what_was_written(tmp_path):
    record = {"name": "布", "values": [0.1, 2, None, True]}
    write_json(tmp_path / "a.json", record)
    assert read_json(tmp_path / "a.json") == record
    with pytest.raises(InputError, match="cannot be written"):
        write_json(tmp_path / "b.json", {"a": float("nan")})


@pytest.mark.parametrize("kind", READERS)
def test_a_missing_file_a_folder_and_noise_are_refused_in_one_line(tmp_path, kind):
    path = tmp_path / f"a.{kind}"
    for make in (lambda: None, path.mkdir, lambda: path.rmdir() or path.write_bytes(RANDOM.bytes(997))):
        make()
        with pytest.raises(InputError) as refused:
            READERS[kind](path)
        assert "\n" not in str(refused.value) and str(path) in str(refused.value)


@pytest.mark.parametrize("kind", ["exr", "png"])
def test_a_truncated_image_is_refused_wherever_it_is_cut(tmp_path, kind):
    image = RANDOM.integers(0, 255, (31, 37, 3), dtype=np.uint8)
    path = tmp_path / f"a.{kind}"
    if kind == "png":
        write_png(path, image)
    else:
        write_exr(path, {"R": image[..., 0], "G": image[..., 1]})
    whole = path.read_bytes()
    for share in (0.0, 0.003, 0.02, 0.1, 0.5, 0.9, 0.999):
        path.write_bytes(whole[: int(share * len(whole))])
        with pytest.raises(InputError):
            READERS[kind](path)


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("", "0 rows"),
        ("400,1\n500,2\n", "no header"),
        ("a,b\n", "1 rows"),
        ("a,b\n1,2\n3\n", "line 3 has 1 cells"),
        ("a,b\n1,x\n", "column b: 'x'"),
        ("a,b\n1,nan\n", "not a finite number"),
        ("a,a\n1,2\n", "its own name"),
    ],
)
def test_a_bad_table_is_refused(tmp_path, content, said):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(InputError, match=said):
        read_table(tmp_path / "a.csv")


@pytest.mark.parametrize("content", ['{"a": NaN}', '{"a": 1', "[" * 100_000])
def test_bad_json_is_refused(tmp_path, content):
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(InputError):
        read_json(tmp_path / "a.json")


def test_a_key_that_stands_twice_in_a_table_of_json_is_refused(tmp_path):
    """The last one held without a word; TOML refuses it, too. In different tables it is another key."""
    (tmp_path / "a.json").write_text('{"lamps": [{"iso": 1, "gain": 2, "gain": 3}], "iso": 4}')
    with pytest.raises(InputError, match=r"a.json states the key 'gain' twice in one table: keep one"):
        read_json(tmp_path / "a.json")
    (tmp_path / "a.json").write_text('{"lamps": [{"iso": 1}, {"iso": 2}], "iso": 4}')
    assert read_json(tmp_path / "a.json")["iso"] == 4


@pytest.mark.parametrize(("side", "said"), [(2**31 - 1, "1 to 1000000 a side"), (30_000, "too few for them")])
def test_a_png_that_promises_more_than_it_holds_is_refused_before_allocation(tmp_path, side, said):
    write_png(tmp_path / "a.png", np.zeros((5, 7), np.uint8))
    data = bytearray((tmp_path / "a.png").read_bytes())
    data[16:24] = struct.pack(">II", side, side)
    data[29:33] = struct.pack(">I", zlib.crc32(data[12:29]))
    (tmp_path / "a.png").write_bytes(data)
    with pytest.raises(InputError, match=said):
        read_png(tmp_path / "a.png")


class Sized(Record, frozen=True, kw_only=True):
    version_key = "format_version"
    newest_version = 2
    old_names: ClassVar = {"length": "size"}

    format_version: int = 1
    size: Annotated[float, about("edge [m]")]
    name: str = "box"
    kind: Annotated[str, one_of("plane", "sphere")] = "plane"
    place: Vector | None = None
    count: Count = 0


def test_a_record_checks_every_key():
    assert decode({"size": 2}, Sized, "f") == Sized(size=2.0, name="box", kind="plane")
    for record, said in [
        ({}, "lacks the key 'size'"),
        ({"size": 1, "sise": 2}, "unknown key 'sise': known are format_version, size, name, kind"),
        ({"size": "x"}, "f: size must be a finite number: given 'x'"),
        ({"size": float("inf")}, "finite number"),
        ({"size": True}, "finite number"),
        ({"size": 1, "kind": "cone"}, "one of plane, sphere"),
        ({"size": 10**400}, "finite number: given 1000"),
        ({"size": None}, "finite number: given None"),
        ({"size": 1, "place": [1, 2]}, "place must be a list of 3 finite numbers"),
        ({"size": 1, "place": [1, 2, float("nan")]}, "place.2. must be a finite number: given nan"),
        ({"size": 1, "place": [1, 2, True]}, "place must be a list of 3 finite numbers"),
        ({"size": 1, "count": 1.5}, "count must be a whole number, 0 or more: given 1.5"),
        ({"size": 1, "count": -(10**400)}, "count must be a whole number, 0 or more"),
        ([1], "must be a table"),
    ]:
        with pytest.raises(InputError, match=said) as refused:
            decode(record, Sized, "f")
        assert "\n" not in str(refused.value) and len(str(refused.value)) < 200


def test_old_names_and_versions_are_read_and_newer_versions_refused():
    assert decode({"length": 2}, Sized, "f").size == 2.0
    assert decode({"size": 2, "format_version": 2}, Sized, "f").format_version == 2
    with pytest.raises(InputError, match="'size' twice"):
        decode({"length": 2, "size": 2}, Sized, "f")
    with pytest.raises(InputError, match="format version 3: this package reads up to 2, update Hagoromo"):
        decode({"size": 2, "format_version": 3, "unheard_of": 1}, Sized, "f")


def test_paths_in_files_stay_in_the_folder(tmp_path):
    assert inside(tmp_path, "./a/../b.png") == tmp_path / "b.png"
    for relative in ("../b.png", "/etc/passwd", "a/../../b", ".."):
        with pytest.raises(InputError, match="points outside"):
            inside(tmp_path, relative)


@pytest.mark.parametrize("failure", [RuntimeError, KeyboardInterrupt])
def test_a_failed_write_leaves_what_was_there(tmp_path, failure):
    (tmp_path / "old.txt").write_text("old")
    with whole_folder(tmp_path / "old") as folder:
        (folder / "a").write_text("old")
    before = sorted(tmp_path.rglob("*"))
    for name in ("new", "old"):
        with pytest.raises(failure), whole_file(tmp_path / f"{name}.txt", force=True) as path:
            path.write_text("half")
            raise failure
        with pytest.raises(failure), whole_folder(tmp_path / name, force=True) as path:
            (path / "a").write_text("half")
            raise failure
    assert sorted(tmp_path.rglob("*")) == before
    assert (tmp_path / "old.txt").read_text() == (tmp_path / "old" / "a").read_text() == "old"


def test_an_existing_output_is_replaced_with_force_only(tmp_path):
    for content, force in (("one", False), ("two", True)):
        with whole_file(tmp_path / "a" / "b.txt", force) as path:
            path.write_text(content)
        with whole_folder(tmp_path / "c", force) as folder:
            (folder / content).touch()
    assert (tmp_path / "a" / "b.txt").read_text() == "two"
    assert [p.name for p in (tmp_path / "c").iterdir() if not p.name.startswith(".")] == ["two"]
    for output in (whole_file(tmp_path / "a" / "b.txt"), whole_folder(tmp_path / "c")):
        with pytest.raises(InputError, match="--force"), output:
            pass


def test_a_folder_of_other_files_is_never_replaced(tmp_path):
    (tmp_path / "photos").mkdir()
    (tmp_path / "photos" / "a.jpg").touch()
    with pytest.raises(InputError, match="did not write"), whole_folder(tmp_path / "photos", force=True):
        pass
    assert (tmp_path / "photos" / "a.jpg").exists()


def exr_of_window(path, last: int, other: int) -> None:
    """An EXR of two parts; the header of the second says that its last pixel is (last, other)."""
    import OpenEXR

    window = (np.zeros(2, np.int32), np.full(2, 3, np.int32))
    header = {"compression": OpenEXR.ZIP_COMPRESSION, "type": OpenEXR.scanlineimage, "displayWindow": window}
    parts = [OpenEXR.Part(dict(header), {"R": np.zeros((4, 4), np.float32)}, name) for name in ("a", "b")]
    with OpenEXR.File(parts) as file:
        file.write(str(path))
    data = path.read_bytes()
    place = data.rindex(b"dataWindow\0box2i\0") + len(b"dataWindow\0box2i\0") + 4
    path.write_bytes(data[:place] + struct.pack("<iiii", 0, 0, last, other) + data[place + 16 :])


@pytest.mark.parametrize("last", [(2**20, 2**20), (2**29, 40), (40, 2**29)])
def test_an_exr_of_which_any_part_promises_more_than_memory_is_refused_before_allocation(tmp_path, last):
    exr_of_window(tmp_path / "a.exr", 3, 3)
    assert read_exr(tmp_path / "a.exr")[0]["R"].shape == (4, 4)
    exr_of_window(tmp_path / "a.exr", *last)
    with pytest.raises(InputError, match=r"GiB of memory|too few for them"):
        read_exr(tmp_path / "a.exr")


def test_the_memory_of_a_picture_follows_its_depth_and_kind(tmp_path, monkeypatch):
    image = np.zeros((100, 100, 4), np.uint16)
    write_png(tmp_path / "a.png", image)
    monkeypatch.setattr(memory, "free_memory", lambda: 2.1 * image.nbytes)  # two copies fit in nine tenths, or not
    with pytest.raises(InputError, match=r"GiB of memory|too few for them"):
        read_png(tmp_path / "a.png")
    monkeypatch.setattr(memory, "free_memory", lambda: 2.3 * image.nbytes)
    assert read_png(tmp_path / "a.png").shape == image.shape


def test_a_progressive_jpeg_needs_room_for_its_coefficients_too(tmp_path, monkeypatch):
    import cv2

    for name, progressive in (("a.jpg", 0), ("b.jpg", 1)):
        encoded = cv2.imencode(".jpg", np.zeros((100, 100, 3), np.uint8), [cv2.IMWRITE_JPEG_PROGRESSIVE, progressive])[
            1
        ]
        (tmp_path / name).write_bytes(encoded.tobytes())
    monkeypatch.setattr(memory, "free_memory", lambda: 9 * 100 * 100)
    assert read_jpeg(tmp_path / "a.jpg").shape == (100, 100, 3)
    with pytest.raises(InputError, match=r"GiB of memory|too few for them"):
        read_jpeg(tmp_path / "b.jpg")


def test_a_tiff_with_fewer_bytes_than_pixels_is_refused_before_allocation(tmp_path):
    import tifffile

    tifffile.imwrite(tmp_path / "a.tif", np.zeros((64, 64), np.uint8))
    data = bytearray((tmp_path / "a.tif").read_bytes())
    with tifffile.TiffFile(tmp_path / "a.tif") as file:
        places = [file.pages.first.tags[name].valueoffset for name in ("ImageWidth", "ImageLength")]
    for place in places:
        struct.pack_into("<H", data, place, 4096)
    (tmp_path / "a.tif").write_bytes(data)
    with pytest.raises(InputError, match="is cut off"):
        read_tiff(tmp_path / "a.tif")


def test_a_table_of_very_many_columns_is_refused(tmp_path):
    (tmp_path / "a.csv").write_text(",".join(f"c{k}" for k in range(5000)) + "\n" + ",".join("1" for _ in range(5000)))
    with pytest.raises(InputError, match="5000 columns"):
        read_table(tmp_path / "a.csv")
