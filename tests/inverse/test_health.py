"""Mistakes in taking photographs are named by the photographs themselves, and right ones are not doubted."""

import tempfile
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo.files.record import read_json
from hagoromo.measurement.health.examine import Examined, examine
from hagoromo.measurement.health.health import NAMES, Health
from hagoromo.measurement.health.lamps import FittedLamps
from studies.closely import scene
from studies.mistakes import blurred, coded, exchanged, masked, moved, turned, twice, under, uneven
from studies.random_captures import direction, encoded, random_scene, strength, swapped, without_shape
from tests.data import DATA, real_data
from tests.inverse import simulated_relief
from tests.inverse.simulated_relief import SimulatedRelief, dome, relief_camera, relief_capture
from tests.inverse.simulated_vase import vase

TURN = np.arange(12)
MISTAKES = {  # what is done; the check that finds it, and what it says
    "two exchanged": (exchanged, "order", "with {0} 2 and {0} 5 exchanged"),
    "reversed": (lambda capture: under(capture, TURN[::-1]), "order", "in reversed order"),
    "shifted": (lambda capture: under(capture, np.roll(TURN, -1)), "order", "shifted by -1"),
    "one twice": (twice, "order", "{0} 3 and {0} 4 are the same picture"),
    "a lamp 5° off": (lambda capture: turned(capture)[0], "lamps", "the lamp of {0} 3 is"),
    "strengths": (uneven, "strengths", "the lamps differ from the stated strengths by"),
    "display values": (coded, "transfer", "display-encoded"),
    "blurred": (blurred, "blur", "less sharp than the others: {0} 4"),
    "mask too large": (masked, "mask", "inside of its edge: it is too large"),
    "mask too small": (lambda capture: masked(capture, -5), "mask", "outside of its edge: it is too small"),
}
QUICK = ("two exchanged", "strengths")
BALL = 103  # seed of a capture of one glossy ball
FEW_NORMALS = 324, 340, 352, 362, 366, 422  # seeds whose lamps or strengths were doubted
LATER = (direction, strength, encoded)


def named(capture):
    """With names as the real sets have them: object and number."""
    shots = tuple(replace(shot, name=f"vase {k}") for k, shot in enumerate(capture.photographs))
    return replace(capture, photographs=shots)


@pytest.fixture(scope="module")
def glossy():
    return named(vase()[0])


def test_right_photographs_are_not_doubted(glossy):
    health = examine(glossy).health
    assert tuple(one.name for one in health.checks) == NAMES and health.doubtful == ()
    good = [one.name for one in health.checks if one.state == "good"]
    assert good == ["order", "lamps", "strengths", "transfer", "motion", "blur", "mask"]


def test_the_command_writes_and_prints_the_checks_of_a_folder(glossy, tmp_path, capsys):
    exchanged(glossy).save(tmp_path / "capture")
    assert main(["health", str(tmp_path / "capture"), "--out", str(tmp_path / "health.json")]) == 0
    found = hg.check_photographs(tmp_path / "capture")
    assert Health.from_record(read_json(tmp_path / "health.json"), "health.json") == found
    assert [one.name for one in found.doubtful] == ["order"]
    assert capsys.readouterr().out.splitlines()[:-1] == [one.sentence for one in found.checks]


@pytest.mark.by_night(*(name for name in MISTAKES if name not in QUICK))
@pytest.mark.parametrize("mistake", MISTAKES)
def test_a_mistake_is_named_by_the_check_of_its_name(glossy, mistake):
    change, name, said = MISTAKES[mistake]
    found = examine(change(glossy)).health
    assert found[name].state == "doubtful" and said.format("vase") in found[name].said and found[name].advice
    assert [one.name for one in found.doubtful] == [name]


@pytest.mark.nightly
@pytest.mark.parametrize("gloss", [0.0, 0.8])
@pytest.mark.parametrize("across", [0.7, 1.0])
def test_a_photograph_that_moved_is_named(gloss, across):
    found = examine(moved(named(vase(gloss)[0]), 4, across)).health
    assert found["motion"].said.startswith("shifted against the others: vase 4 by (") and len(found.doubtful) == 1


def test_blur_is_not_testable_where_an_object_has_no_fine_edges(glossy):
    """All photographs are blurred by 8 px: one that is blurred by two more looks as the others."""
    smooth = glossy
    for number in range(len(glossy.photographs)):
        smooth = blurred(smooth, number, 8.0)
    found = examine(smooth).health["blur"]
    assert found.state == "not testable" and "no fine edges" in found.said


@pytest.mark.nightly
def test_the_direction_of_a_wrong_lamp_is_corrected(glossy):
    """To 1.5°, of 5°."""
    capture, true = turned(glossy)
    said = examine(capture).health["lamps"].said
    found = np.array([float(word.strip("(,)")) for word in said.split("at ")[1].split(" by")[0].split()])
    assert np.degrees(np.arccos(found @ true / np.linalg.norm(found))) < 1.5


@pytest.mark.parametrize(("spread", "taken"), [(0.12, False), (0.3, True)])
def test_strengths_that_spread_little_are_left_to_the_fit_of_normals(spread, taken):
    """Under few lamps they have errors of a tenth; taken, they spoilt what is shown under other lamps."""
    capture, _ = vase(0.0, size=40)
    count = len(capture.photographs)
    strength = np.exp(spread * np.where(np.arange(count) % 2, 1.0, -1.0))
    lamps = FittedLamps(strength, np.zeros((count, 3)), (0.5, 1.0))
    assert lamps.uneven
    after = Examined(Health(checks=()), None, lamps).with_strengths(capture)
    assert (after is not capture) == taken


@pytest.mark.nightly
def test_strengths_that_nobody_stated_are_fitted_before_normals_are_solved():
    """Normals to twice the error that even lamps leave, and 0.2° more."""
    capture, truth = vase(0.0, size=90)
    known = np.linalg.norm(truth, axis=2) > 0.5

    def error(measured):
        cosine = np.clip(np.sum(measured.normals * truth, axis=2), -1.0, 1.0)
        return float(np.degrees(np.median(np.arccos(cosine[known]))))

    even, fitted = (hg.measure(one, distance=50.0) for one in (capture, uneven(capture)))
    assert "nobody stated them" in fitted.assumptions["strengths"] and "strengths" not in even.assumptions
    assert error(fitted) < 2.0 * error(even) + 0.2


@pytest.mark.nightly
def test_a_flat_relief_with_gloss_is_not_taken_for_display_values():
    """On a flat surface each transfer has strengths of lamps that explain it: those that are stated count first."""
    tile = replace(hg.simulate(scene()), points=None, normals=None)
    assert examine(tile).health.doubtful == ()
    assert [one.name for one in examine(coded(tile)).health.doubtful] == ["transfer"]


@pytest.mark.by_night("0.0-right", "0.0-display values", "0.0-uneven", "1.0-display values", "1.0-uneven")
@pytest.mark.parametrize("done", ["right", "display values", "uneven"])
@pytest.mark.parametrize("gloss", [0.0, 1.0])
def test_a_flat_relief_is_doubted_for_what_is_wrong_alone(gloss, done):
    """Normals within 7° (rms), lamps in two rings. Its gloss is wide, and every place has it under the same lamps. What
    its photographs do not separate, lamps that are uneven and another transfer, is said so, and that such a gloss
    hides a lamp that is stronger.
    """
    capture = relief_capture(SimulatedRelief(), relief_camera(48), dome(12), 1, gloss > 0.0)
    changed = {"right": capture, "display values": coded(capture), "uneven": uneven(capture, 0.2)}[done]
    health = examine(changed).health
    wrong = {"right": [], "display values": ["transfer"], "uneven": [] if gloss else ["strengths"]}[done]
    assert [one.name for one in health.doubtful] == wrong
    if done == "right":
        assert health["transfer"].state == "good"
        assert health["strengths"].state == ("not testable" if gloss else "good")
    if done == "uneven":
        assert health["transfer"].state == "not testable" and "look alike" in health["transfer"].said


@pytest.mark.slow
def test_most_flat_glossy_reliefs_are_doubted_for_what_is_wrong_alone(monkeypatch):
    """Of 18, with six shapes, three glosses, three domes, 13 were called display-encoded, and 7 under lamps uneven by
    20 % out of order. All that are exchanged are found.
    """
    domes = (12, (30.0, 55.0)), (16, (20.0, 45.0, 65.0)), (9, (40.0, 60.0))
    doubted = {"right": [], "uneven": [], "exchanged": []}
    for seed, gloss in product(range(6), ((0.5, 0.25, 1.5), (0.8, 0.12, 1.5), (0.3, 0.4, 1.5))):
        monkeypatch.setattr(simulated_relief, "GLOSS", gloss)
        count, tilts = domes[seed % 3]
        relief = SimulatedRelief(seed=seed, patina=0.3 * (seed % 2))
        capture = relief_capture(relief, relief_camera(48), dome(count, tilts=tilts), seed)
        for done, changed in (
            ("right", capture),
            ("uneven", uneven(capture, 0.2, seed)),
            ("exchanged", exchanged(capture)),
        ):
            doubted[done] += [one.name for one in examine(changed).health.doubtful]
    assert doubted["right"] in ([], ["transfer"])
    assert "order" not in doubted["uneven"] and "transfer" not in doubted["uneven"]
    assert doubted["exchanged"].count("order") == 18


def test_few_lamps_are_not_testable(glossy):
    health = examine(replace(glossy, photographs=glossy.photographs[:4])).health
    assert {health[name].state for name in ("order", "lamps", "strengths")} == {"not testable"}
    assert "from 6 on" in health["order"].said


@real_data("uw_psm")
@pytest.mark.parametrize("name", ["cat", "owl"])
def test_mistakes_are_named_in_real_photographs(name):
    """Lamps were held by hand: their strengths differ by 7 % and more, as said. Motion: the camera did not move."""
    from studies.uw_psm import read_lamps, read_object

    _, lamps = read_lamps(DATA / "uw_psm")
    capture = read_object(DATA / "uw_psm", name, lamps)
    right = examine(capture).health
    assert {one.name for one in right.doubtful} <= {"strengths"}
    for mistake, (change, check, said) in MISTAKES.items():
        found = examine(change(capture)).health[check]
        assert found.state == "doubtful" and said.format(name) in found.said, (mistake, found)


def drawn(seed: int) -> hg.Capture:
    """Photographs of a scene of the study, under near lamps; the shape of its things is not given."""
    with tempfile.TemporaryDirectory() as home:
        scene = Path(home) / "scene.toml"
        scene.write_text(random_scene(seed), encoding="utf-8")
        return without_shape(hg.simulate(scene))


@pytest.fixture(scope="module")
def ball():
    """A glossy ball under 20 lamps some 0.9 m away, beside which the picture is dark."""
    return drawn(BALL)


@pytest.mark.by_night("324", "340", "352", "366", "422")
@pytest.mark.parametrize("seed", FEW_NORMALS)
def test_lamps_and_strengths_of_what_has_few_normals_are_not_doubted(seed):
    """Cubes, and things before a wall: a few squares of pixels at their edges decided where a lamp is."""
    doubted = {one.name for one in examine(drawn(seed)).health.doubtful}
    assert not doubted & {"lamps", "strengths"}


def test_lamps_are_not_good_where_one_that_is_off_would_not_be_noticed():
    """Glossy things under 7 lamps: directions by their shading are 20° off, and all lamps were called good."""
    found = examine(drawn(310)).health["lamps"]
    assert found.state == "not testable" and "is noticed in 0 of 7 trials only" in found.said


def test_a_right_capture_under_near_lamps_is_not_doubted(ball):
    found = examine(ball).health
    assert found.doubtful == ()
    assert all(found[name].state == "good" for name in ("order", "lamps", "strengths"))


@pytest.mark.parametrize("mistake", [swapped, *(pytest.param(one, marks=pytest.mark.nightly) for one in LATER)])
def test_mistakes_under_near_lamps_are_named(ball, mistake):
    checks = {"swapped": "order", "direction": "lamps", "strength": "strengths", "encoded": "transfer"}
    found = examine(mistake(ball, np.random.default_rng(1))).health
    assert checks[mistake.__name__] in [one.name for one in found.doubtful]


def test_a_photograph_that_is_there_twice_is_named_under_near_lamps(ball):
    found = examine(twice(ball, of=7)).health["order"]
    assert found.state == "doubtful" and "are the same picture" in found.said


def test_near_lamps_need_a_place_for_the_object(ball):
    here = tuple(replace(shot, camera=shot.camera.with_pose(np.eye(4))) for shot in ball.photographs)
    found = examine(replace(ball, photographs=here)).health["lamps"]
    assert found.state == "not testable" and "near lamps, and neither points" in found.said
