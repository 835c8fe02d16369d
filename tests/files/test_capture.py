"""A capture reads back as it was written."""

from dataclasses import replace

import numpy as np
import pytest

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.camera.sensor import CANON_EOS_300D, Sensor, develop_raw, expose_raw, native_channels
from hagoromo.errors import InputError
from hagoromo.files.exr import read_exr, write_exr
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import Capture, load_capture, save_capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import read_points

HEIGHT, WIDTH = 13, 17
LENS = (-0.1, 0.02, 0.001, -0.002, 0.003)
NEAR = Lamp(position=(0.5, -1.0, 2.0), intensity=(3.0, 2.0, 1.0), spectrum=Spectrum.named("A"), name="left")
FAR = Lamp(to_lamp=(0.0, 0.6, 0.8), intensity=7.5)
PLAIN = Sensor(exposure=9000.0, full_well=30_000.0, read_noise=6.0, gain=2.3, black_level=64.0, bits=14)


def light(seed: int, channels: int = 3) -> np.ndarray:
    return np.random.default_rng(seed).uniform(0.1, 0.9, (HEIGHT, WIDTH, channels))


def camera(sensor: Sensor | None, seed: int = 0, response: str | None = "canon_eos_300d") -> Camera:
    plain = Camera(WIDTH, HEIGHT, (31.0, 32.0), (8.1, 6.9), LENS, name="test")
    eye = np.random.default_rng(seed).uniform(1.0, 2.0, 3)
    return replace(
        plain.look_at(eye, (0.0, 0.1, 0.2)), sensor=sensor, response=Response.load(response) if response else None
    )


def photograph(sensor: Sensor, seed: int, lamps=(), response="canon_eos_300d", channels: int = 3) -> Photograph:
    values, variance, mask = develop_raw(expose_raw(light(seed, channels), sensor, seed), sensor)
    mask = mask.copy()
    mask[2, 3:7] = False
    native = native_channels(sensor, HEIGHT, WIDTH)
    return Photograph(values, variance, mask, camera(sensor, seed, response), tuple(lamps), f"view {seed}", native)


def assert_same(mine: Photograph, theirs: Photograph, rtol: float = 0.0) -> None:
    np.testing.assert_allclose(mine.values, theirs.values, rtol=rtol)
    np.testing.assert_allclose(mine.variance, theirs.variance, rtol=rtol)
    np.testing.assert_array_equal(mine.mask, theirs.mask)
    assert (mine.native is None) == (theirs.native is None)
    assert mine.native is None or (mine.native == theirs.native).all()
    assert mine.name == theirs.name
    for figure in ("width", "height", "focal", "principal", "distortion", "sensor", "name"):
        assert getattr(mine.camera, figure) == getattr(theirs.camera, figure)
    np.testing.assert_allclose(mine.camera.world_to_camera, theirs.camera.world_to_camera, atol=1e-14)
    assert len(mine.lamps) == len(theirs.lamps)
    for a, b in zip(mine.lamps, theirs.lamps, strict=True):
        assert (a.intensity, a.name) == (b.intensity, b.name)
        np.testing.assert_array_equal(a.spectrum.values, b.spectrum.values)
        for one, other in ((a.position, b.position), (a.to_lamp, b.to_lamp)):
            assert (one is None) == (other is None)
            if one is not None and other is not None:
                np.testing.assert_allclose(one, other, atol=1e-15)  # a direction is made unit again


@pytest.mark.parametrize("sensor", [PLAIN, CANON_EOS_300D, replace(PLAIN, bits=8, gain=70.0, black_level=3.0)])
def test_sensor_numbers_read_back_as_the_same_photographs(tmp_path, sensor):
    """Bit by bit: the numbers are the sensor's own, kept in PNG behind a mosaic or without."""
    shots = [photograph(sensor, 1, [NEAR, FAR]), photograph(replace(sensor, exposure=5000.0), 2, [FAR])]
    folder = save_capture(Capture(tuple(shots), "two", truth={"gamma": 0.2}), tmp_path / "two")
    assert sorted(path.suffix for path in (folder / "images").iterdir()) == [".png", ".png"]
    read = load_capture(folder)
    assert read.name == "two" and read.truth == {"gamma": 0.2} and read.folder == folder
    for mine, theirs in zip(read.photographs, shots, strict=True):
        assert_same(mine, theirs)
        assert mine.camera.response is not None
        np.testing.assert_array_equal(mine.camera.response.values, Response.load("canon_eos_300d").values)
        assert mine.camera.response.name == "canon_eos_300d"
    assert read.photographs[0].lamps[1] is read.photographs[1].lamps[0]


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_linear_values_read_back_as_the_same_photographs(tmp_path, channels):
    """Values that no sensor number gives back are kept in EXR with their variance."""
    noise_free = light(3, channels).astype(np.float32)
    mask = np.ones((HEIGHT, WIDTH), bool)
    shot = Photograph(noise_free, 0.01 * noise_free, mask, camera(PLAIN, 3, None), (NEAR,), "clean")
    folder = save_capture(Capture((shot,)), tmp_path / "a")
    assert (folder / "images" / "0000.exr").exists() and not (folder / "masks").exists()
    assert_same(load_capture(folder).photographs[0], shot)


def test_another_demosaicing_keeps_its_values_and_native_samples(tmp_path):
    shot = photograph(CANON_EOS_300D, 4)
    raw = expose_raw(light(4), CANON_EOS_300D, 4)
    values, variance, _ = develop_raw(raw, CANON_EOS_300D, "menon2007")
    menon = replace(shot, values=values, variance=variance)
    assert_same(load_capture(save_capture(Capture((menon,)), tmp_path / "a")).photographs[0], menon)
    bilinear = save_capture(Capture((shot,)), tmp_path / "b")
    np.testing.assert_array_equal(load_capture(bilinear, demosaic="menon2007").photographs[0].values, values)


def test_a_known_shape_reads_back(tmp_path):
    shots = (photograph(PLAIN, 5, [NEAR]), replace(photograph(PLAIN, 5, [FAR]), name="other"))
    points, normals = (light(seed).astype(np.float32) for seed in (6, 7))
    read = load_capture(save_capture(Capture(shots, points=points, normals=normals), tmp_path / "a"))
    np.testing.assert_array_equal(read.points, points)
    np.testing.assert_array_equal(read.normals, normals)
    with pytest.raises(InputError, match="one view"):
        Capture((shots[0], photograph(PLAIN, 6)), points=points)
    with pytest.raises(InputError, match="resize them"):
        Capture(shots, normals=normals[:-1])


def test_a_slice_of_the_frames_loads(tmp_path):
    folder = save_capture(Capture(tuple(photograph(PLAIN, seed) for seed in range(5))), tmp_path / "a")
    assert [p.name for p in load_capture(folder, slice(1, None, 2)).photographs] == ["view 1", "view 3"]


def test_an_existing_capture_is_replaced_only_by_force(tmp_path):
    folder = save_capture(Capture((photograph(PLAIN, 1),)), tmp_path / "a")
    with pytest.raises(InputError, match="--force"):
        save_capture(Capture((photograph(PLAIN, 2),)), folder)
    save_capture(Capture((photograph(PLAIN, 2),)), folder, force=True)
    assert load_capture(folder).photographs[0].name == "view 2"


def test_a_capture_that_cannot_be_saved_leaves_nothing_behind(tmp_path):
    mixed = Capture((photograph(PLAIN, 1), photograph(PLAIN, 2, response="cie1931")))
    with pytest.raises(InputError, match="responses"):
        save_capture(mixed, tmp_path / "a")
    with pytest.raises(InputError, match="cannot be written"):
        save_capture(Capture((photograph(PLAIN, 1),), truth={"gamma": float("nan")}), tmp_path / "b")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"values": np.ones((5, 7, 3), np.float32)}, "its camera takes"),
        ({"variance": np.ones((5, 7, 3), np.float32)}, "variance of shape"),
        ({"mask": np.ones((5, 7), bool)}, "mask of shape"),
        ({"native": np.ones((HEIGHT, WIDTH), bool)}, "native of shape"),
        ({"values": np.full((HEIGHT, WIDTH, 3), np.nan, np.float32)}, "not finite"),
        ({"variance": np.zeros((HEIGHT, WIDTH, 3), np.float32)}, "variance above 0"),
    ],
)
def test_what_makes_no_photograph_is_refused(change, message):
    with pytest.raises(InputError, match=message):
        replace(photograph(PLAIN, 1), **change)


def test_a_capture_has_a_photograph():
    with pytest.raises(InputError, match="no photograph"):
        Capture(())


@pytest.mark.parametrize("away", [0.0, 1e4, 1e6])
def test_points_keep_their_places_far_from_the_origin(tmp_path, away):
    """Single precision alone keeps 1 mm at 10 km, and 6 cm at 1000 km."""
    points = np.random.default_rng(4).uniform(-0.1, 0.1, (HEIGHT, WIDTH, 3)) + away * np.array((1.0, -0.7, 0.3))
    points[3, 4:9] = 0.0
    capture = Capture((photograph(PLAIN, 1),), points=points, normals=np.zeros_like(points))
    again = load_capture(save_capture(capture, tmp_path / "capture")).points
    assert again is not None and np.abs(again - points).max() < 3e-8
    assert not again[3, 4:9].any() and (again != 0.0).any(axis=2).sum() == HEIGHT * WIDTH - 5
    _, header = read_exr(tmp_path / "capture" / "points.exr")
    assert ("points_origin" in header) == (away > 0.0)  # files of scenes near the origin are as before


@pytest.mark.parametrize("stated", ["1 2", "1 2 nan", "one two three", "1 2 inf", ""])
def test_a_damaged_origin_of_points_is_refused(tmp_path, stated):
    write_exr(tmp_path / "points.exr", dict.fromkeys(("P.X", "P.Y", "P.Z"), np.ones((3, 4))), {"points_origin": stated})
    with pytest.raises(InputError, match=r"points_origin is .*: give three finite numbers"):
        read_points(tmp_path / "points.exr")
