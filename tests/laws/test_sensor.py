"""Photon transfer, honest variance, full well and mosaic of the sensor."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from hagoromo.camera.sensor import (
    CANON_EOS_300D,
    MENON_VARIANCE,
    MOSAICS,
    SATURATION_MARGIN,
    Sensor,
    develop_raw,
    expose_raw,
    native_channels,
)
from hagoromo.errors import InputError
from tests.judges import intervals_hold, standard_normal

PLAIN = Sensor(exposure=9000.0, full_well=30_000.0, read_noise=6.0, gain=2.3, black_level=64.0, bits=14)
BAYER = replace(PLAIN, mosaic="GRBG")


def slope(height: int, width: int) -> np.ndarray:
    """Light that all demosaicing takes exactly: linear across the image; 900 to 18000 electrons."""
    across, down = np.linspace(0.1, 1.0, width)[None, :, None], np.linspace(0.0, 1.0, height)[:, None, None]
    return across * np.array([1.0, 1.4, 0.8]) + down * np.array([0.3, 0.6, 0.1])


def test_photon_transfer_variance_rises_with_the_mean_by_one_over_the_gain():
    """Var[DN] = (DN − black)/gain + (read/gain)² + 1/12 over 13 flat fields of 67 × 61 pixels.

    A variance of n pixels has the relative standard deviation √(2/n) = 2.2 %; the slope of 13 of them is known to
    about 0.8 %: 3 % is beyond 3.5 standard deviations. The offset is tested on darkness alone, 5 % = 2.3 of them.
    """
    levels = np.linspace(0.05, 2.5, 13)
    raws = [expose_raw(np.full((67, 61, 1), level), PLAIN, seed).astype(float) for seed, level in enumerate(levels)]
    means, variances = np.array([[raw.mean(), raw.var(ddof=1)] for raw in raws]).T
    weights = 1.0 / variances
    assert np.polyfit(means, variances, 1, w=weights)[0] == pytest.approx(1.0 / PLAIN.gain, rel=0.03)
    dark = expose_raw(np.zeros((67, 61, 1)), PLAIN, 99)
    assert dark.var(ddof=1) == pytest.approx((PLAIN.read_noise / PLAIN.gain) ** 2 + 1.0 / 12.0, rel=0.05)


def test_the_mean_raw_number_is_black_level_plus_electrons_over_gain():
    """To 4 standard errors of the mean over 4087 pixels."""
    raw = expose_raw(np.full((67, 61, 1), 0.7), PLAIN, 3)
    expected = PLAIN.black_level + 0.7 * PLAIN.exposure / PLAIN.gain
    assert abs(raw.mean() - expected) < 4.0 * raw.std() / np.sqrt(raw.size)


def test_development_returns_the_light():
    """The mean over 31 exposures, in its own standard errors, of 3 · 11 · 13 values; significance 0.001."""
    light = slope(11, 13)
    developed = [develop_raw(expose_raw(light, PLAIN, seed), PLAIN) for seed in range(31)]
    error = np.mean([d.values for d in developed], axis=0) - light
    assert all(d.valid.all() for d in developed)
    assert standard_normal(error / np.sqrt(np.mean([d.variance for d in developed], axis=0) / 31), significance=1e-3)


@pytest.mark.parametrize(
    ("sensor", "demosaic", "tolerance"),
    [(PLAIN, "bilinear", 0.0), (BAYER, "bilinear", 0.0), (BAYER, "menon2007", 0.017)],
)
def test_95_percent_intervals_hold_the_truth_95_percent_of_the_time(sensor, demosaic, tolerance):
    """±1.96σ over 199 exposures of 23 × 29 × 3 values on a slope.

    Each sample serves four interpolated values, so a quarter of them are independent: 0.3 % is tested at a significance
    of 0.1 %. Measured samples: 0.1 % beside chance, as σ is that of the noisy value. Menon's variance is a mean factor:
    it may be off by 1.7 % in coverage beside chance.
    """
    light = slope(23, 29)
    hits = []
    for seed in range(199):
        d = develop_raw(expose_raw(light, sensor, seed), sensor, demosaic)
        hits.append(np.abs(d.values - light) <= 1.96 * np.sqrt(d.variance))
    inner = np.array(hits)[:, 3:-3, 3:-3]  # a mirrored border bends the slope
    assert intervals_hold(inner, 0.95, significance=1e-3, tolerance=tolerance, independent=inner.size / 4)
    native = native_channels(sensor, 23, 29)
    if native is not None:
        assert intervals_hold(np.array(hits)[:, native], 0.95, significance=1e-3, tolerance=0.001)


def test_intervals_stay_honest_in_the_dark():
    """From 0 to 60 electrons with the read noise of a good sensor: 93 to 98 % of 40 000 (discrete counts jump)."""
    quiet = Sensor(exposure=1.0, full_well=9000.0, read_noise=3.0, gain=0.5, black_level=100.0, bits=12)
    for electrons in (0.0, 2.0, 7.0, 20.0, 60.0):
        d = develop_raw(expose_raw(np.full((200, 200, 1), electrons), quiet, 5), quiet)
        covered = (np.abs(d.values - electrons) <= 1.96 * np.sqrt(d.variance)).mean()
        assert 0.93 < covered < 0.98


def test_the_variance_of_a_flat_field_is_shot_read_and_rounding_and_one_electron():
    """In electrons²; of interpolated values of Menon (2007) the measured factor, the same at the border."""
    raw = np.full((12, 14), 1000.0)
    electrons = (1000.0 - BAYER.black_level) * BAYER.gain
    one = (electrons + 1.0 + BAYER.read_noise**2 + BAYER.gain**2 / 12.0) / BAYER.exposure**2
    native = native_channels(BAYER, *raw.shape)
    assert native is not None
    expected = np.where(native, 1.0, [MENON_VARIANCE[colour] for colour in "RGB"]) * one
    np.testing.assert_allclose(develop_raw(raw, BAYER, "menon2007").variance, expected, rtol=1e-6)
    np.testing.assert_allclose(develop_raw(raw[..., None], PLAIN).variance, one, rtol=1e-6)


def test_a_sample_counts_as_saturated_a_margin_and_a_number_below_white():
    full = PLAIN.white_level - SATURATION_MARGIN * PLAIN.read_noise / PLAIN.gain - 1.0
    raw = np.array([[[full - 0.01], [full]]])
    np.testing.assert_array_equal(develop_raw(raw, PLAIN).valid, [[True, False]])


@pytest.mark.parametrize("name", ["exposure", "full_well", "gain", "bits"])
def test_figures_of_a_sensor_are_above_0_but_for_those_of_none(name):
    with pytest.raises(InputError, match="above 0"):
        replace(PLAIN, **dict[str, Any]({name: 0.0}))
    with pytest.raises(InputError, match="must be from 1e-09"):
        replace(PLAIN, gain=1e-10)
    assert replace(PLAIN, read_noise=0.0, black_level=0.0).read_noise == 0.0
    assert replace(PLAIN, read_noise=1e-3, gain=1e-2).gain == 1e-2


def test_the_same_seed_gives_the_same_bits_and_another_seed_others():
    light = slope(11, 13)
    np.testing.assert_array_equal(expose_raw(light, BAYER, 7), expose_raw(light, BAYER, 7))
    assert (expose_raw(light, BAYER, 7) != expose_raw(light, BAYER, 8)).mean() > 0.9


@pytest.mark.parametrize("gain", [1.0, 2.3])
def test_full_well_and_the_largest_number_saturate_and_are_invalid(gain):
    """At gain 1 the 14 bits end first (16383 DN), at gain 2.3 the full well (13107 DN)."""
    sensor = replace(PLAIN, gain=gain)
    light = np.full((7, 11, 2), 0.3)
    light[2, 3, 1] = 40.0
    raw = expose_raw(light, sensor, 1)
    assert abs(raw[2, 3, 1] - sensor.white_level) < 5.0 * sensor.read_noise
    valid = develop_raw(raw, sensor).valid
    assert not valid[2, 3] and valid.sum() == 76


@pytest.mark.parametrize(("demosaic", "reach"), [("bilinear", 1), ("menon2007", 3)])
def test_values_interpolated_from_a_saturated_sample_are_invalid(demosaic, reach):
    light = np.full((17, 19, 3), 0.3)
    light[8, 9] = 40.0
    valid = develop_raw(expose_raw(light, BAYER, 1), BAYER, demosaic).valid
    assert (~valid).sum() == (2 * reach + 1) ** 2 and not valid[8 - reach, 9 + reach]


@pytest.mark.parametrize("mosaic", MOSAICS[1:])
def test_a_mosaic_sees_each_colour_where_its_letters_say(mosaic):
    sensor = replace(PLAIN, mosaic=mosaic)
    native = native_channels(sensor, 5, 7)
    assert native is not None and (native.sum(axis=2) == 1).all()
    assert "".join("RGB"[int(np.argmax(native[r, c]))] for r in (0, 1) for c in (0, 1)) == mosaic
    for channel in range(3):
        light = np.zeros((5, 7, 3))
        light[..., channel] = 1.0
        assert ((expose_raw(light, sensor, 2) > 1000) == native[..., channel]).all()


@pytest.mark.parametrize("demosaic", ["bilinear", "menon2007"])
def test_demosaicing_keeps_native_samples_and_flat_fields(demosaic):
    """Float32 rounding only, up to the border of the image."""
    flat = np.full((11, 13), 5000.0)
    np.testing.assert_allclose(develop_raw(flat, BAYER, demosaic).values, (5000.0 - 64.0) * 2.3 / 9000.0, rtol=1e-6)
    raw = np.random.default_rng(3).uniform(100.0, 9000.0, (11, 13))
    native = native_channels(BAYER, 11, 13)
    assert native is not None
    values = np.where(native, develop_raw(raw, BAYER, demosaic).values, 0.0).sum(axis=2)
    np.testing.assert_allclose(values, (raw - 64.0) * 2.3 / 9000.0, rtol=1e-6)


def test_binning_is_the_mean_over_pixels():
    """3 × 3 means of a fine sensor against its binned twin: mean to 4 standard errors, variance to 10 % (3.5 σ)."""
    fine = replace(PLAIN, exposure=500.0)
    means = expose_raw(np.full((183, 183, 1), 0.6), fine, 1)[..., 0].reshape(61, 3, 61, 3).mean(axis=(1, 3))
    coarse = expose_raw(np.full((61, 61, 1), 0.6), fine.binned(3), 2)[..., 0].astype(float)
    assert abs(means.mean() - coarse.mean()) < 4.0 * np.hypot(means.std(), coarse.std()) / 61
    assert coarse.var() - 1 / 12 == pytest.approx(means.var() - 1 / 108, rel=0.1)


def test_metering_fills_the_asked_share_of_the_range():
    sensor = CANON_EOS_300D.metered(17.0, 0.5)
    raw = expose_raw(np.full((64, 64, 3), 17.0), sensor, 1)
    share = (raw.mean() - sensor.black_level) / (sensor.white_level - sensor.black_level)
    assert share == pytest.approx(0.5, abs=0.001)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: replace(PLAIN, exposure=0.0), "exposure"),
        (lambda: replace(PLAIN, gain=float("nan")), "gain"),
        (lambda: replace(PLAIN, read_noise=-1.0), "read_noise"),
        (lambda: replace(PLAIN, bits=17), "bits"),
        (lambda: replace(PLAIN, black_level=99_999.0), "black"),
        (lambda: replace(PLAIN, mosaic="RGB"), "mosaic"),
        (lambda: PLAIN.metered(0.0), "nothing to expose"),
        (lambda: expose_raw(np.full((5, 7, 3), -1.0), PLAIN, 1), "negative"),
        (lambda: expose_raw(np.full((5, 7, 3), np.nan), PLAIN, 1), "not finite"),
        (lambda: expose_raw(np.ones((5, 7, 4)), BAYER, 1), "height, width, 3"),
        (lambda: develop_raw(np.ones((5, 7, 3)), BAYER), "height, width"),
        (lambda: develop_raw(np.ones((5, 7)), BAYER, "ahd"), "demosaicing"),  # type: ignore[arg-type]
    ],
)
def test_what_makes_no_exposure_is_refused_in_one_line(make, message):
    with pytest.raises(InputError, match=message) as refused:
        make()
    assert "\n" not in str(refused.value)
