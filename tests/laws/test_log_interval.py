"""Intervals by logarithms: no standard error makes them overflow, and no interval is computed past them."""

import ast
import math
from pathlib import Path

import pytest

import hagoromo
from hagoromo.least_squares.loss import NORMAL_95, exp_or_infinity, log_interval

PACKAGE = Path(hagoromo.__file__).parent
ROOMS = ("measurement", "calibration", "reflectance/material", "photograph", "image/spectra", "image/relight")
EXPONENTIALS = {"exp", "exp2", "expm1", "sinh", "cosh", "pow", "power"}
UNBOUNDED = ("error", "relative", "deviation", "normal_95", "half_interval", "significant", "reach", "shift", "odds")


@pytest.mark.parametrize("relative", [0.0, 1e-9, 0.1, 5.0, 735.0, 1e9, math.inf, math.nan])
@pytest.mark.parametrize("value", [1e-300, 0.023, 1.0, 1e300])
def test_a_log_interval_holds_its_value_whatever_its_error(value, relative):
    low, high = log_interval(value, relative)
    assert 0.0 <= low <= value * (1 + 1e-12) and value * (1 - 1e-12) <= high
    if relative == 0.1:
        assert (low, high) == pytest.approx((value * math.exp(-0.1 * NORMAL_95), value * math.exp(0.1 * NORMAL_95)))
    if not relative < 1000.0:
        assert (low, high) == (0.0, math.inf)


def test_nothing_has_no_interval_about_it():
    assert log_interval(0.0, 5.0) == log_interval(0.0, math.inf) == (0.0, 0.0)
    assert exp_or_infinity(1e4) == math.inf and exp_or_infinity(-1e4) == 0.0 and exp_or_infinity(0.0) == 1.0


def unbounded_exponentials(source: str) -> list[str]:
    """Calls of an exponential of something that is named as an error, but for those that are clipped or of −x."""
    found = []
    for node in ast.walk(ast.parse(source)):
        if not isinstance(node, ast.Call) or not node.args:
            continue
        name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
        said = ast.unparse(node.args[0]).lower()
        bounded = said.startswith(("np.clip(", "min(", "-"))
        if name in EXPONENTIALS and not bounded and any(word in said for word in UNBOUNDED):
            found.append(ast.unparse(node))
    return found


def test_no_interval_takes_an_exponential_of_an_unbounded_error():
    """`math.exp(NORMAL_95 * relative)` ended `measure` of a real glossy object: a lobe of 0.023 with an error of 735.

    Searches within bounds of their own (`log_error`, a model's error by bisection) are no intervals.
    """
    searches = {"np.exp(2 * log_error)"}
    calls = [
        f"{path.relative_to(PACKAGE)}: {call}"
        for room in ROOMS
        for path in sorted((PACKAGE / room).rglob("*.py"))
        for call in unbounded_exponentials(path.read_text())
        if call not in searches
    ]
    assert calls == []
    assert unbounded_exponentials("value * math.exp(NORMAL_95 * relative)")
    assert unbounded_exponentials("np.exp(best + reach)") and not unbounded_exponentials("np.exp(np.clip(error, 0, 1))")
