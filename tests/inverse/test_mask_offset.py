"""Mask offset: masks that are too small or too large, before dark and textured backgrounds."""

from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo_recovery.outline.mask_offset import mask_offset, with_masks_moved, without_mixed_pixels
from hagoromo_recovery.outline.silhouettes import views_of
from studies.recover_scenes import TrueObject, shots, simulated
from studies.strange_captures import Cube, ThinPlate, behind, dark, even, masks_moved, textured

BACKGROUNDS = {"dark": dark, "grey": even, "textured": textured}
QUICK = hg.RecoverySettings(side=16, steps=4, rays=1 << 10, keep=0, errors=False)


@pytest.fixture(scope="module", params=[TrueObject, Cube])
def taken(request):
    return simulated(request.param(), shots(5, 5, 60, 1, pixels=144), 1)


@pytest.fixture(scope="module")
def jug():
    return simulated(TrueObject(), shots(6, 5, 60, 1, pixels=96), 1)


def views(taken):
    return views_of(taken.capture.photographs)


@pytest.mark.parametrize("background", BACKGROUNDS)
def test_exact_masks_have_no_offset(taken, background):
    assert mask_offset(views(behind(taken, BACKGROUNDS[background]))) is None


def test_exact_masks_of_a_thin_plate_have_no_offset():
    plate = simulated(ThinPlate(), shots(5, 5, 60, 1, pixels=144), 1)
    assert all(mask_offset(views(behind(plate, background))) is None for background in BACKGROUNDS.values())


@pytest.mark.parametrize("background", BACKGROUNDS)
@pytest.mark.parametrize("pixels", [-3.0, 3.0])
def test_masks_that_are_wrong_are_found_before_any_background(taken, background, pixels):
    found = mask_offset(views(masks_moved(behind(taken, BACKGROUNDS[background]), pixels)))
    assert found is not None
    assert found.pixels == pytest.approx(-pixels, abs=0.8)
    assert ("too small" if pixels < 0.0 else "too large") in found.said


def test_an_outline_that_no_photograph_shows_has_no_offset(jug):
    """A picture of noise alone, and one that was cut out along its mask: nothing says where the outline is."""
    random = np.random.default_rng(0)
    noise = [replace(p, values=random.uniform(0.1, 0.2, p.values.shape)) for p in jug.capture.photographs]
    assert mask_offset(views_of(noise)) is None
    small = views(masks_moved(jug, -3.0))
    cut = [replace(v.photograph, values=v.photograph.values * v.silhouette[..., None]) for v in small]
    assert mask_offset(views_of(cut)) is None


def test_moved_masks_are_about_the_exact_ones(jug):
    exact = [p.silhouette for p in jug.capture.photographs]
    wrong = views(masks_moved(behind(jug, textured), 3.0))
    offset = mask_offset(wrong)
    assert offset is not None
    moved = with_masks_moved(wrong, offset)

    def off(masks):
        return sum(int((a ^ b).sum()) for a, b in zip(masks, exact, strict=True))

    assert off([view.silhouette for view in moved]) < 0.25 * off([view.silhouette for view in wrong])
    for view in moved:
        assert view.photograph.silhouette is not None
        assert np.array_equal(view.photograph.silhouette, view.silhouette)
    assert not any((view.photograph.mask & ~view.silhouette).any() for view in moved)


def test_pixels_at_the_outline_hold_no_light_before_a_background_that_is_not_dark(jug):
    lit, other = views(jug), views(behind(jug, even))
    for view, kept in zip(lit, without_mixed_pixels(lit), strict=True):
        assert (kept.photograph.mask == view.photograph.mask).all()
    for view, kept in zip(other, without_mixed_pixels(other), strict=True):
        assert kept.photograph.mask.sum() < 0.95 * view.photograph.mask.sum()
        assert (kept.silhouette == view.silhouette).all()


@pytest.mark.by_night("masks-True")
@pytest.mark.parametrize(("refine", "moved"), [("auto", True), ("none", False), ("masks", True)])
def test_it_is_said_and_mended_unless_nothing_is_to_be_refined(jug, refine, moved):
    wrong = masks_moved(jug, -3.0).capture
    record = hg.recover(wrong, replace(QUICK, refine=refine)).record()
    said = [each for each in record["remarks"] if each.startswith("masks look about")]
    assert len(said) == 1 and ("were moved" in said[0]) == moved
    assert (record["masks_moved_px"] > 2.0) == moved


def test_fibres_have_no_outline_to_look_for(jug):
    record = hg.recover(masks_moved(jug, -3.0).capture, replace(QUICK, matter="fuzzy", rays=1 << 8)).record()
    assert record["masks_moved_px"] == 0.0 and not any("masks look" in said for said in record["remarks"])
