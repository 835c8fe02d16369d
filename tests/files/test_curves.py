"""Curves of hair and lines are read as other programs write them: positions, thickness, places; damage is told."""

import base64
import json
import struct
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo_formats.curves.curve_file import read_curves

POINTS = np.random.default_rng(7).normal(size=(9, 3)).astype(np.float32)
COUNTS = (2, 4, 3)
FIRST = [0, 2, 6, 9]


def hair(path: Path, **change) -> None:
    """As the format's page describes it: head, segments, points, thickness, transparency, colour."""
    values: dict[str, Any] = {
        "hairs": 3,
        "points": 9,
        "bits": 0b11111,
        "segments": np.array(COUNTS, "<u2") - 1,
    } | change
    head = b"HAIR" + struct.pack("<4I5f", values["hairs"], values["points"], values["bits"], 0, 0.5, 0, 1, 1, 1)
    wide = np.linspace(0.1, 0.9, 9).astype("<f4")
    arrays = [values["segments"], POINTS, wide, np.zeros(9, "<f4"), np.ones((9, 3), "<f4")]
    body = b"".join(array.tobytes() for bit, array in enumerate(arrays) if values["bits"] >> bit & 1)
    path.write_bytes(head.ljust(128, b"\0") + body)


def test_a_hair_file_has_its_points_and_thickness(tmp_path):
    hair(tmp_path / "a.hair")
    lines = read_curves(tmp_path / "a.hair")
    np.testing.assert_array_equal(lines.points, POINTS)
    np.testing.assert_array_equal(lines.first, FIRST)
    assert lines.diameter is not None
    np.testing.assert_allclose(lines.diameter, np.linspace(0.1, 0.9, 9), rtol=1e-6)


def test_a_hair_file_without_arrays_has_what_its_head_says(tmp_path):
    """Three hairs of two segments each, 0.5 thick."""
    hair(tmp_path / "a.hair", bits=0b10)
    data = bytearray((tmp_path / "a.hair").read_bytes())
    data[16:20] = struct.pack("<I", 2)
    (tmp_path / "a.hair").write_bytes(data)
    lines = read_curves(tmp_path / "a.hair")
    np.testing.assert_array_equal(lines.first, [0, 3, 6, 9])
    np.testing.assert_array_equal(lines.diameter, 0.5)


def test_lines_of_obj_go_on_where_they_end(tmp_path):
    """Blender writes a curve as segments; others as one line; a number below 0 counts from the end."""
    rows = [f"v {x} {y} {z}" for x, y, z in POINTS.tolist()]
    rows += ["l 1 2", "l 3 4", "l 4 5", "l 5 6", "l -3/1 -2/2 -1"]
    (tmp_path / "a.obj").write_text("\n".join(rows))
    lines = read_curves(tmp_path / "a.obj")
    np.testing.assert_array_equal(lines.first, FIRST)
    np.testing.assert_allclose(lines.points, POINTS, rtol=1e-6)
    assert lines.diameter is None


def lines_of_gltf(kind, mode, numbers=None, **more):
    """POINTS as a primitive of a mesh of one node, twice as large and moved; numbers: its indices, of 16 bits."""
    binary = b"" if numbers is None else np.array(numbers, "<u2").tobytes()
    binary += b"\0" * (-len(binary) % 4)
    start = len(binary)
    binary += POINTS.astype("<f4").tobytes()
    part = {"mode": mode, "attributes": {"POSITION": 0}} | ({} if numbers is None else {"indices": 1})
    record: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(binary)}],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": POINTS.nbytes},
            {"buffer": 0, "byteLength": max(start, 1)},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": len(POINTS), "type": "VEC3"},
            {"bufferView": 1, "componentType": 5123, "count": len(numbers or ()), "type": "SCALAR"},
        ],
        "meshes": [{"primitives": [part]}],
        "nodes": [{"mesh": 0, "scale": [2.0, 2.0, 2.0], "translation": [1.0, 2.0, 3.0]}],
        **more,
    }
    if kind == "gltf":
        record["buffers"][0]["uri"] = "data:application/octet-stream;base64," + base64.b64encode(binary).decode()
        return json.dumps(record).encode()
    text = json.dumps(record).encode()
    text += b" " * (-len(text) % 4)
    head = struct.pack("<4sIIII", b"glTF", 2, 28 + len(text) + len(binary), len(text), 0x4E4F534A)
    return head + text + struct.pack("<II", len(binary), 0x004E4942) + binary


@pytest.mark.parametrize("kind", ["glb", "gltf"])
@pytest.mark.parametrize(
    ("mode", "numbers", "chains"),
    [
        (3, None, [range(9)]),
        (2, None, [[*range(9), 0]]),
        (1, [0, 1, 1, 2, 2, 3, 5, 6, 6, 8], [[0, 1, 2, 3], [5, 6, 8]]),
        (3, [8, 7, 2], [[8, 7, 2]]),
    ],
)
def test_lines_of_gltf_stand_at_their_nodes(tmp_path, kind, mode, numbers, chains):
    path = tmp_path / f"a.{kind}"
    path.write_bytes(lines_of_gltf(kind, mode, numbers))
    lines = read_curves(path)
    np.testing.assert_array_equal(lines.first, np.cumsum([0, *(len(chain) for chain in chains)]))
    expected = 2.0 * POINTS[[k for chain in chains for k in chain]] + np.array([1.0, 2.0, 3.0])
    np.testing.assert_allclose(lines.points, expected, rtol=1e-6, atol=1e-6)
    assert lines.diameter is None


@pytest.mark.parametrize(
    ("mode", "numbers", "more", "said"),
    [
        (4, None, {}, "has no lines"),
        (3, [0, 9], {}, "name point 9 of 9"),
        (
            3,
            None,
            {"accessors": [{"bufferView": 0, "componentType": 5126, "count": 10, "type": "VEC3"}]},
            "does not hold them",
        ),
        (3, None, {"nodes": [{"mesh": 0, "children": [0]}]}, "within themselves"),
        (3, None, {"buffers": [{"byteLength": 200, "uri": "../a.bin"}]}, "outside"),
    ],
)
def test_lines_of_gltf_that_are_none_are_refused(tmp_path, mode, numbers, more, said):
    (tmp_path / "a.glb").write_bytes(lines_of_gltf("glb", mode, numbers, **more))
    with pytest.raises(InputError, match=said) as refused:
        read_curves(tmp_path / "a.glb")
    assert "\n" not in str(refused.value)


USD = """#usda 1.0
def Xform "head" {{
    double3 xformOp:translate = (1, 2, 3)
    double3 xformOp:scale = (2, 2, 2)
    uniform token[] xformOpOrder = ["xformOp:translate", "xformOp:scale"]
    def BasisCurves "hair" {{
        uniform token type = "{kind}"
        uniform token basis = "{basis}"
        uniform token wrap = "{wrap}"
        int[] curveVertexCounts = [4, 4]
        point3f[] points = [(0,0,0),(1,0,0),(2,0,0),(3,0,0),(0,1,0),(1,1,1),(2,1,8),(3,1,27)]
        float[] widths = [0.25] (interpolation = "constant")
    }}
}}
"""


@pytest.mark.parametrize(
    ("kind", "basis", "wrap", "ends"),
    [("linear", "bezier", "nonperiodic", [(0, 0, 0), (3, 0, 0)]),
     ("cubic", "bezier", "nonperiodic", [(0, 0, 0), (3, 0, 0)]),
     ("cubic", "bspline", "nonperiodic", [(1, 0, 0), (2, 0, 0)]),
     ("cubic", "bspline", "pinned", [(0, 0, 0), (3, 0, 0)]),
     ("cubic", "catmullRom", "pinned", [(0, 0, 0), (3, 0, 0)])],
)  # fmt: skip
def test_curves_of_usd_are_evaluated_at_their_places(tmp_path, kind, basis, wrap, ends):
    """A straight curve stays straight and begins and ends where its basis says; widths grow with the place."""
    pytest.importorskip("pxr", reason="needs usd-core: pip install 'hagoromo[usd]'")
    (tmp_path / "a.usda").write_text(USD.format(kind=kind, basis=basis, wrap=wrap))
    lines = read_curves(tmp_path / "a.usda")
    one = lines.points[: lines.first[1]]
    np.testing.assert_allclose(one[[0, -1]], 2.0 * np.array(ends) + [1, 2, 3], atol=1e-12)
    np.testing.assert_allclose(one[:, 1:], [[2.0, 3.0]] * len(one), atol=1e-12)
    assert lines.diameter is not None
    np.testing.assert_allclose(lines.diameter, 0.5)
    if basis == "catmullRom":  # of a cubic through its points: (2, 1, 8) is one of them
        assert (np.abs(lines.points - (5.0, 4.0, 19.0)).max(axis=1) < 1e-12).any()


@pytest.mark.parametrize(
    ("change", "said"),
    [({"hairs": 2**31}, "cut off"), ({"points": 2**32 - 1}, "cut off"), ({"bits": 1}, "cut off"),
     ({"segments": np.array([9, 9, 9], "<u2")}, "damaged"), ({"segments": np.zeros(3, "<u2")}, "no curves")],
)  # fmt: skip
def test_a_damaged_hair_file_is_refused(tmp_path, change, said):
    hair(tmp_path / "a.hair", **change)
    with pytest.raises(InputError, match=said):
        read_curves(tmp_path / "a.hair")


@pytest.mark.parametrize(
    ("text", "said"),
    [("v 0 0 0\nl 1 2\n", "names vertex"), ("v 0 0 0\nv 1 nan 0\nl 1 2\n", "not finite"), ("v 0 0\nl 1 1", "cannot"),
     ("v 0 0 0\nf 1 1 1\n", "no curves")],
)  # fmt: skip
def test_a_damaged_obj_is_refused(tmp_path, text, said):
    (tmp_path / "a.obj").write_text(text)
    with pytest.raises(InputError, match=said):
        read_curves(tmp_path / "a.obj")


def test_other_formats_are_refused_with_what_is_read(tmp_path):
    (tmp_path / "a.dxf").write_bytes(b"0")
    with pytest.raises(InputError, match=r"\.hair, \.obj, \.abc, \.glb, \.gltf, \.usd"):
        read_curves(tmp_path / "a.dxf")


def test_curves_that_blender_wrote_as_alembic_are_read(tmp_path):
    """Blender wrote h.abc: hair of 3 and 4 points, moved by (1, 2, 3), as linear curves, y up; and a polyline."""
    pytest.importorskip("alembic3d", reason="needs alembic3d: pip install 'hagoromo[alembic]'")
    with zipfile.ZipFile(Path(__file__).parent / "blender_samples.zip") as held:
        (tmp_path / "h.abc").write_bytes(held.read("h.abc"))
    lines = read_curves(tmp_path / "h.abc")
    hair = np.array([(0, 0, 0), (0, 0, 1), (0.5, 0, 2), (1, 0, 0), (1, 0, 1), (1, 1, 2), (1, 1, 3)])
    hair = hair + np.array([1, 2, 3])
    ours = np.concatenate([hair, [(0, 0, 0), (1, 1, 1), (2, 1, 1)]])
    found = lines.points[:, [0, 2, 1]] * (1, -1, 1)  # z up
    np.testing.assert_allclose(found, ours, atol=1e-6)
    np.testing.assert_array_equal(lines.first, [0, 3, 7, 10])
    assert lines.diameter is not None
    np.testing.assert_allclose(lines.diameter, [*(0.02 * np.arange(1, 8)), 2, 2, 2], rtol=1e-6)


@pytest.mark.parametrize("how", ["sublayer", "reference", "payload"])
def test_a_usd_file_that_names_other_files_is_refused(tmp_path, how):
    """They could lie anywhere; the one named here would be read."""
    pytest.importorskip("pxr", reason="needs usd-core: pip install 'hagoromo[usd]'")
    curves = USD.format(kind="linear", basis="bezier", wrap="nonperiodic")
    (tmp_path / "other.usda").write_text(curves)
    text = {
        "sublayer": "#usda 1.0\n(\n    subLayers = [@./other.usda@]\n)\n",
        "reference": '#usda 1.0\ndef "a" (references = @./other.usda@</a>) {}\n',
        "payload": '#usda 1.0\ndef "a" (payload = @./other.usda@</a>) {}\n',
    }[how]
    (tmp_path / "a.usda").write_text(text)
    with pytest.raises(InputError, match="names other files"):
        read_curves(tmp_path / "a.usda")
