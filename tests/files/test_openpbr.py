"""OpenPBR: its terms against furnaces and another program's formula, and the document against what its nodes take."""

from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
import pytest

import hagoromo as hg
from hagoromo_formats.relightable.materialx import write_openpbr
from hagoromo_formats.relightable.openpbr import OpenPbr, difference, directions, open_pbr
from studies.merl_rival import ggx
from tests.app.published_ball import TRUTHS, estimate
from tests.inverse.simulated_ball import BallMaterial

WHITE = (1.0, 1.0, 1.0)
PAINT = estimate("paint, red", BallMaterial((0.2, 0.15, 0.1), 0.9, 0.12, 1.5))
INPUTS = {  # those of ND_open_pbr_surface_surfaceshader of MaterialX 1.39 that are written
    "base_color": "color3", "base_diffuse_roughness": "float", "specular_weight": "float", "specular_color": "color3",
    "specular_roughness": "float", "specular_ior": "float",
}  # fmt: skip


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2])
def test_directions_cover_the_half_sphere(angle):
    pairs = directions(angle)
    assert pairs.weight.sum() == pytest.approx(2.0 * np.pi, rel=2e-3)
    assert (pairs.eye * pairs.weight).sum() == pytest.approx(np.pi, rel=1e-4)


@pytest.mark.parametrize("angle", [0.0, 0.5, 1.2])
@pytest.mark.parametrize("rough", [0.0, 0.4, 1.0])
def test_a_white_body_gives_all_light_back(angle, rough):
    """White furnace: what EON is made for."""
    surface, pairs = OpenPbr(WHITE, rough, 0.0, WHITE, 0.5, 1.5), directions(angle)
    sent = (surface.brdf(pairs, np.zeros_like)[:, 0] * pairs.eye * pairs.weight).sum()
    assert sent == pytest.approx(1.0, abs=1e-4)


def test_the_interface_is_that_of_ggx():
    """As the study of MERL has it, which was written apart: times cosθ_i there."""
    surface, pairs = OpenPbr(WHITE, 0.0, 1.0, WHITE, 0.5, 1.5), directions(0.7)
    lamp = np.full_like(pairs.eye, pairs.lamp)
    expected = ggx(hg.Cosines(lamp, pairs.eye, pairs.half, pairs.deviation), 0.25, 1.5, 0.0) / pairs.lamp
    np.testing.assert_allclose(surface.interface(pairs), expected, rtol=1e-9)


@pytest.mark.parametrize("weight", [0.5, 1.0, 2.0])
def test_a_smooth_interface_reflects_as_fresnel_says(weight):
    """Along the normal specular_weight F₀, to what facets of 0.6° spread."""
    surface = OpenPbr((0.0, 0.0, 0.0), 0.0, weight, WHITE, 0.1, 1.5)
    assert float(surface.albedo()(np.array([1.0]))[0]) == pytest.approx(0.04 * weight, rel=2e-3)


def test_a_matte_body_is_carried_without_a_difference():
    chalk = estimate("chalk", BallMaterial((0.2, 0.25, 0.3), 0.0, 0.2, 1.5))
    assert difference(chalk, open_pbr(chalk)) == pytest.approx((0.0, 0.0, 0.0), abs=1e-6)
    assert open_pbr(chalk).base_color == pytest.approx(np.pi * np.array([0.2, 0.25, 0.3]), rel=1e-5)


def test_the_difference_grows_with_what_openpbr_cannot_have():
    """Gaussian facets within 10 % up to 60°; with a further lobe or another exponent it is more."""
    off = difference(PAINT, open_pbr(PAINT))
    assert max(off) < 0.1
    for other in (replace(PAINT, lobes=((1.0, 0.4),)), replace(PAINT, epsilon=0.3)):
        assert difference(other, open_pbr(other))[0] > 1.5 * off[0]


@pytest.mark.parametrize("sigma", [0.0, 0.4, 1.0])
def test_a_rough_body_is_as_bright_under_even_light(sigma):
    """Over all lamps and eyes; the interface left out."""
    chalk = estimate("chalk", BallMaterial((0.2, 0.2, 0.2), 0.0, 0.2, 1.5))
    surface, sent = open_pbr(replace(chalk, sigma=sigma)), [0.0, 0.0]
    nodes, weights = np.polynomial.legendre.leggauss(24)
    for x, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
        pairs = directions(float(np.arccos(x)))
        s = 2.0 * pairs.deviation**2 - 1.0 - pairs.lamp * pairs.eye
        ours = 0.2 * (1.0 + sigma * s / np.where(s > 0.0, np.maximum(pairs.lamp, pairs.eye), 1.0))
        each = surface.brdf(pairs, np.zeros_like)[:, 0], ours
        sent = [
            old + 2.0 * weight * x * (f * pairs.eye * pairs.weight).sum() for old, f in zip(sent, each, strict=True)
        ]
    assert sent[0] == pytest.approx(sent[1], rel=1e-3)


def test_the_document_has_the_inputs_of_the_node(tmp_path):
    materials = [PAINT, *(estimate(f"ball {k}", truth) for k, truth in enumerate(TRUTHS))]
    off = write_openpbr(tmp_path / "a.mtlx", materials)
    root = ElementTree.parse(tmp_path / "a.mtlx").getroot()
    shaders, surfaces = root.findall("open_pbr_surface"), root.findall("surfacematerial")
    assert len(shaders) == len(surfaces) == len(off) == 3 and root.get("version") == "1.39"
    for shader, surface, each in zip(shaders, surfaces, off, strict=True):
        assert {one.get("name"): one.get("type") for one in shader} == INPUTS
        assert surface[0].get("nodename") == shader.get("name")
        assert f"{100 * each[0]:.0f} % at 0°" in str(shader.get("doc")) and "GGX" in str(shader.get("doc"))
    values = {one.get("name"): str(one.get("value")) for one in shaders[2]}
    tint = np.array([float(one) for one in values["specular_color"].split(", ")])
    np.testing.assert_allclose(tint, np.array([1.2, 1.0, 0.8]) / 1.2, rtol=1e-5)


def test_materialx_takes_the_document(tmp_path):
    mx = pytest.importorskip("MaterialX")
    write_openpbr(tmp_path / "a.mtlx", [PAINT])
    document = mx.createDocument()
    mx.loadLibraries(mx.getDefaultDataLibraryFolders(), mx.getDefaultDataSearchPath(), document)
    mx.readFromXmlFile(document, str(tmp_path / "a.mtlx"))
    valid, message = document.validate()
    assert valid, message
