"""Textures of base colours in glTF, both ways; what is written is read by our own few lines of the specification."""

import base64
import json
import struct
from dataclasses import replace

import cv2
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import srgb_decode, srgb_encode
from hagoromo_formats.scenes.gltf_scene import gltf_from_scene, scene_from_gltf

CORNERS = np.array([[0.0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]])
FACES = np.array([[0, 1, 2], [0, 2, 3]])
UV = np.array([[0.0, 0.0], [1.5, 0.0], [1.5, 0.25], [0.0, 0.25]])  # v up
PIXELS = np.array(
    [[[250, 10, 40], [30, 200, 90], [0, 0, 0]], [[255, 255, 255], [128, 64, 32], [10, 60, 220]]], np.uint8
)
MATT = hg.Reflectance(1.0 / np.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0))


def textured_scene():
    image = hg.SurfaceTexture(srgb_decode(PIXELS), smooth=False)
    vertices = hg.SurfaceTexture(np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0.2, 0.4, 0.6]]), of="vertices")
    mesh = hg.Surface(MATT, "mesh", CORNERS, FACES, uv=UV, name="image", body_texture=image)
    painted = hg.Surface(MATT, "mesh", CORNERS + np.array([2.0, 0, 0]), FACES, name="vertices", body_texture=vertices)
    floor = replace(hg.Surface.floor(-1.0, 3.0, MATT), body_texture=replace_smooth(image))
    ball = replace(hg.Surface.sphere((0, 0, 3), 0.5, MATT, name="ball"), body_texture=image)
    camera = hg.Camera(64, 48, (60, 60), (32, 24)).look_at((0.5, -4.0, 3.0), (0.5, 0.5, 0.0))
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.0, -0.6, 0.8)),), (), (mesh, painted, floor, ball))


def replace_smooth(texture):
    return hg.SurfaceTexture(texture.values, texture.spectra, smooth=True)


def parts_of(file):
    """The JSON and the binary part of a .glb."""
    data = file.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    return json.loads(data[20 : 20 + length]), data[28 + length :]


def view(record, binary, number):
    one = record["bufferViews"][number]
    return binary[one.get("byteOffset", 0) :][: one["byteLength"]]


def test_textures_are_written_as_the_specification_says(tmp_path):
    lost = gltf_from_scene(textured_scene(), tmp_path / "a.glb")
    assert [each for each in lost if "texture" in each] == ["surface 'ball': the body_texture of its sphere"]
    record, binary = parts_of(tmp_path / "a.glb")
    primitives = {mesh["name"]: mesh["primitives"][0] for mesh in record["meshes"]}
    for name, filters in (("image_1", {"magFilter": 9728}), ("floor_3", None)):
        material = record["materials"][primitives[name]["material"]]["pbrMetallicRoughness"]
        assert material["metallicFactor"] == 0.0 and material["baseColorFactor"] == [1.0] * 4
        texture = record["textures"][material["baseColorTexture"]["index"]]
        assert (record["samplers"][texture["sampler"]] if "sampler" in texture else None) == filters
        png = np.frombuffer(view(record, binary, record["images"][texture["source"]]["bufferView"]), np.uint8)
        pixels = cv2.imdecode(png, cv2.IMREAD_COLOR)
        assert pixels is not None
        np.testing.assert_array_equal(pixels[..., ::-1], PIXELS)
    place = record["accessors"][primitives["image_1"]["attributes"]["TEXCOORD_0"]]["bufferView"]
    uv = np.frombuffer(view(record, binary, place), np.float32).reshape(-1, 2)
    np.testing.assert_allclose(uv, np.c_[UV[:, 0], 1.0 - UV[:, 1]], atol=1e-6)  # v down
    place = record["accessors"][primitives["vertices_2"]["attributes"]["COLOR_0"]]["bufferView"]
    colours = np.frombuffer(view(record, binary, place), np.uint8).reshape(4, 4)
    np.testing.assert_array_equal(colours[:3, :3], 255 * np.eye(3))
    np.testing.assert_array_equal(colours[3, :3], [51, 102, 153])  # linear


def test_half_widths_of_facets_are_written_as_roughness(tmp_path):
    """GGX of the specification, D = α²/(π ((N·H)² (α² − 1) + 1)²) with α = roughness², has slopes, D cos⁴, half as
    dense at γ as at 0; to half of a step of 8 bits.
    """
    gloss = replace(MATT, alpha=0.1, beta=0.3, gamma=0.15)
    gammas = np.array([[0.05, 0.1, 0.2], [0.3, 0.4, 0.08]])
    texture = hg.SurfaceTexture(gammas, smooth=False)
    body = hg.SurfaceTexture(srgb_decode(PIXELS))
    both = hg.Surface(gloss, "mesh", CORNERS, FACES, uv=UV, name="both", body_texture=body, gamma_texture=texture)
    floor = replace(hg.Surface.floor(-1.0, 3.0, gloss), gamma_texture=texture)
    ball = hg.Surface.sphere((0, 0, 3), 0.5, gloss, name="ball")
    matt = hg.Surface.sphere((0, 0, 5), 0.5, MATT, name="matt")
    lost_ball = replace(ball, name="lost", gamma_texture=texture)
    scene = replace(textured_scene(), surfaces=(both, floor, ball, matt, lost_ball))
    lost = gltf_from_scene(scene, tmp_path / "a.glb")
    assert [each.split(",")[0] for each in lost if "texture" in each] == ["surface 'lost': its gamma_texture"]
    record, binary = parts_of(tmp_path / "a.glb")
    looks = {m["name"]: m["pbrMetallicRoughness"] for m in record["materials"]}
    assert looks["matt_4"]["roughnessFactor"] == 1.0 and looks["both_1"]["baseColorFactor"] == [1.0] * 4
    specular = {m["name"]: m["extensions"]["KHR_materials_specular"] for m in record["materials"]}
    assert specular["matt_4"]["specularFactor"] == 0.0

    def half(gamma, rough):
        alpha, cosine = rough**2, np.cos(gamma)
        return alpha**4 / (cosine**2 * (alpha**2 - 1.0) + 1.0) ** 2 * cosine**4

    assert half(0.15, looks["ball_3"]["roughnessFactor"]) == pytest.approx(0.5, rel=1e-6)
    for name in ("both_1", "floor_2"):
        assert looks[name]["roughnessFactor"] == 1.0 and looks[name]["metallicFactor"] == 0.0
        one = record["textures"][looks[name]["metallicRoughnessTexture"]["index"]]
        assert record["samplers"][one["sampler"]] == {"magFilter": 9728}
        png = np.frombuffer(view(record, binary, record["images"][one["source"]]["bufferView"]), np.uint8)
        pixels = cv2.imdecode(png, cv2.IMREAD_COLOR)
        assert pixels is not None and pixels.shape == (2, 3, 3)
        wider, narrower = ((pixels[..., 1] + step) / 255.0 for step in (0.51, -0.51))  # green
        assert (half(gammas, wider) >= 0.5).all() and (half(gammas, narrower) <= 0.5).all()
    assert "sampler" not in record["textures"][looks["both_1"]["baseColorTexture"]["index"]]


def test_textures_come_back(tmp_path):
    """In the same places, to the 8 bits of the file: the pictures are the same to 1 % of white."""
    scene = textured_scene()
    scene = replace(scene, surfaces=scene.surfaces[:3])
    gltf_from_scene(scene, tmp_path / "a.glb")
    assert scene_from_gltf(tmp_path / "a.glb", tmp_path / "again") == []
    again, _ = load_scene(tmp_path / "again" / "scene.toml")
    textures = [surface.body_texture for surface in again.surfaces]
    assert {t and (t.of, t.smooth) for t in textures} == {("image", False), ("vertices", True), ("image", True)}
    again = replace(again, camera=scene.camera, lamps=scene.lamps)
    response = hg.Response.load("canon_eos_300d")
    before, after = (hg.render(one).expose(response) for one in (scene, again))
    assert before.std() > 0.1 * before.max()
    assert np.abs(after - before).max() < 0.01 * before.max()


def gltf(folder, source, factor=(1.0, 1.0, 1.0, 1.0), more=()):
    """A textured square in a .gltf; source: the entry of its image."""
    arrays = CORNERS.astype(np.float32).tobytes() + np.c_[UV[:, 0], 1 - UV[:, 1]].astype(np.float32).tobytes()
    arrays += FACES.astype(np.uint32).tobytes()
    views = [{"buffer": 0, "byteOffset": a, "byteLength": n} for a, n in ((0, 48), (48, 32), (80, 24))]
    kinds = ((5126, 4, "VEC3"), (5126, 4, "VEC2"), (5125, 6, "SCALAR"))
    pbr = {"baseColorFactor": list(factor), "baseColorTexture": {"index": 0}}
    record = {
        "asset": {"version": "2.0"},
        "buffers": [{"byteLength": len(arrays), "uri": address(arrays)}],
        "bufferViews": views,
        "accessors": [
            {"bufferView": k, "componentType": c, "count": n, "type": t} for k, (c, n, t) in enumerate(kinds)
        ],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "TEXCOORD_0": 1}, "indices": 2, "material": 0}]}],
        "materials": [{"pbrMetallicRoughness": pbr, **dict(more)}],
        "textures": [{"source": 0}],
        "images": [source],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    (folder / "a.gltf").write_text(json.dumps(record))
    return folder / "a.gltf"


def address(data):
    return "data:application/octet-stream;base64," + base64.b64encode(data).decode()


def png():
    return cv2.imencode(".png", PIXELS[..., ::-1])[1].tobytes()


def test_normals_and_heights_are_written_and_come_back(tmp_path):
    """normalTexture of the material, green up, in 8 bits; the scene that comes back is shaded as this one."""
    x, y = np.meshgrid(np.linspace(-1, 1, 64), np.linspace(-1, 1, 48))
    slopes = np.stack([0.3 * x, 0.5 * y * y, np.ones_like(x)], axis=-1)
    normals = hg.SurfaceTexture(0.5 + 0.5 * slopes / np.linalg.norm(slopes, axis=-1, keepdims=True), ())
    heights = hg.SurfaceTexture(0.1 + 0.1 * np.sin(np.pi * x) * np.cos(np.pi * y))
    mesh = hg.Surface(MATT, "mesh", CORNERS, FACES, uv=UV, name="mesh", smooth=False, normal_texture=normals)
    scene = replace(textured_scene(), surfaces=(mesh,))
    assert not any("texture" in line for line in gltf_from_scene(scene, tmp_path / "a.glb"))
    record, _ = parts_of(tmp_path / "a.glb")
    assert "normalTexture" in record["materials"][0]
    assert not any("ormal" in line for line in scene_from_gltf(tmp_path / "a.glb", tmp_path / "back"))
    (back,) = load_scene(tmp_path / "back" / "scene.toml")[0].surfaces
    assert back.normal_texture is not None
    np.testing.assert_allclose(back.normal_texture.values, normals.values, atol=0.51 / 255)
    camera = hg.Camera(16, 12, (14, 14), (8, 6)).look_at((0.5, 0.5, 1.2), (0.5, 0.5, 0.0), (0, 1, 0))

    def seen(surface):
        return hg.render(replace(scene, camera=camera, surfaces=(surface,))).linear_srgb()[2:-2, 3:-3]

    np.testing.assert_allclose(seen(back), seen(mesh), rtol=0.02)  # 8 bits of normals: 0.4°
    bumpy = replace(mesh, bump_texture=heights)  # on the same pixels, in one image
    assert not any("texture" in line for line in gltf_from_scene(replace(scene, surfaces=(bumpy,)), tmp_path / "b.glb"))
    scene_from_gltf(tmp_path / "b.glb", tmp_path / "b")
    (back,) = load_scene(tmp_path / "b" / "scene.toml")[0].surfaces
    assert np.abs(seen(bumpy) - seen(mesh)).max() > 0.1 * seen(mesh).max()
    np.testing.assert_allclose(seen(back), seen(bumpy), rtol=0.03)  # and slopes, in place of normals, interpolated


@pytest.mark.parametrize("where", ["file", "JSON"])
@pytest.mark.parametrize("factor", [1.0, 0.5])
def test_an_image_is_found_and_has_its_factor(tmp_path, where, factor):
    (tmp_path / "a b.png").write_bytes(png())
    source = {"uri": "a%20b.png"} if where == "file" else {"uri": address(png())}
    more = {"occlusionTexture": {"index": 0}}
    made = scene_from_gltf(gltf(tmp_path, source, (factor, 1.0, 1.0, 1.0), more), tmp_path / "scene")
    assert made[2:] == [
        "lost: texture_1: its occlusionTexture",
        "lost: material 0: its metal (1), of which the colour is the body's",
    ]
    texture = load_scene(tmp_path / "scene" / "scene.toml")[0].surfaces[0].body_texture
    assert texture is not None
    expected = srgb_decode(PIXELS) * [factor, 1.0, 1.0]
    assert np.abs(srgb_encode(texture.values) - srgb_encode(expected).astype(float)).max() <= 1.0


@pytest.mark.parametrize(
    ("source", "said"),
    [
        ({"uri": "../out.png"}, "outside"),
        ({"uri": "none.png"}, "does not exist"),
        ({"uri": address(b"GIF89a and no more")}, "neither PNG, JPEG"),
        ({"uri": address(png()[:60])}, "texture_1.png"),
        ({"bufferView": 2, "mimeType": "image/png"}, "neither PNG, JPEG"),
        ({"bufferView": 9, "mimeType": "image/png"}, "is number 9 of bufferViews, of which there are 3"),
    ],
)
def test_images_that_are_none_are_refused(tmp_path, source, said):
    with pytest.raises(InputError, match=said) as refused:
        scene_from_gltf(gltf(tmp_path, source), tmp_path / "scene")
    assert "\n" not in str(refused.value) and not (tmp_path / "scene").exists()
