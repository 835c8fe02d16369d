"""Captures that are written photograph by photograph: half floats, a model of the variance, memory for one of them."""

import gc
import json
import tracemalloc

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.camera.camera import ORTHOGRAPHIC_FOCAL
from hagoromo.camera.sensor import demosaiced
from hagoromo.files.exr import read_layout
from hagoromo.files.png import write_png
from hagoromo.photograph.development.noise import Noise
from hagoromo.photograph.variance_model import VarianceModel
from tests.inverse.simulated_bracket import FULL, SENSOR, numbers, scene, write_dng

LAMPS = [hg.Lamp(to_lamp=to, name=f"{k}.dng") for k, to in enumerate([(0, 0.5, 1), (0.4, -0.3, 1), (-0.4, -0.2, 1)])]
KNOWN = hg.Developing(gain=SENSOR.gain, read_noise=SENSOR.read_noise)


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """Three RAW files of one scene: light, and the folder of the capture made of them."""
    home, light = tmp_path_factory.mktemp("session"), scene(3)
    for k, seconds in enumerate((0.1, 0.2, 0.2)):
        write_dng(home / f"{k}.dng", numbers(light, seconds, 20 + k), seconds)
    files = [home / f"{k}.dng" for k in range(3)]
    hg.capture(files, LAMPS, developing=KNOWN, out=home / "capture")
    return files, light / SENSOR.gain / (int(FULL) - SENSOR.black_level), home / "capture"


def test_values_and_variances_of_raw_files_are_the_light_and_its_noise(session):
    """Light per second over white: z-scores of the measured samples have variance 1 to 3 % and mean 0 to 0.05: the
    variance is taken at the noisy value, which is smaller where the noise is negative.
    """
    _, light, folder = session
    for shot in hg.load_capture(folder).photographs:
        assert shot.native is not None
        measured = shot.native & shot.mask[..., None]
        z = (shot.values - light)[measured] / np.sqrt(shot.variance[measured])
        assert abs(z.mean()) < 0.05 and 0.97 < z.var() < 1.03 and measured.mean() > 0.25


def test_the_folder_holds_what_capture_gives_in_memory(session):
    """To the rounding of half floats: 2⁻¹¹ of the value, which is 0.17 of the noise of a mean of four full wells."""
    files, _, folder = session
    stored, direct = hg.load_capture(folder), hg.capture(files, LAMPS, developing=KNOWN)
    assert stored.assumptions == direct.assumptions and len(stored.assumptions) >= 5
    for one, other in zip(stored.photographs, direct.photographs, strict=True):
        assert one.name == other.name and one.lamps[0].name == other.lamps[0].name
        np.testing.assert_array_equal(one.mask, other.mask)
        np.testing.assert_array_equal(one.native, other.native)
        off = np.abs(one.values - other.values)[one.mask] / np.sqrt(other.variance[one.mask])
        assert off.max() < 0.18
        np.testing.assert_allclose(one.variance[one.mask], other.variance[one.mask], rtol=0.01)
        np.testing.assert_allclose(one.camera.matrix, other.camera.matrix, rtol=1e-12)


def test_photographs_are_half_floats_without_a_plane_of_variances(session):
    *_, folder = session
    record = json.loads((folder / "transforms.json").read_text())
    assert record["frames"][0]["exposure_s"] == 0.1 and record["iso"] == 100.0
    assert len(record["variance_model"]["variance"]) == 3 and record["variance_model"]["mosaic"] == "RGGB"
    for path in (folder / "images").iterdir():
        channels = read_layout(path.read_bytes()).parts[0].channels
        assert set(channels) <= {"R", "G", "B", "A"} and {kind for kind, _, _ in channels.values()} == {1}
    again = hg.load_capture(hg.load_capture(folder).save(folder.parent / "again"))
    for one, other in zip(hg.load_capture(folder).photographs, again.photographs, strict=True):
        np.testing.assert_allclose(one.variance[one.mask], other.variance[one.mask], rtol=1e-6)


def test_the_focal_length_of_the_exif_is_the_camera_and_the_object_is_at_the_origin(session):
    _, light, folder = session
    camera = hg.load_capture(folder).photographs[0].camera
    assert camera.focal[0] == pytest.approx(55.0 / 22.7 * light.shape[1], rel=1e-4) and not camera.orthographic
    np.testing.assert_allclose(camera.project([0.0, 0.0, 0.0]), camera.principal)
    # the longer side of the picture is one unit of length at the object
    np.testing.assert_allclose(
        camera.project([0.5, 0.0, 0.0]) - camera.principal, (0.5 * light.shape[1], 0.0), atol=1e-9
    )


def test_the_variance_model_is_that_of_every_sample(session):
    """Against the exact propagation through the mosaic, away from the edges that mirror it."""
    random = np.random.default_rng(4)
    signal = random.uniform(0.0, 9000.0, (40, 46))
    noise = Noise(2.0, 3.0)
    exact = demosaiced(signal, noise.variance(signal, 0.0), signal < 0.0, "GBRG", "bilinear")
    ends = noise.variance(np.array([0.0, 1e4]), 0.0)
    model = VarianceModel(np.array([0.0, 1e4]), np.stack([ends] * 3), "GBRG")
    values = exact[0].astype(np.float32)
    found = model.of(values) - (2.0**-10.5 * values) ** 2 / 12.0
    np.testing.assert_allclose(found[2:-2, 2:-2], exact[1][2:-2, 2:-2], rtol=1e-4)
    again = VarianceModel.from_record(model.record(), "a")
    np.testing.assert_allclose(again.of(values), model.of(values), rtol=1e-6)


def test_eight_bits_keep_the_rounding_of_their_curve(tmp_path):
    """sRGB of a slope: the variance above that of the sensor is (dL/dn)²/12."""
    steps = np.repeat(np.tile(np.linspace(2, 250, 120), (20, 1))[..., None], 3, axis=2)
    write_png(tmp_path / "a.png", np.rint(steps).astype(np.uint8))
    quiet = hg.Developing(transfer="srgb", gain=1e6, read_noise=0.0)
    shot = hg.capture([tmp_path / "a.png"], [LAMPS[0]], developing=quiet).photographs[0]
    light = hg.srgb_decode(np.rint(steps))
    np.testing.assert_allclose(shot.values, light, rtol=1e-5)
    slope = (hg.srgb_decode(np.rint(steps) + 0.5) - hg.srgb_decode(np.rint(steps) - 0.5)) ** 2 / 12.0
    inner = slope[:, 10:-10]
    np.testing.assert_allclose(shot.variance[:, 10:-10], inner + (2.0**-10.5 * light[:, 10:-10]) ** 2 / 12.0, rtol=0.1)


@pytest.mark.nightly
def test_memory_does_not_grow_with_the_photographs(tmp_path):
    """The peak of nine photographs is within 3 % of that of three; six more of them would be 1.3 MB of values.

    Other threads of the process may allocate at the same time: the least of two peaks counts.
    """
    random = np.random.default_rng(1)
    lamps = [hg.Lamp(to_lamp=(random.normal(), random.normal(), 3.0)) for _ in range(9)]
    peaks: dict[int, list[int]] = {3: [], 9: []}
    for k in range(9):
        picture = random.integers(600, 700, (110, 160, 3))
        picture[30:70, 50:110] = random.integers(20000, 60000, (40, 60, 3))
        write_png(tmp_path / f"{k}.png", picture.astype(np.uint16))
    for count in (3, 9, 3, 9):  # the first run fills caches of imports
        files = [tmp_path / f"{k}.png" for k in range(count)]
        gc.collect()
        tracemalloc.start()
        out = tmp_path / "capture"
        hg.capture(files, lamps[:count], masks="auto", developing=KNOWN, out=out, force=True)
        peaks[count].append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
    assert min(peaks[9]) < 1.03 * min(peaks[3])


def test_an_orthographic_capture_needs_no_focal_length(tmp_path):
    for k in range(3):
        write_png(tmp_path / f"{k}.png", np.full((20, 30, 3), 900 + k, np.uint16))
    hg.capture([tmp_path / f"{k}.png" for k in range(3)], LAMPS, out=tmp_path / "capture")
    record = json.loads((tmp_path / "capture" / "transforms.json").read_text())
    assert record["camera_model"] == "ORTHOGRAPHIC" and "orthographic" in record["assumptions"]["camera"]
    first = hg.load_capture(tmp_path / "capture").photographs[0].camera
    for key in ("fl_x", "fl_y", "cx", "cy", "transform_matrix"):
        record.pop(key, None)
        for frame in record["frames"]:
            frame.pop(key, None)
    (tmp_path / "capture" / "transforms.json").write_text(json.dumps(record))
    again = hg.load_capture(tmp_path / "capture").photographs[0].camera
    np.testing.assert_allclose(again.matrix, first.matrix, rtol=1e-12)
    assert again.orthographic and np.linalg.norm(again.position) == ORTHOGRAPHIC_FOCAL


def test_the_distortion_of_the_lens_is_removed_as_develop_removes_it(session, tmp_path):
    """A capture of RAW files against those files developed with --undistort: values, validity and native samples."""
    files, light, _ = session
    height, width = light.shape[:2]
    lens = hg.Camera(width, height, (300.0, 301.0), (0.5 * width + 2.0, 0.5 * height), (-0.2, 0.1, 1e-3, 0.0, 0.0))
    lamps = [hg.Lamp(to_lamp=(0.1 * k, 0.2, -1.0), name=f"{k}.dng") for k in range(3)]
    hg.capture(files, lamps, lens, developing=KNOWN, out=tmp_path / "capture")
    capture = hg.load_capture(tmp_path / "capture")
    stored = capture.photographs[1]
    developed = hg.develop(files[1], gain=SENSOR.gain, read_noise=SENSOR.read_noise, undistort=lens)
    assert not any(stored.camera.distortion) and "removed" in capture.assumptions["camera"]
    both = stored.mask & developed.valid
    assert both.mean() > 0.9 * developed.valid.mean()
    off = np.abs(stored.values - developed.values)[both] / np.sqrt(stored.variance[both])
    assert np.quantile(off, 0.999) < 0.1  # half floats, and maps in single precision
    assert stored.native is not None and developed.native is not None
    assert (stored.native == developed.native)[both].mean() > 0.999
    assert (stored.variance >= 0.99 * developed.variance)[both].mean() > 0.999
