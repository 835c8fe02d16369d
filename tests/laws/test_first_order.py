"""Eq. (2)–(12) with one scattering event: the march against an independent oracle in float64, in absolute radiance.

`tests/oracle` computes the same light from the equations alone; first it is held to closed forms and to its own
convergence. The promise of `Settings.tolerance`, root mean square over the mean where there is matter, is then tested
as it is given, with marched shadows and with shadow maps.
"""

import math
from functools import cache

import numpy as np
import pytest

import hagoromo as hg
from tests.oracle.radiance import radiance
from tests.oracle.reflection import element_weights, plane
from tests.oracle.scenes import GREY, WAVELENGTHS, block, cases, error_and_ratio, lamp_above_face

CASES = {case.name: case for case in cases()}
LARGEST_BIAS = 0.25  # of the mean radiance, as a share of the tolerance: less than the error, which changes sign


@cache
def truth(name: str):
    return CASES[name].truth()


@pytest.mark.by_night(
    "ball of flakes-march-0.01", "threads, projected area-march-0.01", "Gaussian ball of grains-march-0.01",
    *(f"{name}-{how}" for name in ("noisy slab of depth 50", "two equal boxes in one place")
      for how in ("march-0.01", "map-0.04")),
)  # fmt: skip
@pytest.mark.parametrize(
    ("name", "shadows", "tolerance"),
    [
        *((name, *how) for name in CASES for how in (("march", 0.01), ("map", 0.04))),
        *((name, "march", 0.16) for name in ("Gaussian ball", "patches of two materials")),  # steps are joined
        *(
            pytest.param(name, *how, marks=pytest.mark.nightly)
            for name in CASES
            for how in (("march", 0.04), ("map", 0.01), ("map", 0.16))
        ),
    ],
)
def test_the_error_of_a_picture_is_within_its_tolerance(name, shadows, tolerance):
    true, transmittance = truth(name)
    seen = CASES[name].seen(hg.Settings(shadows=shadows, tolerance=tolerance))
    error, ratio = error_and_ratio(seen, true, transmittance)
    assert error < tolerance
    assert abs(ratio - 1.0) < LARGEST_BIAS * tolerance


@pytest.mark.parametrize("name", ["Gaussian ball", "hard ball", "block, 1 depth a voxel, lamp at 5°"])
def test_the_oracle_has_converged(name):
    """Parts half as deep and a tenth of the accuracy asked change every third ray by less than 0.02 % of the mean."""
    case, (true, transmittance) = CASES[name], (values[::3] for values in truth(name))
    rays = case.rays[0][::3], case.rays[1][::3]
    finer, _ = radiance(case.boxes, case.scene.lamps, rays, WAVELENGTHS, accuracy=1e-5, fineness=0.25)
    assert error_and_ratio(true, finer, transmittance)[0] < 2e-4


@pytest.mark.parametrize("nu", [math.inf, 1.5])
@pytest.mark.parametrize("element", ["cylinder", "sphere"])
def test_the_oracle_averages_over_the_normals_of_elements(element, nu):
    """f of a plane, weighed by the projected area, over a fine grid of normals: 0.1 % of the largest value."""
    material = hg.Reflectance(0.2, 0.3, 0.3, 1.5, GREY, element=element, nu=nu)
    random = np.random.default_rng(11)
    axis, to_lamp, to_eye = (v / np.linalg.norm(v, axis=1, keepdims=True) for v in random.normal(size=(3, 13, 3)))
    if element == "cylinder":
        turn = (np.arange(6000) + 0.5) / 6000 * 2.0 * math.pi
        across = np.cross(axis, to_lamp)
        across /= np.linalg.norm(across, axis=1, keepdims=True)
        normals = np.cos(turn)[:, None, None] * across + np.sin(turn)[:, None, None] * np.cross(axis, across)
    else:  # a spiral of Fibonacci: every normal stands for the same area
        height, turn = (
            1.0 - (2.0 * np.arange(40_000) + 1.0) / 40_000,
            math.pi * (3.0 - math.sqrt(5.0)) * np.arange(40_000),
        )
        level = np.sqrt(1.0 - height**2)
        normals = np.stack([level * np.cos(turn), level * np.sin(turn), height], axis=-1)[:, None]
    each = plane(material, *np.broadcast_arrays(normals, to_lamp, to_eye))
    area = np.maximum(np.sum(normals * to_eye, axis=-1), 0.0)
    for true, mine in zip(each, element_weights(material, axis, to_lamp, to_eye), strict=True):
        mean = (true * area).sum(axis=0) / area.sum(axis=0)
        assert np.abs(mine - mean).max() < 1e-3 * mean.max()


def test_a_picture_is_exposed_by_eq_10():
    """ρ_c = ∫ L(λ) R_c(λ) dλ of the oracle's spectral radiance, and of the march's weights, ray by ray."""
    case, response = CASES["two materials, colour of voxels"], hg.Response.load("canon_eos_300d")
    wavelengths = np.linspace(400.0, 700.0, 121)
    true, transmittance = radiance(case.boxes, case.scene.lamps, case.rays, wavelengths)
    curves = np.stack([response.curve(c).at(wavelengths) for c in range(3)], axis=1)
    integral = np.asarray(np.trapezoid(true[:, :, None] * curves, wavelengths, axis=1))
    exposed = hg.render(case.scene, hg.Settings(shadows="march", tolerance=0.01)).expose(response).reshape(-1, 3)
    error, ratio = error_and_ratio(exposed.astype(float), integral, transmittance)
    assert error < 0.01
    assert abs(ratio - 1.0) < 2e-3


@pytest.mark.parametrize("margin", [0, 2])
@pytest.mark.parametrize(("each", "degrees"), [(0.3, 60.0), (0.3, 20.0), (3.0, 5.0), (1e4, 20.0)])
def test_the_oracle_sees_a_plate_as_its_closed_form(each, degrees, margin):
    """E f μ_L/(μ_L+μ_V) (1 − exp(−τ (1/μ_L + 1/μ_V))), whatever the profile of density along the normal."""
    voxels, lamp = block(each, margin, (5 + margin, 83, 83)), lamp_above_face(degrees, GREY)
    x, to_eye = np.linspace(-0.02, 0.02, 5), np.array([0.3, 0.4, math.sqrt(0.75)])
    point = np.stack([x, 0.7 * x, np.full(5, 0.5 * voxels.density.shape[0] * voxels.voxel_size)], axis=-1)
    seen, passed = radiance([voxels], [lamp], (point + to_eye, np.broadcast_to(-to_eye, point.shape)), 550.0)
    depth, cosines = each * voxels.density[:, 0, 0].sum(), (math.sin(math.radians(degrees)), to_eye[2])
    rate = 1.0 / cosines[0] + 1.0 / cosines[1]
    true = 0.3 * cosines[0] / (cosines[0] + cosines[1]) * cosines[0] * -math.expm1(-depth * rate)
    assert np.allclose(seen[:, 0], true, rtol=3e-5)
    assert np.allclose(passed, math.exp(-depth / cosines[1]), rtol=1e-9)
