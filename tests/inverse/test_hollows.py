"""Hollows that no silhouette shows."""

import drjit as dr
import numpy as np
import pytest

import hagoromo as hg
from hagoromo.backend import vectors
from hagoromo_recovery.field.near_surface import THICK
from hagoromo_recovery.hollows import FoundHollow, hollowed
from hagoromo_recovery.levels import Levels
from hagoromo_recovery.outline.lattice import Lattice
from hagoromo_recovery.shading.shading import START, coordinates
from hagoromo_recovery.surface_shape import SurfaceShape
from studies.recover_scenes import shots, simulated
from studies.recovery_scores import shape_errors
from studies.strange_captures import Bowl

NODES, RADIUS, WALL = 34, 12.0, 3.0


@pytest.fixture
def half_ball():
    """A massive half ball whose flat face is badly explained."""
    z, y, x = np.meshgrid(*(np.arange(NODES) - 0.5 * (NODES - 1),) * 3, indexing="ij")
    values = np.maximum(np.sqrt(x * x + y * y + (z - 4.3) ** 2) - RADIUS, z - 4.3).astype(np.float32)
    lattice = Lattice(np.zeros(3), 0.002, values.shape)
    colours = np.full((*values.shape, 3), 0.5, np.float32)
    bad = (np.abs(z - 4.3) < 2.0) & (np.hypot(x, y) < RADIUS - 0.5)
    return SurfaceShape(lattice, values, colours, coordinates(*START)), bad


def test_matter_behind_an_opening_is_taken_away_up_to_the_wall(half_ball):
    shape, bad = half_ball
    found = hollowed(shape, bad, WALL)
    assert found is not None
    middle = NODES // 2
    column = found.distance[:, middle, middle]  # from below upwards, through the middle
    inside = np.flatnonzero(column < 0.0)
    assert len(inside) == pytest.approx(WALL, abs=1.0) and inside[0] < 10
    outer = found.distance[: middle - 8, 2:-2, 2:-2] - shape.distance[: middle - 8, 2:-2, 2:-2]
    assert (outer >= 0.0).all()  # nothing is added
    outside = shape.distance > 1.5
    assert (found.distance[outside] > 0.0).all()


def test_nothing_is_taken_away_where_all_is_well_or_all_is_badly_explained(half_ball):
    shape, bad = half_ball
    assert hollowed(shape, np.zeros_like(bad), WALL) is None
    assert hollowed(shape, np.ones_like(bad), WALL) is None
    edge = bad & (np.arange(NODES) < 8)  # too narrow for a hollow between two walls
    assert hollowed(shape, edge, 6.0) is None


class ThickBowl(Bowl):
    """A wall of 8 mm, 3.4 voxels of the lattice below."""

    def distance(self, p):
        return dr.fmax(dr.abs(dr.norm(p) - 0.028) - 0.004, p.z - 0.008)


@pytest.mark.nightly
def test_a_bowl_is_found_where_steps_from_the_hull_make_a_dent():
    """By its shading alone, of the first order."""
    taken = simulated(ThickBowl(), shots(18, 5, 60, 1, pixels=72), 1)
    aside = simulated(ThickBowl(), shots(4, 5, 60, 2, pixels=72), noise=False)
    found = hg.recover(taken.capture, hg.RecoverySettings(side=34, steps=50, keep=0, errors=False))
    assert shape_errors(found, aside).angles.mean() < 15.0  # a dent has 30 degrees


@pytest.mark.nightly
def test_the_wall_of_a_bowl_stays_thin():
    """Of 1.7 voxels: in a soft edge the thinnest that is tried, of 3, would melt, and a thicker one would be taken."""
    taken = simulated(Bowl(), shots(18, 5, 60, 1, pixels=72), 1)
    found = hg.recover(taken.capture, hg.RecoverySettings(side=34, steps=50, keep=0, errors=False))
    way = np.linspace(0.015, 0.04, 251)  # m, downwards from the middle
    value = found.surface_field.value_at(vectors(found.lattice.from_world(way[:, None] * [0.0, 0.0, -1.0])))
    inside = way[np.array(value) < 0.0]
    assert inside[-1] == pytest.approx(0.032, abs=0.5e-3)
    assert inside[-1] - inside[0] < THICK * found.lattice.voxel


def test_the_hollow_that_was_found_is_in_the_record_also_after_an_interrupt(monkeypatch, tmp_path):
    """A trial that leaves half of what the dent leaves."""
    monkeypatch.setattr(Levels, "_hollows", lambda levels, begin: {WALL: begin})
    left = iter([1.0, 0.5])
    monkeypatch.setattr("hagoromo_recovery.levels.left_over", lambda descent: next(left))

    def stop(share, step=""):
        if share > 0.95:
            raise KeyboardInterrupt

    capture, work = simulated(Bowl(), shots(6, 5, 60, 1, pixels=32), 1).capture, tmp_path / "work.npz"
    settings = hg.RecoverySettings(side=31, steps=42, rays=1 << 10, keep=0, errors=False)
    part = hg.recover(capture, settings, stop, work)
    found = hg.recover(capture, settings, work=work)  # the trial is not done again
    voxel = found.lattice.voxel
    assert not part.complete and part.hollow == found.hollow == FoundHollow(WALL * voxel, 0.5)
    assert found.record()["hollow"] == {"wall_m": pytest.approx(WALL * voxel), "left_over": 0.5}
