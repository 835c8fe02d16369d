"""Recover, from captures as strangers bring them: a photograph of another object, lamps in another unit."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.matter import shape as sd
from hagoromo.recovery.remarks import said_of_brightness
from studies.recover_scenes import TrueObject, misstated, shots, simulated, stacked
from studies.recovery_scores import box_psnr, psnr

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
    from hagoromo.recovery import recover

    class Begun(Exception):
        pass

    def begun(*arguments):
        raise Begun

    monkeypatch.setattr(recover, "_first_looks", begun)
    with pytest.warns(UserWarning, match="masks of photographs contradict one another"), pytest.raises(Begun):
        hg.recover(misstated(taken, 3.0, 0.0).capture, QUICK)
    with pytest.raises(Begun):  # and nothing is said of poses that are half a pixel wrong
        hg.recover(misstated(taken, 0.5, 0.0).capture, QUICK)


def test_lamps_in_another_unit_change_nothing_but_the_unit_of_body_colours(taken, usual, aside):
    """Light is body colour times strength: the pictures are those of lamps in the usual unit."""
    weak, strong = (hg.recover(brighter(taken, factor).capture, QUICK) for factor in (0.02, 50.0))
    for found, factor in ((weak, 0.02), (strong, 50.0)):
        assert psnr(found, brighter(aside, factor)) == pytest.approx(psnr(usual, aside), abs=0.5)
        assert found.brightest * factor == pytest.approx(usual.brightest, rel=0.1)  # so few steps have not found it
    assert weak.brightest * 0.02 == pytest.approx(strong.brightest * 50.0, rel=1e-3)
    assert weak.beta * 0.02 == pytest.approx(strong.beta * 50.0, rel=1e-2)
    assert weak.gamma == pytest.approx(strong.gamma, rel=1e-2)


def test_a_box_whose_body_colours_are_more_than_all_light_is_dimmed_and_that_is_said(taken, usual, aside):
    found, seen = hg.recover(brighter(taken, 0.1).capture, QUICK), brighter(aside, 0.1)
    assert found.brightest > 2.0
    assert box_psnr(found, seen) > psnr(found, seen) - 1.0
    assert found.mesh().colours.max() < 2.0
    assert "lamps are stated too weak" in said_of_brightness(found.record())
    assert not said_of_brightness(usual.record())
