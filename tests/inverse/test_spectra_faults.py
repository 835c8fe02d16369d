"""What a chart shows to be wrong with photographs is said and corrected before spectra are made of them."""

import json

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.image.spectra.chart_correction import chart_correction
from hagoromo.light.colour import srgb_curve
from studies.skin import CAMERA, CHART, GAP, NOISE, PLACES, SIZE, WHITE, _picture, places

LEFT, TOP, SIDE = CHART
ENDS = (LEFT - GAP / 2, TOP - GAP / 2, LEFT + 6 * SIDE - GAP / 2, TOP + 4 * SIDE - GAP / 2)
CORNERS = np.array([[ENDS[0], ENDS[1]], [ENDS[2], ENDS[1]], [ENDS[2], ENDS[3]], [ENDS[0], ENDS[3]]])
FLARE, BLACK, GREEN = 0.05, 0.02, 0.45


def uneven():
    """(h, w) light of a near lamp, which differs by 41 % over the chart, over its geometric mean there."""
    x = np.arange(SIZE[1]) + 0.5 - np.mean(ENDS[::2])
    y = np.arange(SIZE[0])[:, None] + 0.5 - np.mean(ENDS[1::2])
    light = ((x / 120 + 2.0) ** 2 + (y / 120 + 1.2) ** 2 + 7.2**2) ** -1.5
    inside = np.s_[round(ENDS[1]) : round(ENDS[3]), round(ENDS[0]) : round(ENDS[2])]
    return light / np.exp(np.log(light[inside]).mean())


FAULTS = {  # what is done to light of mean white 1, before noise, and after it; what is said of it
    "none": (lambda p: p, lambda p: p, ""),
    "falls off": (lambda p: p * uneven()[..., None], lambda p: p, "photograph 1: the light differs by 4"),
    "sRGB": (lambda p: p, lambda p: srgb_curve(np.clip(p, 0, 1)), "coded by the sRGB curve"),
    "flare": (lambda p: p + FLARE * p.mean(axis=(0, 1)), lambda p: p, "channel G: the readings are +4."),
    "black": (lambda p: p, lambda p: p - BLACK, "channel G: the readings are -10."),
    "clipped": (
        lambda p: p, lambda p: np.minimum(p, [9.0, GREEN * p[..., 1].max(), 9.0]), "channel G: 4 readings are clipped"
    ),
}  # fmt: skip


def photograph(fault, lamp="D65", seed=0):
    """(h, w, 3) as a 16-bit file has it, and what is exact of it."""
    light, camera = hg.Spectrum.named(lamp), hg.Response.load(CAMERA)
    exact = _picture(light, camera) * WHITE / hg.camera_white(light, camera).max()
    before, after, _ = FAULTS[fault]
    lit = before(exact)
    noise = NOISE * np.sqrt(np.maximum(lit, 0.01)) * np.random.default_rng(seed).standard_normal(lit.shape)
    return np.rint(65535.0 * np.clip(after(lit + noise), 0.0, 1.0)), exact


@pytest.mark.by_night("none", "sRGB", "flare", "black", "clipped")
@pytest.mark.parametrize("fault", FAULTS)
def test_a_chart_shows_the_fault_of_its_photograph_and_corrects_it(fault):
    """Regions beside the chart, up to one factor for all: to 1 %, three times what 41 % of falloff leave there."""
    picture, exact = photograph(fault)
    found = chart_correction(picture, hg.Spectrum.named("D65"), hg.chart_spectra(), CORNERS, "photograph 1")
    said = " | ".join(found.remarks())
    assert FAULTS[fault][2] in said and bool(said) == (fault != "none")
    corrected = found.applied(picture)
    ratios = []
    for _, (x, y, width, height) in PLACES.values():
        part = np.s_[y : y + height, x : x + width]
        ratios.append(corrected[part].mean(axis=(0, 1)) / exact[part].mean(axis=(0, 1)))
    ratios = np.array(ratios)
    np.testing.assert_allclose(ratios / ratios.mean(axis=0), 1.0, atol=0.01)
    if fault == "clipped":
        assert (
            np.isnan(corrected[TOP + 3 * SIDE + 20, LEFT + 20, 1]) and np.isfinite(corrected[TOP + 20, LEFT + 20]).all()
        )


def differences(found):
    """ΔE00 under D65 of each region from the truth."""
    nm, truth = next(iter(found.estimates.values())).wavelengths, places()
    exact = {name: hg.SpectrumEstimate(nm, one.at(nm), 1e-12 * np.eye(31), {}, {}) for name, one in truth.items()}
    made = {
        name: hg.SpectrumEstimate(nm, one.values, 1e-12 * np.eye(31), {}, {}) for name, one in found.estimates.items()
    }
    return [hg.spectrum_difference(exact[name], made[name], hg.Spectrum.named("D65"))[0] for name in made]


REGIONS = [f"{name}={','.join(map(str, place))}" for name, (_, place) in PLACES.items()]


@pytest.mark.nightly
@pytest.mark.parametrize("fault", FAULTS)
def test_spectra_from_one_photograph_with_a_fault_are_as_without(fault):
    """ΔE00 of 0.6 to 1.1 without a fault; 1.3 to 9.4 with these, before they were corrected."""
    marks = hg.Marks(REGIONS, corners=[CORNERS])
    found, right = (hg.spectra([photograph(one)[0]], ["D65"], marks) for one in (fault, "none"))
    assert np.abs(np.subtract(differences(found), differences(right))).max() < 0.15
    assert any(FAULTS[fault][2] in line for line in found.remarks) or (fault == "none" and not found.remarks)


@pytest.mark.nightly
def test_lamps_in_the_wrong_order_are_exchanged_and_it_is_said(tmp_path):
    """ΔE00 was 1.5 to 3.1, without a word."""
    for k, lamp in enumerate(("D65", "A")):
        hg.write_png(tmp_path / f"{lamp}.png", photograph("none", lamp, k)[0].astype(np.uint16))
    corners = [str(number) for number in (*CORNERS.ravel(), *CORNERS.ravel())]
    pictures = [str(tmp_path / "D65.png"), str(tmp_path / "A.png")]
    regions = [word for one in REGIONS for word in ("--region", one)]
    lamps = ["--lamp", "A", "--lamp", "D65"]
    given = ["spectra", *pictures, *lamps, "--corners", *corners, *regions, "--out", str(tmp_path / "out")]
    assert main(given) == 0
    record = json.loads((tmp_path / "out" / "spectra.json").read_text())
    (said,) = record["remarks"]
    assert said.startswith("the lamps of photograph 1 and photograph 2 are exchanged") and said.endswith("used so")
    for one in record["regions"]:
        nm, none = np.array(one["wavelengths"]), 1e-12 * np.eye(31)
        truth = hg.SpectrumEstimate(nm, places()[one["name"]].at(nm), none, {}, {})
        made = hg.SpectrumEstimate(nm, np.array(one["values"]), none, {}, {})
        assert hg.spectrum_difference(truth, made, hg.Spectrum.named("D65"))[0] < 0.3


@pytest.mark.nightly
def test_a_region_that_is_clipped_in_one_channel_is_named_and_that_channel_left_out():
    picture, _ = photograph("clipped")
    white = f"white={LEFT + 10},{TOP + 3 * SIDE + 10},{SIDE - 30},{SIDE - 30}"
    found = hg.spectra([picture], ["D65"], hg.Marks([*REGIONS, white], corners=[CORNERS]))
    assert "white: channel G is clipped in photograph 1 and left out: expose less" in found.remarks
    low, high = found.estimates["white"].band_95
    truth = hg.chart_spectra()[18].at(found.estimates["white"].wavelengths)
    assert ((low <= truth) & (truth <= high)).mean() > 0.9
