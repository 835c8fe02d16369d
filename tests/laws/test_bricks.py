"""Bricks: what is packed is read back, the two-level table leads to it, and rays meet the boxes in their order."""

import drjit as dr
import numpy as np
import pytest

from hagoromo import backend
from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.transport.lighting import Lighting
from hagoromo.transport.march import march, optical_depth
from hagoromo.transport.materials import Materials
from hagoromo.transport.medium import Medium
from hagoromo.transport.palette import palette_of
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.store.brick_writer import BrickWriter
from hagoromo.volume.store.fill_bricks import candidates
from hagoromo.volume.table import BLOCK, in_table_order, table_of
from hagoromo.volume.voxels import SMALLEST_DENSITY

WHITE = Spectrum.constant(1.0)
MATTER = Reflectance(0.25, 0.2, 0.25, 1.5, WHITE)


def noise_box(seed: int, corner, shape=(11, 17, 13), turn=0.0) -> VolumeBox:
    """A box of random densities and axes, turned about z."""
    rng = np.random.default_rng(seed)
    density = rng.random(shape).astype(np.float16) * (rng.random(shape) < 0.5)
    axis = rng.normal(size=(*shape, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    pose = np.eye(4)
    pose[:2, :2] = [[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]]
    pose[:3, 3] = corner
    return VolumeBox.from_arrays(density, axis, 0.01, 9.0, [MATTER], pose=pose)


def test_densities_come_back_exactly_and_axes_to_their_bits():
    """Densities below 6e-5 count as none. Axes: ½/1023 along x and y, ½/511 along z, and a half's rounding."""
    rng = np.random.default_rng(1)
    density = (10.0 ** rng.uniform(-8, 4.7, (17, 17, 17))).astype(np.float16)
    axis = rng.normal(size=(17, 17, 17, 3))
    axis /= np.linalg.norm(axis, axis=-1, keepdims=True)
    box = VolumeBox.from_arrays(density, axis, 0.01, 1.0, [MATTER])
    again, turned = box.bricks.dense()
    assert np.array_equal(again, np.where(density < SMALLEST_DENSITY, np.float16(0), density))
    off = np.abs(turned - axis)[density >= SMALLEST_DENSITY].max(axis=0)
    assert (off < np.array([0.5 / 1023, 0.5 / 1023, 0.5 / 511]) + 2.0**-11).all()


def test_some_bricks_are_read_as_each_of_them():
    """Also where bricks of several boxes lie in one pool."""
    boxes = [noise_box(k, (0.3 * k, 0.0, 0.0)) for k in (1, 2)]
    Medium(boxes)
    for box in boxes:
        grid, numbers = box.bricks.density, np.array([3, 0, box.bricks.kept - 1], np.uint32)
        each = [np.array(grid.read(number, number + 1)) for number in map(int, numbers)]
        assert np.array_equal(np.array(grid.of(numbers)), np.concatenate(each))
    assert boxes[1].bricks.density.first > 0


@pytest.mark.parametrize("shape", [(17, 17, 17), (13, 40, 26)])
def test_rays_meet_the_matter_of_every_voxel(shape):
    """One voxel at a time: the light along x that is lost behind it is that of its own tent, at the lattice's faces,
    where density is that of the nearest voxel, too; and rays start and end at the bricks that hold it.
    """
    random = np.random.default_rng(5)
    last = np.array(shape) - 1
    places = [*(random.integers(0, last + 1) for _ in range(2)), np.zeros(3, int), last, last - 8]
    for place in places:
        density = np.zeros(shape, np.float32)
        density[tuple(place)] = 1.0
        box = VolumeBox.from_arrays(
            density, np.broadcast_to(np.array((0, 0, 1), np.float32), (*shape, 3)), 0.01, 30.0, [MATTER]
        )
        outer = np.where(place == 0, -0.25, np.where(place == last, 0.25, 0.0))  # between the centre and the face
        z, y, _ = 0.01 * (np.asarray(place) + outer + 0.5)
        ray = arrays().Array3f(-1.0, float(y), float(z)), arrays().Array3f(1, 0, 0)
        depth = optical_depth(Medium([box]), *ray, arrays().Float(0), arrays().Float(9))[0]
        assert depth == pytest.approx(0.3, rel=1e-3), place
        assert (np.ptp(box.matter_corners(), axis=0) <= 0.01 * 17.01).all()  # two bricks, and half a voxel at both ends


def test_bricks_read_and_written_again_keep_their_bits():
    bricks = noise_box(2, (0, 0, 0)).bricks
    held = bricks.read(0, bricks.kept)
    writer = BrickWriter(bricks.shape, bricks.places)
    writer.write(0, held["density"], held["axis"])
    again = writer.bricks()
    for name in ("density", "axis"):
        one, other = (np.array(getattr(b, name).values) for b in (bricks, again))
        assert np.array_equal(one, other), name


@pytest.mark.parametrize("share", [0.0, 0.0005, 0.02, 1.0])
def test_the_table_leads_to_every_brick_and_tells_the_distance_to_the_nearest(share):
    """Against the Chebyshev distance to every kept brick, counted one by one."""
    lattice = (19, 23, 29)
    places = np.argwhere(np.random.default_rng(3).random(lattice) < share)
    places = in_table_order(np.random.default_rng(4).permutation(places), lattice)
    table = table_of(places, lattice)
    for z, y, x in np.random.default_rng(5).integers(0, lattice, (400, 3)):
        block = table.coarse[z // BLOCK, y // BLOCK, x // BLOCK]
        if not len(places):
            assert block < 0
            continue
        away = np.abs(places - (z, y, x)).max(axis=1).min()
        if block < 0:
            blocks = np.abs(places // BLOCK - (z // BLOCK, y // BLOCK, x // BLOCK)).max(axis=1).min()
            assert block == -(2 * blocks + 1)
            continue
        entry = table.fine[block, ((z % BLOCK) * BLOCK + y % BLOCK) * BLOCK + x % BLOCK]
        if entry >= 0:
            assert tuple(places[entry]) == (z, y, x)
        else:
            assert entry == -2 * away


def test_more_bricks_than_an_array_can_number_are_refused(monkeypatch):
    """Indices have 32 bits: here a limit of 2¹⁶ stands for 2³²."""
    monkeypatch.setattr(backend, "MOST_ENTRIES", 2**16)
    with pytest.raises(InputError, match="numbers and an array holds"):
        BrickWriter((81, 81, 81), np.argwhere(np.ones((10, 10, 10), bool)))
    one, other = noise_box(1, (0, 0, 0)), noise_box(2, (0.2, 0, 0))
    monkeypatch.setattr(backend, "MOST_ENTRIES", one.bricks.kept * one.bricks.axis.each)
    with pytest.raises(InputError, match="the bricks of all boxes together"):
        Medium([one, other])


def test_cubes_that_may_hold_matter_are_cut_down_to_the_same_bricks():
    """A sphere's surface: the bricks whose ball it cuts, found from large cubes down and one by one."""
    lattice = (61, 67, 71)

    def occupied(middle, radius):
        return dr.abs(dr.norm(middle - arrays().Array3f(280.0, 260.0, 240.0)) - 200.0) < radius

    found = np.concatenate(list(candidates(lattice, occupied)))
    every = np.concatenate(list(candidates(lattice, None)))
    middle = arrays().Array3f(*(np.ascontiguousarray(every[:, k] * 8.0 + 4.0, np.float32) for k in (2, 1, 0)))
    wanted = every[np.array(occupied(middle, 0.5 * 3**0.5 * 9))]
    assert len(found) == len(wanted) > 1000
    assert np.array_equal(in_table_order(found, lattice), in_table_order(wanted, lattice))


def picture(boxes, slots=None):
    """Rays across `boxes`: weights and transmittance; `slots`: as many boxes at once, in place of what may overlap."""
    jit, lamps = arrays(), [Lamp(position=(0.3, 0.5, -2.9))]
    medium = Medium(boxes)
    medium.frames.slots = slots or medium.frames.slots
    lighting = Lighting(lamps, Materials([MATTER] * len(boxes), palette_of([MATTER], [], [WHITE])))
    index = dr.arange(jit.UInt, 61 * 47)
    x, y = jit.Float(index % 61) / 61 * 0.7 - 0.1, jit.Float(index // 61) / 47 * 0.5 - 0.1
    direction = dr.normalize(jit.Array3f(0.1 * x + 0.05, 0.1 * y, 1.0))
    channels, passed = march(medium, lighting, jit.Array3f(x, y, -2.0), direction, jit.Float(0), jit.Float(dr.inf))
    return medium.frames.slots, np.stack([np.array(value) for value in (*channels, passed)])


def test_boxes_that_are_exchanged_along_a_ray_change_nothing():
    """A row of pairs that overlap in twos, some turned: two or three slots against all boxes at once, but for the order
    of sums in single precision.
    """
    boxes = [
        noise_box(k, (0.2 * (k // 2 % 3), 0.2 * (k // 6), 0.3 * (k % 2) * 0.2 + 0.4 * (k // 12)), turn=0.2 * (k % 3))
        for k in range(18)
    ]
    slots, exchanged = picture(boxes)
    assert slots < len(boxes)
    _, together = picture(boxes, slots=len(boxes))
    assert exchanged[-1].min() < 0.5 < exchanged[-1].max()
    np.testing.assert_allclose(exchanged, together, rtol=0, atol=2e-6 * together.max())


def test_boxes_of_a_scene_share_one_pool_and_one_matter_is_held_once():
    """Bytes of the pool: those of the distinct bricks, however often they stand in the scene."""
    one, other = noise_box(1, (0, 0, 0)), noise_box(2, (0.2, 0, 0))
    alone = picture([one])[1]
    moved = np.eye(4)
    moved[:3, 3] = (0.4, 0.0, 0.0)
    medium = Medium([one, other, one.with_pose(moved)])
    pool = medium.boxes[0].bricks.density.values
    assert pool is other.bricks.density.values
    assert dr.width(pool) == (one.bricks.kept + other.bricks.kept) * one.bricks.density.each
    assert np.array_equal(picture([one])[1], alone)  # its voxels have moved, and are the same
