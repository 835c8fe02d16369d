"""A transfer that the shading casts doubt on is said by every command that measures: its lines, pages and files."""

from dataclasses import replace
from typing import cast

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.camera.camera import unplaced_camera
from hagoromo.files.record import read_json
from hagoromo.image.relight.prediction import Prediction
from hagoromo.image.relight.relighting import Relighting
from hagoromo.image.relight.stage import Stage
from hagoromo.photograph.exponent import Exponent
from hagoromo_page.report.measure_report import write_measure_report
from hagoromo_page.report.relight_page import write_relight_report

SIDE = 31
SAID = r"linear values have 1: .*display-encoded \(sRGB\).*capture again with the other curve \(--transfer srgb\)"


def ball_of_power(power: float) -> hg.Capture:
    """A matte ball under eight far lamps, whose values are its light to the power 1/`power`."""
    y, x = (np.mgrid[:SIDE, :SIDE] + 0.5) / SIDE * 2.1 - 1.05
    on = x**2 + y**2 < 0.95
    normals = np.stack([x, y, -np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))], axis=2)  # the camera looks along z
    around, up = 2.4 * np.arange(8), np.radians(np.linspace(35.0, 75.0, 8))
    lamps = np.stack([np.cos(up) * np.cos(around), np.cos(up) * np.sin(around), -np.sin(up)], axis=1)
    random, camera, shots = np.random.default_rng(2), unplaced_camera(SIDE, SIDE, None), []
    turn = camera.world_to_camera[:3, :3].T
    for number, to_lamp in enumerate(lamps):
        light = 0.8 * np.maximum(normals @ to_lamp, 0.0) ** (1.0 / power)
        noisy = light[..., None] + random.normal(0.0, 0.002, (SIDE, SIDE, 3))
        values = np.where(on[..., None], np.maximum(noisy, 0.0), 0.0).astype(np.float32)
        lamp = hg.Lamp(to_lamp=turn @ to_lamp, intensity=3.0, name=f"lamp {number}")
        shots.append(hg.Photograph(values, np.full_like(values, 4e-6), on, camera, (lamp,), f"shot {number}"))
    return hg.Capture(tuple(shots), "ball")


@pytest.fixture(scope="module")
def measured() -> hg.Measurement:
    with pytest.warns(UserWarning, match=SAID):
        return hg.measure(ball_of_power(1.32))


def relit(measured: hg.Measurement) -> Relighting:
    """As `relight` makes it, with a prediction of two pixels."""
    grey, source = np.full((1, 2, 3), 0.5), ball_of_power(1.0).photographs[0]
    one = Prediction("shot", 0, source, grey, {"boxes": grey}, np.ones((1, 2), bool), {}, 1.0, ("a lamp",), 2)
    return Relighting(measured, cast(Stage, None), (one,))


def test_measure_says_that_its_values_may_not_be_linear(measured, tmp_path):
    """In a warning, in assumptions.json and on the page, with what to do. Before, 1.32 ± 0.06 passed without a word."""
    measured.save(tmp_path / "measured")
    record = read_json(tmp_path / "measured" / "assumptions.json")
    low, high = record["interval_95"]
    assert record["finding"] == "doubtful" and 1.0 < low < 1.32 < high and "--transfer srgb" in record["advice"]
    assert "linear values have 1" in record["assumptions"]["linearity"]
    write_measure_report(tmp_path / "report.html", measured)
    page = (tmp_path / "report.html").read_text()
    assert page.index("Health of the photographs") < page.index("What was found") and "--transfer srgb" in page
    transfer = measured.health["transfer"]
    assert transfer.state == "doubtful" and "linear values have 1" in transfer.said
    (check,) = (one for one in read_json(tmp_path / "measured" / "health.json")["checks"] if one["name"] == "transfer")
    assert check["state"] == "doubtful" and hg.Measurement.load(tmp_path / "measured").health == measured.health


def test_relight_says_so_in_its_file_and_on_its_page(measured, tmp_path):
    (record,) = relit(measured).records()
    assert record["linearity"]["finding"] == "doubtful" and "--transfer srgb" in record["linearity"]["advice"]
    write_relight_report(tmp_path / "page.html", replace(relit(measured), predictions=()))
    assert "The photographs may not be linear in light" in (tmp_path / "page.html").read_text()


def test_a_page_of_linear_photographs_has_no_such_notice(measured, tmp_path):
    linear = replace(measured, linearity=Exponent(1.02, 0.03))
    write_relight_report(tmp_path / "report.html", replace(relit(linear), predictions=()))
    assert "linear in light</h2>" not in (tmp_path / "report.html").read_text()
    assert relit(linear).records()[0]["linearity"]["advice"] == ""
