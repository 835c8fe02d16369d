"""Smooth normals: what a smooth surface is, how much noise is left, and that detail of a surface stays."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.measurement.normals.normals import solve_normals
from hagoromo.measurement.normals.pixel_fit import NormalFit, PixelConditions, fit_pixels
from hagoromo.measurement.normals.smooth_normals import (
    SmoothField,
    bodies_at,
    chosen_stiffness,
    flattened,
    halves,
    noise_factor,
    smooth_surface,
)
from hagoromo.measurement.normals.smooth_share import Stiffness
from hagoromo.measurement.normals.views import Views, views_from_capture
from hagoromo.measurement.surface.smooth_tiles import margin_of
from studies.glossy_objects import GLOSSY, _reflected
from studies.mirror_objects import mirror_object

SIZE, LAMPS, RADIUS = 41, 9, 30.0  # px, lamps, px


def seen(size: int = SIZE) -> Views:
    """A square of pixels seen from afar; what the photographs show has no effect."""
    camera = hg.Camera(size, size, (1e5, 1e5), (size / 2, size / 2)).look_at((0, 0, 50.0), (0, 0, 0), up=(0, 1, 0))
    values, turn = np.full((size, size, 2), 0.3, np.float32), 2.0 * np.pi * np.arange(LAMPS) / LAMPS
    shots = [
        hg.Photograph(values, np.full_like(values, 1e-6), np.ones((size, size), bool), camera, (lamp,), f"{k}")
        for k, lamp in enumerate(
            hg.Lamp(to_lamp=(0.5 * np.cos(t), 0.5 * np.sin(t), np.sqrt(0.75)), intensity=np.pi) for t in turn
        )
    ]
    return views_from_capture(hg.Capture(tuple(shots), "square"))


def sphere(views: Views) -> np.ndarray:
    x, y = (views.columns + 0.5 - SIZE / 2) / RADIUS, (SIZE / 2 - views.rows - 0.5) / RADIUS
    return np.stack([x, y, np.sqrt(1.0 - x * x - y * y)], axis=1)


def noisy(normals: np.ndarray, spread: float | np.ndarray, random: np.random.Generator) -> np.ndarray:
    """Normals turned by noise of this standard deviation [rad] in each of two turns."""
    noise = spread * random.normal(size=normals.shape)
    moved = normals + noise - np.sum(noise * normals, axis=1, keepdims=True) * normals
    return moved / np.linalg.norm(moved, axis=1, keepdims=True)


def angle(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    return np.arccos(np.clip(np.sum(one * other, axis=1), -1.0, 1.0))


@pytest.mark.parametrize("name", ["plane", "sphere"])
def test_a_plane_and_a_sphere_are_smooth_already(name):
    views = seen()
    normals = sphere(views) if name == "sphere" else np.broadcast_to([0.36, 0.48, 0.8], (len(views.rows), 3))
    variance = np.random.default_rng(1).uniform(1e-6, 1e-3, len(normals))
    assert angle(SmoothField(views, 1e6).smoothed(normals, variance), normals).max() < 1e-6


@pytest.mark.parametrize("ratio", [0.3, 30.0])
def test_the_share_of_noise_that_is_left_is_the_inverse_of_the_normal_equations(ratio):
    """Oracle: the dense inverse, and far from the borders its spectrum, the mean over waves of 1/(1 + ρ s²) with
    s = 4 sin²(u/2) + 4 sin²(v/2); lattices of probes leave 10 %.
    """
    views, spread2 = seen(), 1e-4
    up = np.broadcast_to([0.0, 0.0, 1.0], (len(views.rows), 3))
    share = SmoothField(views, ratio / spread2).share(up, np.full(len(up), 2.0 * spread2))
    wave = 4.0 * np.sin(0.5 * 2.0 * np.pi * (np.arange(256) + 0.5) / 256) ** 2
    spectrum = float(np.mean(1.0 / (1.0 + ratio * (wave[:, None] + wave) ** 2)))
    inner = (np.abs(views.rows - SIZE / 2) < 8) & (np.abs(views.columns - SIZE / 2) < 8)
    assert np.mean(share[inner]) == pytest.approx(spectrum, rel=0.1)
    normals = noisy(up, np.sqrt(spread2), np.random.default_rng(2))
    left = angle(SmoothField(views, ratio / spread2).smoothed(normals, np.full(len(up), 2.0 * spread2)), up) ** 2
    # what is left of noise alone, without a change of the surface, is less: the spectrum of the square
    plain = float(np.mean(1.0 / (1.0 + ratio * (wave[:, None] + wave) ** 2) ** 2))
    assert np.mean(left[inner]) == pytest.approx(2.0 * spread2 * plain, rel=0.3)  # some 60 independent squares


def test_noise_is_smoothed_away_and_detail_of_the_surface_stays():
    views, random, spread = seen(), np.random.default_rng(3), 0.01
    true, status = sphere(views), np.zeros(SIZE**2, np.int8)
    body, variance = np.ones((2, len(true))), np.full(len(true), 2.0 * spread**2)
    both = [NormalFit(noisy(true, spread, random), body, variance, status) for _ in range(2)]
    found = chosen_stiffness(views, both, np.ones(len(true)))
    assert found is not None
    stiffness, gain = found.value, found.gain
    # of the squared distance, twice the noise of a half, half is the noise of the half that is not smoothed; ± 2 σ
    assert stiffness > 1e5
    assert gain == pytest.approx(0.5, abs=0.05)
    before, after = both[0].normals, SmoothField(views, stiffness).smoothed(both[0].normals, variance)
    assert np.mean(angle(after, true) ** 2) < 0.1 * np.mean(angle(before, true) ** 2)
    detail = noisy(true, 5.0 * spread, random)
    both = [NormalFit(noisy(detail, spread, random), body, variance, status) for _ in range(2)]
    assert chosen_stiffness(views, both, np.ones(len(true))) is None


def test_noise_is_found_where_it_is_larger_than_stated_and_a_shared_turn_is_none():
    views, random, spread = seen(), np.random.default_rng(4), 0.003
    true, status, body = sphere(views), np.zeros(SIZE**2, np.int8), np.ones((2, SIZE**2))
    times = np.where(views.columns < SIZE / 2, 1.0, 3.0)[:, None]
    turned = np.array([0.006, 0.0, 0.0])
    both = [
        NormalFit(noisy(true + shift, spread * times, random), body, np.full(len(true), 2.0 * spread**2), status)
        for shift in (0.0, turned)
    ]
    factor = noise_factor(views, both)
    assert np.median(factor[views.columns < SIZE / 4]) == pytest.approx(1.0, rel=0.15)
    assert np.median(factor[views.columns > 3 * SIZE / 4]) == pytest.approx(9.0, rel=0.15)


def test_what_smoothing_takes_away_beyond_noise_is_found_where_it_was():
    views, random, spread = seen(), np.random.default_rng(5), 0.003
    up, variance = np.broadcast_to([0.0, 0.0, 1.0], (SIZE**2, 3)), np.full(SIZE**2, 2.0 * spread**2)
    noise = noisy(up, spread, random)
    away = flattened(views, noise, up, variance, np.zeros(len(up)))
    assert away.mean() < 0.05 * 2.0 * spread**2
    corner = (views.rows < 15) & (views.columns < 15)
    bent = noise + np.where(corner, 0.006, 0.0)[:, None] * np.array([1.0, 0.0, 0.0])
    away = flattened(views, bent / np.linalg.norm(bent, axis=1, keepdims=True), up, variance, np.zeros(len(up)))
    assert away[(views.rows < 8) & (views.columns < 8)].mean() == pytest.approx(0.006**2, rel=0.25)


def test_halves_share_no_lamp_and_stand_all_around():
    one, other = halves(seen(7))
    first, second = (half.used.any(axis=1) for half in (one, other))
    assert not (first & second).any()
    assert (first | second).all()
    assert np.abs(one.to_lamp[first].mean(axis=(0, 1))[:2]).max() < 0.2


def test_normals_of_two_lobes_are_found_with_both():
    """Oracle: eq. (2)–(6) written once more in `glossy_objects`. With the haze alone, the spike turns normals."""
    views, gloss = seen(), GLOSSY["glaze"]
    true, to_lamp = sphere(views), views.to_lamp
    body = np.broadcast_to([0.10, 0.07], (len(true), 2))
    values = np.stack([_reflected(true, lamp[0], gloss, body[:, :1])[:, 0] for lamp in to_lamp])
    values = np.stack([values, values + (0.07 - 0.10) * np.stack([_lit(true, lamp[0], gloss) for lamp in to_lamp])], 1)
    views = replace(views, values=values, used=np.ones(views.used.shape, bool))
    haze = [np.log(gloss.haze[0]), np.log(np.radians(gloss.haze[1])), 0.0, np.log1p(gloss.epsilon), 0.0, 0.0]
    rows, precise = np.tile(haze, (len(true), 1)), np.full(values.shape, 1e4)
    spike = np.tile(np.log([gloss.spike[0], np.radians(gloss.spike[1])]), (len(true), 1))
    start = noisy(true, 0.01, np.random.default_rng(6))
    error = {}
    for name, further in (("haze", ()), ("both", (spike,))):
        light = PixelConditions(rows, np.ones(views.used.shape), precise, further)
        error[name] = np.mean(angle(fit_pixels(views, light, start, body.T).normals, true))
    assert error["both"] < 3e-4  # single precision
    assert error["haze"] > 3.0 * error["both"]


def _lit(normals: np.ndarray, to_lamp: np.ndarray, gloss) -> np.ndarray:
    one = _reflected(normals, to_lamp, gloss, np.ones((len(normals), 1)))
    return (one - _reflected(normals, to_lamp, gloss, np.zeros((len(normals), 1))))[:, 0]


def test_tiles_with_a_margin_join_as_if_they_were_smoothed_together():
    """Four tiles of 61 px and the whole: normals differ by a 50th of the noise that is left to them, at most by a 10th.
    Shares of it agree to what their probes leave, 10 % in the mean (see above), and half as much again in each pixel.
    """
    size, spread, stiffness = 121, 0.004, Stiffness(1e6, 0.5)
    views, random = seen(size), np.random.default_rng(8)
    radius = (views.columns - 60.0) / 100.0, (views.rows - 60.0) / 100.0
    true = np.stack([radius[0], -radius[1], np.sqrt(1.0 - radius[0] ** 2 - radius[1] ** 2)], axis=1)
    times = np.where(views.columns < 50, 1.0, 1.5)
    normals, variance = noisy(true, spread * times[:, None], random), 2.0 * (spread * times) ** 2
    whole, share = smooth_surface(views, stiffness.value, normals, variance)
    margin = margin_of(stiffness, views.image(variance.astype(np.float32)))
    assert 8 <= margin < 60
    found, left = np.zeros_like(whole), np.zeros(len(whole))
    for row in (0, 61):
        for column in (0, 61):
            near, own = (
                (views.rows >= row - m) & (views.rows < row + 61 + m) & (views.columns >= column - m)
                & (views.columns < column + 61 + m) for m in (margin, 0)
            )  # fmt: skip
            parts = smooth_surface(views.pixels(near), stiffness.value, normals[near], variance[near])
            found[own], left[own] = (part[own[near]] for part in parts)
    off, stated = angle(found, whole), np.sqrt(share * variance)
    assert np.sqrt(np.mean((off / stated) ** 2)) < 0.02
    assert np.max(off / stated) < 0.1
    inner = np.all([(one > 12) & (one < size - 12) for one in (views.rows, views.columns)], axis=0)
    assert np.sqrt(np.mean((left / share - 1.0)[inner] ** 2)) < 0.15
    assert left[inner].mean() == pytest.approx(share[inner].mean(), rel=0.1)


@pytest.mark.nightly
@pytest.mark.parametrize("name", ["ball", "wavy"])
def test_narrow_highlights_under_unseen_lamps_follow_from_smooth_normals(name):
    """24 lamps on an object of 9 thousand pixels: normals within 0.15°, and their errors hold."""
    found = mirror_object(name, 119, 24)
    solved = solve_normals(found.capture)
    views, fit = solved.views, solved.fit
    assert fit.smooth is not None
    squared = angle(fit.normals, found.normals[views.rows, views.columns]) ** 2
    assert np.degrees(np.sqrt(np.mean(squared))) < 0.3
    assert np.mean(squared < 3.0 * fit.variance) > 0.9
    np.testing.assert_allclose(bodies_at(views, fit), fit.body, rtol=0.1)
