"""Recover fuzzy matter: a ball of down of a size that a test has time for, against a surface in its place."""

from dataclasses import replace

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo_recovery.export import conserving
from hagoromo_recovery.field.fuzzy_moves import LEAST
from studies.fuzzy_scenes import down, fuzzy_simulated
from studies.recover_scenes import TrueObject, shots, simulated
from studies.recovery import psnr

SETTINGS = hg.RecoverySettings(side=20, steps=24, rays=1 << 12, keep=0, errors=False, matter="fuzzy")


@pytest.fixture(scope="module")
def box():
    return down(2.0)


@pytest.fixture(scope="module")
def taken(box):
    return fuzzy_simulated(box, shots(12, 5, 60, 1, pixels=40), 1)


@pytest.fixture(scope="module")
def aside(box):
    """Other views, under other lamps from the side."""
    return fuzzy_simulated(box, shots(3, 80, 110, 2, pixels=40), noise=False)


@pytest.fixture(scope="module")
def recovered(taken):
    return hg.recover(taken.capture, SETTINGS)


def test_new_views_under_new_lamps_are_predicted(taken, aside, recovered):
    """In the mean of two descents, which differ by what rays they draw: by 0.7 dB."""
    other = hg.recover(taken.capture, replace(SETTINGS, seed=1))
    assert recovered.matter == other.matter == "fuzzy"
    assert 0.5 * (psnr(recovered, aside) + psnr(other, aside)) > 24.0


@pytest.mark.nightly
def test_they_are_predicted_better_than_by_a_surface(taken, aside, recovered):
    surface = hg.recover(taken.capture, replace(SETTINGS, matter="surface"))
    assert surface.matter == "surface"
    assert psnr(recovered, aside) > psnr(surface, aside) + 4.0


def test_its_box_shows_through_render_what_it_shows_itself(recovered, aside):
    """To 0.5 dB, against the truth."""
    box, photograph, (_, dim) = recovered.box(), aside.capture.photographs[0], conserving(recovered)
    assert box.materials[0].element == "cylinder" and box.extinction == "isotropic"
    lamps = tuple(replace(lamp, intensity=lamp.intensity / dim) for lamp in photograph.lamps)
    image = hg.render(hg.Scene(photograph.camera, lamps, boxes=(box,)), hg.Settings(samples=4))
    shown, own = image.expose(photograph.camera.response), recovered.picture(photograph)[0]
    truth = aside.exact[0]
    assert abs(10.0 * np.log10(np.mean((shown - truth) ** 2) / np.mean((own - truth) ** 2))) < 0.5


def test_density_is_not_negative_and_axes_are_unit_vectors(recovered):
    fuzzy = recovered.fuzzy
    there = fuzzy.reach < 0.0
    assert fuzzy.density.min() >= 0.0 and fuzzy.density[there].min() >= LEAST
    assert np.allclose(np.linalg.norm(fuzzy.axes[there], axis=1), 1.0, atol=1e-4)


def test_the_surface_that_stands_for_it_is_about_where_it_is_half_opaque(recovered):
    mesh = recovered.mesh()
    reach = np.linalg.norm(mesh.vertices, axis=1)
    assert 0.015 < np.median(reach) < 0.036  # m
    assert np.isin(mesh.photographs, 0).mean() < 0.5


@pytest.mark.nightly
def test_the_better_law_is_chosen(taken):
    """On down the free density, on an exact surface the surface."""
    quick = replace(SETTINGS, matter="auto")
    found = hg.recover(taken.capture, quick)
    assert found.matter == "fuzzy"
    tried = found.record()["matter_tried_db"]
    assert tried["fuzzy"] > tried["surface"] + 0.5
    hard = simulated(TrueObject(), shots(12, 5, 60, 1, pixels=40), 1)
    assert hg.recover(hard.capture, quick).matter == "surface"


@pytest.mark.nightly
def test_one_seed_gives_the_same_bits_whatever_the_cores(taken):
    cores, found = dr.thread_count(), []
    for count in (cores, 1):
        dr.set_thread_count(count)
        found.append(hg.recover(taken.capture, replace(SETTINGS, steps=3)).fuzzy)
    dr.set_thread_count(cores)
    for name in ("density", "axes", "colours", "gloss"):
        assert np.array_equal(getattr(found[0], name), getattr(found[1], name))


@pytest.mark.nightly
def test_work_that_was_interrupted_ends_with_the_same_bits(taken, tmp_path):
    settings = replace(SETTINGS, side=16, steps=34)
    whole, work = hg.recover(taken.capture, settings).fuzzy, tmp_path / "work.npz"

    def stop(share, step=""):
        if share > 31.5 / 34.0:  # after the nodes that move were chosen anew
            raise KeyboardInterrupt

    assert not hg.recover(taken.capture, settings, stop, work).complete
    again = hg.recover(taken.capture, settings, work=work)
    assert again.complete and not work.exists()
    for name in ("density", "axes", "colours", "reach", "gloss"):
        assert np.array_equal(getattr(again.fuzzy, name), getattr(whole, name))


def test_bad_input_is_one_line(taken):
    with pytest.raises(hg.InputError, match="matter is 'fur': give surface, fuzzy, auto"):
        hg.RecoverySettings(matter="fur")  # type: ignore[arg-type]
    unlit = hg.Capture(tuple(replace(p, lamps=()) for p in taken.capture.photographs), "unlit")
    with pytest.raises(hg.InputError, match="light is 'camera', which is by the normal, and fuzzy matter has none"):
        hg.recover(unlit, replace(SETTINGS, light="camera"))
