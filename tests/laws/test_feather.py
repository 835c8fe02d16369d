"""A feather is what its recipe says: counts, angles, volumes, asymmetry, down, splits; a wing is whole and one."""

from __future__ import annotations

import math
from itertools import pairwise

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.fill import Fineness
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo_matter.feather.barb import Barbs
from hagoromo_matter.feather.barbule import Barbules
from hagoromo_matter.feather.down import Down
from hagoromo_matter.feather.feather import feather, vane_patch
from hagoromo_matter.feather.kinds import FEATHERS
from hagoromo_matter.feather.marking import Marking
from hagoromo_matter.feather.plume import Plume, flat_spot, spot_on
from hagoromo_matter.feather.rod import film, rod
from hagoromo_matter.feather.vane import Feather, feather_at, vane_thickness, web_at
from hagoromo_matter.feather.wing import Wing, wing_of
from hagoromo_matter.feather.wing_bones import ARM, ground
from hagoromo_matter.feather.wing_grid import cell_at, places_on
from hagoromo_matter.feather.wing_rows import FEATHER_FIELDS, feathers

GREY = Reflectance(0.2, 0.1, 0.2, 1.5, Spectrum.constant(0.8), element="cylinder")
WHOLE = Feather(barbs=Barbs(splits_per_cm=0.0, ragged_mm=0.0, waver=0.0))  # a vane without faults
MIDDLE = (6.0, 60.0)  # (across, along) on its inner vane


def points(x: np.ndarray, y: np.ndarray, z: np.ndarray):
    grids = np.broadcast_arrays(x, y, z)
    return arrays().Array3f(*(np.ascontiguousarray(g, np.float32).ravel() for g in grids))


def density_of(made: Feather, x: np.ndarray, y: np.ndarray, z: np.ndarray, voxel_mm: float) -> np.ndarray:
    """Density of a flat feather at places (across, below, along)."""
    density, _, _ = feather_at(flat_spot(points(x, y, z)), made, Fineness(voxel_mm, 0.03), arrays().UInt(3))
    return np.array(density).reshape(np.broadcast_shapes(x.shape, y.shape, z.shape))


def test_thin_rods_and_films_keep_their_volume():
    """Sums over a lattice eight times as fine as the softness, for rods from far below to far above it: within 1 %."""
    step = np.arange(-3.0, 3.0, 0.0125, dtype=np.float32)
    flat = arrays().Float(step)
    x, y = (arrays().Float(part.ravel()) for part in np.meshgrid(step, step))
    for radius, tall in ((0.01, 0.05), (0.04, 0.0), (0.2, 0.3), (0.9, 0.0)):
        area = np.array(rod(x, y, arrays().Float(radius), tall, 0.1)).sum() * 0.0125**2
        assert area == pytest.approx(radius * (math.pi * radius + 4.0 * tall), rel=0.01)
    for thick in (0.02, 0.5):
        assert np.array(film(flat, thick, 0.015, 0.1)).sum() * 0.0125 == pytest.approx(0.015, rel=0.01)


@pytest.mark.parametrize("per_mm", [1.7, 2.9])
def test_a_vane_has_its_barbs_per_mm(per_mm):
    """Barbs counted along a line beside the shaft; the count is whole, so it is right to 1."""
    made = WHOLE._replace(barbs=WHOLE.barbs._replace(per_mm=per_mm, steepen=1.0))
    z = np.arange(40.0, 60.0, 0.01)
    density = density_of(made, np.array(2.5), np.array(0.06), z, 0.02)
    crossed = np.diff((density > 0.5 * density.max()).astype(int)) == 1
    assert abs(crossed.sum() - 20.0 * per_mm) <= 1


@pytest.mark.parametrize(("outer", "inner"), [(4.0, 13.0), (9.0, 7.0)])
def test_vanes_have_their_widths(outer, inner):
    """Widths where a vane is as wide as stated, over half of its length: their ratio within 2 %."""
    made = WHOLE._replace(plume=Plume(outer_mm=outer, inner_mm=inner))
    x = np.arange(-20.0, 20.0, 0.02)
    rim = np.array(web_at(*on_device(x, np.array([60.0])), made=made, seed=3).rim)
    inside = x[rim < 0]
    assert inside.max() / -inside.min() == pytest.approx(inner / outer, rel=0.02)


def angle_to_barb(distal: bool) -> np.ndarray:
    """Angles [°] between barbules and the barb that they leave, where those of one side are dense in a fine patch."""
    barbules = Barbules(hooks=0, rise_mm=0.02)
    made = WHOLE._replace(barbules=barbules)
    x, z = (m + np.arange(0.0, 0.6, 0.003) for m in MIDDLE)
    y = np.array(0.012 - (0.014 if distal else -0.006))
    spot = flat_spot(points(x[:, None], y, z))
    density, tangent, _ = feather_at(spot, made, Fineness(0.002, 0.03), arrays().UInt(3))
    web = web_at(spot.across, spot.along, made, arrays().UInt(3))
    along = np.array([np.array(web.barb.along.x), np.array(web.barb.along.y)])
    way = np.array(tangent)[[0, 2]]
    beside = np.array(web.barb.beside) / np.array(web.barb.spacing)
    between = (np.abs(beside) > 0.2) & (np.array(density) > 0.3)
    turned = np.arctan2(along[0] * way[1] - along[1] * way[0], (along * way).sum(axis=0))[between]
    return np.degrees(turned)


def test_barbules_leave_their_barb_at_their_angle():
    """Both kinds lie across each other in one patch: every tangent is at one of the two angles, within 5°."""
    barbules = Barbules()
    for distal in (True, False):
        turned = angle_to_barb(distal)
        wanted = barbules.distal_deg if distal else -barbules.proximal_deg
        near = np.abs(turned - wanted) < 5.0
        other = np.abs(turned - (-barbules.proximal_deg if distal else barbules.distal_deg)) < 5.0
        assert near.sum() > 300
        assert (near | other).mean() > 0.99


def test_hooklets_reach_below_distal_barbules():
    """Beneath both kinds of barbule there is matter of hooklets alone, half rings that go down by hook_mm.

    They take nothing away, but for the rounding of places [mm] in two kernels, over the width of an edge.
    """
    with_hooks, without = (WHOLE._replace(barbules=Barbules(hooks=n, rise_mm=0.005)) for n in (4, 0))
    x, z = (m + np.arange(0.0, 0.9, 0.004) for m in MIDDLE)
    y = np.arange(0.024, 0.04, 0.004)
    hooked, bare = (density_of(made, x[:, None, None], y[:, None], z, 0.002) for made in (with_hooks, without))
    extra = (hooked - bare).sum(axis=(0, 2))
    assert extra.min() > 1.0
    assert (hooked >= bare - 4.0 * np.spacing(np.float32(MIDDLE[1])) / 0.002).all()


@pytest.mark.by_night("0.004")
@pytest.mark.parametrize("voxel_mm", [0.004, 0.006, 0.05, 0.3])
def test_the_optical_depth_of_a_vane_is_its_volume(voxel_mm):
    """Mean thickness through a patch against that of the recipe: resolved, half resolved and as a film, within 3 %."""
    made = WHOLE._replace(barbules=Barbules(hooks=0))
    across, along = MIDDLE
    side = 0.9 if voxel_mm < 0.01 else 3.0
    step = min(voxel_mm, 0.02) * (1.0 if voxel_mm < 0.01 else 0.5)
    x, z = (m + np.arange(0.0, side, step * 1.03) for m in (across, along))
    y = np.arange(-1.2 * voxel_mm - 0.05, 0.22 + 1.2 * voxel_mm, 0.5 * min(voxel_mm, 0.05))
    thickness = vane_thickness(*on_device(x, z), made=made, seed=3)
    density = (
        np.mean([density_of(made, x[:, None], np.array(h), z, voxel_mm).mean() for h in y]) * (y[1] - y[0]) * len(y)
    )
    assert density == pytest.approx(float(np.array(thickness).mean()), rel=0.03)


def on_device(x: np.ndarray, z: np.ndarray):
    return [arrays().Float(part.astype(np.float32).ravel()) for part in np.meshgrid(x, z)]


def test_the_downy_foot_is_looser_than_the_vane():
    """Mean density within a barb's height of the middle surface: less than half of the closed vane's."""
    made = WHOLE._replace(down=Down(share=0.25))
    x, y = np.arange(3.0, 6.0, 0.05), np.arange(-0.1, 0.26, 0.05)
    foot, closed = (
        density_of(made, x[:, None, None], y[:, None], z + np.arange(0, 3.0, 0.05), 0.05) for z in (26.0, 70.0)
    )
    assert 0.02 * closed.mean() < foot.mean() < 0.5 * closed.mean()


def test_splits_open_the_vane_towards_its_edge():
    """More of the outer half of a torn vane is empty than of its inner half; a vane without splits is closed."""
    torn = WHOLE._replace(barbs=WHOLE.barbs._replace(splits_per_cm=1.0, split_mm=4.0))
    z = np.arange(42.0, 62.0, 0.05)  # beyond the downy foot, before the rounded tip
    for made, open_ in ((WHOLE, False), (torn, True)):
        near, far = (
            (density_of(made, np.array(x), np.arange(0.0, 0.16, 0.04)[:, None], z, 0.1).max(axis=0) < 1e-3).mean()
            for x in (2.0, 10.5)
        )
        assert near == 0.0
        assert (far > 0.01) == open_


def test_bent_feathers_keep_their_lengths():
    """Steps along and across a bent feather are as long as those told, on its middle surface: within 1 %."""
    plume = Plume(bow_mm=12.0, arch_mm=9.0, camber_mm=2.0)
    draw = np.random.default_rng(5)
    place = draw.uniform((-4.0, -1.0, 20.0), (9.0, 8.0, 80.0), (4000, 3)).T.astype(np.float32)
    point = arrays().Array3f(*place)
    spot = spot_on(point, plume)
    near = np.abs(np.array(spot.height)) < 0.3  # 1 + height / radius: radii are 40 mm and more
    assert near.sum() > 50
    for direction, name in ((spot.right, "across"), (spot.ahead, "along"), (spot.above, "height")):
        moved = spot_on(point + direction * 0.05, plume)
        grown = np.array(getattr(moved, name) - getattr(spot, name))[near] / 0.05
        # off the shaft the bow makes barbs' feet wider or closer: 1 + across / radius, here 4 % at most
        assert np.abs(grown - 1.0).max() < (0.04 if name == "along" else 0.01)
    assert np.abs(np.array(dr.dot(spot.right, spot.ahead))).max() < 1e-4


def same_bits(one: VolumeBox, other: VolumeBox) -> bool:
    return all(np.array_equal(a, b) for a, b in zip(one.bricks.dense(), other.bricks.dense(), strict=True))


@pytest.mark.by_night("secondary", "contour", "covert", "down")
@pytest.mark.parametrize("kind", FEATHERS)
def test_one_seed_one_feather(kind):
    """Bits compared whole, on a coarse lattice."""
    first, again, other = (feather(GREY, FEATHERS[kind], Fineness(0.4, 0.1), seed).box() for seed in (3, 3, 4))
    assert same_bits(first, again)
    assert not same_bits(first, other)


def test_the_bound_of_a_feather_loses_no_matter():
    """The faces of its box are empty, and so is what the bound leaves out (all bricks of a coarse lattice)."""
    for kind in ("primary", "down"):
        plan = feather(GREY, FEATHERS[kind], Fineness(0.5, 0.1), 3)
        bounded = plan.box()
        density = bounded.bricks.dense()[0]
        assert max(density[[0, -1]].max(), density[:, [0, -1]].max(), density[:, :, [0, -1]].max()) == 0
        plan.blocks.occupied = None  # type: ignore[attr-defined]
        assert np.array_equal(plan.box().bricks.places, bounded.bricks.places)


def test_a_patch_is_a_part_of_its_feather():
    patch = vane_patch((GREY, GREY), Feather(marking=Marking("bars")), (1.1, 0.9), (2.0, 50.0), Fineness(0.03, 0.03))
    box = patch.box()
    assert box.bricks.shape[2] * box.voxel_size == pytest.approx(1.1e-3, abs=2 * 0.03e-3)  # whole voxels, and one more
    assert len(box.materials) == 3
    with pytest.raises(InputError, match="is not on the feather"):
        vane_patch(GREY, middle_mm=(40.0, 50.0))


@pytest.mark.parametrize(
    ("part", "change", "message"),
    [
        ("plume", {"length_mm": -1.0}, "length_mm of the feather's plume is -1"),
        ("plume", {"length_mm": math.nan}, "length_mm of the feather's plume is nan"),
        ("plume", {"quill": 1.0}, "quill is 1"),
        ("plume", {"rachis_mm": 9.0}, "wider than a vane"),
        ("plume", {"bow_mm": 80.0}, "rolls the feather up"),
        ("barbs", {"per_mm": 30.0}, "do not fit side by side"),
        ("barbs", {"inner_deg": 95.0}, "inner_deg is 95"),
        ("barbules", {"distal_per_mm": 100.0}, "do not fit side by side"),
        ("barbules", {"distal_deg": 0.0}, "distal_deg of the feather's barbules is 0"),
        ("down", {"share": 1.5}, "share is 1.5"),
        ("marking", {"pattern": "stripes"}, "give one of plain, bars"),
    ],
)
def test_feathers_that_cannot_be_are_refused_in_one_line(part, change, message):
    made = Feather()
    with pytest.raises(InputError, match=message) as refused:
        feather(GREY, made._replace(**{part: getattr(made, part)._replace(**change)}))
    assert "\n" not in str(refused.value)


@pytest.fixture(scope="module")
def wings() -> VolumeBox:
    return wing_of((GREY, GREY), 0.25, 2).box()


def seen_from_the_front(box: VolumeBox) -> np.ndarray:
    """Optical depth along y: (z, x)."""
    return box.bricks.dense()[0].astype(float).sum(axis=1) * box.voxel_size * box.tau


@pytest.mark.nightly
def test_wings_are_whole(wings):
    """One connected piece a side (26 neighbours), but for crumbs below a thousandth; no holes inside the outline."""
    from scipy.ndimage import binary_fill_holes, label

    density = wings.bricks.dense()[0] > 0.02
    pieces = np.empty(density.shape, np.int32)
    label(density, np.ones((3, 3, 3)), output=pieces)
    sizes = np.sort(np.bincount(pieces.ravel())[1:])[::-1]
    assert sizes[:2].sum() > 0.999 * sizes.sum()
    covered = seen_from_the_front(wings) > 0.1
    for half in np.array_split(covered, 2, axis=1):
        assert (
            np.count_nonzero(np.asarray(binary_fill_holes(half)) & ~half) < 0.005 * half.sum()
        )  # splits of single feathers


def test_left_and_right_mirror_each_other_up_to_their_random_part(wings):
    """Outlines overlap by more than nine tenths, and are not the same."""
    covered = seen_from_the_front(wings) > 0.1
    mirrored = covered[:, ::-1]
    shared = (covered & mirrored).sum() / (covered | mirrored).sum()
    assert 0.9 < shared < 1.0


def test_all_feathers_grow_from_the_arm():
    """Roots lie within 9 mm of the line of the arm, and every feather stays in the box of the wings."""
    line = np.array(ARM)
    fine = np.concatenate([np.linspace(a, b, 50) for a, b in pairwise(line)])
    both = feathers(2)
    roots = both[:, :, :2].reshape(-1, 1, 2)
    assert np.linalg.norm(roots - fine, axis=2).min(axis=1).max() < 9.0
    assert len(np.unique(both.reshape(-1, len(FEATHER_FIELDS)), axis=0)) == both.shape[0] * both.shape[1]
    reach = np.concatenate(
        [
            places_on(dict(zip(FEATHER_FIELDS, row.tolist(), strict=True)))
            for row in both.reshape(-1, len(FEATHER_FIELDS))
        ]
    )
    assert reach[:, 0].max() < 135.0
    assert reach[:, 1].min() > 53.0


def test_no_feather_is_overlooked():
    """At places over one wing, the feathers that a cell names hold all that any of the feathers holds there."""
    made, jit = Wing(2, Fineness(0.4, 0.1)), arrays()
    draw = np.random.default_rng(3)
    point = arrays().Array3f(*draw.uniform((2.0, 15.0, 60.0), (135.0, 70.0, 300.0), (60_000, 3)).T.astype(np.float32))
    place, count = ground(point), feathers(2).shape[1]
    cell = np.array(cell_at(place.x, place.z, place.height)) + made.cells
    starts, members = np.array(made.starts), np.array(made.members)
    for number in range(count, 2 * count, 7):
        density = np.array(made.feather(place, dr.full(jit.UInt, number, len(cell)))[0])
        for at in np.flatnonzero(density > 0)[:50]:
            assert number in members[starts[cell[at]] : starts[cell[at] + 1]]


@pytest.mark.nightly
def test_one_seed_one_pair_of_wings(wings):
    assert same_bits(wings, wing_of((GREY, GREY), 0.25, 2).box())
    assert not same_bits(wings, wing_of((GREY, GREY), 0.25, 3).box())
    with pytest.raises(InputError, match="resolution is -1"):
        wing_of(GREY, -1.0)
