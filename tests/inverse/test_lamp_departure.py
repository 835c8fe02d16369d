"""Lamp departure: how far the lamps found depart from those stated, and what a photograph misses for that."""

from dataclasses import replace
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.image.relight.relighting import Relighting
from hagoromo.measurement.lamp_departure import LampDeparture, lamp_departure
from hagoromo.measurement.normals.normals import NormalMap, least_squares_fit
from hagoromo.measurement.normals.views import views_from_capture

SIZE, LAMPS = 24, 8  # px
NEAR = 0.3  # m


def lamps(intensity: np.ndarray, near: bool) -> list[hg.Lamp]:
    """Lamps around the camera, 30° to 50° from it, of these intensities (K,)."""
    turn, tilt = 2.4 * np.arange(LAMPS), np.radians(np.linspace(30.0, 50.0, LAMPS))
    towards = np.stack([np.sin(tilt) * np.cos(turn), np.sin(tilt) * np.sin(turn), np.cos(tilt)], axis=1)
    if near:
        return [
            hg.Lamp(position=tuple(NEAR * one), intensity=by)
            for one, by in zip(towards, intensity.tolist(), strict=True)
        ]
    return [hg.Lamp(to_lamp=tuple(one), intensity=by) for one, by in zip(towards, intensity.tolist(), strict=True)]


def solved_under(stated: list[hg.Lamp], strength: np.ndarray, slope: np.ndarray, error: float = 1e-3) -> NormalMap:
    """Lambert's fit of a flat card whose lamps were found with `strength` (K,) and `slope` (K, 2), to `error`."""
    camera = hg.Camera(SIZE, SIZE, (1e5, 1e5), (SIZE / 2, SIZE / 2))
    camera = camera.look_at((0.0, 0.0, 50.0), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    rows, columns = 5e-4 * (np.mgrid[:SIZE, :SIZE] + 0.5 - SIZE / 2)
    mask, points = np.ones((SIZE, SIZE), bool), np.stack([columns, -rows, np.full((SIZE, SIZE), 0.01)], axis=2)
    photographs = []
    for lamp in stated:
        to_lamp, light = lamp.direction_and_irradiance(points.reshape(-1, 3))
        values = (0.2 * light * to_lamp[:, 2]).reshape(SIZE, SIZE, 1).repeat(3, axis=2).astype(np.float32)
        photographs.append(hg.Photograph(values, np.full_like(values, 1e-8), mask, camera, (lamp,), "card"))
    views = views_from_capture(hg.Capture(tuple(photographs), "card", points=points))
    fit = replace(least_squares_fit(views), strength=strength, slope=slope, lamp_variance=np.full((LAMPS, 6), error**2))
    none = np.zeros((SIZE, SIZE), np.float32)
    return NormalMap(none, none, none, np.zeros((SIZE, SIZE), int), fit, views)


def centred(spread: float, *shape: int) -> np.ndarray:
    """Random numbers, of mean 0 over the lamps."""
    found = spread * np.random.default_rng(3).normal(size=shape)
    return found - found.mean(axis=0)


@pytest.mark.parametrize("near", [False, True])
def test_strengths_miss_what_they_differ_by(near):
    """Closed form: a photograph under a lamp of ln strength s, taken as 1, is off by |1 − exp(−s)|, anywhere.

    What all lamps have in common is no departure.
    """
    stated, strength = lamps(np.full(LAMPS, 2.0), near), centred(0.06, LAMPS)
    found = lamp_departure(solved_under(stated, strength + 0.3, np.zeros((LAMPS, 2))), stated)
    assert found is not None and found.significant
    assert found.strength == pytest.approx(np.sqrt(np.mean(strength**2)), rel=1e-9)
    assert found.photograph == pytest.approx(np.sqrt(np.mean((1.0 - np.exp(-strength)) ** 2)), rel=1e-9)
    assert found.falloff < 1e-12 and found.direction < 1e-6


def test_lamps_that_were_found_brighter_are_stronger():
    """The same where the fit has the strengths in its lamps, as of near ones."""
    strength = centred(0.06, LAMPS)
    solved = solved_under(lamps(2.0 * np.exp(strength), True), np.zeros(LAMPS), np.zeros((LAMPS, 2)))
    found = lamp_departure(solved, lamps(np.full(LAMPS, 2.0), True))
    assert found is not None and found.strength == pytest.approx(np.sqrt(np.mean(strength**2)), rel=1e-9)


def test_fall_off_is_that_over_the_object():
    """Of a square of side 2 r √π / 2 radii: ln s = a · p has the variance |a|² π / 12, to the square of a."""
    stated, slope = lamps(np.full(LAMPS, 2.0), False), centred(0.03, LAMPS, 2)
    found = lamp_departure(solved_under(stated, np.zeros(LAMPS), slope), stated)
    assert found is not None and found.significant
    assert found.falloff == pytest.approx(np.sqrt(np.mean(np.sum(slope**2, axis=1)) * np.pi / 12.0), rel=0.01)
    assert found.photograph == pytest.approx(found.falloff, rel=0.05)


def test_what_errors_explain_is_no_departure():
    """Strengths that differ by 3 %, found to 3 %; by 0.4 %, found to 0.1 %, as lamps vary from capture to capture."""
    stated, still = lamps(np.full(LAMPS, 2.0), False), np.zeros((LAMPS, 2))
    for spread, error in ((0.03, 0.03), (0.004, 0.001)):
        found = lamp_departure(solved_under(stated, centred(spread, LAMPS), still, error), stated)
        assert found is not None and not found.significant
    known = solved_under(stated, centred(0.06, LAMPS), still)
    assert lamp_departure(replace(known, fit=replace(known.fit, lamp_variance=None)), stated) is None


def test_a_rig_is_advised_where_it_would_bring_a_tenth():
    """Errors of 3 % and, for the lamp, 4 %: 5 %, 3 % if it were known. Not where the lamp adds a twentieth."""
    departure = LampDeparture(0.04, 0.01, 0.001, (0.04,), True)

    def relit(left_out: float | None, found: LampDeparture | None) -> Relighting:
        measured = SimpleNamespace(lamp_departure=found, rig=None)
        return Relighting(cast(Any, measured), cast(Any, None), (), left_out)

    def advice(left_out: float | None, found: LampDeparture | None) -> str | None:
        return relit(left_out, found).advice

    assert relit(0.03, departure).expected == pytest.approx((0.05, 0.03))

    said = advice(0.03, departure)
    assert said is not None and "about 5 %, by 3 % if that lamp were known" in said and "calibrate rig" in said
    assert advice(0.03, replace(departure, photographs=(0.01,))) is None
    assert advice(0.03, replace(departure, evident=False)) is None
    assert advice(None, departure) is None and advice(0.03, None) is None
