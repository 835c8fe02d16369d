"""Light that an object sends to itself: estimated, said, and subtracted where it is asked for. Oracle: a bowl."""

import json
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.files.exr import read_exr
from hagoromo.measurement.normals.normals import NormalMap, least_squares_fit
from hagoromo.measurement.surface import own_light, solved_surface
from hagoromo.measurement.surface.depth import DepthSurface
from hagoromo.measurement.surface.exchange import exchange
from hagoromo.measurement.surface.shadow_light import shadow_light
from hagoromo_page.report.measure_report import write_measure_report
from tests.inverse.simulated_bowl import FOCAL, OPENING, PIXEL, bowl

ALBEDO, SIZE = np.array([0.6, 0.5, 0.4]), 23
DISTANCE = FOCAL * PIXEL


def degrees_off(measurement, normals):
    """Rms angle [°] of the normals that are known to the true ones."""
    known = np.isfinite(measurement.normal_variance) & (np.linalg.norm(normals, axis=2) > 0.5)
    cosine = np.clip((measurement.normals * normals).sum(axis=2)[known], -1, 1)
    return float(np.degrees(np.sqrt(np.mean(np.arccos(cosine) ** 2))))


def measured(capture, use):
    return hg.measure(capture, distance=DISTANCE, facets="gaussian", interface="neutral", own_light=use)


@pytest.fixture(scope="module")
def both():
    """A bowl whose photographs are in 0.7 of the unit of the lamps, as `report` and `subtract` measure it.

    Both start with the same solution, which is computed once.
    """
    capture, normals, share = bowl(ALBEDO, SIZE, unit=0.7)
    solve, solved = solved_surface._solve, []

    def solve_once(given, *settings):
        same = np.array_equal(given.photographs[0].values, capture.photographs[0].values)
        if not same:
            return solve(given, *settings)
        if not solved:
            solved.append(solve(given, *settings))
        return solved[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(solved_surface, "_solve", solve_once)
        found = [measured(capture, use) for use in ("report", "subtract")]
    return normals, share, found


def test_a_bowl_sends_every_patch_the_same_light():
    """Of unit light leaving everywhere, E = π f: exact in a sphere, whatever the patch; patches leave 3 %."""
    capture, normals, _ = bowl(ALBEDO, 41)
    radius = 0.47 * 41 * PIXEL / np.sin(OPENING)
    points = np.where(np.linalg.norm(normals, axis=2, keepdims=True) > 0.5, -radius * normals, 0.0)
    net = exchange(points, normals.astype(np.float32), capture.photographs[0].camera)
    light = net.pixels(net.matrix.sum(axis=1, keepdims=True))[..., 0][net.known]
    truth = np.pi * 0.5 * (1.0 - np.cos(OPENING))
    assert np.mean(light) == pytest.approx(truth, rel=0.03) and np.std(light) < 0.05 * truth


def test_a_ball_sends_itself_nothing():
    """Seen from outside, no patch faces another one."""
    capture, normals, _ = bowl(ALBEDO, 31)
    outward = normals * (-1.0, -1.0, 1.0)
    net = exchange(0.005 * outward, outward.astype(np.float32), capture.photographs[0].camera)
    assert net.matrix.max() == 0.0


def test_what_is_in_the_way_takes_the_light():
    """Two walls that face each other across a ridge as high as they are."""
    camera = hg.Camera(32, 8, (FOCAL, FOCAL), (16.0, 4.0)).look_at((0.0, 0.0, DISTANCE), (0, 0, 0), up=(0.0, 1.0, 0.0))
    columns = np.arange(32) - 15.5
    sums = []
    for ridge in (0.0, 14.0):
        height = np.where(np.abs(columns) > 8, np.abs(columns) - 8, np.where(np.abs(columns) < 2, ridge, 0.0))
        slope = np.where(np.abs(columns) > 8, np.sign(columns), 0.0)
        x, y = np.meshgrid(columns * PIXEL, (3.5 - np.arange(8)) * PIXEL)
        points = np.stack([x, y, np.broadcast_to(height * PIXEL, x.shape)], axis=2)
        normals = np.stack([-slope, 0 * slope, np.ones(32)], axis=1) / np.sqrt(1 + slope[:, None] ** 2)
        net = exchange(points, np.broadcast_to(normals, (8, 32, 3)).astype(np.float32), camera)
        left, right = (net.places[1] < 8), (net.places[1] > 23)
        sums.append(net.matrix[np.ix_(left, right)].sum())
    assert sums[0] > 0.0 and sums[1] < 0.02 * sums[0]


def test_own_light_is_estimated_and_said(both, tmp_path):
    """Its share of all light to a tenth, in what it adds; the files and the remark have it."""
    _, share, (found, _) = both
    own = found.own_light
    assert own is not None and own.known and not own.subtracted
    values = [p.values.mean(axis=2) for p in found.capture.photographs]
    truth = sum(s * v for s, v in zip(share, values, strict=True)) / np.maximum(sum(values), 1e-30)
    known = found.labels >= 0
    assert np.mean(own.share[known]) == pytest.approx(np.mean(truth[known]), rel=0.15)
    assert any("comes from the object itself" in remark for remark in found.materials[0].remarks)
    home = found.save(tmp_path / "out")
    channels, _ = read_exr(home / "own_light.exr")
    np.testing.assert_allclose(channels["share"], own.share, atol=1e-3)
    record = json.loads((home / "own_light.json").read_text())["own_light"]
    assert record["up_to"] == pytest.approx(own.up_to) and record["subtracted"] is False
    back = hg.Measurement.load(home).own_light
    assert back is not None and back.record() == record and back.remark(known) == own.remark(known)
    np.testing.assert_array_equal(back.most, own.most)


def test_a_record_of_own_light_that_is_none_is_refused(both, tmp_path):
    home = both[2][0].save(tmp_path / "out")
    for spoilt in ("[]", '{"own_light": 3}', '{"own_light": {"unit": {"value": "much"}}}', '{"own_light": {}}'):
        (home / "own_light.json").write_text(spoilt, encoding="utf-8")
        with pytest.raises(hg.InputError, match="own_light"):
            hg.Measurement.load(home)
    (home / "own_light.json").unlink()  # as measurements of earlier versions
    assert hg.Measurement.load(home).own_light is None


def test_the_report_shows_own_light_and_says_that_light_of_the_room_would_look_the_same(both, tmp_path):
    """A bowl's own light is as even as that of a room."""
    found = both[2][0]
    assert not found.own_light.separate and "lamps off" in found.own_light.undetermined()
    assert any("light of the room, which cannot be separated from it" in line for line in found.materials[0].remarks)
    write_measure_report(tmp_path / "report.html", found)
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert f"comes from the object itself (white: {100 * found.own_light.up_to:.0f} %)" in page
    assert "one with all lamps off" in page


@pytest.mark.parametrize("alike", [False, True])
def test_light_of_the_room_is_separated_where_own_light_differs_from_it(alike):
    """In shadows u = 0.8 of the own light that is expected and 0.05 of the room's; alike: from patch to patch, too."""
    random, count, side = np.random.default_rng(4), 6, 40
    rows, columns = np.divmod(np.arange(side**2), side)
    body = random.uniform(0.1, 0.3, (side, side, 1)).repeat(3, axis=2)
    views = SimpleNamespace(
        rows=rows, columns=columns, shape=(side, side), to_lamp=np.tile((0, 0, -1.0), (count, 1, 1))
    )
    normal_map: Any = SimpleNamespace(
        views=views,
        fit=SimpleNamespace(normals=np.tile((0, 0, 1.0), (side**2, 1)), labels=np.zeros(side**2, int)),
        body=body,
    )
    light = np.linspace(0.0, 0.2, side)[:, None, None] * np.linspace(1.0, 0.2, count)[:, None, None, None]
    parts = list(np.broadcast_to(0.1 if alike else light, (count, side, side, 1)) * body)
    mask, variance = np.ones((side, side), bool), np.full(body.shape, 1e-6)
    values = [0.8 * part + 0.05 * body + 1e-3 * random.standard_normal(body.shape) for part in parts]
    photographs = [SimpleNamespace(values=value, mask=mask, variance=variance) for value in values]
    capture: Any = SimpleNamespace(photographs=photographs)
    unit = own_light._unit(shadow_light(capture, normal_map, parts))
    assert unit.separate != alike
    if alike:
        assert unit.value == pytest.approx(0.8 + 0.05 / 0.1, rel=0.02)
    else:
        assert abs(unit.value - 0.8) < 4 * unit.error < 0.02 and abs(unit.room - 0.05) < 4 * unit.room_error < 0.002


def test_subtracting_it_mends_normals_and_body_colour(both):
    """Normals 3.8° off with it: 0.5° at most without. Albedo, in the unit that shadows show: within 5 %."""
    normals, _, (before, after) = both
    assert degrees_off(before, normals) > 3.0 and degrees_off(after, normals) < 0.5
    assert after.own_light.subtracted and any("was subtracted" in remark for remark in after.materials[0].remarks)
    assert after.own_light.unit == pytest.approx(1 / 0.7, rel=0.05)
    body = np.pi * after.own_light.unit * np.median(after.body.value[after.labels >= 0], axis=0)
    np.testing.assert_allclose(body, ALBEDO, rtol=0.05)
    worst = max(np.nanmedian(np.abs(p - c.values)[c.mask]) / c.values[c.mask].mean()
                for p, c in zip(after.predicted, after.capture.photographs, strict=True))  # fmt: skip
    assert worst < 0.02


def test_a_unit_in_which_no_body_can_be_so_bright_is_not_subtracted(both, monkeypatch):
    """Nothing is solved again then: `_solve` gives what was found before, with bodies of four times the albedo."""
    found = both[2][0]
    assert found.capture is not None
    capture = replace(found.capture, points=None, normals=None)
    views = hg.views_from_capture(capture)
    normals = found.normals[views.rows, views.columns].astype(np.float64)
    fit = replace(least_squares_fit(views), normals=normals)
    bright = replace(fit, body=4.0 * fit.body, variance=np.full(len(normals), 1e-4))
    maps = found.normals, found.normal_variance, views.image(bright.body.T.astype(np.float32))
    surface = DepthSurface(found.points, found.distance_variance)
    solved = NormalMap(maps[0], maps[1], maps[2], found.labels, bright, views), surface
    monkeypatch.setattr(solved_surface, "_solve", lambda *_: solved)
    monkeypatch.setattr(own_light, "_unit", lambda *_: own_light.Unit())
    with pytest.warns(UserWarning, match="different units"):
        assert not solved_surface.solve_surface(capture, DISTANCE, use="subtract").own_light.subtracted


def test_another_word_is_refused():
    with pytest.raises(hg.InputError, match="own_light is 'remove'"):
        hg.measure(bowl(ALBEDO, 11)[0], distance=DISTANCE, own_light="remove")  # type: ignore[arg-type]
