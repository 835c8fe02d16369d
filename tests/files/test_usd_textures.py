"""Textures of USD, both ways: what others write as text, and what we write, read by tinyusdz and from the text."""

import math
import re
import zipfile
from dataclasses import replace
from typing import Any

import cv2
import numpy as np
import pytest
import trimesh
from trimesh.visual import TextureVisuals

import hagoromo as hg
from hagoromo.errors import InputError
from hagoromo.files.png import write_png
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import srgb_decode
from hagoromo_formats.scenes.usd_out import usd_from_scene
from hagoromo_formats.scenes.usd_scene import scene_from_usd
from tests.files.blender import in_blender
from tests.files.test_gltf_textures import CORNERS, FACES, UV

pytest.importorskip("pxr", reason="needs usd-core: pip install 'hagoromo[usd]'")

TEXT = """#usda 1.0
(
    metersPerUnit = 1
    upAxis = "Z"
)
def Material "m" {
    token outputs:surface.connect = </m/s.outputs:surface>
    def Shader "s" { uniform token info:id = "UsdPreviewSurface"
        color3f inputs:diffuseColor.connect = </m/base.outputs:rgb>
        float inputs:roughness.connect = </m/gloss.outputs:g>
        token outputs:surface
    }
    def Shader "uvs" { uniform token info:id = "UsdPrimvarReader_float2"
        string inputs:varname = "map1"
        float2 outputs:result
    }
    def Shader "base" { uniform token info:id = "UsdUVTexture"
        asset inputs:file = @./maps/base.png@
        token inputs:sourceColorSpace = "auto"
        float4 inputs:scale = (0.5, 0.5, 0.5, 1)
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        float2 inputs:st.connect = </m/uvs.outputs:result>
        float3 outputs:rgb
    }
    def Shader "gloss" { uniform token info:id = "UsdUVTexture"
        asset inputs:file = @maps/gloss.png@
        token inputs:sourceColorSpace = "raw"
        token inputs:wrapS = "repeat"
        token inputs:wrapT = "repeat"
        float2 inputs:st.connect = </m/uvs.outputs:result>
        float outputs:g
    }
}
def Mesh "square" (prepend apiSchemas = ["MaterialBindingAPI"]) {
    rel material:binding = </m>
    uniform token subdivisionScheme = "none"
    int[] faceVertexCounts = [3, 3]
    int[] faceVertexIndices = [0, 1, 2, 0, 2, 3]
    point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]
    texCoord2f[] primvars:map1 = [(0, 0), (0.5, 0), (0.5, 1), (0.5, 0), (1, 1), (0.5, 1)] (
        interpolation = "faceVarying")
}
"""
BASE = np.array([[[250, 10, 40], [30, 200, 90]], [[255, 255, 255], [10, 60, 220]]], np.uint8)  # R, G, B
ROUGH = np.array([[120, 200], [90, 255]], np.uint8)


def write(folder, text=TEXT):
    (folder / "maps").mkdir()
    gloss = np.zeros((2, 2, 3), np.uint8)
    gloss[..., 1] = ROUGH
    cv2.imwrite(str(folder / "maps" / "base.png"), np.ascontiguousarray(BASE[..., ::-1]))
    cv2.imwrite(str(folder / "maps" / "gloss.png"), gloss)
    (folder / "a.usda").write_text(text, encoding="utf-8")
    return folder / "a.usda"


def read(file, folder):
    lost = scene_from_usd(file, folder / "scene")
    return load_scene(folder / "scene" / "scene.toml")[0].surfaces[0], lost


def archive(folder, packed=False, more=()):
    file = write(folder)
    with zipfile.ZipFile(folder / "a.usdz", "w", zipfile.ZIP_DEFLATED if packed else zipfile.ZIP_STORED) as out:
        for name in ("a.usda", "maps/base.png", "maps/gloss.png"):
            out.write(folder / name, name)
        for name in more:
            out.writestr(name, "text")
    file.unlink()
    return folder / "a.usdz"


@pytest.mark.parametrize("source", ["folder", "archive"])
def test_textures_lie_where_usd_says(tmp_path, source):
    """sRGB · scale, the first row at the top (t = 1); the corner that two faces share has the UVs of each."""
    surface, lost = read((write if source == "folder" else archive)(tmp_path), tmp_path)
    body, gamma = surface.body_texture, surface.gamma_texture
    assert body is not None and gamma is not None and surface.uv is not None
    assert body.values == pytest.approx(0.5 * srgb_decode(BASE), abs=0.004)
    expected = np.arctan((ROUGH / 255.0) ** 2 * math.sqrt(math.sqrt(2.0) - 1.0))
    assert gamma.values[..., 0] == pytest.approx(expected, rel=1e-5)
    corners = {(*np.round(p, 6).tolist(), *np.round(t, 6).tolist())
               for p, t in zip(np.asarray(surface.vertices)[:, :2], surface.uv, strict=True)}  # fmt: skip
    assert corners == {(0, 0, 0, 0), (1, 0, 0.5, 0), (1, 1, 0.5, 1), (0, 0, 0.5, 0), (1, 1, 1, 1), (0, 1, 0.5, 1)}
    assert not any("texture" in each for each in lost)


@pytest.mark.parametrize("suffix", ["exr", "tif"])
def test_textures_of_floats_and_of_16_bits(tmp_path, suffix):
    """EXR is linear by itself, TIFF of 16 bits as its sourceColorSpace says; what is above 1 is 1."""
    file = write(tmp_path, TEXT.replace("base.png", f"base.{suffix}").replace("gloss.png", f"gloss.{suffix}"))
    linear, rough = np.array([[[0.9, 0.1, 0.3], [0.0, 1.0, 0.02]]], np.float32), np.array([[0.3, 0.8]], np.float32)
    maps, bits = tmp_path / "maps", 1.0 if suffix == "exr" else 65535.0
    for name, values in (("base", linear), ("gloss", np.repeat(rough[..., None], 3, axis=2))):
        if suffix == "exr":
            hg.write_exr(maps / f"{name}.exr", {key: values[..., k] for k, key in enumerate("RGB")})
        else:
            stored = np.round(bits * values).astype(np.uint16)
            assert cv2.imwrite(str(maps / f"{name}.tif"), np.ascontiguousarray(stored[..., ::-1]))
    surface, lost = read(file, tmp_path)
    body, gamma = surface.body_texture, surface.gamma_texture
    assert body is not None and gamma is not None
    assert body.values == pytest.approx(0.5 * linear, abs=0.004)
    assert gamma.values[..., 0] == pytest.approx(np.arctan(rough**2 * math.sqrt(math.sqrt(2.0) - 1.0)), rel=1e-4)
    assert not any("texture" in each for each in lost)


def test_raw_colours_are_linear_and_metal_is_said(tmp_path):
    text = TEXT.replace('"auto"', '"raw"')
    text = text.replace("token outputs:surface\n", "float inputs:metallic = 0.7\ntoken outputs:surface\n")
    surface, lost = read(write(tmp_path, text), tmp_path)
    assert surface.body_texture is not None
    assert surface.body_texture.values == pytest.approx(0.5 * BASE / 255.0, abs=0.004)
    assert any("its metal (0.7)" in each for each in lost)


def test_colours_of_a_specular_workflow_are_factors_on_f0(tmp_path):
    """F0 of n = 1.5 is 0.04: a specularColor of 0.02 is half of it."""
    plain = "int inputs:useSpecularWorkflow = 1\ncolor3f inputs:specularColor = (0.02, 0.01, 0.02)\n"
    plain += "float inputs:roughness = 0.5\n"
    text = TEXT.replace("float inputs:roughness.connect = </m/gloss.outputs:g>\n", plain)
    made = read(write(tmp_path, text), tmp_path)[0].reflectance
    assert made.beta == pytest.approx(0.5 / (4.0 * math.pi * 0.5**4), rel=1e-6) and made.n == 1.5


@pytest.mark.parametrize("kind", ["vertex", "faceVarying", "uniform", "bound"])
def test_display_colours_become_those_of_vertices(tmp_path, kind):
    colours = [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.5, 0.2, 0.1), (1, 1, 0), (0.2, 0.2, 0.2)]
    count = {"vertex": 4, "faceVarying": 6, "uniform": 2, "bound": 4}[kind]
    how = "vertex" if kind == "bound" else kind
    line = f'color3f[] primvars:displayColor = {list(colours[:count])} (interpolation = "{how}")\n'
    text = TEXT.replace("int[] faceVertexCounts", f"{line}int[] faceVertexCounts")
    if kind == "bound":
        text = text.replace("</m/base.outputs:rgb>", "</m/paint.outputs:result>")
        paint = 'def Shader "paint" { uniform token info:id = "UsdPrimvarReader_float3"\n'
        paint += 'string inputs:varname = "displayColor"\nfloat3 outputs:result\n}\n'
        text = text.replace('def Shader "uvs"', f'{paint}def Shader "uvs"')
    else:
        text = text.replace("rel material:binding = </m>\n", "")
    surface, lost = read(write(tmp_path, text), tmp_path)
    body = surface.body_texture
    assert body is not None and body.of == "vertices"
    corner = {"vertex": [0, 1, 2, 0, 2, 3], "faceVarying": range(6), "uniform": [0, 0, 0, 1, 1, 1]}[how]
    found = body.values[np.asarray(surface.faces).ravel()]
    assert found == pytest.approx(np.array([colours[k] for k in corner], float), abs=0.005)
    assert any("beside colours of vertices" in each for each in lost) == (kind == "bound")


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("@./maps/base.png@", "@../base.png@", "outside"),
        ("@./maps/base.png@", "@/etc/passwd@", "outside"),
        ("@./maps/base.png@", "@https://example.org/a.png@", "does not exist"),
        ("@./maps/base.png@", "@a.usda@", "neither PNG, JPEG"),
    ],
)
def test_textures_that_are_elsewhere_or_none_are_refused(tmp_path, old, new, said):
    file = write(tmp_path, TEXT.replace(old, new))
    with pytest.raises(InputError, match=said):
        read(file, tmp_path)
    assert not (tmp_path / "scene").exists()


def test_archives_that_are_packed_or_lead_out_are_refused(tmp_path, monkeypatch):
    for name, packed, more, said in (("packed", True, (), "is packed"), ("out", False, ("../b.txt",), "outside")):
        (tmp_path / name).mkdir()
        with pytest.raises(InputError, match=said):
            read(archive(tmp_path / name, packed, more), tmp_path)
    (tmp_path / "allowed").mkdir()
    monkeypatch.setenv("HAGOROMO_ALLOW", "/")  # reading elsewhere may be allowed, writing there never is
    with pytest.raises(InputError, match="lead out"):
        read(archive(tmp_path / "allowed", more=["../b.txt"]), tmp_path)
    (tmp_path / "none.usdz").write_bytes(b"PK")
    with pytest.raises(InputError, match="archive"):
        read(tmp_path / "none.usdz", tmp_path)


USED = ("image", "vertices")
PICTURES = {"Base Color": "diffuseColor", "Roughness": "roughness", "Specular Tint": "specularColor"}
GAMMAS = np.array([[0.15, 0.1, 0.2], [0.3, 0.4, 0.25]])
BETAS = np.array([[1.0, 0.5, 0.8], [0.2, 0.1, 0.3]])
PIXELS = np.array(
    [[[250, 10, 40], [30, 200, 90], [0, 0, 0]], [[255, 255, 255], [128, 64, 32], [10, 60, 220]]], np.uint8
)
VERTICES = np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 1], [0.2, 0.4, 0.6]])


def a_scene():
    """A square with textures of colour and gloss, one with colours of vertices, a ball that has no UVs."""
    gloss = hg.Reflectance(0.1, 0.3, 0.15, 1.5, hg.Spectrum.constant(1.0))
    matt = hg.Reflectance(1.0 / math.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0))
    body = hg.SurfaceTexture(srgb_decode(PIXELS))
    maps: dict[str, Any] = {"gamma_texture": hg.SurfaceTexture(GAMMAS), "beta_texture": hg.SurfaceTexture(BETAS)}
    image = hg.Surface(gloss, "mesh", CORNERS, FACES, uv=UV, name="image", body_texture=body, **maps)
    painted = hg.SurfaceTexture(VERTICES, of="vertices")
    vertices = hg.Surface(matt, "mesh", CORNERS, FACES, name="vertices", body_texture=painted)
    ball = hg.Surface.sphere((0, 0, 3), 0.5, matt, name="ball")
    camera = hg.Camera(64, 48, (60, 60), (32, 24)).look_at((0.5, -4.0, 3.0), (0.5, 0.5, 0.0))
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.0, -0.6, 0.8)),), (), (image, vertices, ball))


def test_blender_finds_the_textures(tmp_path):
    """Pictures of colour, roughness and gloss, and colours of vertices, at the inputs of its own material."""
    usd_from_scene(a_scene(), tmp_path / "b.usda")
    found = in_blender(tmp_path, "b.usda")
    image, painted = (next(e["inputs"] for name, e in found.items() if name.startswith(each)) for each in USED)
    assert [image[key][0].endswith(f"_{name}.png") for key, name in PICTURES.items()] == [True] * 3
    assert image["Base Color"][1] == "sRGB" and image["Roughness"][1] == "Non-Color" and image["IOR"] == 1.5
    assert painted["Base Color"] == "displayColor" and painted["Roughness"] == 1.0


def test_blender_finds_normals_and_tiles(tmp_path):
    """Images by UDIM of colour and of normals, these behind a node of normals, in the numbers of the file."""
    (tmp_path / "in").mkdir()
    usd_from_scene(by_udim(tmp_path / "in"), tmp_path / "b.usda")
    (inputs,) = (each["inputs"] for name, each in in_blender(tmp_path, "b.usda").items() if name.startswith("strip"))
    assert inputs["Base Color"][0].endswith("_diffuseColor.<UDIM>.png") and inputs["Base Color"][1] == "sRGB"
    assert inputs["Normal"][0].endswith("_normal.<UDIM>.png") and inputs["Normal"][1] == "Non-Color"


@pytest.mark.parametrize("name", ["a.usda", "a.usdz"])
def test_textures_that_are_written_come_back(tmp_path, name):
    """Colours to the 8 bits of the file, of alpha · texture; γ to half a step of roughness, β to one of its factor."""
    lost = usd_from_scene(a_scene(), tmp_path / name)
    assert not any("texture" in each for each in lost)
    files = {each.name for each in tmp_path.iterdir()}
    assert len(files) == (4 if name == "a.usda" else 1)
    lost = scene_from_usd(tmp_path / name, tmp_path / "again")
    assert not any("texture" in each or "of its gloss, which" in each for each in lost)
    again = {s.name: s for s in load_scene(tmp_path / "again" / "scene.toml")[0].surfaces}
    found = again["image"]
    assert found.body_texture is not None and found.gamma_texture is not None and found.beta_texture is not None
    alpha = found.reflectance.alpha * found.body_texture.values
    assert alpha == pytest.approx(0.1 * srgb_decode(PIXELS), abs=0.005 * 0.1 * math.pi)
    rough = np.sqrt(np.tan(GAMMAS) / math.sqrt(math.sqrt(2.0) - 1.0))
    got = np.sqrt(np.tan(found.gamma_texture.values[..., 0]) / math.sqrt(math.sqrt(2.0) - 1.0))
    assert np.abs(got - rough).max() <= 0.501 / 255.0
    strength = 4.0 * math.pi * got**4 * 0.3 * BETAS
    betas = found.reflectance.beta * found.beta_texture.values[..., 0]
    assert (np.abs(betas - 0.3 * BETAS) <= 0.51 / 255.0 * strength.max() / (4.0 * math.pi * got**4)).all()
    assert found.uv == pytest.approx(UV, abs=1e-6)
    painted = again["vertices"].body_texture
    assert painted is not None and painted.values == pytest.approx(VERTICES, abs=0.005)


@pytest.mark.parametrize("name", ["a.usda", "a.usdc"])
def test_another_reader_finds_textures_and_uvs(tmp_path, name):
    """tinyusdz, and OpenCV for the pictures: at the peak, F0 s / (4π a²) is β F0, to half a step of the pictures.

    It takes no colours of vertices for those of a surface: that one is left out.
    """
    tiny = pytest.importorskip("tinyusdz", reason="needs tinyusdz, another reader of USD")
    scene = a_scene()
    usd_from_scene(replace(scene, surfaces=(scene.surfaces[0], scene.surfaces[2])), tmp_path / name)
    found = tiny.tydra.convert_to_render_scene(tiny.load(str(tmp_path / name)))
    (mesh,) = (each for each in found.meshes() if each.display_name == "image")
    np.testing.assert_allclose(np.array(mesh.texcoord(0)), UV, atol=1e-6)
    look = found.materials()[mesh.material_id].preview_surface
    images, textures = found.images(), found.textures()
    used = {key: textures[look[key]["texture_id"]] for key in ("diffuse_color", "roughness", "specular_color")}
    files = {key: tmp_path / images[each.texture_image_id].asset_identifier for key, each in used.items()}
    stored = {key: np.asarray(cv2.imread(str(file), cv2.IMREAD_UNCHANGED)) for key, file in files.items()}
    assert {each.varname_uv for each in used.values()} == {"st"}
    assert [each.output_channel for each in used.values()] == ["rgb", "r", "rgb"]
    rough, grey = stored["roughness"] / 255.0, stored["specular_color"][..., 0] / 255.0
    normal = used["specular_color"].scale[0] * grey
    step = 0.51 / 255.0 * used["specular_color"].scale[0]
    assert (np.abs(normal - 0.04 * 0.3 * BETAS * 4.0 * math.pi * rough**4) <= step).all()
    albedo = srgb_decode(stored["diffuse_color"][..., ::-1]) * (1.0 - normal.mean())
    assert albedo == pytest.approx(0.1 * math.pi * srgb_decode(PIXELS), abs=0.0025)  # half a step at a third


def test_the_text_says_how_pictures_and_colours_of_vertices_are_meant(tmp_path):
    usd_from_scene(a_scene(), tmp_path / "a.usda")
    text = (tmp_path / "a.usda").read_text(encoding="utf-8")
    spaces = re.findall(r"inputs:file = @\./a_2_(\w+)\.png@.*?inputs:sourceColorSpace = \"(\w+)\"", text, re.DOTALL)
    assert dict(spaces) == {"diffuseColor": "sRGB", "roughness": "raw", "specularColor": "raw"}
    (values,) = re.findall(r"primvars:displayColor = \[(.*?)\] \(\s*interpolation = \"vertex\"", text)
    assert np.array(re.findall(r"[\d.]+", values), float).reshape(-1, 3) == pytest.approx(VERTICES, abs=1e-6)
    assert "inputs:diffuseColor.connect = </scene/materials/material_3/colours.outputs:result>" in text


UDIM_OF_NORMALS = "InvalidFile: UsdUVTexture prim </scene/materials/material_2/normal> (connected"


def test_what_is_written_passes_the_checks_of_usd(tmp_path):
    """All validators that come with usd-core; of an empty stage they find faults. That of normals looks for a file
    whose name has the mark of UDIM itself, and finds none.
    """
    usd, validation = (pytest.importorskip(f"pxr.{name}") for name in ("Usd", "UsdValidation"))
    context = validation.ValidationContext(validation.ValidationRegistry().GetOrLoadAllValidators())
    assert context.Validate(usd.Stage.CreateInMemory())
    (tmp_path / "in").mkdir()
    for name, scene in (("a.usda", a_scene()), ("a.usdz", a_scene()), ("b.usda", by_udim(tmp_path / "in"))):
        usd_from_scene(scene, tmp_path / name)
        found = context.Validate(usd.Stage.Open(str(tmp_path / name)))
        said = [f"{each.GetName()}: {each.GetMessage()}" for each in found]
        assert [each[:70] for each in said] == [UDIM_OF_NORMALS[:70]] * (name == "b.usda")


SHEARED = np.array([[0.0, 0, 0], [1, 0, 0], [1.4, 0.8, 0.3], [0.4, 0.8, 0.3]])  # a parallelogram aslant
X, Y = np.meshgrid(np.linspace(0.0, 2.0 * math.pi, 64, endpoint=False), np.linspace(0.0, 2.0 * math.pi, 48, False))


def in_relief(mirrored=False):
    """A parallelogram with images of normals and of heights, whose UVs are sheared, or mirrored as well."""
    matt = hg.Reflectance(1.0 / math.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0))
    slopes = np.stack([0.3 * np.sin(X), 0.2 * np.cos(Y), np.ones_like(X)], axis=-1)
    normals = hg.SurfaceTexture(0.5 + 0.5 * slopes / np.linalg.norm(slopes, axis=-1, keepdims=True), ())
    heights = hg.SurfaceTexture(0.03 + 0.03 * np.sin(X) * np.cos(Y))
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0, 1]]) * ([-1.0, 1.0] if mirrored else 1.0)
    made = hg.Surface(matt, "mesh", SHEARED, FACES, uv=uv, smooth=False, name="relief", normal_texture=normals,
                      bump_texture=heights)  # fmt: skip
    camera = hg.Camera(24, 18, (30, 30), (12, 9)).look_at((0.7, -0.5, 1.4), (0.7, 0.4, 0.15), (0, 1, 0))
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.5, -0.3, 0.8)),), (), (made,))


@pytest.mark.parametrize("mirrored", [False, True])
def test_normals_and_heights_are_one_image_of_normals(tmp_path, mirrored):
    """The scene that comes back is shaded as this one: to 1 %, as normals are interpolated in place of slopes."""
    scene = in_relief(mirrored)
    assert not any("texture" in each for each in usd_from_scene(scene, tmp_path / "a.usda"))
    text = (tmp_path / "a.usda").read_text(encoding="utf-8")
    assert "normal3f inputs:normal.connect" in text and "float4 inputs:bias = (-1, -1, -1, 0)" in text
    assert not any("texture" in each for each in scene_from_usd(tmp_path / "a.usda", tmp_path / "again"))
    (found,) = load_scene(tmp_path / "again" / "scene.toml")[0].surfaces
    plain = replace(scene.surfaces[0], normal_texture=None, bump_texture=None)
    pictures = [hg.render(replace(scene, surfaces=(one,))).linear_srgb() for one in (scene.surfaces[0], found, plain)]
    inside = pictures[2][..., 1] > 0.999 * np.median(pictures[2][..., 1])
    mine, other, flat = (picture[inside] for picture in pictures)
    assert np.abs(mine - flat).max() > 0.2 * flat.max()
    np.testing.assert_allclose(other, mine, atol=0.01 * flat.max())


def test_heights_on_uvs_that_are_stretched_unlike_are_said(tmp_path):
    """Of two triangles the second has twice the length along u."""
    scene = in_relief()
    uv = np.array([[0.0, 0], [1, 0], [1, 1], [0.5, 1]])
    lost = usd_from_scene(replace(scene, surfaces=(replace(scene.surfaces[0], uv=uv),)), tmp_path / "a.usda")
    assert [each for each in lost if "bump_texture are off by up to" in each]


TILES = {(0, 0): 60, (1, 0): 120, (0, 1): 200}  # and their grey


def by_udim(folder):
    """A scene file of a strip over three tiles, with images of colour and of normals."""
    for (u, v), grey in TILES.items():
        colours = np.full((4, 6, 3), grey, np.uint8)
        colours[0, 0] = 250  # the corner at the top left
        normals = np.full((4, 6, 3), (128, 128, 255), np.uint8)
        normals[:, :3, 0] = 128 + 30 * (1 + u + v)
        for name, image in (("body", colours), ("normal", normals)):
            write_png(folder / f"{name}.{1001 + u + 10 * v}.png", image)
    corners = np.array([[x, y, 0.0] for y in (0, 1) for x in (0, 1, 2)] + [[0.0, 2, 0], [1, 2, 0]])
    faces = np.array([[0, 1, 4], [0, 4, 3], [1, 2, 5], [1, 5, 4], [3, 4, 7], [3, 7, 6]])
    visual = TextureVisuals(uv=corners[:, :2])
    data = trimesh.Trimesh(corners, faces, process=False, visual=visual).export(file_type="ply")
    (folder / "strip.ply").write_bytes(data)
    (folder / "scene.toml").write_text("""
[camera]
size = [16, 16]
focal = [12.0, 12.0]
eye = [1.0, 1.0, 2.0]
target = [1.0, 1.0, 0.0]
up = [0.0, 1.0, 0.0]
[[lamp]]
to_lamp = [0.3, 0.2, 1.0]
[[surface]]
name = "strip"
mesh = "strip.ply"
smooth = false
reflectance = {alpha = 0.3, beta = 0.0, gamma = 0.3, n = 1.5, body_colour = 1.0}
body_texture = {file = "body.<UDIM>.png"}
normal_texture = {file = "normal.<UDIM>.png"}
""")
    return load_scene(folder / "scene.toml")[0]


@pytest.mark.parametrize("name", ["a.usda", "a.usdc", "a.usdz"])
def test_images_by_udim_go_out_and_come_back_so(tmp_path, name):
    """One file for each tile that the UVs use, by the name with the mark; the picture is the same to 8 bits."""
    (tmp_path / "in").mkdir()
    scene = by_udim(tmp_path / "in")
    assert not any("texture" in each for each in usd_from_scene(scene, tmp_path / name))
    if name != "a.usdz":
        numbers = {path.name for path in tmp_path.glob("a_2_*.png")}
        assert numbers == {f"a_2_{key}.{n}.png" for key in ("diffuseColor", "normal") for n in (1001, 1002, 1011)}
    assert not any("texture" in each for each in scene_from_usd(tmp_path / name, tmp_path / "again"))
    text = (tmp_path / "again" / "scene.toml").read_text(encoding="utf-8")
    assert text.count(".<UDIM>.png") == 2
    again = load_scene(tmp_path / "again" / "scene.toml")[0]
    assert again.surfaces[0].tiles == (2, 2)
    pictures = [hg.render(replace(scene, surfaces=one.surfaces)).linear_srgb() for one in (scene, again)]
    np.testing.assert_allclose(pictures[1], pictures[0], atol=0.01 * pictures[0].max())
    assert len(np.unique(np.round(pictures[0][..., 1], 3))) > 6


def test_an_image_beside_those_by_udim_lies_on_each_tile(tmp_path):
    """A roughness without tiles repeats on all of them; a tile that the UVs use and no file has is one line."""
    file = write(tmp_path, TEXT.replace("base.png", "base.<UDIM>.png"))
    (tmp_path / "maps" / "base.png").rename(tmp_path / "maps" / "base.1001.png")
    (tmp_path / "maps" / "base.1002.png").write_bytes((tmp_path / "maps" / "base.1001.png").read_bytes())
    surface, lost = read(file, tmp_path)
    assert surface.gamma_texture is not None and surface.body_texture is not None
    assert surface.gamma_texture.values.shape == (2, 4, 1) and not any("texture" in each for each in lost)
    first, second = np.split(surface.gamma_texture.values, 2, axis=1)
    np.testing.assert_array_equal(first, second)
    (tmp_path / "b").mkdir()
    file = write(
        tmp_path / "b", TEXT.replace("base.png", "base.<UDIM>.png").replace("(1, 1), (0.5, 1)]", "(3, 1), (2.5, 1)]")
    )
    (tmp_path / "b" / "maps" / "base.png").rename(tmp_path / "b" / "maps" / "base.1001.png")
    with pytest.raises(InputError, match="add it"):
        read(file, tmp_path / "b")
