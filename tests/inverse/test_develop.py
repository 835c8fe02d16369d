"""Development of simulated exposures of known truth: no bias, variance that covers, noise, movement, bent responses."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter

from hagoromo.camera.sensor import Sensor
from hagoromo.errors import InputError
from hagoromo.files.exif import Exif
from hagoromo.photograph.development.develop_exposures import develop_exposures
from hagoromo.photograph.development.development import CalibrationFrames, Development
from hagoromo.photograph.development.exposure import Exposure
from hagoromo.photograph.development.master import dark_master
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.noise_estimate import noise_from_frames, noise_from_pairs
from tests.inverse.simulated_bracket import FULL, HEIGHT, SENSOR, WIDTH, scene, shot
from tests.judges import standard_normal

TIMES = (0.05, 0.2, 0.8, 3.2)  # s
KNOWN = Noise(SENSOR.gain, SENSOR.read_noise)
UNIT = SENSOR.gain * (FULL - SENSOR.black_level)  # electrons a second of the value 1
ALPHA = 1e-4  # significance of a statistical test, two-sided


def residuals(found: Development, light: np.ndarray) -> np.ndarray:
    """(value − truth)/σ of the samples that the sensor measured itself."""
    assert found.native is not None
    measured = found.native & found.valid[..., None]
    return (found.values - light / UNIT)[measured] / np.sqrt(found.variance[measured])


def assert_standard(z: np.ndarray, tolerance: float = 0.0) -> None:
    """Mean 0 and variance 1 within ALPHA; tolerance: relative, of the variance, for what is stated as approximate.

    The mean may be off by 0.03: σ is that of the measured value, smaller where its noise is below 0, which moves the
    mean of (value − truth)/σ by −1/(2√n) at n electrons though the values have no bias.
    """
    assert standard_normal(z, ALPHA, mean_tolerance=0.03, variance_tolerance=tolerance)


@pytest.mark.parametrize("seed", [11, 12, 13])
def test_a_merged_bracket_has_no_bias_and_its_variance_covers(seed):
    """Scene of 1 : 50 000 by four exposures. The stated variance has one electron more than the law, which matters
    where there are less than fifty; 2 % of the variance is granted for it.
    """
    light = scene(seed)
    found = develop_exposures(
        [shot(light, t, 100 * seed + i) for i, t in enumerate(TIMES)], CalibrationFrames(noise=KNOWN)
    )
    z = residuals(found, light)
    assert z.size > 0.9 * HEIGHT * WIDTH
    assert_standard(z, tolerance=0.02)
    assert found.valid.mean() > 0.95 and found.clipped < 0.01
    assert found.native is not None
    measured = found.native & found.valid[..., None]
    for low, high in [(0.0, 300.0), (300.0, 3000.0), (3000.0, 30_000.0), (30_000.0, 1e9)]:  # dark to bright alike
        part = measured & (light >= low) & (light < high)
        z = (found.values - light / UNIT)[part] / np.sqrt(found.variance[part])
        assert_standard(z, tolerance=0.03)


def test_a_bracket_is_better_than_any_of_its_exposures():
    light = scene(4)
    shots = [shot(light, t, 40 + i) for i, t in enumerate(TIMES)]
    merged = develop_exposures(shots, CalibrationFrames(noise=KNOWN))
    for one in shots:
        alone = develop_exposures([one], CalibrationFrames(noise=KNOWN))
        both = alone.valid & merged.valid
        assert np.median(merged.variance[both] / alone.variance[both]) < 1.0 and merged.valid.sum() >= alone.valid.sum()


@pytest.mark.by_night("22", "23")
@pytest.mark.parametrize("seed", [21, 22, 23])
def test_the_frames_tell_gain_and_read_noise_within_the_stated_errors(seed):
    """Four standard errors each (99.99 % if normal), and errors small enough to be worth stating: 2 % and 5 %."""
    light = scene(seed)
    noise = develop_exposures([shot(light, t, 100 * seed + i) for i, t in enumerate(TIMES)]).noise
    assert abs(noise.gain - SENSOR.gain) < 4 * noise.gain_error and noise.gain_error < 0.02 * SENSOR.gain
    assert abs(noise.read_noise - SENSOR.read_noise) < 4 * noise.read_error and noise.read_error < 0.05 * 6.0


def test_flats_and_darks_tell_gain_and_read_noise():
    """As the laboratory does it: pairs of flats and of darks, the light of the lamp 1 % different between two flats."""
    ramp = np.linspace(0.05, 1.0, WIDTH)[None, :, None] * np.full((HEIGHT, WIDTH, 3), 20_000.0)
    nothing = np.zeros_like(ramp)
    pairs = [(shot(ramp, 1.0, 1), shot(1.01 * ramp, 1.0, 2)), (shot(nothing, 1.0, 3), shot(nothing, 1.0, 4))]
    noise = noise_from_pairs(pairs)
    assert abs(noise.gain - SENSOR.gain) < 4 * noise.gain_error and noise.gain_error < 0.02 * SENSOR.gain
    assert abs(noise.read_noise - SENSOR.read_noise) < 4 * noise.read_error and noise.read_error < 0.02 * 6.0


def test_one_smooth_frame_tells_the_gain_and_texture_only_adds_noise():
    """A ramp: 4 standard errors. A textured scene looks noisier than it is, and never less so."""
    ramp = np.linspace(0.02, 1.0, WIDTH)[None, :, None] * np.full((HEIGHT, WIDTH, 3), 20_000.0)
    noise = noise_from_frames([shot(ramp, 1.0, 5)])
    assert abs(noise.gain - SENSOR.gain) < 4 * noise.gain_error and noise.gain_error < 0.1 * SENSOR.gain
    weak = ramp * (1.0 + 0.2 * gaussian_filter(np.random.default_rng(6).normal(size=(HEIGHT, WIDTH)), 4)[..., None])
    textured = noise_from_frames([shot(weak, 1.0, 6)])
    level = np.array([1000.0, 8000.0])
    assert (textured.variance(level, 0.0) > 0.9 * KNOWN.variance(level, 0.0)).all()


def test_darks_and_flats_are_taken_out():
    """Dark signal of 20 ± 5 DN, twelve hot samples, a lens that darkens to a third: the truth again, variance covers.

    Tolerance of the variance 5 %: one dark and flat serve many samples, so their errors do not average out in it.
    """
    random = np.random.default_rng(7)
    light = scene(7) * 0.3
    fall = np.linspace(0.33, 1.0, WIDTH)[None, :, None]
    offset = np.maximum(random.normal(20.0, 5.0, (HEIGHT, WIDTH)), 0.0)
    offset.flat[random.choice(HEIGHT * WIDTH, 12, replace=False)] = 900.0

    def taken(shown: np.ndarray, t: float, seed: int) -> Exposure:
        """With the dark signal as electrons, which have shot noise as those of light."""
        return shot(shown + offset[..., None] * SENSOR.gain / t, t, seed)

    darks = [taken(np.zeros_like(light), t, 700 + 10 * i + k) for i, t in enumerate(TIMES) for k in range(8)]
    flats = [taken(np.full_like(light, 18_000.0) * fall, 0.8, 800 + k) for k in range(16)]
    shots = [taken(light * fall, t, 900 + i) for i, t in enumerate(TIMES)]
    found = develop_exposures(shots, CalibrationFrames(darks, flats, KNOWN))
    assert found.hot * HEIGHT * WIDTH >= 12 and found.hot < 0.001
    mean = np.array([fall[0, :, 0][k::2].mean() for k in (0, 1)])  # the mean share of the columns of a colour
    shares = np.stack([np.full(WIDTH, mean[0]), np.full(WIDTH, fall.mean()), np.full(WIDTH, mean[1])], axis=1)
    shares[:, 1] = np.where(np.arange(WIDTH) % 2 == 1, mean[1], mean[0])  # green stands in both
    truth = light * shares[None]
    z = residuals(found, truth)
    assert abs(np.median(z)) < 0.05 and 0.9 < z.var() < 1.1
    with pytest.raises(InputError, match="the right black"):  # the dark signal, left in, bends the response
        develop_exposures(shots, CalibrationFrames(noise=KNOWN))


def test_hot_samples_are_found_without_dark_frames():
    light = 0.02 * np.full((HEIGHT, WIDTH, 3), 3000.0)
    offset = np.zeros((HEIGHT, WIDTH))
    offset[30, 41] = offset[120, 200] = 5000.0
    found = develop_exposures([shot(light, 1.0, 9, offset=offset)], CalibrationFrames(noise=KNOWN))
    assert not found.valid[30, 41] and not found.valid[120, 200] and found.valid.mean() > 0.99


def test_shutters_that_miss_their_times_are_measured():
    """Stated 1/60 and 1/15 s, in truth 1/64 and 1/16 s: relative to the first, 4.00 stays; 1/8 for 1/7.5 s is seen."""
    light = scene(8) * 20
    true = (1 / 64, 1 / 16, 1 / 7.5)
    shots = [shot(light, t, 80 + i) for i, t in enumerate(true)]
    stated = (1 / 64, 1 / 16, 1 / 8)
    shots = [
        replace(s, exif=Exif(exposure_s=t), name=f"{i}") for i, (s, t) in enumerate(zip(shots, stated, strict=True))
    ]
    found = develop_exposures(shots)
    assert found.exposures["1"] == 1 / 16
    assert found.exposures["2"] == pytest.approx(1 / 7.5, rel=0.003)
    assert found.record()["linearity"] == "tested"


@pytest.mark.parametrize("moved", [(0.6, -0.4), (-3.3, 2.1), (11.0, 7.0)])
def test_frames_that_moved_are_told_by_how_much(moved):
    """To 0.15 px: a mosaic's grey picture has half the resolution, and the estimate steps of a tenth of a pixel."""
    shots = [shot(scene(5), 0.2, 1), shot(scene(5, moved), 0.8, 2)]
    with pytest.raises(InputError, match="has moved by") as refused:
        develop_exposures(shots, CalibrationFrames(noise=KNOWN))
    words = str(refused.value).split("(")[1].split(")")[0].split(",")
    assert np.abs(np.array([float(word) for word in words]) - moved).max() < 0.15


def test_frames_of_noise_alone_have_not_moved():
    flat = np.full((HEIGHT, WIDTH, 3), 5000.0)
    found = develop_exposures([shot(flat, 0.2, 1), shot(flat, 0.8, 2)], CalibrationFrames(noise=KNOWN))
    assert list(found.shifts.values()) == [(0.0, 0.0)]


def bent(one: Exposure, power: float) -> Exposure:
    return replace(one, signal=np.asarray(one.white * (np.maximum(one.signal, 0.0) / one.white) ** power, np.float32))


def test_a_response_that_is_not_linear_is_told():
    """A display's power 1/2.2 changes the ratio of exposures outright; one that saturates softly bends it by level; a
    wrong black level as well.
    """
    light = scene(6)
    shots = [shot(light, t, 60 + i) for i, t in enumerate(TIMES)]
    with pytest.raises(InputError, match=r"not linear.*power 0\.4[0-9]"):
        develop_exposures([bent(one, 1 / 2.2) for one in shots])
    soft = [
        replace(one, signal=np.asarray(one.signal / (1.0 + 0.2 * one.signal / one.white), np.float32)) for one in shots
    ]
    with pytest.raises(InputError, match=r"not linear.*from dark to bright"):
        develop_exposures(soft)
    with pytest.raises(InputError, match="not linear"):
        develop_exposures([replace(one, signal=one.signal + np.float32(200.0)) for one in shots])
    assert develop_exposures(shots).ratios[0].bend == 0.0


def test_exposures_that_do_not_go_together_are_refused():
    light = scene(3)
    one, two = shot(light, 0.2, 1), shot(light, 0.8, 2)
    small = shot(light[:-2], 0.8, 2)
    coarse = Sensor(1.0, 30_000.0, 6.0, 2.1, 512.0, 14, "")
    for shots, said in [
        ([], "no photograph is given"),
        ([one, small], "different size or mosaic"),
        ([one, shot(light, 0.8, 2, coarse)], "different size or mosaic"),
        ([one, replace(two, exif=Exif(0.8, 200.0))], "different ISO"),
        ([replace(one, exif=Exif(0.2, None, 4.0)), replace(two, exif=Exif(0.8, None, 8.0))], "different apertures"),
        ([one, replace(two, exif=Exif())], r"state exposures_s \(--exposures\)"),
    ]:
        with pytest.raises(InputError, match=said) as refused:
            develop_exposures(shots)
        assert "\n" not in str(refused.value)
    even = np.full((HEIGHT, WIDTH, 3), 100.0)
    with pytest.warns(UserWarning, match=r"--gain, --read-noise\); the noise of a typical sensor is assumed"):
        assert develop_exposures([shot(even, 1.0, 1)]).noise.source.endswith("assumed")
    with pytest.raises(InputError, match="--gain"):
        noise_from_pairs([(shot(0 * light, 1.0, 1), shot(0 * light, 1.0, 2))])
    with pytest.warns(UserWarning, match="is used"):
        dark_master([shot(0 * light, 1.0, 1)], 5.0, KNOWN)
    with pytest.raises(InputError, match=r"100 % of the samples are clipped.*shorter"):
        develop_exposures([shot(light + 1e9, 0.2, 1)], CalibrationFrames(noise=KNOWN))
    with pytest.raises(InputError, match="has ISO 400 and the photographs 100"):
        develop_exposures([one], CalibrationFrames(darks=[replace(two, exif=Exif(0.2, 400.0))], noise=KNOWN))
    with pytest.raises(InputError, match="is clipped or dark"):
        develop_exposures([one], CalibrationFrames(flats=[shot(light + 1e9, 1.0, 1)], noise=KNOWN))
