"""Lobes that photographs do not hold are dropped; of those whose strength they leave open the interval says so."""

import math
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.measurement.normals.gloss_estimate import measurement_of
from hagoromo.measurement.normals.lobe_fit import held, with_lobes
from hagoromo.measurement.normals.lobe_samples import samples_of, trust_of
from hagoromo.measurement.normals.lobe_shape import LobeShapes, with_covariance
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import Fit
from hagoromo.measurement.parameters import GAMMA_RANGE
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from hagoromo.reflectance.material.materials_file import read_materials, write_materials
from studies import glossy_objects
from studies.glossy_objects import GLOSSY, glossy_object
from tests.inverse.test_further_lobes import solved

HAZE, SPIKE = (0.6, 18.0), (3000.0, 0.25)  # β and γ [°]
KNOWN_NORMALS = np.radians(0.15) ** 2  # rad²


def ball(spike=SPIKE, lamps: int = 8, clipped: float = 99.0) -> tuple[hg.Capture, hg.Views, Fit]:
    """A glossy object, all highlights of whose spike are clipped or fall between the lamps, and the fit of its haze."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setitem(GLOSSY, "clipped", glossy_objects.TrueGloss(0.0, HAZE, spike))
        patch.setattr(glossy_objects, "CLIPPED_SHARE", clipped)
        patch.setattr(glossy_objects, "LAMPS", lamps)
        capture, normals = glossy_object("clipped", 0, size=36)
    views, fit = solved(capture, normals, glossy_objects.TrueGloss(0.0, HAZE, spike))
    return capture, views, replace(fit, variance=np.full(len(fit.normals), KNOWN_NORMALS))


def material_of(capture: hg.Capture, views: hg.Views, fit: Fit) -> MaterialEstimate:
    labels = np.full(views.shape, -1)
    labels[views.rows, views.columns] = 0
    normals = views.image(fit.normals.astype(np.float32), 0.0)
    body, known = views.image(fit.body.T.astype(np.float32)), views.image(fit.variance.astype(np.float32))
    return measurement_of(capture, NormalMap(normals, known, body, labels, fit, views)).materials[0]


@pytest.fixture(scope="module")
def spiky() -> tuple[hg.Capture, hg.Views, Fit]:
    """Capture and views of a ball whose spike is seen in clipped pixels alone, and its fit with both lobes."""
    capture, views, fit = ball()
    return capture, views, with_lobes(capture, views, fit)


def test_a_lobe_of_unknown_strength_has_an_open_interval(spiky, tmp_path):
    """Before: `OverflowError`, from a lobe of 6479 with a relative error of 748. A line says what would tell."""
    material = material_of(*spiky)
    ((low, high), (narrow, wide)), (beta, _) = material.interval_95["lobes"][0], material.lobes[0]
    assert low < 0.1 * beta and high > 10.0 * beta and low < SPIKE[0] < high
    assert GAMMA_RANGE[0] <= narrow <= np.radians(SPIKE[1]) <= wide <= GAMMA_RANGE[1]
    assert any("leave open how strong the lobe" in remark for remark in material.remarks)
    write_materials([material], tmp_path / "materials.json")
    (read,) = read_materials(tmp_path / "materials.json")
    assert read.interval_95["lobes"] == material.interval_95["lobes"]


@pytest.mark.parametrize("error", [5.0, 735.0, 1e6])
def test_no_error_of_the_gloss_ends_a_measurement(spiky, error, tmp_path):
    """Of any lobe, the first included: bounds that no float holds are none, and files have them so."""
    capture, views, fit = spiky
    lobes = replace(fit.lobes, covariances=(error**2 * np.eye(2),))
    material = material_of(capture, views, replace(fit, lobes=lobes, covariance=error**2 * np.eye(7)[None]))
    bounds = [material.interval_95[key] for key in ("beta", "gamma", "specular_albedo")]
    bounds += [*material.interval_95["lobes"][0]]
    for low, high in bounds:
        assert 0.0 <= low < high and not math.isnan(high)
    assert not material.identifiable["beta"] and not material.identifiable["gamma"]
    write_materials([material], tmp_path / "materials.json")
    (read,) = read_materials(tmp_path / "materials.json")
    assert read.interval_95["beta"] == material.interval_95["beta"]


@pytest.mark.by_night("made_up0", "made_up2")
@pytest.mark.parametrize("made_up", [(0.023, 40.0), (1e-6, 3.0), (1e3, 0.03)])
def test_a_lobe_without_evidence_is_dropped(made_up):
    """Wide and weak as the body, too weak to be seen, or too narrow to meet a pixel. Both true lobes stay."""
    spike = (6.0, 4.0)
    capture, views, fit = ball(spike, lamps=20, clipped=99.7)
    place = views.place
    samples = samples_of(views, fit, place, trust_of(capture, views))
    each = np.array([(math.log(beta), math.log(math.radians(gamma))) for beta, gamma in (HAZE, spike, made_up)])
    shapes, samples = held(samples, LobeShapes(each, 0.0), fit.variance, place)
    assert len(shapes.each) == 2
    found = sorted(np.exp(with_covariance(samples, shapes, place).each[:, 1]))
    np.testing.assert_allclose(found, np.radians([spike[1], HAZE[1]]), rtol=0.1)


def test_evidence_is_not_what_a_robust_fit_throws_away():
    """A lobe that all photographs show stays, and so does one that only clipped pixels hold: its light was there."""
    for spike, clipped in (((6.0, 4.0), 99.7), (SPIKE, 99.0)):
        capture, views, fit = ball(spike, clipped=clipped)
        samples = samples_of(views, fit, views.place, trust_of(capture, views))
        each = np.log([(HAZE[0], math.radians(HAZE[1])), (spike[0], math.radians(spike[1]))])
        assert len(held(samples, LobeShapes(each, 0.0), fit.variance, views.place)[0].each) == 2
