"""Spectra of regions, of whole images, and of surfaces of other sets of data than the prior's."""

import inspect
import os
import re
import shlex
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app import spectra_verb
from hagoromo.app.cli import main
from hagoromo.calibration.response.chart import read_chart
from hagoromo.files.picture import read_picture
from hagoromo.image.spectra.spectra_plot import spectra_figure
from hagoromo.reflectance.spectra.bounded_spectra import within_bounds
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS, apart, surfaces
from hagoromo.reflectance.spectra.reflectance_prior import UNLIKE_SURFACES, family
from hagoromo.reflectance.spectra.spectrum_estimate import unexplained_above
from studies.skin import CHART, GAP, skin

CAMERA = hg.Response.load("canon_eos_300d")
TWO = np.concatenate([hg.reading_matrix(hg.Spectrum.named(lamp), CAMERA) for lamp in ("D65", "A")])
ONE = TWO[:3]
NOISE = 0.003
PAGE = Path(__file__).parents[2] / "docs" / "tutorial_skin.md"


def test_bands_under_two_lamps_hold_surfaces_of_a_set_of_data_that_is_not_in_the_prior():
    """AMPAS' 190 patches, every third, from a prior without them: 95 ± 3 % of all wavelengths (0.91 before).

    The share is known to some 1 %: 64 surfaces, whose wavelengths are not independent.
    """
    from colour.characterisation import read_training_data_rawtoaces_v1

    table = read_training_data_rawtoaces_v1()
    tested = np.array([np.interp(WAVELENGTHS, table.wavelengths, row) for row in table.values.T])
    others = apart(surfaces(), tested)
    learnt = hg.ReflectancePrior.from_spectra("surfaces", others, UNLIKE_SURFACES)
    priors = [learnt, hg.ReflectancePrior.load("smooth")]
    random, inside, explained = np.random.default_rng(0), [], []
    for truth in tested[::3]:
        exact = TWO @ truth
        noise = NOISE * exact
        found = hg.estimate_spectrum(TWO, exact + noise * random.standard_normal(6), np.diag(noise**2), priors)
        inside.append(np.abs(found.values - truth) <= 1.96 * found.standard_error)
        explained.append(found.explained)
    assert np.mean(inside) == pytest.approx(0.95, abs=0.03) and all(explained)


def test_skin_is_recognised_by_a_family_that_no_measured_spectrum_is_in():
    """Spectra of the family drawn anew, seen under one lamp: its probability is above a half, and the others' below."""
    priors = [hg.ReflectancePrior.load(name) for name in ("surfaces", "smooth", "skin", "textile", "pigment")]
    for truth in family("skin")[::40]:
        values = ONE @ truth
        found = hg.estimate_spectrum(ONE, values, np.diag((NOISE * values) ** 2), priors)
        assert found.probability["skin"] > 0.5


def test_many_pixels_have_the_spectra_of_each():
    """One lamp and two. The mean to 0.2 of the standard error in the median: that of cells and their slopes."""
    random = np.random.default_rng(1)
    chosen = surfaces()[random.choice(len(surfaces()), 6, replace=False)]
    priors = [hg.ReflectancePrior.load("smooth"), hg.ReflectancePrior.from_spectra("few", surfaces()[::5])]
    truth = np.repeat(chosen, 70, axis=0) * random.uniform(0.4, 1.0, (420, 1))
    for matrix in (ONE, TWO):
        exact = truth @ matrix.T
        errors = NOISE * exact
        values = exact + errors * random.standard_normal(exact.shape)
        values[5, 0], values[6] = np.nan, -0.1
        found = hg.estimate_spectra(matrix, values.reshape(20, 21, -1), errors.reshape(20, 21, -1), priors)
        flat = found.values.reshape(420, -1)
        assert np.isnan(flat[[5, 6]]).all() and not found.explained.ravel()[5]
        off = []
        for pixel in range(7, 420, 29):
            one = hg.estimate_spectrum(matrix, values[pixel], np.diag(errors[pixel] ** 2), priors)
            off.append(np.abs(one.values - flat[pixel]) / one.standard_error)
            assert found.probability.reshape(420, -1)[pixel].sum() == pytest.approx(1.0, abs=1e-4)
        assert np.median(np.max(off, axis=1)) < 0.2 and np.max(off) < 1.0
        assert np.nanmin(flat) >= 0.0 and np.nanmax(flat) <= 1.0


def test_bounds_are_those_of_the_fit_of_one_spectrum():
    from hagoromo.reflectance.spectra.spectrum_estimate import _within

    random = np.random.default_rng(3)
    roots = 0.1 * random.standard_normal((5, 31, 31))
    covariances = roots @ roots.transpose(0, 2, 1) + 0.01 * np.eye(31)
    means = random.uniform(-0.3, 1.3, (5, 31))
    for found, mean, covariance in zip(within_bounds(means, covariances, 1.0), means, covariances, strict=True):
        np.testing.assert_allclose(found, _within(mean, covariance, 1.0), atol=1e-6)


def test_a_white_above_the_bound_and_readings_that_nothing_explains_are_stated():
    white = hg.Reading(ONE @ np.full(31, 1.007), [0.0005] * 3, hg.Spectrum.named("D65"), CAMERA)
    with pytest.warns(UserWarning, match="brighter than the upper bound allows"):
        found = hg.reflectance_spectrum([white])
    assert found.values.max() <= 1.0
    assert not hg.reflectance_spectrum([white], upper=1.1).remarks()
    grey = TWO @ np.full(31, 0.4)
    grey[3:] *= [1.5, 0.6, 1.4]  # no surface is so under one lamp and grey under another
    found = hg.estimate_spectrum(TWO, grey, np.diag((NOISE * grey) ** 2), [hg.ReflectancePrior.load("surfaces")])
    assert not found.explained and found.chi_square > unexplained_above(6) and "no likely" in found.remarks()[0]


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """The folder in which every command and the Python of the page on skin was run."""
    folder, before = tmp_path_factory.mktemp("session"), Path.cwd()
    page = re.sub(r"^> ?", "", PAGE.read_text(encoding="utf-8"), flags=re.MULTILINE)
    os.chdir(folder)
    try:
        for language, block in re.findall(r"^```(sh|python)\n(.*?)^```", page, re.DOTALL | re.MULTILINE):
            if language == "python":
                exec(compile(block, str(PAGE), "exec"), {})
                continue
            words = shlex.split(block.replace("\\\n", " "))
            if words[0] == "hagoromo":
                assert main(words[1:]) == 0
            else:
                assert words[:4] == ["python", "-m", "studies.skin", "--out"]
                skin(words[4])
    finally:
        os.chdir(before)
    return folder


@pytest.mark.nightly
def test_the_chart_is_found_alike_with_any_number_of_threads(session):
    """With two threads it was found in two of three tries only. Corners: within 10 px, a sixth of a patch."""
    import cv2

    grey = np.array([patch.mean() for patch in hg.chart_spectra()])
    photograph = read_picture(session / "skin" / "tube.png")
    count, found = cv2.getNumThreads(), []
    for threads in (1, 2, 2, 2):
        cv2.setNumThreads(threads)
        found.append(read_chart(photograph, grey).corners)
    cv2.setNumThreads(count)
    top_left, bottom_right = CHART[:2], (CHART[0] + 6 * CHART[2] - GAP, CHART[1] + 4 * CHART[2] - GAP)
    assert all(np.array_equal(corners, found[0]) for corners in found)
    assert np.abs(found[0][[0, 2]] - [top_left, bottom_right]).max() < 10.0


@pytest.mark.nightly
def test_the_page_measures_skin_from_a_chart_and_three_photographs(session):
    """Truth inside the 95 % bands at nine of ten wavelengths and more; ΔE00 below 0.5; skin is recognised."""
    out = session / "spectra"
    record, truth = hg.read_json(out / "spectra.json"), hg.read_table(session / "skin" / "truth.csv")
    for region in record["regions"]:
        low, high = np.array(region["interval_95"]).T
        true = np.array(truth[region["name"]])
        assert np.mean((low <= true) & (true <= high)) >= 0.9, region["name"]
        assert region["probability"]["skin"] > 0.9 and region["explained"]
        for lamp, colour in region["colours"].items():
            light = hg.Spectrum.named(lamp)
            exact = hg.spectrum_difference(_certain(true), _certain(np.array(region["values"])), light)[0]
            assert exact < 0.5 and colour["delta_e_2000_95"] < 1.0
    assert record["regions"][1]["delta_e_2000"]["D65"]["low"] < record["regions"][1]["delta_e_2000"]["D65"]["high"]
    assert (out / "spectra.png").read_bytes()[:4] == b"\x89PNG"
    assert set(hg.read_table(out / "spectra.csv")) >= {"wavelength_nm", "forearm", "forearm low", "forearm high"}


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (["--lamp", "D65", "--region", "a=1,1,9,9"], "1 photographs and 2 lamps"),
        (["--region", "a=1,1,900,9"], "leaves the photograph"),
        (["--region", "a"], "give NAME=x,y,width,height"),
        ([], "no region is marked"),
        (["--region", "a=1,1,9,9", "--white", "b", "--response", "canon_eos_300d"], "no region is called 'b'"),
        (["--region", "a=1,1,9,9", "--white", "a"], "does not calibrate the camera"),
    ],
)
def test_wrong_use_is_one_line(session, capsys, arguments, said):
    picture = str(session / "skin" / "daylight.png")
    out = session / "refused"
    assert main(["spectra", picture, "--lamp", "D65", *arguments, "--out", str(out)]) == 2
    message = capsys.readouterr().err
    assert said in message and message.count("\n") == 1 and not out.exists()


def _certain(values):
    return hg.SpectrumEstimate(WAVELENGTHS, values, 1e-12 * np.eye(31), {}, {})


def test_the_panels_of_a_plot_have_one_scale():
    """A dark and a bright surface: compared at a glance, and every band inside the picture."""
    bright, dark = (
        hg.SpectrumEstimate(WAVELENGTHS, np.full(31, height), 0.01**2 * np.eye(31), {}, {}) for height in (0.9, 0.05)
    )
    axes = spectra_figure({"bright": bright, "dark": dark}).axes
    assert axes[0].get_ylim() == axes[1].get_ylim() and axes[0].get_ylim()[1] > bright.band_95[1].max()
    np.testing.assert_array_equal(axes[1].lines[0].get_ydata(), dark.values)


def test_the_defaults_of_the_verb_are_those_of_the_function():
    """The verb states them itself, so that its help loads no heavy module."""
    verb, function = (inspect.signature(one).parameters for one in (spectra_verb.spectra, hg.spectra))
    for name in ("upper", "illumination", "whole_image"):
        assert verb[name].default == function[name].default
