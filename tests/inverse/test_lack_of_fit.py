"""Lack of fit: the alarm is as rare as stated where the model is right, and sounds where it is wrong."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.measurement.material.estimate import estimate_material
from hagoromo.measurement.material.lack_of_fit import LEVEL, lack_of_fit
from hagoromo.measurement.material.material_fit import fit_material
from hagoromo.measurement.material.material_objective import expected
from hagoromo.measurement.parameters import pack_theta
from studies.coverage_bench import BALL_PIXELS, BENCHES, TrueMaterial, ball, drawn, exposed, observed
from studies.goniometer import goniometer, readings
from tests.judges import alarms_are_rare

BENCH = BENCHES["three lamps"]


def p_values(simulated, count, first_seed):
    found = (lack_of_fit(fit_material(simulated(np.random.default_rng([s, first_seed])))) for s in range(count))
    return np.array([one.p_value for one in found if one is not None])


def right(full_well, misjudged=1.0, texture=0.0):
    """Observations of the model itself; the variance is stated `misjudged` times; each pixel has its shade."""

    def simulated(random):
        truth, seen = drawn(BENCH, random), ball(BENCH.azimuths)
        clean = expected(seen, pack_theta(truth.alpha_body, truth.beta, truth.gamma, truth.n))
        shade = 1.0 + texture * random.standard_normal((BALL_PIXELS, 1))
        of = exposed(seen, clean * np.tile(shade, (len(BENCH.azimuths), 1)), full_well, random)
        return replace(of, noise=misjudged * of.noise, gain=misjudged * of.gain)

    return simulated


def ggx(random, truth=None):
    """A material but for its facets, which are those of GGX, of the same half width in tan φ."""
    truth, seen = truth or drawn(BENCH, random), ball(BENCH.azimuths)
    at, c = seen.cosines, 3
    flat = expected(seen, pack_theta(np.zeros(c), truth.beta, 1e3, truth.n))
    width = truth.gamma / 0.644  # D falls to half where tan φ is 0.644 of its α
    tan2 = 1.0 / at.half**2 - 1.0
    clean = truth.alpha_body * seen.body + flat * (1.0 + tan2 / width**2) ** -2 / at.half**4
    return exposed(seen, clean, 45_000.0, random)


@pytest.mark.by_night("simulated1", "simulated2", "simulated3", "simulated4")
@pytest.mark.parametrize(
    "case", [right(45_000.0), right(1_000.0), right(45_000.0, 0.25), right(45_000.0, 4.0), right(45_000.0, 1.0, 0.05)]
)
def test_alarms_are_as_rare_as_stated_where_the_model_is_right(case):
    """12 materials a case: more than 4 of p < 0.05 come by chance once in 5,000, one of p < LEVEL once in 800."""
    p = p_values(case, 12, 3)
    assert alarms_are_rare(p, 0.05, significance=5e-4) and np.sum(p < LEVEL) == 0


def test_facets_of_ggx_are_told():
    """Decided beforehand: in half of the materials at least; narrow or faint lobes have too few pixels to tell."""
    assert np.mean(p_values(ggx, 10, 5) < LEVEL) >= 0.5


def test_what_is_wrong_stands_in_the_result():
    paint = TrueMaterial(np.array([0.2, 0.15, 0.1]), 0.6, 0.2, 1.5)
    found = estimate_material(ggx(np.random.default_rng(1), paint), "paint", 1, facets="gaussian")
    assert found.lack_of_fit is not None and found.lack_of_fit["rejected"]
    assert any("lack of fit" in remark for remark in found.remarks)
    sound = estimate_material(observed(BENCH, paint, 6e3, np.random.default_rng(3)), "paint", 1)
    assert sound.lack_of_fit is not None and not sound.lack_of_fit["rejected"]
    assert not any("lack of fit" in remark for remark in sound.remarks)


def test_goniometer_reads_what_the_model_gives():
    """Readings of the model itself at 1 %: the parameters return within 4 standard errors."""
    at, random = goniometer(), np.random.default_rng(8)
    truth = replace(drawn(BENCH, random), gamma=0.2, beta=0.5)
    blank = readings(at, np.ones((len(at.to_lamp), 3)), np.ones((len(at.to_lamp), 3)))
    clean = expected(blank.sight, pack_theta(truth.alpha_body, truth.beta, truth.gamma, truth.n))
    noisy = clean * (1.0 + 0.01 * random.standard_normal(clean.shape))
    found = estimate_material(readings(at, noisy, (0.01 * noisy) ** 2), "tile", len(noisy))
    for key, value in (("alpha", truth.alpha_body.mean()), ("beta", 0.5), ("gamma", 0.2), ("n", truth.n)):
        assert abs(getattr(found, key) - value) < 4 * found.standard_error[key]
    with pytest.raises(InputError, match="directions"):
        readings(at, clean[:5], clean[:5])
    with pytest.raises(InputError, match="variance above 0"):
        readings(at, clean, 0.0 * clean)
