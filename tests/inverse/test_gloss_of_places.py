"""Two glosses, of which places have shares: on photographs of an object whose upper half is glazed."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.reflectance.facets import facet_density_at
from hagoromo_recovery.descent.gloss_step import Slopes
from hagoromo_recovery.descent.share_step import SHARE_EVENNESS, SLOW, ShareSteps
from hagoromo_recovery.shading.mixed_gloss import mixed_gloss
from studies.gloss_recovery import Glaze, halves
from studies.recover_scenes import TrueObject, shots, simulated
from studies.recovery_scores import box_psnr, psnr

SETTINGS = hg.RecoverySettings(side=32, steps=80, keep=0, errors=False, gloss="places")
SHORT = hg.RecoverySettings(side=18, steps=42, rays=1 << 10, keep=0, gloss="places")


@pytest.fixture(scope="module")
def taken():
    return simulated(Glaze(halves), shots(24, 5, 60, 1, pixels=64), 1)


@pytest.fixture(scope="module")
def aside():
    return simulated(Glaze(halves), shots(4, 5, 60, 2, pixels=64), noise=False)


@pytest.fixture(scope="module")
def recovered(taken):
    return hg.recover(taken.capture, SETTINGS)


@pytest.mark.nightly
def test_new_views_are_predicted_better_than_by_one_gloss(taken, recovered, aside):
    one = hg.recover(taken.capture, replace(SETTINGS, gloss="one"))
    assert psnr(recovered, aside) > psnr(one, aside) + 1.0  # dB


@pytest.mark.nightly
def test_the_glazed_half_has_more_and_narrower_gloss():
    """The other half has a fifteenth of its β and three times its γ: these are found with less contrast."""
    many = simulated(Glaze(halves), shots(36, 5, 60, 1, pixels=96), 1)
    found = hg.recover(many.capture, replace(SETTINGS, side=64, steps=120))
    assert found.shares is not None
    there = np.abs(found.distance) < 0.5
    gloss, upper = mixed_gloss(found.gloss, found.shares[there]), found.lattice.nodes()[there][:, 2] > 0.0
    assert np.median(gloss.beta[upper]) > 2.0 * np.median(gloss.beta[~upper])
    assert np.median(gloss.gamma[upper]) == pytest.approx(0.1, rel=0.2)


@pytest.mark.nightly
def test_its_box_shows_through_render_what_it_shows_itself(recovered, aside):
    """The box has some levels of the share; what that costs is less than what its voxels cost."""
    assert len(recovered.box(64).materials) > 2
    assert box_psnr(recovered, aside) > psnr(recovered, aside) - 1.0  # dB


@pytest.mark.nightly
def test_the_record_and_the_mesh_have_the_gloss_of_places(taken, tmp_path):
    """Also of a quick look, of 18 nodes."""
    import trimesh

    recovered = hg.recover(taken.capture, SHORT)
    record, mesh = recovered.record(), recovered.mesh()
    first, second = record["materials"]
    assert first["gamma"] < second["gamma"] and first["interval_95"]["beta"][0] < first["beta"]
    assert record["gloss"]["beta"][0] < record["gloss"]["beta"][-1]
    mesh.save(tmp_path / "mesh.ply")
    read = trimesh.load(tmp_path / "mesh.ply", process=False).metadata["_ply_raw"]["vertex"]["data"]
    assert (
        mesh.gloss is not None
        and np.allclose(read["beta"].ravel(), mesh.gloss.beta)
        and "gamma_error" in read.dtype.names
    )


def test_a_mixture_has_half_of_its_facets_at_gamma():
    gloss, shares = np.log([2.0, 0.1, 0.5, 0.15, 0.3]), np.linspace(0.0, 1.0, 7)

    def density(angle):
        first, second = (np.array([facet_density_at(a * a, width) for a in angle]) for width in (0.1, 0.3))
        return (1.0 - shares) * 2.0 * first + shares * 0.15 * second

    found = mixed_gloss(gloss, shares)
    assert np.allclose(found.beta, density(np.zeros(7)))
    assert np.allclose(density(found.gamma), 0.5 * found.beta)


def test_a_share_step_solves_its_linear_system():
    """Against a dense matrix: data of nodes, and differences of neighbours."""
    random, shape = np.random.default_rng(4), (5, 6, 7)
    inner = np.zeros(shape, bool)
    inner[1:-1, 1:-1, 1:-1] = True
    nodes, count = np.flatnonzero(inner), int(inner.sum())
    start, pixels = random.uniform(0.4, 0.6, count), 300
    by, rest = 0.5 * random.normal(size=(pixels, 3)), 0.05 * random.normal(size=(pixels, 3))
    at = random.integers(0, count, pixels)
    nothing = np.zeros((pixels, 3))
    slopes = Slopes(by[:, :, None], nothing, rest, nodes[at], np.zeros(pixels, np.int64))
    found = ShareSteps(nodes, shape).step(start, slopes)

    matrix, side = np.zeros((count, count)), np.zeros(count)
    for pixel, k in enumerate(at):
        matrix[k, k] += by[pixel] @ by[pixel]
        side[k] += by[pixel] @ (rest[pixel] + by[pixel] * start[k])
    pull = SHARE_EVENNESS * pixels / len(np.unique(at))
    places = np.argwhere(inner)
    for k, place in enumerate(places):
        for other in np.flatnonzero(np.abs(places - place).sum(axis=1) == 1):
            matrix[k, k] += pull
            matrix[k, other] -= pull
    solved = np.clip(np.linalg.solve(matrix, side), 0.0, 1.0)
    assert np.allclose(found, start + (solved - start) / (1.0 + SLOW), atol=1e-3)


@pytest.mark.nightly
def test_work_that_goes_on_ends_with_the_same_bits(taken, tmp_path):
    def stop(share, step=""):
        if share > 0.45:
            raise KeyboardInterrupt

    part = hg.recover(taken.capture, SHORT, stop, tmp_path / "work.npz")
    assert not part.complete
    resumed, whole = hg.recover(taken.capture, SHORT, work=tmp_path / "work.npz"), hg.recover(taken.capture, SHORT)
    for name in ("distance", "colours", "gloss", "shares"):
        assert np.array_equal(getattr(resumed, name), getattr(whole, name)), name
    assert resumed.errors is not None and whole.errors is not None
    assert resumed.errors.gloss is not None and whole.errors.gloss is not None
    assert np.array_equal(resumed.errors.gloss, whole.errors.gloss, equal_nan=True)
    near, thin = np.abs(whole.distance) < 1.0, whole.errors.thin
    assert np.isfinite(whole.errors.gloss[near & ~thin]).all() and (near & ~thin).sum() > 300
    assert np.isnan(whole.errors.gloss[near & thin]).all()  # where matter is too thin for its lattice none is stated


@pytest.mark.slow  # five minutes
def test_auto_takes_the_gloss_of_places_where_photographs_show_it():
    """Of halves with two glosses. A look of 32 nodes and 80 steps shows it too little, and takes one gloss."""
    settings = hg.RecoverySettings(side=48, keep=0, errors=False, gloss="auto")
    two = simulated(Glaze(halves), shots(36, 5, 60, 1, pixels=160), 1)
    assert hg.recover(two.capture, settings).shares is not None
    even = simulated(TrueObject(), shots(24, 5, 60, 1, pixels=64), 1)
    found = hg.recover(even.capture, settings)
    assert found.shares is None and set(found.record()["gloss_tried_db"]) == {"one", "places"}


def test_what_has_no_gloss_of_places_is_one_line(taken):
    with pytest.raises(hg.InputError, match="gloss is 'places', which is of a surface"):
        hg.RecoverySettings(matter="fuzzy", gloss="places")
    two: Any = "two"
    with pytest.raises(hg.InputError, match="gloss is 'two': give one, places, auto"):
        hg.RecoverySettings(gloss=two)
    dark = hg.Capture(tuple(replace(p, lamps=()) for p in taken.capture.photographs), "unlit")
    with pytest.raises(hg.InputError, match="no photograph has a lamp that could show it"):
        hg.recover(dark, SHORT)
