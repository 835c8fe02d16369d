"""Recover, from captures as strangers bring them: a photograph of another object, lamps in another unit."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.matter import shape as sd
from studies.recover_scenes import TrueObject, misstated, shots, simulated, stacked
from studies.recovery_scores import box_psnr, psnr
from studies.strange_captures import in_files, resized, unlit

QUICK = hg.RecoverySettings(side=20, steps=20, rays=1 << 11, keep=0, errors=False)


class Block(TrueObject):
    """Another object."""

    def distance(self, p):
        return sd.rounded_box(p, (0.0, 0.0, 0.0), (0.026, 0.026, 0.026), 0.002)


@pytest.fixture(scope="module")
def taken():
    return simulated(TrueObject(), shots(12, 5, 60, 1, pixels=48), 1)


@pytest.fixture(scope="module")
def usual(taken):
    return hg.recover(taken.capture, QUICK)


@pytest.fixture(scope="module")
def aside():
    return simulated(TrueObject(), shots(3, 5, 60, 2, pixels=48), noise=False)


UNIT = 0.1  # dB


def remarks_on(found):
    """Remarks; 20 nodes do not hold the arms of the object, which is said each time."""
    return [said for said in found.record()["remarks"] if not said.startswith("matter behind")]


def changed(taken, change):
    photographs = tuple(change(number, p) for number, p in enumerate(taken.capture.photographs))
    return replace(taken, capture=replace(taken.capture, photographs=photographs))


def brighter(taken, factor):
    """The same with lamps that are stated stronger by a factor."""

    def lit(number, photograph):
        lamps = tuple(replace(lamp, intensity=factor * float(np.mean(lamp.intensity))) for lamp in photograph.lamps)
        return replace(photograph, lamps=lamps)

    return changed(taken, lit)


def test_a_photograph_of_another_object_is_named(taken):
    other = simulated(Block(), shots(12, 5, 60, 1, pixels=48), 1)
    photographs = list(taken.capture.photographs)
    photographs[4] = replace(other.capture.photographs[4], name="the block")
    with pytest.raises(hg.InputError, match="of 1 of 12 photographs contradict all others: the block") as error:
        hg.recover(stacked([replace(taken.capture, photographs=tuple(photographs))], "odd"), QUICK)
    assert "\n" not in str(error.value)


def test_poses_of_all_that_are_wrong_are_said(taken, monkeypatch):
    from hagoromo_recovery import recover

    class Begun(Exception):
        pass

    def begun(*arguments):
        raise Begun

    monkeypatch.setattr(recover, "_first_looks", begun)
    with pytest.warns(UserWarning, match="masks of photographs contradict one another"), pytest.raises(Begun):
        hg.recover(misstated(taken, 3.0, 0.0).capture, QUICK)
    with pytest.raises(Begun):  # and nothing is said of poses that are half a pixel wrong
        hg.recover(misstated(taken, 0.5, 0.0).capture, QUICK)


@pytest.mark.nightly
def test_lamps_in_another_unit_change_nothing_but_the_unit_of_body_colours(taken, usual, aside):
    """Light is body colour times strength: the pictures are those of lamps in the usual unit."""
    weak, strong = (hg.recover(brighter(taken, factor).capture, QUICK) for factor in (0.02, 50.0))
    for found, factor in ((weak, 0.02), (strong, 50.0)):
        assert psnr(found, brighter(aside, factor)) == pytest.approx(psnr(usual, aside), abs=UNIT)
        assert found.brightest * factor == pytest.approx(usual.brightest, rel=1e-3)
    assert weak.brightest * 0.02 == pytest.approx(strong.brightest * 50.0, rel=1e-3)
    assert weak.beta * 0.02 == pytest.approx(strong.beta * 50.0, rel=1e-2)
    assert weak.gamma == pytest.approx(strong.gamma, rel=1e-2)


@pytest.mark.nightly
@pytest.mark.parametrize(
    ("factor", "strengths"), [(1e3, False), (0.05, True), (100.0, True)], ids=["mm", "5 mm", "10 m"]
)
def test_the_unit_of_length_and_the_size_of_the_object_change_nothing(taken, usual, aside, factor, strengths):
    """In millimetres with strengths for metres, body colours are a million times too large, which is said."""
    found = hg.recover(resized(taken, factor, strengths).capture, QUICK)
    assert psnr(found, resized(aside, factor, strengths)) == pytest.approx(psnr(usual, aside), abs=UNIT)
    assert found.lattice.voxel == pytest.approx(factor * usual.lattice.voxel, rel=1e-3)
    remarks = remarks_on(found)
    assert len(remarks) == (not strengths) and all("lamps are stated too weak or too far" in said for said in remarks)


@pytest.mark.nightly
@pytest.mark.by_night("16")
@pytest.mark.parametrize("bits", [8, 16])
def test_files_of_8_and_16_bits_give_the_same_object(taken, usual, aside, tmp_path, bits):
    found = hg.recover(in_files(taken, tmp_path / "capture", bits).capture, QUICK)
    assert psnr(found, aside) == pytest.approx(psnr(usual, aside), abs=1.0)
    assert remarks_on(found) == []


def test_photographs_without_light_take_no_part_and_are_named(taken, aside):
    found = hg.recover(unlit(taken, lambda k: k in (2, 7)).capture, QUICK)
    others = [p for k, p in enumerate(taken.capture.photographs) if k not in (2, 7)]
    without = hg.recover(stacked([replace(taken.capture, photographs=tuple(others))], "lit"), QUICK)
    assert np.array_equal(found.distance, without.distance)
    assert remarks_on(found)[0].startswith("2 photographs show no light above their noise")
    assert "view 2, view 7" in remarks_on(found)[0]


def test_photographs_of_noise_alone_end_in_one_line(taken):
    with pytest.raises(hg.InputError, match="only darkness"):
        hg.recover(unlit(taken, lambda k: True).capture, QUICK)
    with pytest.raises(hg.InputError, match="10 of 12 photographs show no light"):
        hg.recover(unlit(taken, lambda k: k > 1).capture, QUICK)


@pytest.mark.nightly
def test_a_box_whose_body_colours_are_more_than_all_light_is_dimmed_and_that_is_said(taken, usual, aside):
    found, seen = hg.recover(brighter(taken, 0.1).capture, QUICK), brighter(aside, 0.1)
    assert found.brightest > 2.0
    assert box_psnr(found, seen) > psnr(found, seen) - 1.0
    assert found.mesh().colours.max() < 2.0
    assert "lamps are stated too weak" in found.record()["remarks"][0]
    assert remarks_on(usual) == []


def another_exposure(number, photograph):
    return replace(photograph, values=0.7 * photograph.values) if number == 8 else photograph


def mixed_up_lamps(number, photograph):
    return replace(photograph, lamps=(MIXED[number],)) if number in MIXED else photograph


MIXED = {}  # lamps of others, by the number of a photograph


@pytest.mark.nightly
@pytest.mark.by_night("exposure")
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (another_exposure, "1 of 18 photographs are brighter or darker than the others say: view 8 by -2"),
        (mixed_up_lamps, "the light of 2 of 18 photographs is explained 3 times worse than is usual: view 6, view 9;"),
        (lambda _, photograph: photograph, ""),
    ],
    ids=["exposure", "lamps", "none"],
)
def test_photographs_of_another_exposure_or_lamp_are_named(change, said):
    """Light that is wrong by 30 %, and the lamps of two mixed up: the right ones are named, and nothing else is."""
    taken = simulated(TrueObject(), shots(18, 5, 60, 1, pixels=48), 1)
    MIXED.update({6: taken.capture.photographs[9].lamps[0], 9: taken.capture.photographs[6].lamps[0]})
    remarks = remarks_on(hg.recover(changed(taken, change).capture, replace(QUICK, steps=40)))
    assert len(remarks) == bool(said) and "".join(remarks).startswith(said)


@pytest.mark.nightly
def test_what_no_lamp_lights_has_no_stated_body_colour(taken):
    """All lamps stand on one side: what is behind is seen, and not lit."""
    axis = np.array([0.0, -0.8, 0.6])
    one_sided = replace(
        shots(12, 5, 60, 1, pixels=48), lamps=[np.array([0.5 * axis + 0.02 * np.eye(3)[k % 3]]) for k in range(12)]
    )
    found = hg.recover(simulated(TrueObject(), one_sided, 1).capture, replace(QUICK, errors=True))
    behind = found.lattice.nodes() - found.lattice.middle
    behind = (behind @ axis < -0.01) & (np.abs(found.distance) < 0.5)
    assert found.evidence is not None and found.errors is not None
    assert found.never_shown > 0.15 and (found.evidence.photographs[behind] == 0).mean() > 0.6
    assert np.isnan(found.errors.colour[behind & (found.evidence.photographs == 0)]).all()
    assert (np.isfinite(found.errors.position) | found.errors.thin)[behind].all()
    assert any("of the surface is lit in no photograph" in said for said in found.record()["remarks"])


@pytest.mark.nightly
@pytest.mark.by_night("2.2-0.1")
@pytest.mark.parametrize(("beta", "gamma"), [(0.0, 0.1), (0.4, 0.5), (2.2, 0.1)])
def test_an_object_without_gloss_is_called_matt_and_no_other(beta, gamma):
    """What a broad lobe explains of a matt object is an error of the model; a true broad one explains far more."""
    taken = simulated(TrueObject(beta, gamma), shots(18, 5, 60, 1, pixels=48), 1)
    found = hg.recover(taken.capture, replace(QUICK, steps=40))
    material = found.record()["material"]
    low, high = material["interval_95"]["beta"]
    assert low <= beta <= high
    assert (material["beta"] == 0.0) == (beta == 0.0)
    assert beta > 0.0 or not any(material["identifiable"].values())
