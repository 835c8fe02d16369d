"""Further lobes of the interface: a spike on a haze is found and predicts photographs left out; no lobe is made up."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.measurement.normals.gloss_estimate import measurement_of
from hagoromo.measurement.normals.highlight_check import highlight_check
from hagoromo.measurement.normals.lobe_fit import with_lobes
from hagoromo.measurement.normals.normals import NormalMap, least_squares_fit
from hagoromo.measurement.normals.photometric_model import Fit, predicted
from hagoromo.measurement.normals.shading import Gloss, turned
from hagoromo.measurement.sight import sight_of
from hagoromo.reflectance.material.materials_file import read_materials, write_materials
from studies import glossy_objects
from studies.glossy_objects import GLOSSY, glossy_object

HELD = 4  # the lamp that is left out


def solved(capture: hg.Capture, normals: np.ndarray, gloss: glossy_objects.TrueGloss) -> tuple[hg.Views, Fit]:
    """The fit of one lobe as the photometric fit gives it: true normals, exponent and haze."""
    views = hg.views_from_capture(capture)
    beta, gamma = gloss.haze
    row = np.log(beta), np.log(np.radians(gamma)), 0.0, np.log1p(gloss.epsilon)
    fit = replace(
        least_squares_fit(views),
        normals=normals[views.rows, views.columns],
        gloss=Gloss.alike(row, 1, 3),
        covariance=np.full((1, 7, 7), 1e-4) * np.eye(7),
        model_error=0.01,
    )
    return views, fit


def left_out(capture: hg.Capture, views: hg.Views, fit: Fit) -> float:
    """Relative error of the photograph left out, all its pixels, clipped at white."""
    photograph, place = capture.photographs[HELD], (views.rows, views.columns)
    lamp = photograph.lamps[0]
    towards = np.broadcast_to(np.asarray(lamp.to_lamp), (1, len(views.rows), 3))
    model = np.clip(predicted(fit, towards, views.to_eye)[0].T * lamp.intensity, 0.0, 1.0)
    true = np.minimum(photograph.values[place], 1.0)
    return float(np.sqrt(np.mean((model - true) ** 2) / np.mean(true**2)))


@pytest.mark.nightly
@pytest.mark.parametrize("seed", [0])
def test_a_spike_on_a_haze_is_found(seed, tmp_path):
    """The error under a lamp left out falls to half and less; clipped highlights are lower bounds: the sum of the lobes
    at φ = 0 comes within a third of the truth, which is over white. Files and the sight of a known shape have them.
    """
    capture, normals = glossy_object("lacquer", seed, size=64)
    rest = replace(capture, photographs=tuple(p for k, p in enumerate(capture.photographs) if k != HELD))
    views, one = solved(rest, normals, GLOSSY["lacquer"])
    found = with_lobes(rest, views, one)
    assert found.lobes is not None and found.lobes.gains[0] > 0.5
    assert left_out(capture, views, found) < 0.5 * left_out(capture, views, one)
    peak = np.exp(found.gloss.rows[0, 0]) + sum(beta for beta, _ in found.lobes.each[0])
    assert peak == pytest.approx(GLOSSY["lacquer"].haze[0] + GLOSSY["lacquer"].spike[0], rel=0.35)
    labels = np.where(np.linalg.norm(normals, axis=2) > 0.5, 0, -1)
    maps = normals.astype(np.float32), np.zeros(labels.shape, np.float32), views.image(found.body.T.astype(np.float32))
    known = NormalMap(*maps, labels, found, views)
    material = measurement_of(rest, known).materials[0]
    assert any("one lobe is not enough" in remark for remark in material.remarks)
    write_materials([material], tmp_path / "materials.json")
    (read,) = read_materials(tmp_path / "materials.json")
    assert read.lobes == material.lobes and read.epsilon == material.epsilon
    assert_same_picture(rest, views, found, read)


def assert_same_picture(capture, views, fit, material):
    """The sight of a known shape gives what the photometric model gives."""
    from hagoromo.measurement.material.material_objective import interface_of

    photograph = capture.photographs[0]
    sight = sight_of(photograph, views.points, fit.normals)
    law = sight.body_of(material.body_law)
    ours = law * fit.body.T + interface_of(sight, material)
    theirs = predicted(fit, views.to_lamp[:1], views.to_eye)[0].T * photograph.lamps[0].intensity
    assert abs(ours - theirs).max() < 2e-3 * theirs.max()


@pytest.mark.nightly
@pytest.mark.parametrize(("haze", "spike"), [((0.5, 10.0), (4.0, 1.9)), ((0.3, 16.0), (8.0, 3.5))])
def test_lobes_are_measured_within_their_intervals(haze, spike, monkeypatch, tmp_path):
    """Normals 0.15° off, as stated. As many lobes as there are, β and γ of each in its interval, which is no wider than
    a factor of 2 in β and 1.4 in γ. Tails and a colour, which one lobe seems to have, are given up. Files keep it all.
    """
    monkeypatch.setitem(GLOSSY, "waxed", glossy_objects.TrueGloss(0.05, haze, spike))
    capture, normals = glossy_object("waxed", 7, size=64)
    views, fit = solved(capture, normals, GLOSSY["waxed"])
    tilt = np.radians(0.15) / np.sqrt(2.0) * np.random.default_rng(0).normal(size=(len(fit.normals), 2))
    rows = fit.gloss.rows + np.array([0.2, 0.1, 0.0, -0.05, 0.5, 0.1, -0.1])
    turned_normals = turned(fit.normals, tilt, views.to_eye)
    fit = replace(fit, normals=turned_normals, variance=np.full(len(tilt), np.radians(0.15) ** 2), gloss=Gloss(rows))
    found = with_lobes(capture, views, fit)
    assert found.lobes is not None and [len(one) for one in found.lobes.each] == [1]
    assert not found.gloss.rows[0, 4:].any() and abs(found.gloss.rows[0, 3] - np.log1p(0.05)) < 0.02
    labels = np.where(np.linalg.norm(normals, axis=2) > 0.5, 0, -1)
    maps = normals.astype(np.float32), np.zeros(labels.shape, np.float32), views.image(found.body.T.astype(np.float32))
    material = measurement_of(capture, NormalMap(*maps, labels, found, views)).materials[0]
    write_materials([material], tmp_path / "materials.json")
    (read,) = read_materials(tmp_path / "materials.json")
    assert read.interval_95["lobes"] == material.interval_95["lobes"]
    assert read.standard_error["lobes"] == material.standard_error["lobes"]
    pairs = [(haze, (read.interval_95["beta"], read.interval_95["gamma"])), (spike, read.interval_95["lobes"][0])]
    for (beta, gamma), intervals in pairs:
        for true, (low, high), widest in zip((beta, np.radians(gamma)), intervals, (2.0, 1.4), strict=True):
            assert low <= true <= high < widest * low


def test_no_lobe_is_made_up(monkeypatch):
    monkeypatch.setitem(GLOSSY, "waxed", replace(GLOSSY["waxed"], spike=(0.0, 5.0)))
    capture, normals = glossy_object("waxed", 2, size=64)
    views, one = solved(capture, normals, GLOSSY["waxed"])
    assert with_lobes(capture, views, one) is one


def test_boxes_show_the_lobes():
    """The light of planes, cylinders and spheres is that of each lobe alone, added up."""
    haze = hg.Reflectance(0.1, 0.4, 0.3, 1.5, hg.Spectrum.constant(1.0))
    spike = replace(haze, alpha=0.0, beta=2.0, gamma=0.05)
    camera = hg.Camera(8, 8, (8.0, 8.0), (4.0, 4.0)).look_at((0.0, 0.0, 1.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    lamp = hg.Lamp(to_lamp=(0.1, 0.0, 0.99498744), intensity=1.0)
    density, directions = np.ones((8, 8, 8)), {"cylinder": (0.0, 1.0, 0.0)}
    for element in ("plane", "cylinder", "sphere"):
        both = replace(haze, element=element, lobes=((2.0, 0.05),))
        axis = np.broadcast_to(directions.get(element, (0.08, 0.0, 0.9968)), (8, 8, 8, 3))
        values = []
        for material in (both, replace(haze, element=element), replace(spike, element=element)):
            box = hg.VolumeBox.from_arrays(density, axis, 0.01, 500.0, [material])
            scene = hg.Scene(camera, (lamp,), (box,))
            light = hg.march(scene, [[0.04, 0.04, 1.0]], [[0.0, 0.0, -1.0]], hg.Settings(shadows="none"))
            values.append(light.weights[0].astype(np.float64))
        assert values[2][1] > 0.05 * values[1][1]
        np.testing.assert_allclose(values[0], values[1] + values[2], rtol=2e-3)
    assert both.interface_albedo == pytest.approx(
        replace(haze, element="sphere").interface_albedo + replace(spike, element="sphere").interface_albedo
    )


def test_lobes_are_checked():
    matte = {"alpha": 0.1, "gamma": 0.3, "n": 1.5, "body_colour": hg.Spectrum.constant(1.0)}
    with pytest.raises(hg.InputError, match="beta above 0"):
        hg.Reflectance(beta=0.0, lobes=((1.0, 0.1),), **matte)
    with pytest.raises(hg.InputError, match="lobe of beta -1"):
        hg.Reflectance(beta=0.1, lobes=((-1.0, 0.1),), **matte)
    with pytest.raises(hg.InputError, match="energy"):
        hg.Reflectance(beta=0.1, lobes=((60.0, 0.5),), **matte)


@pytest.mark.parametrize(("factor", "rejected"), [(1.0, False), (5.0, True), (0.2, True)])
def test_a_lobe_that_is_five_times_off_is_seen(factor, rejected, monkeypatch):
    """In its width; without one too many the check is silent. Before, there was no test under unknown shape."""
    monkeypatch.setitem(GLOSSY, "waxed", replace(GLOSSY["waxed"], spike=(0.0, 5.0)))
    capture, normals = glossy_object("waxed", 3, size=64)
    beta, gamma = GLOSSY["waxed"].haze
    views, fit = solved(capture, normals, replace(GLOSSY["waxed"], haze=(beta, min(factor * gamma, 68.0))))
    incidence = np.maximum(np.einsum("kpi,pi->kp", views.to_lamp, fit.normals), 0.0)
    unit = predicted(replace(fit, body=np.ones_like(fit.body)), views.to_lamp, views.to_eye)
    gloss = predicted(replace(fit, body=np.zeros_like(fit.body)), views.to_lamp, views.to_eye)
    matte = unit - gloss
    weight = (incidence > 0.1)[:, None] & views.used[:, None]
    body = np.sum(weight * matte * (views.values - gloss), axis=0) / np.sum(weight * matte**2, axis=0)
    known = np.stack([p.mask[views.rows, views.columns] for p in capture.photographs]) & (incidence > 0.1)
    found = highlight_check(replace(fit, body=body), views, known & views.used, 0)
    assert found is not None and found.rejected == rejected
    assert not rejected or (found.rms > 0.01 and "the highlight is" in found.where)
