"""What `save` wrote, `load` reads: each typed result with its settings and seed, from the file alone."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.calibration.lamps.highlight import Highlight
from hagoromo.calibration.lamps.lamp_calibration import LampCalibration
from hagoromo.calibration.lamps.place import LampPlace
from hagoromo.calibration.lamps.reading import Strength
from hagoromo.least_squares.fit_status import FitStatus, Status
from hagoromo.light.lamp_spread import LampSpread

NOTHING = np.zeros((0, 2))
ENDED = FitStatus(Status.OUT_OF_STEPS, 7, 0.25, last_step=1e-3)


def lamp_calibration(near: bool) -> LampCalibration:
    ball = hg.Ball((31.5, 30.25), 11.0, (0.1, 0.2, 0.3), 0.05, NOTHING, edge_share=0.4)
    balls = (ball, hg.Ball((71.0, 29.0), 11.5, (0.1, 0.1, 0.2), 0.04, NOTHING, source="photographs", softness=0.8))
    to_lamp = np.array([0.6, 0.0, 0.8])
    shown = Highlight((33.0, 29.0), 0.1, 17, 0.01, NOTHING, NOTHING, "core", (35.0, 28.0), "streaks")
    readings = [hg.LampReading("a", to_lamp, 0.5, shown, ball, 1.5) for ball in balls]
    place = LampPlace("a", np.zeros(3), to_lamp, 0.4, 2.0 * to_lamp, 1e-4 * np.eye(3), 0.5, 0.01, 1.1, tuple(readings))
    strength = Strength(np.ones(3), 0.1 * np.ones(3), "reference", 0.02, (to_lamp, 1.5), (ENDED,))
    spread = LampSpread(1, 1.0, 0.0)
    known = (place,) if near else (readings[0],)
    return LampCalibration(known, (strength,), balls, spread, settings={"moved": near, "radius_m": 0.02})


@pytest.mark.parametrize("near", [True, False])
def test_calibrated_lamps_are_read_back(near, tmp_path):
    calibration = lamp_calibration(near)
    again = hg.LampCalibration.load(calibration.save(tmp_path / "lamps.json"))
    assert again.record() == calibration.record()
    assert again.settings == {"moved": near, "radius_m": 0.02}
    with pytest.raises(hg.InputError, match=r"no lamps\.json of an object"):
        hg.SelfCalibration.load(tmp_path / "lamps.json")


def test_lamps_of_an_object_are_read_back(tmp_path):
    way = np.array([[0.0, 0.6, 0.8], [0.6, 0.0, 0.8]])
    calibration = hg.SelfCalibration(
        ("a", "b"), way, np.ones((2, 3)), np.array([1.5, 2.5]), np.array([0.1, 0.2]), 0.9, 0.05, 3.5,
        statuses={"integrability": ENDED}, seed=3,
    )  # fmt: skip
    again = hg.SelfCalibration.load(calibration.save(tmp_path / "lamps.json"))
    assert again.record() == calibration.record() and again.seed == 3
    with pytest.raises(hg.InputError, match=r"no lamps\.json of chrome balls"):
        hg.LampCalibration.load(tmp_path / "lamps.json")


def test_a_response_and_its_calibration_are_read_back(tmp_path):
    response = hg.Response([400.0, 500.0, 600.0], [[1.0, 2.0], [3.0, 5.0], [7.0, 11.0]], ("U", "V"))
    again = hg.Response.load(response.save(tmp_path / "own.csv"))
    np.testing.assert_array_equal(again.values, response.values)
    assert again.channels == ("U", "V")
    bounds = np.stack([response.values - 0.5, response.values + 0.5], axis=2)
    one = np.ones(2)
    calibration = hg.ResponseCalibration(response, bounds, np.ones((3, 2)), one, one, one)
    again = hg.ResponseCalibration.load(calibration.save(tmp_path / "response.csv")[0])
    np.testing.assert_array_equal(again.interval_95, bounds)
    np.testing.assert_array_equal(again.response.values, response.values)
    response.save(tmp_path / "response.csv", force=True)
    hg.Response([400.0, 500.0], [[1.0, 2.0], [3.0, 5.0]], ("U", "V")).save(tmp_path / "response.csv", force=True)
    with pytest.raises(hg.InputError, match="does not hold the intervals"):
        hg.ResponseCalibration.load(tmp_path / "response.csv")


def test_a_volume_box_and_a_simulated_capture_are_read_back(tmp_path):
    glaze = hg.Reflectance(0.1, 0.6, 0.2, 1.5, hg.Spectrum([400, 700], [0.5, 1.0]), name="glaze")
    density, axis = np.ones((5, 7, 11)), np.zeros((5, 7, 11, 3))
    axis[..., 2] = 1.0
    box = hg.VolumeBox.from_arrays(density, axis, 0.001, 200.0, [glaze], name="block")
    again = hg.VolumeBox.load(box.save(tmp_path / "box.zarr"))
    np.testing.assert_array_equal(again.bricks.places, box.bricks.places)
    np.testing.assert_array_equal(np.array(again.bricks.density.values), np.array(box.bricks.density.values))
    camera = hg.Camera.preset("canon_eos_kiss_digital", binning=64).look_at((0.0, -0.3, 0.0), (0.0, 0.0, 0.0))
    scene = hg.Scene(camera, (hg.Lamp(to_lamp=(0.0, -1.0, 0.0)),), (), (hg.Surface.sphere((0, 0, 0), 0.03, glaze),))
    capture = hg.simulate(scene, hg.Settings(samples=2, seed=5))
    hg.save_capture(replace(capture, name="ball"), tmp_path / "capture")
    read = hg.load_capture(tmp_path / "capture")
    assert read.seed == 5 and read.settings == capture.settings and read.settings["samples"] == 2
