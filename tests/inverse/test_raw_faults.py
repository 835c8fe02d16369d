"""Raw frames with the faults of real sensors: narrow-band lamps, flooded neighbours, a black level that is off."""

from typing import Any

import numpy as np
import pytest

from hagoromo.app.cli import main
from hagoromo.errors import InputError
from hagoromo.files.exif import Exif
from hagoromo.files.exr import read_exr
from hagoromo.files.png import write_png
from hagoromo.photograph.development.develop import develop
from hagoromo.photograph.development.develop_exposures import develop_exposures
from hagoromo.photograph.development.development import CalibrationFrames, Development
from hagoromo.photograph.development.exposure import Exposure, StatedExposure, read_exposure
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.development.noise_estimate import noise_from_frames, noise_from_pairs
from tests.inverse.simulated_raw import (
    BLACK,
    HEIGHT,
    SEVERAL_GREENS,
    TIMES,
    USUAL,
    WIDTH,
    RawSensor,
    object_light,
    raw_bracket,
    raw_exposure,
    raw_numbers,
)

FULL_LIGHT = USUAL.full_well / 3.0 / TIMES[-1]  # e⁻/s that fill the longest exposure to a third
BLUE = (0.02, 0.40, 0.45, 1.0)


@pytest.mark.parametrize(("over", "bands"), [(-0.2, SEVERAL_GREENS), (0.5, BLUE), (1.0, SEVERAL_GREENS)])
def test_brackets_under_narrow_lamps_are_accepted_and_their_noise_is_the_sensors(over, bands):
    """Gain within four standard errors, which are below 5 %; the black level to 0.1 DN; no pair bends by 3 %."""
    found = develop_exposures(raw_bracket(3, RawSensor(over=over), bands))
    assert abs(found.noise.gain - USUAL.gain) < 4 * found.noise.gain_error and found.noise.gain_error < 0.05 * 23.5
    assert abs(found.noise.read_noise - USUAL.read_noise) < 4 * found.noise.read_error
    assert list(found.blacks.values())[:4] == pytest.approx([over] * 4, abs=0.1)
    assert len(found.ratios) >= 4 and max(ratio.bend for ratio in found.ratios) <= 0.03


EIGHT_BITS = RawSensor(gain=22.0, read_noise=9.0, full_well=6500.0)
OVERS = (0.7, -0.1, 0.4, 1.0)


@pytest.mark.parametrize(("seed", "read_noise", "black"), [(3, 9.0, 0.0), (5, 14.0, 4.0), (6, 5.0, 16.0)])
def test_eight_bit_brackets_of_dark_scenes_tell_the_noise_and_the_black_of_each_frame(seed, read_noise, black):
    """Nine tenths of the frame have next to no light, 8 bits, each frame another black; noise is cut off at number 0.

    Gain within a tenth and three standard errors, no pair bends by 3 %. Blacks: to 0.1 DN those of the shorter frames;
    those of all within three standard errors, as constant light and a black in proportion to the exposure are one.
    """
    sensor, rows, columns = EIGHT_BITS._replace(read_noise=read_noise), *np.mgrid[:HEIGHT, :WIDTH]
    shape = np.exp(-0.5 * (((rows - 70) / 26) ** 2 + ((columns - 90) / 30) ** 2) ** 2)
    light, shots = (0.004 + shape * object_light(seed, 0.3)) * 0.5 * 255 * sensor.gain / TIMES[3], []
    for i, over in enumerate(OVERS):
        numbers = raw_numbers(light, TIMES[i], sensor._replace(over=over), 10 * seed + i)  # of a black of 128 DN
        signal = np.clip(numbers - BLACK, -black, 255.0 - black)
        exif = Exif(exposure_s=TIMES[i], iso=100.0)
        white = 255.0 - black
        shots.append(Exposure(signal.astype(np.float32), 1 / 12, signal >= white, white, "RGGB", exif, f"{i}"))
    found = develop_exposures(shots)
    assert found.noise.source.startswith("pairs of frames") and found.noise.determined
    assert found.noise.gain == pytest.approx(22.0, rel=0.1)
    assert abs(found.noise.gain - 22.0) < 3 * found.noise.gain_error
    assert len(found.ratios) == 3 and max(ratio.bend for ratio in found.ratios) < 0.03
    off, errors = np.array(list(found.blacks.values())) - OVERS, np.array(list(found.black_errors.values()))
    assert (np.abs(off[:2]) < 0.1).all() and (np.abs(off) < 3 * errors).all()


def test_further_frames_of_a_camera_tell_the_noise_that_two_dark_frames_do_not(recwarn):
    """Two frames below 3 DN: what is usual takes part, and it is said. With the bracket of another lamp: the truth."""
    dim = raw_bracket(3, USUAL, BLUE, 0.002, (0.0, 0.0))
    alone = develop_exposures(dim).noise
    assert not alone.determined or "assumed" in alone.source
    assert any("hardly determine" in str(of.message) or "assumed" in str(of.message) for of in recwarn)
    together = develop_exposures(dim, CalibrationFrames(others=raw_bracket(4))).noise
    assert together.determined and abs(together.gain - USUAL.gain) < 3 * together.gain_error


def test_the_black_of_each_frame_comes_back_from_a_file(tmp_path):
    found = develop_exposures(raw_bracket(3, overs=OVERS))
    again = Development.load(found.save(tmp_path / "one.exr"))
    assert again.blacks == found.blacks and again.black_errors == found.black_errors and len(again.blacks) == 4


def test_clipped_samples_and_their_flooded_neighbours_are_left_out():
    """Thirty times the light: the merged values are those of the light, as those of a sensor that floods nothing."""
    known = CalibrationFrames(noise=Noise(USUAL.gain, USUAL.read_noise))
    flooded, dry = (develop_exposures(raw_bracket(3, RawSensor(bloom=b), level=30.0), known) for b in (0.1, 0.0))
    both = flooded.valid & dry.valid
    assert both.mean() > 0.9
    off = (flooded.values - dry.values)[both] / np.sqrt((flooded.variance + dry.variance)[both])
    assert abs(off.mean()) < 0.02 and off.std() < 1.1


@pytest.mark.parametrize("seed", [1, 4])
def test_a_nearly_black_frame_has_not_moved(seed):
    """Its noise and the sensor's columns match some shift of any picture; before, (−29.3, 24.5) px were stated."""
    columns = 0.6 * np.random.default_rng(9).normal(size=WIDTH)
    light = object_light(seed) * FULL_LIGHT
    numbers = [
        raw_numbers(light * share, TIMES[i], USUAL, 10 * seed + i, SEVERAL_GREENS)
        for i, share in ((0, 0.003), (6, 1.0))
    ]
    shots = [
        raw_exposure(np.rint(of + columns), t, USUAL) for of, t in zip(numbers, (TIMES[0], TIMES[-1]), strict=True)
    ]
    found = develop_exposures(shots, CalibrationFrames(noise=Noise(USUAL.gain, USUAL.read_noise)))
    assert list(found.shifts.values()) == [(0.0, 0.0)]


def test_noise_of_dim_pairs_is_not_certain_of_a_wrong_gain():
    """Signals below 11 DN. Before, a read noise near rounding gave 19.6 ± 0.0009 for 23.5."""
    sensor = RawSensor(read_noise=18.0)
    light = object_light(1) * FULL_LIGHT * 0.01
    shots = [raw_exposure(raw_numbers(light, t, sensor, i), t, sensor) for i, t in enumerate(TIMES)]
    found = noise_from_pairs([(shots[0], shots[1]), (shots[2], shots[3]), (shots[4], shots[5])])
    assert abs(found.gain - 23.5) < 4 * found.gain_error and found.gain_error < 0.2 * 23.5
    quiet = RawSensor(read_noise=5.0)
    shots = [raw_exposure(raw_numbers(light, t, quiet, i), t, quiet) for i, t in enumerate(TIMES)]
    try:
        found = noise_from_pairs([(shots[0], shots[1]), (shots[2], shots[3]), (shots[4], shots[5])])
    except InputError as refused:
        assert "does not grow" in str(refused) or "too few" in str(refused)
    else:
        assert abs(found.gain - 23.5) < 4 * found.gain_error


@pytest.mark.parametrize("contrast", [0.0, 0.05])
def test_the_noise_of_a_single_frame_is_right_within_a_tenth(contrast):
    """Over the levels of the frame, with fine texture of 0 and 1 % behind a lens of 1.3 px on a mosaic."""
    light = np.tile(object_light(1, contrast), (3, 3))
    light *= FULL_LIGHT / np.median(light)
    parts = [
        [raw_numbers(part, TIMES[-1], USUAL, 3 * i + j, (1, 0.4, 0.2, 0.1)) for j, part in enumerate(np.hsplit(row, 3))]
        for i, row in enumerate(np.vsplit(light, 3))
    ]  # fmt: skip
    found = noise_from_frames([raw_exposure(np.block(parts), TIMES[-1], USUAL)])
    levels = np.array([100.0, 300.0, 1000.0])
    ratio = found.variance(levels, 1 / 12) / Noise(USUAL.gain, USUAL.read_noise).variance(levels, 1 / 12)
    assert (np.abs(ratio - 1.0) < 0.1).all()


def test_one_clipped_colour_leaves_the_others(tmp_path):
    """Red is clipped all over; green and blue are valid, their layers say so, and the file gives them back."""
    light = np.full((HEIGHT, WIDTH), 4.0 * USUAL.full_well / TIMES[0])
    numbers = raw_numbers(light, TIMES[0], RawSensor(bloom=0.0), 1, (1.0, 0.1, 0.1, 0.05))
    with pytest.warns(UserWarning, match="R is clipped everywhere and G, B is not"):
        found = develop_exposures(
            [raw_exposure(numbers, TIMES[0], USUAL)], CalibrationFrames(noise=Noise(USUAL.gain, USUAL.read_noise))
        )
    assert found.valid_channels is not None
    assert not found.valid.any() and found.valid_channels[..., 1:].all() and not found.valid_channels[..., 0].any()
    layers, _ = read_exr(found.save(tmp_path / "one.exr"))
    assert (layers["valid.R"] == 0.0).all() and (layers["valid.G"] == 1.0).all()
    again = Development.load(tmp_path / "one.exr")
    np.testing.assert_array_equal(again.valid_channels, found.valid_channels)


def sixteen_bits(path, numbers):
    write_png(path, numbers.astype(np.uint16))
    return path


def test_dark_frames_have_exposure_times_of_their_own(tmp_path, capsys):
    """A pattern of dark current: with their times, darks fit their photographs; without, the times are asked for."""
    random, light = np.random.default_rng(2), object_light(2) * FULL_LIGHT / 4.0
    warm = 23.5 * random.uniform(50.0, 800.0, (HEIGHT, WIDTH))  # e⁻/s
    times, paths, darks = (0.02, 0.08), [], []
    for i, t in enumerate(times):
        numbers = raw_numbers(light + warm, t, USUAL, 10 + i, (1, 1, 1, 1))
        paths.append(sixteen_bits(tmp_path / f"shot{i}.png", numbers))
        darks.append(sixteen_bits(tmp_path / f"dark{i}.png", raw_numbers(warm, t, USUAL, 20 + i, (1, 1, 1, 1))))
    options: dict[str, Any] = dict(exposures_s=times, black=128, white=3400, mosaic="RGGB", gain=23.5, read_noise=18.0)
    with pytest.raises(InputError, match=r"dark1.png does not state its exposure time.*--dark-exposures"):
        develop(paths, darks=darks[::-1], **options)
    found = develop(paths, darks=darks[::-1], dark_exposures_s=times[::-1], **options)
    truth = light / 23.5 / (3400 - 128)
    assert found.native is not None
    native = found.native & found.valid[..., None]
    ratio = found.values[native].sum() / (truth[..., None] * native)[native].sum()
    assert ratio == pytest.approx(1.0, abs=0.01)
    command = ["develop", *map(str, paths), "--exposures", *map(str, times), "--black", "128", "--white", "3400"]
    command += ["--mosaic", "RGGB", "--gain", "23.5", "--read-noise", "18", "--dark", *map(str, darks)]
    assert main([*command, "--dark-exposures", "0.02", "0.08", "--out", str(tmp_path / "out.exr")]) == 0
    assert main([*command, "--dark-exposures", "0.02", "--out", str(tmp_path / "other.exr")]) == 2
    assert "1 exposure times for 2 dark frames" in capsys.readouterr().err


def test_a_mosaic_that_is_not_stated_is_noticed(tmp_path):
    """A grey photograph of the same object, and one that is said to have none, are taken as they are."""
    light = object_light(5, 0.5) * FULL_LIGHT
    coloured = sixteen_bits(tmp_path / "raw.png", raw_numbers(light, TIMES[-1], USUAL, 1, (1.0, 0.9, 0.9, 0.7)))
    grey = sixteen_bits(tmp_path / "grey.png", raw_numbers(light, TIMES[-1], USUAL, 1, (1.0,) * 4))
    with pytest.raises(InputError, match=r"has one channel, and the positions .* state mosaic \(--mosaic\)"):
        read_exposure(coloured)
    assert read_exposure(coloured, StatedExposure(mosaic="none")).signal.shape == (HEIGHT, WIDTH, 1)
    assert read_exposure(coloured, StatedExposure(mosaic="RGGB")).signal.shape == (HEIGHT, WIDTH)
    assert read_exposure(grey).signal.shape == (HEIGHT, WIDTH, 1)


def test_the_transfer_curve_of_a_mosaic_is_estimated(tmp_path):
    """8 bits of exponent 1/2.2 behind a mosaic: values proportional to the light within 3 %, over a range of 1 : 30."""
    light, paths, times = object_light(6, 0.6), [], (0.01, 0.02, 0.04, 0.08, 0.16)
    share = np.tile([[1.0, 0.6], [0.6, 0.3]], (HEIGHT // 2, WIDTH // 2))
    for i, t in enumerate(times):
        shown = np.minimum(light * share * t / 0.32, 1.0) ** (1 / 2.2)
        shown += np.random.default_rng(i).normal(0.0, 0.004, shown.shape)
        write_png(tmp_path / f"{i}.png", np.clip(np.rint(255 * shown), 0, 255).astype(np.uint8))
        paths.append(tmp_path / f"{i}.png")
    found = develop(paths, exposures_s=times, transfer="estimate", mosaic="RGGB", gain=1.0, read_noise=1.0)
    assert found.native is not None
    native = found.native & found.valid[..., None]
    ratio = found.values[native] / np.broadcast_to((light * share)[..., None], found.values.shape)[native]
    bright = np.broadcast_to((light * share)[..., None], found.values.shape)[native]
    ratio = ratio[(bright > 0.05) & (bright < 1.5)] / np.median(ratio)
    assert np.percentile(np.abs(ratio - 1.0), 50) < 0.03
