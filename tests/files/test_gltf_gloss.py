"""Gloss in glTF, both ways; the oracle is GGX and Fresnel of the specification, D F0 / 4 along the normal."""

import json
import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.image.scene.scene_file import load_scene
from hagoromo.light.colour import srgb_decode, srgb_encode
from hagoromo.light.environment import upsampled
from hagoromo_formats.scenes.gltf_scene import gltf_from_scene, scene_from_gltf
from hagoromo_formats.scenes.pbr import linear
from tests.files.test_gltf_textures import CORNERS, FACES, UV, address, gltf, parts_of

CAMERA = hg.Camera(64, 48, (60, 60), (32, 24)).look_at((0.5, -4.0, 3.0), (0.5, 0.5, 0.0))
LAMPS = (hg.Lamp(to_lamp=(0.0, -0.6, 0.8)),)
UP = (0.0, 0.0, 1.0)


def surface(alpha, beta, gamma, n, colour=None, **more):
    body = hg.Spectrum.constant(0.5)
    made = hg.Reflectance(alpha, beta, gamma, n, body, colour or hg.Spectrum.constant(1.0))
    return hg.Surface(made, "mesh", CORNERS, FACES, uv=UV, **more)


def there_and_back(tmp_path, *surfaces):
    gltf_from_scene(hg.Scene(CAMERA, LAMPS, (), surfaces), tmp_path / "a.glb")
    lost = scene_from_gltf(tmp_path / "a.glb", tmp_path / "again")
    return load_scene(tmp_path / "again" / "scene.toml")[0].surfaces, lost


def along_normal(material, alpha_width):
    """Radiance of body and gloss per irradiance, lamp and eye along the normal: base (1 − F)/π, and D F / 4."""
    specular = material.get("extensions", {}).get("KHR_materials_specular", {"specularFactor": 1.0})
    n = material.get("extensions", {}).get("KHR_materials_ior", {"ior": 1.5})["ior"]
    tint = specular.get("specularColorFactor", [1.0] * 3)[1]
    fresnel = specular.get("specularFactor", 1.0) * min(((n - 1) / (n + 1)) ** 2 * tint, 1.0)
    body = material["pbrMetallicRoughness"]["baseColorFactor"][1] * (1.0 - fresnel) / math.pi
    return body, fresnel / (4.0 * math.pi * alpha_width**2)


CASES = [(0.2, 0.3, 0.15, 1.5), (0.05, 8.0, 0.03, 1.4), (0.25, 0.1, 0.5, 1.7), (0.1, 900.0, 0.004, 1.33)]


@pytest.mark.parametrize("numbers", CASES)
def test_alpha_beta_gamma_and_n_come_back(tmp_path, numbers):
    """To the digits of decimal text; the product α c_b, as albedos have no scale of their own."""
    (found,), lost = there_and_back(tmp_path, surface(*numbers))
    made = found.reflectance
    assert made.alpha * made.body_colour.at(550.0) == pytest.approx(0.5 * numbers[0], rel=1e-6)
    assert (made.beta, made.gamma, made.n) == pytest.approx(numbers[1:], rel=1e-6)
    assert found.gamma_texture is None and made.interface_colour.at(450.0) == pytest.approx(1.0)
    assert all("its gloss dims" in each or "camera" in each for each in lost), lost
    scene = hg.Scene(CAMERA, LAMPS, (), (found,))
    assert not any("tails" in each for each in gltf_from_scene(scene, tmp_path / "b.glb"))  # those of GGX stay


@pytest.mark.parametrize("numbers", CASES)
def test_written_gloss_is_as_bright_along_the_normal_as_the_specification_says(tmp_path, numbers):
    one = surface(*numbers, name="a")
    gltf_from_scene(hg.Scene(CAMERA, LAMPS, (), (one,)), tmp_path / "a.glb")
    material = parts_of(tmp_path / "a.glb")[0]["materials"][0]
    body, gloss = along_normal(material, material["pbrMetallicRoughness"]["roughnessFactor"] ** 2)
    weights = one.reflectance.weights(*(arrays().Array3f(*UP) for _ in range(3)))
    assert body == pytest.approx(0.5 * weights.body[0], rel=1e-5)
    assert gloss == pytest.approx(weights.interface[0], rel=1e-4)


def test_colours_of_gloss_mirrors_glass_and_matt_come_back(tmp_path):
    gold = upsampled([1.0, 0.8, 0.4])
    glossy = surface(0.1, 0.3, 0.2, 1.5, colour=gold)
    plain = surface(0.3, 0.0, 0.2, 1.5)
    mirror = replace(plain, reflectance=replace(plain.reflectance, alpha=0.0, interface_colour=gold), optics="mirror")
    glass = replace(mirror, reflectance=replace(mirror.reflectance, n=1.33), optics="glass")
    found, _ = there_and_back(tmp_path, glossy, plain, mirror, glass)
    by_optics = {each.optics or ("glossy" if each.reflectance.beta else "matt"): each.reflectance for each in found}
    assert by_optics.keys() == {"glossy", "matt", "mirror", "glass"} and by_optics["glass"].n == pytest.approx(1.33)
    for kind in ("glossy", "mirror", "glass"):
        colour = by_optics[kind].interface_colour
        assert linear(colour) == pytest.approx([1.0, 0.8, 0.4], abs=1e-3)


def grey(values):
    """Bytes of a PNG."""
    done, data = cv2.imencode(".png", np.asarray(values))
    assert done
    return address(data.tobytes())


def foreign(tmp_path, change):
    """The surface of a textured square whose material was changed, and what was lost."""
    file = gltf(tmp_path, {"uri": grey(np.full((2, 3, 3), 255, np.uint8))})
    record = json.loads(file.read_text(encoding="utf-8"))
    change(record, record["materials"][0])
    file.write_text(json.dumps(record), encoding="utf-8")
    lost = scene_from_gltf(file, tmp_path / "scene")
    return load_scene(tmp_path / "scene" / "scene.toml")[0].surfaces[0], lost


@pytest.mark.parametrize(
    ("factors", "extensions", "said"),
    [
        ({"metallicFactor": 0.0, "roughnessFactor": 0.5}, {}, ""),
        ({"metallicFactor": 0.0, "roughnessFactor": 0.3}, {"KHR_materials_ior": {"ior": 1.8}}, ""),
        ({"metallicFactor": 0.0, "roughnessFactor": 0.3},
         {"KHR_materials_specular": {"specularFactor": 0.5, "specularColorFactor": [0.5, 1.5, 1.0]}}, ""),
        ({"roughnessFactor": 0.4}, {}, "the Fresnel curve of its metal"),
        ({"metallicFactor": 0.0, "roughnessFactor": 0.4}, {"KHR_materials_sheen": {}}, "its KHR_materials_sheen"),
    ],
)  # fmt: skip
def test_materials_of_others_are_as_bright_along_the_normal_as_the_specification_says(
    tmp_path, factors, extensions, said
):
    base = 0.1 if "metallicFactor" in factors else 0.5

    def change(_, material):
        del material["pbrMetallicRoughness"]["baseColorTexture"]
        material["pbrMetallicRoughness"] |= {"baseColorFactor": [base, base, base, 1.0]} | factors
        material["extensions"] = extensions

    found, lost = foreign(tmp_path, change)
    made, width = found.reflectance, factors["roughnessFactor"] ** 2
    weights = made.weights(*(arrays().Array3f(*UP) for _ in range(3)))
    body, gloss = along_normal(
        {"extensions": extensions, "pbrMetallicRoughness": {"baseColorFactor": [base] * 4}}, width
    )
    if "metallicFactor" not in factors:
        body, gloss = 0.0, 0.5 / (4.0 * math.pi * width**2)
    assert weights.body[0] * made.body_colour.at(550.0) == pytest.approx(body, rel=0.01)  # the largest of the colours
    assert weights.interface[0] * linear(made.interface_colour)[1] == pytest.approx(gloss, rel=1e-3)
    cosine = math.cos(made.gamma)  # D of GGX · cos⁴ is half at γ
    half = width**4 / (cosine**2 * (width**2 - 1.0) + 1.0) ** 2 * cosine**4
    assert half == pytest.approx(0.5, rel=1e-6) and made.nu == 2.0
    assert any(said in each for each in lost)


def test_roughness_one_without_specular_is_matt(tmp_path):
    def change(_, material):
        material["pbrMetallicRoughness"] |= {"metallicFactor": 0.0}

    made = foreign(tmp_path, change)[0].reflectance
    assert made.beta == 0.0 and made.alpha == pytest.approx(1.0 / math.pi)


def test_green_is_roughness_and_alpha_the_factor_on_fresnel(tmp_path):
    """a = (0.8 G)², γ as of the specification; β = 0.6 A / (4π a²) at each pixel alone (nearest)."""
    pixels = np.zeros((2, 3, 4), np.uint8)
    pixels[..., 1] = [[51, 102, 153], [204, 255, 76]]
    pixels[..., 3] = [[4, 30, 60], [120, 255, 10]]

    def change(record, material):
        record["images"].append({"uri": grey(pixels)})  # OpenCV's B, G, R, A
        record["samplers"] = [{"magFilter": 9728}]
        record["textures"].append({"source": 1, "sampler": 0})
        pbr = {"metallicFactor": 0.0, "roughnessFactor": 0.8, "metallicRoughnessTexture": {"index": 1}}
        material["pbrMetallicRoughness"] |= pbr | {"baseColorFactor": [0.2, 0.2, 0.2, 1.0]}
        material["extensions"] = {"KHR_materials_specular": {"specularFactor": 0.6, "specularTexture": {"index": 1}}}

    found, lost = foreign(tmp_path, change)
    width = (0.8 * pixels[..., 1] / 255.0) ** 2
    assert found.gamma_texture is not None and found.beta_texture is not None and not found.gamma_texture.smooth
    expected = np.arctan(width * math.sqrt(math.sqrt(2.0) - 1.0))
    assert found.gamma_texture.values[..., 0] == pytest.approx(expected, rel=1e-5)
    betas = found.reflectance.beta * found.beta_texture.values[..., 0]
    assert betas == pytest.approx(0.6 * pixels[..., 3] / 255.0 / (4.0 * math.pi * width**2), rel=1e-4)
    assert not any("gloss, which" in each for each in lost)


@pytest.mark.parametrize("one_colour", [True, False])
def test_colours_of_gloss_by_place_are_a_colour_and_its_factor(tmp_path, one_colour):
    """F0 = 0.04 · colour: β follows its largest band at each pixel, of several colours the mean stands, and is said."""
    levels = np.array([[0.1, 0.4, 0.9], [1.0, 0.6, 0.2]])
    linear_colours = levels[..., None] * np.array([1.0, 0.5, 0.25])  # R, G, B
    if not one_colour:
        linear_colours[0] = linear_colours[0, :, ::-1]
    pixels = np.full((2, 3, 4), 255, np.uint8)
    pixels[..., 2::-1] = srgb_encode(linear_colours)  # OpenCV's B, G, R, A
    exact = srgb_decode(pixels[..., 2::-1])

    def change(record, material):
        record["images"].append({"uri": grey(pixels)})
        record["samplers"] = [{"magFilter": 9728}]
        record["textures"].append({"source": 1, "sampler": 0})
        pbr = {"metallicFactor": 0.0, "roughnessFactor": 0.5, "baseColorFactor": [0.2, 0.2, 0.2, 1.0]}
        material["pbrMetallicRoughness"] |= pbr
        colours = {"specularColorTexture": {"index": 1}, "specularColorFactor": [0.5, 0.5, 0.5]}
        material["extensions"] = {"KHR_materials_specular": colours}

    found, lost = foreign(tmp_path, change)
    assert found.beta_texture is not None
    betas = found.reflectance.beta * found.beta_texture.values[..., 0]
    assert betas == pytest.approx(0.5 * exact.max(axis=2) / (4.0 * math.pi * 0.5**4), rel=2e-4)
    assert any("colour of its gloss by place" in each for each in lost) != one_colour
    if one_colour:
        r, g, b = linear(found.reflectance.interface_colour)
        assert (g / r, b / r) == pytest.approx((0.5, 0.25), rel=0.03)


def test_textures_of_gloss_come_back(tmp_path):
    """γ to half a step of roughness, β to half a step of its factor in 255."""
    gammas = np.array([[0.15, 0.1, 0.2], [0.3, 0.4, 0.25]])
    factors = np.array([[1.0, 0.5, 0.8], [0.2, 0.1, 0.3]])
    more = {
        "gamma_texture": hg.SurfaceTexture(gammas, smooth=False),
        "beta_texture": hg.SurfaceTexture(factors, smooth=False),
    }
    (found,), lost = there_and_back(tmp_path, surface(0.2, 0.3, 0.15, 1.5, **more))
    assert found.gamma_texture is not None and found.beta_texture is not None
    rough = np.sqrt(np.tan(gammas) / math.sqrt(math.sqrt(2.0) - 1.0))
    got = np.sqrt(np.tan(found.gamma_texture.values[..., 0]) / math.sqrt(math.sqrt(2.0) - 1.0))
    assert np.abs(got - rough).max() <= 0.501 / 255.0
    strength = 4.0 * math.pi * got**4 * 0.3 * factors
    betas = found.reflectance.beta * found.beta_texture.values[..., 0]
    assert (np.abs(betas - 0.3 * factors) <= 0.51 / 255.0 * strength.max() / (4.0 * math.pi * got**4)).all()
    assert not found.beta_texture.smooth and not any("texture" in each for each in lost)


def test_gloss_between_rough_and_smooth_neighbours_keeps_to_the_light_received(tmp_path):
    """A smooth image of the narrowest beside the widest facets: read, with a line, and no refusal."""
    pixels = np.zeros((4, 4, 3), np.uint8)
    pixels[:, :2, 1], pixels[:, 2:, 1] = 10, 255

    def change(record, material):
        record["images"].append({"uri": grey(pixels)})
        record["textures"].append({"source": 1})
        material["pbrMetallicRoughness"] |= {"metallicFactor": 0.0, "metallicRoughnessTexture": {"index": 1}}

    found, lost = foreign(tmp_path, change)
    assert found.gamma_texture is not None and any("of its gloss, which would" in each for each in lost)


@pytest.mark.parametrize("number", [float("nan"), 1e400, "x", None, [1.0]])
def test_numbers_that_are_none_are_refused(tmp_path, number):
    def change(_, material):
        material["pbrMetallicRoughness"] |= {"metallicFactor": 0.0, "roughnessFactor": number}

    with pytest.raises(InputError) as refused:
        foreign(tmp_path, change)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(("base", "rough"), [(0.5, 0.2), (0.8, 0.3), (0.8, 0.5)])
def test_bright_glossy_bodies_of_others_keep_their_highlights(tmp_path, base, rough):
    """Seen along the normal and at 30°, the BRDF of the specification (GGX, Smith, Schlick) to 5 % of its root mean
    square over lamps within 75°: there the gloss dims the body, here it rises less.
    """

    def change(_, material):
        del material["pbrMetallicRoughness"]["baseColorTexture"]
        factors = {"baseColorFactor": [base] * 3 + [1.0], "metallicFactor": 0.0, "roughnessFactor": rough}
        material["pbrMetallicRoughness"] |= factors

    found, lost = foreign(tmp_path, change)
    made, angles, width = found.reflectance, np.radians(np.linspace(-75.0, 75.0, 61)), rough**2
    to_lamp = np.stack([np.sin(angles), 0.0 * angles, np.cos(angles)])
    for tilt in (0.0, math.radians(30.0)):
        to_eye = np.repeat([[math.sin(tilt)], [0.0], [math.cos(tilt)]], 61, axis=1)
        half = (to_lamp + to_eye) / np.linalg.norm(to_lamp + to_eye, axis=0)
        density = width**2 / (math.pi * (half[2] ** 2 * (width**2 - 1.0) + 1.0) ** 2)
        seen = [1.0 / (c + np.sqrt(width**2 + (1.0 - width**2) * c * c)) for c in (to_lamp[2], to_eye[2])]
        fresnel = 0.04 + 0.96 * (1.0 - (half * to_eye).sum(axis=0)) ** 5
        theirs = to_lamp[2] * (base / math.pi * (1.0 - fresnel) + fresnel * density * seen[0] * seen[1])
        weights = made.weights(
            *(arrays().Array3f(*each) for each in (np.repeat([[0.0], [0.0], [1.0]], 61, 1), to_lamp, to_eye))
        )
        ours = np.array(weights.body) * made.body_colour.at(550.0) + np.array(weights.interface)
        assert np.sqrt(((ours - theirs) ** 2).mean()) < 0.05 * np.sqrt((theirs**2).mean())
    assert any("how its gloss rises" in each for each in lost)
