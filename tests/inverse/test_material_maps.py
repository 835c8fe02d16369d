"""Maps of a material: its body pixel by pixel where it varies, photographs parted, and highlights that were cut off."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr
from hagoromo.least_squares.loss import HUBER
from hagoromo.measurement.known_shape import measure_known_shape
from hagoromo.measurement.material.material_fit import fit_material
from hagoromo.measurement.material.material_objective import AlbedoVariationObjective
from hagoromo.measurement.observations import known_shape, observe
from hagoromo.reflectance.material.materials_file import read_materials
from tests.inverse.simulated_ball import FULL_WELL, READ_NOISE, BallMaterial, simulate

RED = BallMaterial((0.20, 0.15, 0.10), 0.5, 0.15, 1.5)
ANGLES = ((35, 20), (80, -15), (130, 10), (-40, 30), (-75, -10))
SIZE = 47
ALL = np.zeros((SIZE, SIZE), int)


def dappled(seed, width):
    """A capture of RED whose body has its own shade in every pixel, the shades (h, w, 1), the bodies' clean light."""
    clean = [simulate([truth], seed, SIZE, angles=ANGLES, full_well=1e12) for truth in (RED, replace(RED, beta=0.0))]
    random = np.random.default_rng(seed)
    shade = 1.0 + width * random.standard_normal((SIZE, SIZE, 1))
    photographs, bodies = [], []
    for both, body in zip(*(capture.photographs for capture in clean), strict=True):
        bodies.append(np.maximum(body.values, 0) * shade)
        light = np.maximum(both.values - body.values, 0) + bodies[-1]
        exposure = 0.8 * FULL_WELL / light.max()
        electrons = random.poisson(light * exposure) + random.normal(0, READ_NOISE, light.shape)
        variance = (np.maximum(electrons, 0) + 1 + READ_NOISE**2) / exposure**2
        photographs.append(replace(both, values=electrons / exposure, variance=variance))
    return replace(clean[0], photographs=tuple(photographs)), shade, bodies


@pytest.fixture(scope="module")
def measured():
    capture, shade, bodies = dappled(1, 0.1)
    return capture, measure_known_shape(capture, labels=ALL), shade, bodies


def test_elimination_of_the_bodies_has_the_gradient_of_its_cost():
    """Oracle: central differences; JᵀWJ of the stated Jacobian is the stated curvature."""
    seen = observe(dappled(2, 0.1)[0], known_shape(dappled(2, 0.1)[0]), None, 0)
    objective = AlbedoVariationObjective(seen, seen.noise, HUBER, np.ones_like(seen.values), shaped=(3, 4, 5))
    theta = fit_material(seen).theta * 1.01
    theta[3:6] = 0.02, -0.03, 0.05  # an interface colour and a tail
    (gradient,), (curvature,) = objective.evaluate(theta[None])[1:]
    for i, step in enumerate(1e-6 * np.eye(len(theta))):
        cost = objective.evaluate(np.stack([theta + step, theta - step]))[0]
        assert gradient[i] == pytest.approx((cost[0] - cost[1]) / 2e-6, rel=1e-3)
    j = objective.jacobian(theta)
    by_jacobian = np.einsum("nc,ncp,ncq->pq", np.where(seen.used, 1.0 / seen.noise, 0.0), j, j)
    np.testing.assert_allclose(by_jacobian, curvature, rtol=1e-6, atol=1e-9 * np.abs(curvature).max())


def test_body_that_varies_is_measured_pixel_by_pixel_and_the_gloss_with_it(measured):
    """Gloss within 4 standard errors; 9 in 10 pixels at least within 1.96 of theirs, which leave out the gloss's."""
    _, found, shade, _ = measured
    (material,) = found.materials
    assert material.texture["per_pixel"] and material.texture["variation"][0] == pytest.approx(0.1, rel=0.1)
    assert any("it was estimated per pixel" in remark for remark in material.remarks)
    for key in ("beta", "gamma", "n"):
        assert abs(getattr(material, key) - getattr(RED, key)) < 4 * material.standard_error[key]
    assert material.chi_square == pytest.approx(1.0, abs=0.1) and not material.lack_of_fit["rejected"]
    known = (found.labels >= 0) & np.isfinite(found.body.error).all(axis=2)
    off = (found.body.value - shade * RED.alpha_body)[known] / found.body.error[known]
    assert known.sum() > 900 and np.mean(np.abs(off) < 1.96) > 0.9


def test_one_colour_stays_one():
    (material,) = measure_known_shape(simulate([RED], 3, SIZE, angles=ANGLES), labels=ALL).materials
    assert material.texture is not None
    assert material.texture["per_pixel"] is False and material.texture["log_evidence"] < 0


def test_photograph_is_parted_into_body_and_interface(measured):
    """They sum to the photograph; where a highlight lies, the body's light is told to 5 % (median)."""
    capture, found, _, bodies = measured
    parts, photograph = found.separation, capture.photographs[found.separation.number]
    known = np.isfinite(parts.body).all(axis=2)
    np.testing.assert_allclose((parts.body + parts.interface)[known], photograph.values[known], rtol=1e-6, atol=1e-9)
    true = bodies[parts.number]
    glossy = known & (photograph.values - true > true).all(axis=2) & (true > 0.1 * true.max()).all(axis=2)
    assert glossy.sum() > 10
    assert np.median(np.abs(parts.body - true)[glossy] / true[glossy]) < 0.05


def test_maps_are_written_and_the_file_reads_back(measured, tmp_path):
    _, found, _, _ = measured
    home = found.save(tmp_path / "out")
    channels, _ = read_exr(home / "body.exr")
    assert set(channels) == {"R", "G", "B", "error.R", "error.G", "error.B"}
    np.testing.assert_allclose(channels["G"], np.nan_to_num(found.body.value[..., 1]), rtol=1e-6)
    number = f"{found.separation.number:02d}"
    assert {f"separation_{number}.exr", f"separation_{number}_body.png"} <= {path.name for path in home.iterdir()}
    (back,) = read_materials(home / "materials.json")
    assert back.texture == found.materials[0].texture and back.lack_of_fit == found.materials[0].lack_of_fit


def test_gloss_that_is_clipped_everywhere_is_not_stated():
    """The brightest value is 3.5 times what the well holds; α is in its interval, and nothing else is claimed."""
    (found,) = measure_known_shape(simulate([RED], 6, metered=3.5), labels=np.zeros((61, 61), int)).materials
    unknown = dict.fromkeys(("beta", "gamma", "n", "nu", "interface_colour"), False)
    assert found.identifiable == {"alpha": True} | unknown
    assert found.interval_95["specular_albedo"] == (0.0, 1.0) and found.standard_error["gamma"] is None
    low, high = found.interval_95["alpha"]
    assert low < RED.alpha < high
    assert any("highlights are clipped" in remark for remark in found.remarks)
    assert not any("no interface" in remark for remark in found.remarks)


def test_light_that_is_cut_off_without_a_mask_is_found():
    capture = simulate([RED], 6, metered=3.5)
    inside = known_shape(capture)
    cut = tuple(replace(p, values=np.minimum(p.values, 0.8 * p.values.max()), mask=inside) for p in capture.photographs)
    with pytest.warns(UserWarning, match="taken for clipped"):
        (found,) = measure_known_shape(replace(capture, photographs=cut), labels=np.zeros((61, 61), int)).materials
    assert not found.identifiable["gamma"] and any("highlights are clipped" in remark for remark in found.remarks)


def test_a_body_that_is_clipped_is_refused_with_what_to_do():
    with pytest.raises(InputError, match="clipped: expose shorter"):
        measure_known_shape(simulate([RED], 6, metered=12.0), labels=np.zeros((61, 61), int))
