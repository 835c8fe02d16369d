"""Laws of the beams of near lamps: every kind, in kernels, in files, and turned with the world."""

import math
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.light.beams import BEAMS
from hagoromo.light.lamp import by_place
from hagoromo.light.lamp_light import LampLight
from hagoromo.photograph.transforms import lamp_from_record, record_from_lamp

RANDOM = np.random.default_rng(5)
FLOOD = hg.LampProfile([0, 35, 90, 130, 180], [0, 11, 30, 75, 90], RANDOM.uniform(0.2, 1.0, (5, 5)))
PLACE = (0.2, -0.1, 0.9)
KEYS: list[dict[str, Any]] = [
    {},
    {"axis": (-0.2, 0.3, -1.0), "axis_power": 7.3},
    {"axis": (0.3, 0.1, -0.7), "profile": FLOOD, "roll": 0.7},
]
LAMPS = [hg.Lamp(PLACE, intensity=3.0, **keys) for keys in KEYS]
WAYS = RANDOM.normal(size=(4001, 3))
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)
TURN = np.array([[0.8, 0.0, 0.6], [0.36, 0.8, -0.48], [-0.48, 0.6, 0.64]])
NAMES = [lamp.beam.word for lamp in LAMPS]


def test_every_kind_is_looked_at_here():
    assert {type(lamp.beam) for lamp in LAMPS} == set(BEAMS)


@pytest.mark.parametrize("lamp", LAMPS, ids=NAMES)
def test_kernels_have_the_light_of_the_record(lamp):
    """Single precision: 2e-6 of the brightest, but at the edge of a table, which a rounded angle may be beyond."""
    jit, points = arrays(), np.array(PLACE) + WAYS
    light = LampLight(lamp, lamp.intensity)
    to_lamp, distance, irradiance = light.arriving(jit.Array3f(*(jit.Float(c.astype(np.float32)) for c in points.T)))
    ways, truth = lamp.direction_and_irradiance(points.astype(np.float32))
    angle = np.degrees(np.arccos(np.clip(-ways @ (lamp.axis if lamp.axis is not None else WAYS[0]), -1.0, 1.0)))
    inner = np.abs(angle - 90.0) > 1e-3
    np.testing.assert_allclose(np.array(irradiance)[inner], truth[inner], atol=2e-6 * 3.0 * 8.0)
    np.testing.assert_allclose(np.array(to_lamp).T, ways, atol=1e-6)
    np.testing.assert_allclose(np.array(distance), 1.0, rtol=1e-5)


@pytest.mark.parametrize("lamp", LAMPS, ids=NAMES)
def test_a_record_gives_the_lamp_back(lamp, tmp_path):
    again = lamp_from_record(record_from_lamp(lamp), tmp_path, "lamp")
    np.testing.assert_allclose(again.relative_intensity(WAYS), lamp.relative_intensity(WAYS), atol=1e-12)


@pytest.mark.parametrize("lamp", LAMPS, ids=NAMES)
def test_a_lamp_that_turns_with_the_world_shines_into_turned_directions(lamp, tmp_path):
    middle = np.array([0.1, 0.2, 0.3])
    record = record_from_lamp(lamp) | lamp.turned_record(TURN, middle)
    turned = lamp_from_record(record, tmp_path, "lamp")
    np.testing.assert_allclose(turned.place, TURN @ (np.array(PLACE) - middle) + middle)
    np.testing.assert_allclose(turned.relative_intensity(WAYS @ TURN.T), lamp.relative_intensity(WAYS), atol=1e-9)


def test_lamps_of_one_beam_stand_at_one_place():
    """Equal keys: `by_place` joins lamps that shine alike."""
    twins = [hg.Lamp(PLACE, intensity=2.0, **keys) for keys in KEYS]
    assert by_place([*LAMPS, *twins]) == [[0, 3], [1, 4], [2, 5]]


@pytest.mark.parametrize("power", [0.5, 1.0, 20.0])
def test_a_spot_is_half_as_bright_at_its_half_angle(power):
    """The closed form of a spot, and the search of other beams, by the same light."""
    lamp = hg.Lamp(PLACE, axis=(0, 0, -1), axis_power=power)
    table = np.arange(0.0, 90.5, 0.5)
    values = [np.cos(np.radians(table)).clip(0.0) ** power]
    searched = hg.Lamp(PLACE, axis=(0, 0, -1), profile=hg.LampProfile([0], table, values)).beam.half_angle()
    angle = lamp.beam.half_angle()
    assert lamp.relative_intensity([math.sin(angle), 0.0, -math.cos(angle)]) == pytest.approx(0.5, rel=1e-9)
    assert searched == pytest.approx(angle, abs=math.radians(0.1))


@pytest.mark.parametrize("power", [0.0, 0.01, 0.5, 1.0, 7.0, 60.0])
def test_a_cone_in_place_of_a_spot_begins_before_it_ends(power):
    """As glTF and Mitsuba ask for; its middle is where the spot is half as bright, where the widest cone allows it."""
    beam = hg.Lamp(PLACE, axis=(0, 0, -1), axis_power=power).beam
    cone, half = beam.nearest_cone(89.0), math.degrees(beam.half_angle())
    assert 0.0 <= cone.begins < cone.ends <= 89.0
    assert half > 85.0 or 0.5 * (cone.begins + cone.ends) == pytest.approx(half)


def test_the_spot_of_another_program_is_as_wide_as_the_profile():
    """A profile that is half as bright at 20°: glTF took each for a spot of 60°, and did not say so."""
    narrow = hg.LampProfile([0], [0, 20, 40], [[1.0, 0.5, 0.0]])
    light, lost = hg.Lamp(PLACE, axis=(0, 0, -1), profile=narrow, name="narrow").gltf()
    assert light.cone is not None and sum(light.cone) / 2 == pytest.approx(math.radians(20.0), abs=1e-3)
    assert lost == ["lamp 'narrow': its profile; here it is a spot, half as bright at the same angle"]
