"""Silhouettes without masks: what is bright, with what lies in shadow."""

import numpy as np
import pytest

from hagoromo_recovery.explained import Explained, said_of
from hagoromo_recovery.outline.agreement import UNCOVERED, Shadow, misses_of
from hagoromo_recovery.outline.hull import ALLOWED, box_of, hull_distance, outlines_of
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.outline.silhouettes import bright_of, views_of
from studies.drawn_objects import without_masks
from studies.recover_scenes import TrueObject, shots, simulated

VIEWS, PIXELS = 16, 48


def photographs(low, high, lamps=1):
    """Without masks, lit `low` to `high` degrees off the eye."""
    taken = simulated(TrueObject(beta=0.0), shots(VIEWS, low, high, 1, PIXELS, lamps), 1)
    return without_masks(taken).capture.photographs


def test_photographs_from_one_pose_share_what_one_of_them_shows_lit():
    shown = photographs(60, 110, lamps=2)
    views = views_of(shown)
    for first, second, a, b in zip(views[::2], views[1::2], shown[::2], shown[1::2], strict=True):
        assert np.array_equal(first.silhouette, second.silhouette)
        assert np.array_equal(first.silhouette, bright_of(a) | bright_of(b))


def test_the_hull_covers_what_photographs_lit_from_the_side_show():
    """A share of the photographs that is fixed would leave most of it out."""
    outlines = outlines_of(views_of(photographs(60, 110)))
    usual = int(ALLOWED * len(outlines))
    misses = misses_of(outlines)
    assert misses > usual
    lattice = Lattice.around(*box_of(outlines, misses), 32)
    shadows = [Shadow(outline, lattice) for outline in outlines]

    def uncovered(count):
        hull = (hull_distance(outlines, lattice, count) < 1.0).ravel()
        return np.array([shadow.uncovered(hull) for shadow in shadows])

    assert np.quantile(uncovered(misses), 1.0 - ALLOWED) <= UNCOVERED
    assert np.quantile(uncovered(usual), 0.5) > 0.2


def test_photographs_lit_from_the_front_may_miss_a_place_no_more_often_than_usual():
    assert misses_of(outlines_of(views_of(photographs(5, 40)))) == int(ALLOWED * VIEWS)


@pytest.mark.parametrize(("rest", "count"), [(0.05, 0), (0.25, 1)])
def test_photographs_that_are_all_badly_explained_are_said(rest, count):
    """None of them is worse than the others."""
    said = said_of([Explained(name, light=1.0, rest=rest, scaled=rest, factor=1.0, missing=0.0) for name in "abc"])
    assert len(said) == count and all(one.startswith("25 % of the light of photographs is unex") for one in said)


@pytest.mark.parametrize(("stated", "what"), [(True, "1 of 3 masks are not"), (False, "bright in 1 of 3 photographs")])
def test_what_the_object_does_not_cover_is_said(stated, what):
    usual = Explained("a", light=1.0, rest=0.01, scaled=0.01, factor=1.0, missing=0.0)
    said = said_of([usual, usual._replace(name="b"), usual._replace(name="c", missing=0.4)], stated)
    assert len(said) == 1 and what in said[0] and "c by 40 %" in said[0]
