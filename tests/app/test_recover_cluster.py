"""A recovery by workers: the bits of one machine, whoever dies."""

import os
import signal
from dataclasses import replace

import numpy as np
import pytest

import hagoromo as hg
from hagoromo.app.cli import main
from hagoromo_recovery import recover as recovering
from studies.fuzzy_scenes import down, fuzzy_simulated
from studies.recover_scenes import TrueObject, shots, simulated

SETTINGS = hg.RecoverySettings(side=16, steps=9, rays=1 << 12, keep=0, errors=False)


@pytest.fixture(scope="module")
def capture():
    return simulated(TrueObject(), shots(7, 5, 60, 1, pixels=36), 1).capture


def pids(cluster):
    return set(cluster.client.run(os.getpid).values())


def same(one, other):
    assert one.evidence is not None and other.evidence is not None
    for name in ("distance", "colours", "gloss"):
        assert np.array_equal(getattr(one, name), getattr(other, name)), name
    assert np.array_equal(one.evidence.covariance, other.evidence.covariance)
    assert np.array_equal(one.evidence.photographs, other.evidence.photographs)


@pytest.mark.nightly
def test_a_killed_worker_loses_nothing(capture, cluster, address):
    """One of two is killed after some steps; gradients, the gloss and its covariance have the bits of one process."""
    before = pids(cluster)

    def kill(share: float, step: str = "") -> None:
        if share > 0.4 and len(before) == 2:
            os.kill(before.pop(), signal.SIGKILL)

    found = hg.recover(capture, SETTINGS, kill, scheduler=address)
    assert len(before) == 1
    same(found, hg.recover(capture, SETTINGS))


@pytest.mark.nightly
@pytest.mark.parametrize("refine", ["cameras,lamps,exposure,places", "turn"])
def test_what_is_estimated_beside_the_object_has_the_same_bits(capture, address, refine):
    settings = replace(SETTINGS, side=18, steps=36, refine=refine)
    if refine == "turn":
        capture = hg.Capture(tuple(replace(p, lamps=()) for p in capture.photographs), "unlit")
        settings = replace(settings, light="camera")
    same(hg.recover(capture, settings, scheduler=address), hg.recover(capture, settings))


@pytest.mark.nightly
def test_the_gloss_of_places_has_the_same_bits(capture, address):
    settings = replace(SETTINGS, side=18, steps=36, gloss="places")
    one, other = hg.recover(capture, settings, scheduler=address), hg.recover(capture, settings)
    same(one, other)
    assert one.shares is not None and other.shares is not None and np.array_equal(one.shares, other.shares)


@pytest.mark.nightly
def test_light_between_parts_has_the_same_bits(capture, address):
    settings = replace(SETTINGS, side=18, steps=36, orders="all", refine="lamps")
    same(hg.recover(capture, settings, scheduler=address), hg.recover(capture, settings))


@pytest.mark.nightly
def test_fuzzy_matter_and_errors_have_the_same_bits(address):
    taken = fuzzy_simulated(down(2.0), shots(12, 5, 60, 1, pixels=40), 1).capture
    settings = replace(SETTINGS, side=34, steps=6, matter="fuzzy", errors=True)
    one, other = hg.recover(taken, settings, scheduler=address), hg.recover(taken, settings)
    same(one, other)
    assert one.fuzzy is not None and other.fuzzy is not None
    assert np.array_equal(one.fuzzy.density, other.fuzzy.density) and np.array_equal(one.fuzzy.axes, other.fuzzy.axes)
    assert one.errors is not None and other.errors is not None
    assert np.array_equal(one.errors.position, other.errors.position, equal_nan=True)


@pytest.mark.nightly
def test_the_command_takes_workers(capture, tmp_path):
    capture.save(tmp_path / "capture")
    quick = ["--side", "16", "--steps", "3", "--no-errors", "--voxels", "16"]
    for name, more in (("here", []), ("there", ["--scheduler", "2"])):
        assert main(["recover", str(tmp_path / "capture"), "--out", str(tmp_path / f"{name}.zarr"), *quick, *more]) == 0
    assert (tmp_path / "here.ply").read_bytes() == (tmp_path / "there.ply").read_bytes()


@pytest.mark.nightly
def test_a_lattice_larger_than_the_memory_is_refused_with_what_would_fit(capture, monkeypatch):
    monkeypatch.setattr(recovering, "free_memory", lambda: 64 << 20)
    with pytest.raises(hg.InputError, match=r"of 512 nodes along its edge needs .* --side \d+ would fit") as error:
        hg.recover(capture, replace(SETTINGS, side=512))
    fits = int(str(error.value).split("--side ")[1].split()[0])
    assert 16 <= fits < 512
    hg.recover(capture, replace(SETTINGS, side=fits, steps=1), scheduler=None)
