"""Exported files are read back by decoders that share no line with the product, and relit pixels are compared."""

import json
import struct
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.files.png import read_png
from hagoromo.light.colour import srgb_decode
from hagoromo_formats.relightable import export as export_module
from hagoromo_formats.relightable.rti import hsh_basis, write_ptm
from hagoromo_page.publication.lit import hemisphere, reflected, shown, white_level
from hagoromo_page.publication.surface_maps import surface_maps
from tests.app.published_ball import ball, radiance

ALL = ("png", "tiff", "exr", "glb", "ply", "ptm", "hsh", "relight", "materialx")


@pytest.fixture(scope="module")
def exported(tmp_path_factory):
    """The ball's maps, the folder of all formats, and the record."""
    out = tmp_path_factory.mktemp("export") / "out"
    capture, measured = ball()
    record = hg.export(measured, ALL, out)
    return capture, measured, surface_maps(measured, capture.photographs[0].camera, "ball", True), out, record


def test_the_pictures_that_formats_are_fitted_to_are_those_of_the_reflectance(exported):
    """Oracle: the written-out formula in float64. Tolerance: single precision."""
    capture, measured, maps, *_ = exported
    direction = np.array([0.4, 0.3, np.sqrt(0.75)])
    body, interface, _ = radiance(capture, measured, direction)
    part = np.s_[int(maps.y) : int(maps.y) + maps.labels.shape[0], int(maps.x) : int(maps.x) + maps.labels.shape[1]]
    colours = np.array([material.interface_colour for material in measured.materials])[np.maximum(measured.labels, 0)]
    gloss = interface if interface.shape[2] == 3 else interface * colours
    exact = (body + gloss)[part]
    np.testing.assert_allclose(reflected(maps, direction)[maps.known], exact[maps.known], rtol=2e-3, atol=2e-4)


def ptm_pixels(path, u, v):
    """HP's PTM format 1.2, LRGB: six lines, six coefficients per pixel, then colours; rows from the bottom."""
    data = path.read_bytes()
    lines, place = [], 0
    while len(lines) < 6:
        end = data.index(b"\n", place)
        lines.append(data[place:end].decode())
        place = end + 1
    assert lines[:2] == ["PTM_1.2", "PTM_FORMAT_LRGB"]
    width, height = int(lines[2]), int(lines[3])
    scale, bias = [float(x) for x in lines[4].split()], [int(x) for x in lines[5].split()]
    image = np.zeros((height, width, 3))
    colours = place + 6 * width * height
    assert len(data) == colours + 3 * width * height
    powers = (u * u, v * v, u * v, u, v, 1.0)
    for row in range(height):
        for column in range(width):
            pixel = row * width + column
            raw = data[place + 6 * pixel : place + 6 * pixel + 6]
            light = sum((r - b) * s * p for r, b, s, p in zip(raw, bias, scale, powers, strict=True)) / 255.0
            for channel in range(3):
                image[height - 1 - row, column, channel] = light * data[colours + 3 * pixel + channel] / 255.0
    return np.clip(image, 0.0, 1.0)


LOWEST = 0.15  # rad above the plane: OpenLIME turns no lamp lower


def harmonics(x, y, z):
    """Nine hemispherical harmonics as RTIViewer (hsh.cpp) and OpenLIME (ShaderRTI.js) list them."""
    phi, c = np.arctan2(y, x), np.cos(min(np.arccos(z), np.pi / 2 - LOWEST))
    r = np.sqrt(max(c - c * c, 0.0))
    return np.array([
        1 / np.sqrt(2 * np.pi), np.sqrt(6 / np.pi) * np.cos(phi) * r, np.sqrt(3 / (2 * np.pi)) * (-1 + 2 * c),
        np.sqrt(6 / np.pi) * r * np.sin(phi), np.sqrt(30 / np.pi) * np.cos(2 * phi) * (-c + c * c),
        np.sqrt(30 / np.pi) * np.cos(phi) * (-1 + 2 * c) * r, np.sqrt(5 / (2 * np.pi)) * (1 - 6 * c + 6 * c * c),
        np.sqrt(30 / np.pi) * (-1 + 2 * c) * r * np.sin(phi), np.sqrt(30 / np.pi) * (-c + c * c) * np.sin(2 * phi),
    ])  # fmt: skip


def hsh_pixels(path, direction):
    """As RTIViewer reads .rti: of a pixel all terms of red, then of green, then of blue, from the top row."""
    data = path.read_bytes()
    head, rest = data.split(b"\n", 4)[:4], data.split(b"\n", 4)[4]
    width, height, channels = map(int, head[2].split())
    terms = int(head[3].split()[0])
    assert head[0] == b"#HSH1.2" and head[1] == b"3" and channels == 3 and terms == 9
    numbers = struct.unpack(f"<{2 * terms}f", rest[: 8 * terms])
    codes = np.frombuffer(rest[8 * terms :], np.uint8).reshape(height, width, 3, terms)
    values = codes / 255.0 * np.array(numbers[:terms]) + np.array(numbers[terms:])
    return np.clip(values @ harmonics(*direction), 0.0, 1.0)


def relight_pixels(folder, direction):
    """OpenLIME's shader: Σ_j base_j (plane_j − bias_j) scale_j, planes of 0…1."""
    from PIL import Image

    info = json.loads((folder / "info.json").read_text())
    assert info["type"] == "hsh" and info["colorspace"] == "rgb" and info["nplanes"] == 27
    scale, bias = (np.array(info["materials"][0][key]).reshape(9, 3) for key in ("scale", "bias"))
    image = 0.0
    for number, weight in enumerate(harmonics(*direction)):
        plane = np.asarray(Image.open(folder / f"plane_{number}.jpg"), float) / 255.0
        image = image + weight * (plane - bias[number]) * scale[number]
    return np.clip(image, 0.0, 1.0)


def test_relightable_images_are_near_the_reflectance_and_state_how_near(exported):
    """Oracle: decoders above. Their error is that of the record, but for 8 bits of the coefficients and JPEG: 2 %."""
    _, _, maps, out, record = exported
    white, off = white_level(maps), {"ptm": [], "hsh": [], "relight": []}
    for direction in hemisphere(12, 0.25)[::4]:
        truth = shown(reflected(maps, direction), white)[maps.known]
        seen = {
            "ptm": ptm_pixels(out / "object.ptm", direction[0], direction[1]),
            "hsh": hsh_pixels(out / "object.rti", direction),
            "relight": relight_pixels(out / "relight", direction),
        }
        for name, image in seen.items():
            off[name].append(np.mean((image[maps.known] - truth) ** 2))
    for name, squares in off.items():
        stated = record["formats"][name].get("rms_error_before_quantisation")
        assert np.sqrt(np.mean(squares)) < stated + 0.03, (name, np.sqrt(np.mean(squares)), stated)
        assert stated < 0.12, (name, stated)


def test_a_matte_polynomial_survives_the_file(tmp_path):
    """Pictures that are a PTM come back to the steps of 8 bits, the right way up."""
    random = np.random.default_rng(0)
    directions, tint = hemisphere(20), random.uniform(0.4, 1.0, (5, 7, 3))
    tint /= tint.max(axis=2, keepdims=True)
    slope = random.uniform(-0.2, 0.2, (5, 7, 2))
    pictures = [(0.6 + slope @ d[:2])[..., None] * tint for d in directions]
    write_ptm(tmp_path / "a.ptm", pictures, directions)
    for k in (3, 11):
        again = ptm_pixels(tmp_path / "a.ptm", *directions[k, :2])
        np.testing.assert_allclose(again, pictures[k], atol=0.012)
    np.testing.assert_allclose(hsh_basis(directions)[4], harmonics(*directions[4]), atol=1e-12)


def gltf(path):
    """glTF 2.0 binary by its specification: the primitive's arrays by name, its material, and the texture's bytes."""
    data = path.read_bytes()
    magic, version, length = struct.unpack("<4sII", data[:12])
    size, kind = struct.unpack("<I4s", data[12:20])
    assert (magic, version, length, kind) == (b"glTF", 2, len(data), b"JSON")
    record, rest = json.loads(data[20 : 20 + size]), data[20 + size :]
    assert rest[4:8] == b"BIN\0" and struct.unpack("<I", rest[:4])[0] == len(rest) - 8

    def view(number):
        place = record["bufferViews"][number]
        start = 8 + place.get("byteOffset", 0)
        return rest[start : start + place["byteLength"]]

    (primitive,) = record["meshes"][0]["primitives"]
    arrays = {}
    for name, number in {**primitive["attributes"], "faces": primitive["indices"]}.items():
        accessor = record["accessors"][number]
        columns = {"SCALAR": 1, "VEC2": 2, "VEC3": 3}[accessor["type"]]
        kind = {5123: "<u2", 5125: "<u4", 5126: "<f4"}[accessor["componentType"]]
        values = np.frombuffer(view(accessor["bufferView"]), kind, accessor["count"] * columns)
        arrays[name] = values.reshape(-1, columns)
        if name == "POSITION":  # the specification demands them
            np.testing.assert_allclose([accessor["min"], accessor["max"]], [values.reshape(-1, 3).min(0),
                                       values.reshape(-1, 3).max(0)], rtol=1e-6)  # fmt: skip
    material = record["materials"][primitive["material"]]["pbrMetallicRoughness"]
    image = record["images"][record["textures"][material["baseColorTexture"]["index"]]["source"]]
    return arrays, material, view(image["bufferView"])


def test_a_glb_is_gltf_2_with_its_texture_the_right_way_up(exported):
    """Coordinates of glTF count from the top left corner of the texture."""
    import io

    from PIL import Image

    _, _, maps, out, _ = exported
    arrays, material, texture = gltf(out / "object.glb")
    known = maps.known
    rows, columns = np.nonzero(known)
    expected = np.stack([(columns + 0.5) / known.shape[1], (rows + 0.5) / known.shape[0]], axis=1)
    np.testing.assert_allclose(arrays["TEXCOORD_0"], expected, atol=1e-5)
    np.testing.assert_allclose(arrays["NORMAL"], maps.normals[known], atol=1e-5)
    np.testing.assert_allclose(-arrays["POSITION"][:, 2], maps.depth[known], rtol=1e-5)
    assert arrays["faces"].max() == known.sum() - 1 and material["metallicFactor"] == 0.0
    picture = np.asarray(Image.open(io.BytesIO(texture)).convert("RGB"))
    wanted = 255.0 * shown(np.pi * maps.body, 1.0)
    assert picture.shape[:2] == known.shape and np.abs(picture - wanted)[known].max() <= 0.51


def test_vtk_reads_the_mesh_and_the_png(exported):
    """VTK wrote neither of them. It comes with the extra of the benchmarks."""
    reason = "VTK is not installed: pip install hagoromo[bench]"
    gltf_reader = pytest.importorskip("vtkmodules.vtkIOGeometry", reason=reason).vtkGLTFReader()
    png = pytest.importorskip("vtkmodules.vtkIOImage", reason=reason).vtkPNGReader()
    vtk_to_numpy = pytest.importorskip("vtkmodules.util.numpy_support", reason=reason).vtk_to_numpy
    _, _, maps, out, _ = exported
    gltf_reader.SetFileName(str(out / "object.glb"))
    gltf_reader.Update()
    assert gltf_reader.GetOutput().GetBlock(0).GetBlock(0).GetNumberOfPoints() == maps.known.sum()
    png.SetFileName(str(out / "normals.png"))
    png.Update()
    scalars = vtk_to_numpy(png.GetOutput().GetPointData().GetScalars())
    pixels = scalars.reshape(*maps.labels.shape, 3)[::-1]  # VTK: from the bottom
    assert (pixels == hg.read_png(out / "normals.png")).all()


def test_other_libraries_read_what_was_written(exported):
    """OpenCV reads the TIFF, Mitsuba the PNG and the EXR: neither of them wrote its file."""
    import cv2
    import mitsuba

    _, _, maps, out, _ = exported
    known, shape = maps.known, maps.labels.shape
    if mitsuba.variant() is None:
        mitsuba.set_variant("scalar_rgb")
    pixels = np.array(mitsuba.Bitmap(str(out / "normals.png")))
    assert pixels.dtype == np.uint16 and (pixels == hg.read_png(out / "normals.png")).all()
    tiff = cv2.imread(str(out / "normals.tiff"), cv2.IMREAD_UNCHANGED)
    assert tiff is not None and (tiff[..., ::-1] == pixels).all()
    depth = cv2.imread(str(out / "depth.tiff"), cv2.IMREAD_UNCHANGED)
    assert depth is not None and depth.dtype == np.uint16 and depth.shape == shape
    bitmap = mitsuba.Bitmap(str(out / "planes.exr"))
    layers = dict(zip([field.name for field in bitmap.struct_()], np.moveaxis(np.array(bitmap), 2, 0), strict=True))
    np.testing.assert_allclose(layers["Z"][known], maps.depth[known], rtol=1e-6)
    np.testing.assert_allclose(layers["N.X"][known], maps.normals[known][:, 0], atol=1e-6)


def test_planes_and_meshes_hold_the_maps(exported):
    import tifffile
    import trimesh

    _, _, maps, out, _ = exported
    known = maps.known
    for normals in (hg.read_png(out / "normals.png"), tifffile.imread(out / "normals.tiff")):
        assert normals.dtype == np.uint16
        np.testing.assert_allclose(normals[known] / 65535.0 * 2.0 - 1.0, maps.normals[known], atol=2e-5)
    layers, _ = hg.read_exr(out / "planes.exr")
    np.testing.assert_allclose(layers["Z"][known], maps.depth[known], rtol=1e-6)
    np.testing.assert_allclose(layers["R"][known], np.pi * maps.body[known][:, 0], rtol=1e-6)
    near = json.loads((out / "depth.json").read_text())
    depth = hg.read_png(out / "depth.png")[known] / 65535.0 * (near["far_m"] - near["near_m"]) + near["near_m"]
    np.testing.assert_allclose(depth, maps.depth[known], atol=1e-4 * (near["far_m"] - near["near_m"]))
    for name in ("object.glb", "object.ply"):
        mesh: Any = trimesh.load(out / name, force="mesh", process=False)
        assert len(mesh.vertices) == known.sum() and len(mesh.faces) > known.sum()
        np.testing.assert_allclose(-np.asarray(mesh.vertices)[:, 2], maps.depth[known], rtol=1e-5)
        facing = np.sum(mesh.face_normals * maps.normals[known][mesh.faces[:, 0]], axis=1)
        assert np.median(facing) > 0.95  # faces turn to the eye as the measured normals do
    textured: Any = trimesh.load(out / "object.glb", force="mesh", process=False)
    uv = textured.visual.uv
    columns = np.nonzero(known)[1]
    np.testing.assert_allclose(uv[:, 0] * known.shape[1] - 0.5, columns, atol=1e-3)


def test_colours_beyond_1_keep_their_ratios_in_formats_that_hold_0_to_1(exported, tmp_path):
    """Lamps of unknown strength: the ball five times as bright is the same picture, and the record says the factor."""
    _, measured, maps, out, record = exported
    assert "colours_times" not in record["formats"]["png"], "of colours within 0…1"
    body = replace(measured.body, value=5.0 * measured.body.value)
    bright = replace(measured, body=body, materials=tuple(one.times(5.0) for one in measured.materials))
    brighter = hg.export(bright, ("png", "openpbr", "exr"), tmp_path / "out")
    white = 5.0 * white_level(maps)
    assert white > 1.0 and brighter["formats"]["png"]["colours_times"] == pytest.approx(1.0 / white, rel=1e-6)
    assert "colours_times" not in brighter["formats"]["exr"], "floats are as measured"
    albedo, plain = (read_png(one / "albedo.png") / 65535.0 for one in (tmp_path / "out", out))
    linear, expected = srgb_decode(albedo), srgb_decode(plain) / white_level(maps)
    np.testing.assert_allclose(linear, np.clip(expected, 0.0, 1.0), atol=1e-4)
    assert (albedo[maps.known] >= 1.0).any(axis=1).mean() < 0.02
    # the nearest OpenPBR is that of the reflectance times the factor: nothing of it is cut off
    off = brighter["formats"]["openpbr"]["relative_difference"]
    plainly = hg.export(measured, ("openpbr",), tmp_path / "plain")["formats"]["openpbr"]["relative_difference"]
    assert all(np.allclose(off[name], plainly[name], atol=0.02) for name in plainly)


def test_materialx_reads_its_own_document(exported):
    mx = pytest.importorskip("MaterialX")
    _, measured, _, out, _ = exported
    document = mx.createDocument()
    mx.readFromXmlFile(document, str(out / "materials.mtlx"))
    valid, message = document.validate()
    assert valid, message
    shaders = [node for node in document.getNodes() if node.getCategory() == "standard_surface"]
    assert len(shaders) == len(measured.materials) == len(document.getMaterialNodes())
    assert shaders[0].getInputValue("specular_IOR") == pytest.approx(measured.materials[0].n, rel=1e-4)
    assert "GGX" in shaders[0].getAttribute("doc")


def test_the_verb_writes_all_or_nothing_and_says_what_is_lost(tmp_path, capsys):
    _, measured = ball()
    measured.save(tmp_path / "measured")
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "measured"), "--to", "vrml", "--out", str(out)]) == 2
    assert "no format is called vrml" in capsys.readouterr().err and not out.exists()
    assert main(["export", str(tmp_path / "measured"), "--to", "csv", "--out", str(out)]) == 2
    assert "has no spectra" in capsys.readouterr().err and not out.exists()
    assert main(["export", str(tmp_path / "measured"), "--to", "ply", "materialx", "--out", str(out)]) == 0
    assert "holes" in capsys.readouterr().out
    assert {path.name for path in out.iterdir()} >= {"object.ply", "materials.mtlx", "export.json"}
    assert json.loads((out / "export.json").read_text())["lengths"] == "m"
    assert main(["export", str(tmp_path / "measured"), "--to", "ply", "--out", str(out)]) == 2
    assert main(["export", str(tmp_path / "measured"), "--to", "ply", "--out", str(out), "--force"]) == 0


def test_a_format_that_cannot_be_written_does_not_keep_others_from_it(tmp_path, capsys):
    """Each is one line on standard error and in the record; the others are whole; the exit status says so."""
    _, measured = ball()
    flat = replace(measured, points=None)
    flat.save(tmp_path / "measured")
    out = tmp_path / "out"
    given = ["export", str(tmp_path / "measured"), "--to", "csv", "materialx", "ply", "vrml", "--out", str(out)]
    assert main(given) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert [line.split(": ")[2] for line in said] == ["csv", "ply", "no format is called vrml"]
    assert {path.name for path in out.glob("[a-z]*")} == {"materials.mtlx", "export.json"}
    record = json.loads((out / "export.json").read_text())
    assert set(record["formats"]) == {"materialx"} and set(record["refused"]) == {"csv", "ply", "vrml"}


def test_rti_stands_for_both_files_that_programs_for_rti_open(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(export_module, "LAMPS", 9)
    monkeypatch.setattr(export_module, "TESTED", 2)
    _, measured = ball()
    measured.save(tmp_path / "measured")
    out = tmp_path / "out"
    assert main(["export", str(tmp_path / "measured"), "--to", "rti", "hsh", "--out", str(out)]) == 0
    assert {path.name for path in out.glob("[a-z]*")} == {"object.rti", "object.ptm", "export.json"}
    said = capsys.readouterr().out
    assert "hsh (object.rti): lost: " in said and "ptm (object.ptm): lost: " in said
    assert (out / "object.rti").read_bytes().startswith(b"#HSH") and (out / "object.ptm").read_bytes()[:3] == b"PTM"
