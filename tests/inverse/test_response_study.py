"""The study of responses: its faults are what they are called, and its page has them."""

import numpy as np

from hagoromo.camera.response import Response
from studies.response_bench import CURVE_WAVELENGTHS
from studies.response_faults import (
    LAMPS,
    FaultyReadings,
    chart_layout,
    clip,
    fall_off,
    fault_cases,
    fault_score,
    many_pairs,
    repeat,
    share_errors,
)
from studies.response_page import write_response_page

CAMERA = Response.load("Nikon 5100 (NPL)")


def test_faults_are_what_they_are_called():
    """A lamp over a corner leaves 0.71 of its light on the far one; a tenth is clipped; a lamp errs once a channel."""
    chart, random = chart_layout(LAMPS), np.random.default_rng(0)
    even = np.ones((3, 96))
    lit = fall_off(even, chart, random).reshape(3, 4, 24)
    np.testing.assert_allclose(lit.min(axis=2) / lit.max(axis=2), 0.71, atol=0.005)
    shared = share_errors(even, chart, random).reshape(3, 4, 24)
    assert (np.ptp(shared, axis=2) == 0.0).all() and len(np.unique(shared)) == 12
    rising = np.tile(np.arange(1.0, 97.0), (3, 1))
    assert ((cut := clip(rising, chart, random)) == cut.max()).sum() == 3 * 10
    np.testing.assert_array_equal(repeat(rising, chart, random)[:, 7], rising[:, 6])
    assert many_pairs(CURVE_WAVELENGTHS).matrix.shape == (598, len(CURVE_WAVELENGTHS))


def test_shared_errors_are_remarked_on_where_the_lamps_are_known():
    case = FaultyReadings("shared", chart_layout(LAMPS), share_errors, lamps_known=True)
    score = fault_score(case, {"one": CAMERA})
    assert score["remarked"] == 1.0 and score["coverage"] > 0.9
    assert all(of["median"] > 0.99 for of in score["correlation"].values())


def test_the_page_has_a_row_for_every_case(tmp_path):
    of = {channel: {"median": 0.9876, "p10": 0.9812} for channel in "RGB"}
    score = {"correlation": of, "coverage": 0.94, "coverage_above_5_percent": 0.93, "remarked": 0.5}
    cases = fault_cases()
    row = {
        "correlation": of, "correlation_knowing_the_truth": of, "coverage": dict.fromkeys("RGB", 0.97),
        "coverage_above_5_percent": 0.96,
    }  # fmt: skip
    record = {
        "cameras": ["one"], "noise": 0.01, "rows": {"lights": row}, "cpu_s": {"no fault": 1.25},
        "faults": {name: {case.name: score for case in group} for name, group in cases.items()},
    }  # fmt: skip
    write_response_page(tmp_path, record)
    lines = (tmp_path / "response.md").read_text(encoding="utf-8").splitlines()
    rows = [line for line in lines if line.startswith("| ") and "0.9876 / 0.9812" in line]
    assert len(rows) == 2 + sum(len(group) for group in cases.values())
    assert rows[0].split(" | ")[-2:] == ["97, 97, 97 %", "96 % |"] and rows[1].count("|") == rows[0].count("|")
    assert rows[-1].split(" | ")[-3:] == ["94 %", "93 %", "50 % |"]
    assert (tmp_path / "response.png").stat().st_size > 10_000
