"""The plugin `hagoromo` of Mitsuba is our reflectance: its values, its sampler, its energy, in every variant.

Values are held against `Reflectance.weights` in double precision; the sampler is judged by Mitsuba's own
chi-square test.
"""

import math

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
import hagoromo_formats.mitsuba as hm
from hagoromo import backend
from hagoromo.errors import InputError
from hagoromo.light.colour import linear_colour
from tests.judges import mean_is
from tests.laws.test_gloss_classes import MATERIAL

SILK = hg.Reflectance(
    0.2, 0.3, 0.25, 1.5, hg.Spectrum([400, 550, 700], [0.2, 0.6, 1.0]), hg.Spectrum([400, 700], [0.8, 1.0])
)
MATERIALS = {
    "silk": SILK,
    "tails and lobes": hg.Reflectance(0.1, 0.8, 0.15, 1.6, hg.Spectrum.constant(0.7), lobes=((0.5, 0.1),), nu=2.0),
    "rough body": hg.Reflectance(0.2, 0.1, 0.4, 1.4, hg.Spectrum.constant(0.8), epsilon=0.3, sigma=0.4),
}
ROUNDING = 2e-4  # relative, of single precision: the angle of a half vector, in widths of the facets
DOT_ROUNDING = 2e-6  # of L·V, which the length of L + V is computed from; it is short where L = −V


@pytest.fixture(params=["rgb", "spectral", "mono"])
def mi(request):
    """Mitsuba in one of the variants that have the plugin, and afterwards in that of the package again."""
    import mitsuba

    mitsuba.set_variant(f"{backend.name()}_ad_{request.param}")
    hm.register()
    yield mitsuba
    backend.mitsuba()


def directions(count, seed):
    """Unit directions (3, count), uniform over the sphere."""
    ways = np.random.default_rng(seed).normal(size=(3, count))
    return ways / np.linalg.norm(ways, axis=0)


def interaction(mi, wi, wavelengths=(450.0, 500.0, 550.0, 650.0)):
    si = dr.zeros(mi.SurfaceInteraction3f, wi.shape[1])
    si.wi = mi.Vector3f(wi.astype(np.float32))
    if mi.is_spectral:
        si.wavelengths = mi.Spectrum(*wavelengths)
    return si


def colours(mi, spectrum):
    """The values of a spectrum in the variant: at the wavelengths of `interaction`, or in linear sRGB under D65."""
    if mi.is_spectral:
        return spectrum.at(np.array([450.0, 500.0, 550.0, 650.0]))
    if np.ptp(spectrum.values) == 0.0:
        return np.repeat(spectrum.values[:1], 3 if mi.is_rgb else 1)
    rgb = linear_colour(spectrum, hg.Spectrum.named("D65"))
    return rgb if mi.is_rgb else np.array([rgb @ (0.2126, 0.7152, 0.0722)])


@pytest.mark.parametrize("name", MATERIALS)
def test_values_are_those_of_our_reflectance(mi, name):
    """In all directions, from above and from below."""
    made, wi, wo = MATERIALS[name], directions(2000, 1), directions(2000, 2)
    wi[2, ::2] = np.sign(wo[2, ::2]) * np.abs(wi[2, ::2])
    seen = np.array(mi.load_dict(hm.bsdf(made)).eval(mi.BSDFContext(), interaction(mi, wi), mi.Vector3f(wo)))
    real, side = backend.arrays().Array3f64, np.sign(wi[2])
    lifted = [np.float32(ways).astype(float) * np.array([1.0, 1.0, 0.0])[:, None] for ways in (wi, wo)]
    for ways, given in zip(lifted, (wi, wo), strict=True):
        ways[2] = side * np.float32(given[2])
    weights = made.weights(real(0, 0, 1), real(lifted[1]), real(lifted[0]))
    body, interface = (np.array(each) for each in weights)
    truth = np.outer(colours(mi, made.body_colour), body) + np.outer(colours(mi, made.interface_colour), interface)
    assert (truth > 0).mean() > 0.3 and (truth == 0).any()
    cos_squared = 0.5 + 0.5 * np.sum(lifted[0] * lifted[1], axis=0)  # of half the angle between eye and lamp
    assert (np.abs(seen - truth) <= (ROUNDING + DOT_ROUNDING / cos_squared) * truth + 1e-6).all()


@pytest.mark.parametrize("name", MATERIALS)
@pytest.mark.parametrize("polar", [0.1, 1.2])
def test_the_sampler_follows_its_density(name, polar, tmp_path, monkeypatch):
    """Significance 0.1 %; a sampler of facets half as wide again is refused."""
    monkeypatch.chdir(tmp_path)  # where Mitsuba writes its table if the test fails
    backend.mitsuba()
    from mitsuba.chi2 import BSDFAdapter, ChiSquareTest, SphericalDomain

    record = hm.bsdf(MATERIALS[name])
    wi = [math.sin(polar), 0.0, math.cos(polar)]

    def agrees(shown):
        drawn, _ = BSDFAdapter("hagoromo", shown, wi=wi)
        _, density = BSDFAdapter("hagoromo", record, wi=wi)
        return ChiSquareTest(SphericalDomain(), drawn, density, 3, 200_000, res=51, ires=8).run(1e-3, quiet=True)

    assert agrees(record)
    assert not agrees(record | {"gamma": 1.5 * record["gamma"]})


def test_what_is_drawn_weighs_what_is_sent_on(mi):
    """The mean weight is the albedo: a white Lambert surface sends all back, and silk what quadrature says."""
    count = 100_000
    for made in (hg.Reflectance(1 / math.pi, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0)), MATERIALS["tails and lobes"]):
        plugin = mi.load_dict(hm.bsdf(made))
        wi = np.repeat([[0.0], [0.0], [1.0]], count, axis=1)
        sampler = mi.load_dict({"type": "independent"})
        sampler.seed(3, count)
        numbers = sampler.next_1d(), sampler.next_2d()
        drawn, weight = plugin.sample(mi.BSDFContext(), interaction(mi, wi), *numbers)
        value, density = plugin.eval_pdf(mi.BSDFContext(), interaction(mi, wi), drawn.wo)
        assert np.allclose(np.array(weight * density), np.array(value), rtol=1e-4, atol=1e-7)
        weights, truth = np.array(weight)[0], float(made.directional_albedo()[0])
        assert mean_is(weights, truth, tolerance=1e-3) if weights.std() > 1e-6 else abs(weights.mean() - truth) < 1e-5


def test_eye_and_lamp_change_places(mi):
    for made in MATERIALS.values():
        plugin, (one, two) = mi.load_dict(hm.bsdf(made)), (np.abs(directions(1000, seed)) for seed in (5, 6))
        there = np.array(plugin.eval(mi.BSDFContext(), interaction(mi, one), mi.Vector3f(two))) / two[2]
        back = np.array(plugin.eval(mi.BSDFContext(), interaction(mi, two), mi.Vector3f(one))) / one[2]
        assert np.allclose(there, back, rtol=2e-4, atol=1e-6)


def test_xml_takes_a_measured_material_and_parameters(tmp_path):
    """A materials.json by its name, as it is read by the package; parameters as numbers; textures as colours."""
    mi = backend.mitsuba()
    hm.register()
    file = hg.write_materials([MATERIAL], tmp_path / "materials.json")
    text = f"<bsdf type='hagoromo'><string name='file' value='{file}'/><string name='material' value='glaze'/></bsdf>"
    scene = mi.load_string(f"<scene version='3.0.0'><shape type='sphere'>{text}</shape></scene>")
    ours, wi = mi.load_dict(hm.bsdf(MATERIAL.reflectance())), np.abs(directions(100, 7))
    wo = mi.Vector3f(np.abs(directions(100, 8)))
    seen = [each.eval(mi.BSDFContext(), interaction(mi, wi), wo) for each in (scene.shapes()[0].bsdf(), ours)]
    assert np.array_equal(np.array(seen[0]), np.array(seen[1]))
    by_numbers = "".join(f"<float name='{k}' value='{v}'/>" for k, v in
                         (("alpha", 0.2), ("beta", 0.0), ("gamma", 0.2), ("n", 1.5)))  # fmt: skip
    chess = "<texture type='checkerboard' name='body_colour'/>"
    text = (
        f"<scene version='3.0.0'><shape type='sphere'><bsdf type='hagoromo'>{by_numbers}{chess}</bsdf></shape></scene>"
    )
    plugin, si = mi.load_string(text).shapes()[0].bsdf(), interaction(mi, np.repeat([[0.0], [0.0], [1.0]], 2, axis=1))
    si.uv = mi.Point2f([0.3, 0.7], [0.3, 0.3])
    value = np.array(plugin.eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, 1)))
    assert np.allclose(value[0], [0.08, 0.04], rtol=1e-5)  # alpha times the 0.4 and 0.2 of a checkerboard
    params = mi.traverse(plugin)
    params["alpha"] = 0.1
    params.update()
    assert np.allclose(np.array(plugin.eval(mi.BSDFContext(), si, mi.Vector3f(0, 0, 1)))[0], [0.04, 0.02], rtol=1e-5)


def test_what_mitsuba_cannot_hold_is_refused_in_one_line(tmp_path):
    import mitsuba

    mi = backend.mitsuba()
    hm.register()
    for made, words in (
        (hg.Reflectance(0.2, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0), element="sphere"), "give a 'plane'"),
        (hg.Reflectance(0.1, 0.0, 0.2, 1.5, hg.Spectrum.constant(1.0), transmission=0.5), "transmission = 0"),
    ):
        with pytest.raises(InputError, match=words):
            hm.bsdf(made)
    for change, words in (
        ({"alpha": 0.9}, "energy conservation"),
        ({"lobes": "0.5"}, "lobes"),
        ({"n": 0.2}, "n is 0.2"),
    ):
        with pytest.raises(Exception, match=words):
            mi.load_dict(hm.bsdf(SILK) | change)
    mitsuba.set_variant("scalar_rgb")
    with pytest.raises(InputError, match="scalar variants"):
        hm.register()
    backend.mitsuba()
