"""A varnish over the body: photons walk through it in double precision, and everything that shows it agrees.

The walk knows only Snell, Fresnel (by sines and tangents), Beer and Lambert; it has none of the closed forms.
"""

import math
from dataclasses import replace
from itertools import pairwise, product

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
import hagoromo_formats.mitsuba as hm
from hagoromo import backend
from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.colour import linear_colour
from hagoromo.reflectance.varnish import Varnish, sent_back
from hagoromo.transport.materials import Materials
from hagoromo.transport.palette import palette_of
from hagoromo.transport.path.scatter import Scattering
from tests.judges import mean_is

RED = hg.Spectrum([400, 550, 600, 700], [0.05, 0.1, 0.7, 0.8])
PAINT = hg.Reflectance(1.0 / math.pi, 0.0, 0.2, 1.5, RED, name="paint")
VARNISHES = [(1.5, 0.0), (1.5, 0.2), (1.0, 0.3), (2.2, 0.05)]
PHOTONS, BOUNCES = 100_000, 200
SPECULAR = 1.0 - 1e-9  # cosines above this stand for the normal, where sines and tangents are 0
WAVES = (450.0, 600.0, 650.0)
STEPS = np.array([0.0, 0.35, 0.6, 0.8, 1.0])  # of cosines to the eye, limits of the bins


def fresnel_passed(cosine, ratio):
    """Share of light that passes a boundary, and its cosine behind it: sinθ' = ratio sinθ; 0 where that is above 1."""
    cosine = np.minimum(cosine, SPECULAR)
    here = np.arccos(cosine)
    sine = ratio * np.sin(here)
    there = np.arcsin(np.minimum(sine, 1.0))
    with np.errstate(divide="ignore", invalid="ignore"):
        s = np.sin(here - there) / np.sin(here + there)
        p = np.tan(here - there) / np.tan(here + there)
    passed = 1.0 - 0.5 * (s * s + p * p) if ratio != 1.0 else np.ones_like(cosine)
    return np.where(sine < 1.0, passed, 0.0), np.cos(there)


def walked(albedo, n, depth, incidence, seed):
    """Share of light from cosθ_i that each photon brings into each bin of cosines to the eye: (PHOTONS, bins)."""
    random, bins = np.random.default_rng(seed), np.zeros((PHOTONS, len(STEPS) - 1))
    passed, within = fresnel_passed(np.full(PHOTONS, incidence), 1.0 / n)
    weight = passed * np.exp(-depth / within)
    for _ in range(BOUNCES):
        up = np.sqrt(random.uniform(size=PHOTONS))
        weight = albedo * weight * np.exp(-depth / up)
        leaves, outside = fresnel_passed(up, n)
        number = np.clip(np.searchsorted(STEPS, outside) - 1, 0, len(STEPS) - 2)
        bins[np.arange(PHOTONS), number] += weight * leaves
        weight = weight * (1.0 - leaves) * np.exp(-depth / up)
        if weight.max() < 1e-9:
            return bins
    raise AssertionError("photons are still on their way")


def expected(albedo, n, depth, incidence):
    """What `evaluate` has of it: 2π ∫ f/cosθ_i cosθ_r d cosθ_r over each bin."""
    made = replace(PAINT, body_colour=hg.Spectrum.constant(albedo), varnish_n=n, varnish_depth=depth)
    lamp = [math.sqrt(1.0 - incidence**2), 0.0, incidence]
    nodes, weights = np.polynomial.legendre.leggauss(64)
    shares = []
    for low, high in pairwise(STEPS):
        eye = low + (high - low) * 0.5 * (1.0 + nodes)
        f = made.evaluate([0, 0, 1], lamp, np.stack([np.sqrt(1.0 - eye**2), 0.0 * eye, eye], axis=-1))[:, 0]
        shares.append(math.pi * (high - low) * np.sum(weights * f * eye) / incidence)
    return np.array(shares)


@pytest.mark.parametrize("varnish", VARNISHES)
@pytest.mark.parametrize("albedo, incidence", [(0.9, 1.0), (0.4, 0.5)])
def test_photons_leave_as_the_formula_has_it(varnish, albedo, incidence):
    """In four bins of cosines to the eye, each at a significance of 0.1 %; under another depth they do not."""
    n, depth = varnish
    bins = walked(albedo, n, depth, incidence, seed=4)
    truth, other = (expected(albedo, n, one, incidence) for one in (depth, depth + 0.05))
    assert all(mean_is(share, one) for share, one in zip(bins.T, truth, strict=True))
    assert not all(mean_is(share, one) for share, one in zip(bins.T, other, strict=True))


def test_the_layer_sends_back_what_is_tabled():
    """K of n = 1.5 without absorption is 0.596, which paint makers round to 0.6; and a sum over cosines within."""
    assert sent_back(1.5, 0.0) == pytest.approx(0.596, abs=5e-4)
    cosines = (np.arange(200_000) + 0.5) / 200_000
    for n, depth in VARNISHES:
        reflected = 1.0 - fresnel_passed(cosines, n)[0]
        summed = 2.0 * np.mean(reflected * np.exp(-2.0 * depth / cosines) * cosines)
        assert sent_back(n, depth) == pytest.approx(summed, abs=1e-6)


@pytest.mark.parametrize("varnish", VARNISHES)
def test_lamp_and_eye_can_change_places(varnish):
    made = replace(PAINT, varnish_n=varnish[0], varnish_depth=varnish[1], epsilon=0.2, sigma=0.1)
    random = np.random.default_rng(0).normal(size=(2, 500, 3))
    random[..., 2] = abs(random[..., 2])
    one, two = random / np.linalg.norm(random, axis=-1, keepdims=True)
    there, back = made.evaluate([0, 0, 1], one, two), made.evaluate([0, 0, 1], two, one)
    np.testing.assert_allclose(there / one[:, 2:], back / two[:, 2:], rtol=1e-9)


def test_a_white_body_sends_back_all_that_enters():
    """Its albedo is T of the view: what enters leaves again, after however many turns. To the quadrature, 48 nodes."""
    white = replace(PAINT, body_colour=hg.Spectrum.constant(1.0), varnish_n=1.5)
    passed, _ = fresnel_passed(np.cos(np.radians([0, 45, 72, 86])), 1.0 / 1.5)
    np.testing.assert_allclose(white.directional_albedo()[[0, 3, 6, 9]], passed, rtol=1e-4)
    assert (replace(white, varnish_depth=0.1).directional_albedo() < white.directional_albedo()).all()
    with pytest.raises(InputError, match=r"breaks energy conservation: without varnish_n its body reflects 1\.100"):
        replace(white, alpha=1.1 / math.pi)


def test_without_index_and_depth_it_is_lamberts_law_and_an_absorber_is_beers(double_precision):
    plain = replace(PAINT, varnish_n=1.0, varnish_depth=0.0)
    assert plain == PAINT and plain.has_lambert_body and plain.shown_body_colour is plain.body_colour
    assert not {"varnish_n", "varnish_depth"} & plain.record().keys()
    lamp, eye = [0.6, 0.0, 0.8], [0.0, 0.28, 0.96]
    dyed = replace(PAINT, varnish_depth=0.3).evaluate([0, 0, 1], lamp, eye, [450, 650])
    beer = math.exp(-0.3 * (1.0 / 0.8 + 1.0 / 0.96))
    np.testing.assert_allclose(dyed, beer * PAINT.evaluate([0, 0, 1], lamp, eye, [450, 650]), rtol=double_precision)


def test_colours_become_darker_and_more_saturated():
    """A red of 0.1 and 0.75 by n = 1.5: both darker, the lower one more, as multiple turns favour what is bright."""
    f = [made.evaluate([0, 0, 1], [0, 0, 1], [0, 0, 1], [550, 650]) for made in (PAINT, replace(PAINT, varnish_n=1.5))]
    ratio = f[1] / f[0]
    assert ratio[0] < 0.45 < ratio[1] < 0.8 and ratio[1] > 1.5 * ratio[0]


def test_the_colour_between_knots_is_that_of_each_wavelength():
    """The colour as it shows is straight between steps of 5 nm; f is right to 1e-4 of its largest value."""
    made = replace(PAINT, varnish_n=1.5, varnish_depth=0.1)
    waves = np.arange(400.0, 700.5, 0.5)
    each = [
        replace(made, body_colour=hg.Spectrum.constant(c)).evaluate([0, 0, 1], [0, 0, 1], [0, 0, 1])[0]
        for c in RED.at(waves[::20])
    ]
    f = made.evaluate([0, 0, 1], [0, 0, 1], [0, 0, 1], waves)
    np.testing.assert_allclose(f[::20], np.ravel(each), atol=1e-4 * f.max())


def test_a_colour_takes_no_more_wavelengths_than_are_seen():
    """Whatever a file says: steps of 5 nm lie between 360 and 830 nm."""
    far = replace(PAINT, body_colour=hg.Spectrum([1.0, 400.0, 1e15], [0.1, 0.2, 0.3]), varnish_n=1.5)
    assert len(far.shown_body_colour.wavelengths) < 100
    short = replace(PAINT, body_colour=hg.Spectrum([500.0, 503.0], [0.1, 0.2]), varnish_n=1.5)
    assert short.shown_body_colour.wavelengths.tolist() == [500.0, 503.0]


def panel(**of_surface):
    """A painted panel lit from aside: the picture of its middle in linear channels, in a mode."""
    floor = hg.Surface.floor(0.0, 1.0, of_surface.pop("reflectance"))
    camera = hg.Camera(6, 4, (40.0, 40.0), (3.0, 2.0)).look_at((0.0, -1.0, 1.0), (0.0, 0.0, 0.0))
    return hg.Scene(camera, (hg.Lamp(to_lamp=(0.6, 0.0, 0.8)),), (), (replace(floor, **of_surface),))


def seen(image, waves=(450.0, 650.0)):
    """Radiance per lamp at wavelengths: the mean over pixels of the weights times the colours of the palette."""
    colours = np.array([spectrum.at(waves) for spectrum in image.palette.colours])
    return np.asarray(image.weights, float).reshape(-1, image.weights.shape[-1]).mean(axis=0) @ colours


@pytest.mark.parametrize("mode", ["march", "full", "path"])
def test_every_mode_shows_it(mode):
    """Flat ground does not light itself: its radiance is f, which changes by less than 3e-3 over the view."""
    varnished = replace(PAINT, varnish_n=1.5, varnish_depth=0.2, epsilon=0.1)
    image = hg.render(panel(reflectance=varnished), hg.Settings(samples=8, walks=0), mode=mode)
    f = varnished.evaluate([0, 0, 1], [0.6, 0.0, 0.8], [0.0, -1.0, 1.0], [450, 650])
    np.testing.assert_allclose(seen(image), f, rtol=3e-3)


def test_a_texture_shows_it_place_by_place():
    """Each value as a body colour of its own: greys as body colours are, to rounding.

    A pure red is c' of its value times its spectrum B. That is brighter than what c B becomes, as c' is convex in c,
    where B is between 0 and 1.
    """
    varnished = replace(PAINT, varnish_n=1.5, varnish_depth=0.1)
    for grey in (0.3, 0.6):
        texture = hg.SurfaceTexture(np.full((2, 2, 3), grey))
        textured = seen(hg.render(panel(reflectance=varnished, body_texture=texture)))
        same = replace(varnished, body_colour=hg.Spectrum.constant(grey))
        np.testing.assert_allclose(textured, seen(hg.render(panel(reflectance=same))), rtol=1e-5)
    red = hg.SurfaceTexture(np.full((2, 2, 3), (0.8, 0.0, 0.0)))
    textured, own = seen(hg.render(panel(reflectance=varnished, body_texture=red)), WAVES), red.spectra[0]
    shown = replace(varnished, body_colour=hg.Spectrum.constant(0.8))
    np.testing.assert_allclose(textured, seen(hg.render(panel(reflectance=shown)), WAVES) * own.at(WAVES), rtol=1e-5)
    exact = replace(varnished, body_colour=hg.Spectrum(own.wavelengths, 0.8 * own.values))
    assert (textured > seen(hg.render(panel(reflectance=exact)), WAVES)).all()


@pytest.mark.parametrize("depth, most", [(0.0, 0.07), (0.2, 0.022)])
def test_a_texture_is_as_near_as_the_page_of_the_model_says(depth, most):
    """Values of R, G, B up to 0.8, against the law at each wavelength: linear sRGB under D65, in parts of white."""
    texture, waves = hg.SurfaceTexture(np.ones((2, 2, 3)) * (0.8, 0.4, 0.1)), np.arange(400.0, 701.0, 5.0)
    basis, day = np.array([one.at(waves) for one in texture.spectra]), hg.Spectrum.named("D65")
    layer = Varnish(varnish_n=1.5, varnish_depth=depth)
    shown = lambda colour: layer.shown_colour(colour, 1.0 / math.pi)  # noqa: E731
    errors = []
    for values in product((0.0, 0.4, 0.8), repeat=3):
        exact, ours = shown(np.array(values) @ basis), shown(np.array(values)) @ basis
        assert (ours > exact - 1e-12).all()
        errors.append(linear_colour(hg.Spectrum(waves, ours - exact), day) / shown(0.8))
    assert np.abs(errors).max() < most


def test_walks_draw_it_with_its_albedo():
    """The mean weight of what mode path draws is the albedo seen from there: significance 0.1 %."""
    made = replace(PAINT, varnish_n=1.5, varnish_depth=0.2)
    materials = Materials([made, PAINT], palette_of([made, PAINT], [], [hg.Spectrum.constant(1.0)]))
    jit, count = arrays(), 50_000
    numbers = [jit.Float(row.astype(np.float32)) for row in np.random.default_rng(3).uniform(size=(5, count))]
    for number, one in enumerate((made, PAINT)):
        view = jit.Array3f(math.sin(math.radians(65.0)), 0.0, math.cos(math.radians(65.0)))
        axis, which = jit.Array3f(0, 0, 1), dr.full(jit.UInt, number, count)
        _, weights, good = Scattering([made, PAINT], materials).drawn(which, axis, view, numbers)
        drawn = np.array(dr.select(good, weights[0], 0.0)) * float(one.shown_body_colour.at(700.0))
        truth = one.directional_albedo()[5]
        assert mean_is(drawn, truth, tolerance=1e-3) if drawn.std() > 1e-6 else abs(drawn.mean() - truth) < 1e-5


@pytest.mark.parametrize("variant", ["rgb", "spectral"])
def test_mitsuba_shows_it(variant):
    """Of a grey in both variants; of our red by each wavelength in the spectral one."""
    import mitsuba as mi

    mi.set_variant(f"{backend.name()}_ad_{variant}")
    hm.register()
    try:
        colour = RED if variant == "spectral" else hg.Spectrum.constant(0.7)
        made = replace(PAINT, body_colour=colour, varnish_n=1.5, varnish_depth=0.2)
        si = dr.zeros(mi.SurfaceInteraction3f, 3)
        si.wi = mi.Vector3f([0.0, 0.6, 0.0], 0.0, [1.0, 0.8, 1.0])
        wo = mi.Vector3f([0.0, 0.0, 0.96], 0.0, [1.0, 1.0, 0.28])
        waves = [450.0, 550.0, 620.0, 650.0]
        if mi.is_spectral:
            si.wavelengths = mi.Spectrum(*waves)
        shown = np.array(mi.load_dict(hm.bsdf(made)).eval(mi.BSDFContext(), si, wo))
    finally:
        backend.mitsuba()
    f = made.evaluate([0, 0, 1], [[0, 0, 1], [0, 0, 1], [0.96, 0, 0.28]], [[0, 0, 1], [0.6, 0, 0.8], [0, 0, 1]], waves)
    np.testing.assert_allclose(shown, f.T[: len(shown)], rtol=2e-4)


def test_what_has_no_place_for_it_is_refused():
    varnished = replace(PAINT, varnish_n=1.5, alpha=0.2)
    with pytest.raises(InputError, match="element is 'sphere': give varnish_n to planes only"):
        replace(varnished, element="sphere")
    density, axis = np.ones((3, 3, 3), np.float32), np.ones((3, 3, 3, 3), np.float32)
    colours = np.full((3, 3, 3, 1), 0.5, np.float32)
    with pytest.raises(InputError, match="its voxels have colours of their own, and varnish_n of material 'paint'"):
        hg.VolumeBox.from_arrays(
            density, axis, 0.01, 50.0, [varnished], body_colour=colours, basis=(hg.Spectrum.constant(1.0),)
        )
