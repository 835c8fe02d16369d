"""The bodies of the figures: distance bounds, proportions, two like hands; hair that holds its volume and its way."""

from typing import Any

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.fill import Fineness, fill
from hagoromo.matter.shape import SLOPES
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo_matter.figure.body import arms, bust, feet
from hagoromo_matter.figure.figure_skin import (
    GRANULES,
    LARGEST_SLOPE,
    SKIN_FINENESS,
    SKIN_PLACES,
    figure_skin,
    lips_of,
    shown,
)
from hagoromo_matter.figure.hand import FOLDED, LENGTH, OPEN, digits, frame
from hagoromo_matter.figure.head import head
from hagoromo_matter.figure.locks import CROWN, SCALP, fallen, head_axes
from hagoromo_matter.figure.mannequin import arm, trunk
from hagoromo_matter.figure.pose import PRAYER, WELCOME
from hagoromo_matter.figure.splat import StrandPoints, along, splat
from hagoromo_matter.figure.tresses import CLOTHES, LOCK_HALF_WIDTH, LOCKS, hair_of
from hagoromo_matter.skin.skin import skin

SKIN = Reflectance(0.3, 0.2, 0.4, 1.4, Spectrum.constant(0.5), element="sphere")
HAIR = Reflectance(0.3, 0.2, 0.15, 1.55, Spectrum.constant(0.2), element="cylinder")


def near_surface(shape, low, high, count=60_000, reach=0.25):
    """Points within `reach` [mm] of a surface, (3, n), and the values and slopes there."""
    draw = np.random.default_rng(7)
    points = draw.uniform(low, high, (count, 3)).astype(np.float32).T.copy()
    for _ in range(3):  # towards the surface
        value, slope = valued(shape, points)
        points = (points - slope * value / np.maximum((slope**2).sum(axis=0), 0.1)).astype(np.float32)
    points = (points + draw.uniform(-reach, reach, points.shape)).astype(np.float32)
    value, slope = valued(shape, points)
    inside = (np.abs(value) < reach) & np.all((points.T > low) & (points.T < high), axis=1)
    return points[:, inside], value[inside], slope[:, inside]


def valued(shape, points):
    point = arrays().Array3f(np.ascontiguousarray(points))
    dr.enable_grad(point)
    value = shape(point)
    dr.backward(value)
    return np.array(value), np.array(dr.grad(point))


@pytest.mark.parametrize(
    ("figure", "place"), [(figure, place) for figure in SKIN_PLACES for place in SKIN_PLACES[figure]]
)
def test_bodies_are_distance_bounds(figure, place):
    """Slopes near the surface are within those that a distance may have, and no steeper than the skin's box is told:
    one point in a thousand may lie on a seam, where less of the slope is left.
    """
    _, low, high = SKIN_PLACES[figure][place]
    _, _, slope = near_surface(shown(figure, place), low, high)
    slopes = np.linalg.norm(slope, axis=0)
    assert slopes.size > 3000
    assert np.isfinite(slopes).all()
    assert slopes.max() < LARGEST_SLOPE < SLOPES[1]
    assert np.quantile(slopes, 1e-3) > SLOPES[0]


@pytest.mark.by_night("hands", "feet")
@pytest.mark.parametrize("place", SKIN_PLACES["angel"])
def test_the_bound_of_a_body_loses_no_skin(place):
    """Bricks that the bound leaves out are empty, and so are the faces of the box but where it cuts neck and arms."""
    plan = figure_skin("angel", place, SKIN, 0.25)
    extent = SKIN_PLACES["angel"][place][1:]
    fine, whole = SKIN_FINENESS.finer(0.25), shown("angel", place)
    field: Any = lambda p: skin(p, whole, GRANULES, fine, 1)  # noqa: E731
    unbounded = fill(field, lambda p: 0.0 * p.x - 1.0, extent, fine, SKIN).box()
    assert np.array_equal(plan.box().bricks.places, unbounded.bricks.places)


def test_a_head_has_its_proportions():
    """37 mm from chin to crown, 0.66 as broad, 0.87 as deep (Farkas 1994), to a twentieth, without ears and nose."""
    points, value, _ = near_surface(head, (-20.0, -22.0, -22.0), (20.0, 22.0, 22.0), reach=0.05)
    assert np.abs(value).max() <= 0.05
    (left, front, bottom), (right, back, top) = points.min(axis=1), points.max(axis=1)
    assert top - bottom == pytest.approx(37.0, rel=0.02)
    skull = points[:, points[2] > 6.0]
    assert np.ptp(skull[0]) == pytest.approx(0.66 * 37.0, rel=0.05)
    assert back - skull[1].min() == pytest.approx(0.87 * 37.0, rel=0.05)
    assert front < skull[1].min() - 2.0  # the nose
    assert right - left > np.ptp(skull[0]) + 1.0  # the ears


def test_a_face_is_not_its_mirror_image_but_hands_are():
    rng = np.random.default_rng(3)
    points = rng.uniform((-12, -20, -18), (12, -8, 8), (3000, 3)).astype(np.float32).T.copy()
    mirrored = points * np.array([[-1], [1], [1]], np.float32)
    apart = np.abs(valued(head, points)[0] - valued(head, mirrored)[0])
    assert 0.01 < apart.max() < 0.5
    points = rng.uniform((-60, -50, 130), (60, 0, 210), (3000, 3)).astype(np.float32).T.copy()
    mirrored = points * np.array([[-1], [1], [1]], np.float32)
    for pose in (PRAYER, WELCOME):
        one, other = (valued(lambda p, pose=pose: arms(p, pose), at)[0] for at in (points, mirrored))
        assert np.array_equal(one, other)


@pytest.mark.parametrize("gesture", [FOLDED, OPEN])
def test_fingers_keep_their_lengths_however_they_bend(gesture):
    """Phalanges in their shares; the longest finger of a straight hand ends at the hand's length, to 3 %."""
    fingers = digits(gesture)
    assert len(fingers) == 5
    for finger in fingers[:4]:
        bones = np.linalg.norm(np.diff(finger.joints, axis=0), axis=1)
        bones[2] += finger.widths[3]
        assert bones / bones.sum() == pytest.approx((0.45, 0.31, 0.24))
        assert finger.pad @ (finger.joints[3] - finger.joints[2]) == pytest.approx(0.0, abs=1e-9)
    if gesture is FOLDED:
        tip = max(finger.joints[3][2] + finger.widths[3] for finger in fingers)
        assert tip == pytest.approx(LENGTH, rel=0.03)


def test_a_hand_turns_its_palm_and_its_thumb():
    """A left hand that points up with its palm to the right has its thumb towards the body (+y)."""
    axes = frame((0, 0, 0), (0, 0, 1), (-1.0, 0.3, 0.0))
    assert np.allclose(axes @ axes.T, np.eye(3))
    assert axes[0][1] > 0.9
    assert float(np.linalg.det(axes)) == pytest.approx(1.0)


@pytest.mark.parametrize(
    ("skin", "worn", "pose", "low", "high"),
    [
        (bust, trunk, WELCOME, (-26.0, -16.0, 196.5), (26.0, 20.0, 226.0)),  # up to the nun's collar
        (bust, trunk, PRAYER, (-16.0, -16.0, 226.0), (16.0, 24.0, 234.0)),  # chin, throat and nape under her coif
        (arms, lambda p, pose: arm(p, pose, 1.0), PRAYER, (6.0, -33.0, 158.0), (44.0, 6.0, 180.0)),  # to the cuff
        (arms, lambda p, pose: arm(p, pose, 1.0), WELCOME, (30.0, -22.0, 150.0), (50.0, 6.0, 172.0)),
    ],
)
def test_what_clothes_cover_lies_inside_the_mannequin(skin, worn, pose, low, high):
    """Skin below neckline and cuffs is not outside what the clothes were draped over: they would show it."""
    points, _, _ = near_surface(lambda p: skin(p, pose), low, high, reach=0.05)
    assert points.shape[1] > 500
    assert np.array(worn(arrays().Array3f(points), pose)).max() < 0.1


def test_feet_stand_on_the_floor():
    points, _, _ = near_surface(lambda p: feet(p, WELCOME), (-28.0, -34.0, -3.0), (28.0, 16.0, 30.0), reach=0.02)
    assert points[2].min() == pytest.approx(0.0, abs=0.05)
    assert np.ptp(points[1][points[0] > 0]) == pytest.approx(35.0, abs=2.0)


def test_lips_are_red_where_they_are():
    """Between the mouth's corners and nowhere else on the head."""
    points, _, _ = near_surface(shown("nun", "head"), (-16, -26, 222), (16, 20, 266), reach=0.05)
    share = np.array(lips_of("nun")(arrays().Array3f(points)))
    red = points[:, share > 0.5]
    assert 0.002 < red.shape[1] / points.shape[1] < 0.03
    assert np.ptp(red[0]) == pytest.approx(8.2, abs=1.0)
    assert np.ptp(red[2]) < 4.5


def test_strands_keep_their_volume_and_their_tangent():
    """Straight strands along one line: the lattice holds their volume, to half precision, and that direction."""
    direction = np.array([2.0, 3.0, 6.0]) / 7.0
    rng = np.random.default_rng(2)
    starts = rng.uniform(0.0, 3.0, (40, 3))
    paths = starts[:, None] + np.linspace(0.0, 9.0, 8)[:, None] * direction
    strands = along(paths, 0.01, 0.1)
    assert strands.volume.sum() == pytest.approx(40 * 9.0 * 0.01)
    box = splat(strands, (HAIR, HAIR), Fineness(0.25, 0.2)).box()
    density, axis = (array.astype(float) for array in box.bricks.dense())
    assert density.sum() * 0.25**3 == pytest.approx(strands.volume.sum(), rel=2e-3)
    found = axis[density > 0]
    assert (found @ direction / np.linalg.norm(found, axis=1)).min() > 1 - 0.5 * (2 / 511) ** 2  # kept to 1/511


def test_a_splat_of_two_kinds_tells_them_apart():
    one, two = (along(np.array([[[x, 0.0, 0.0], [x, 0.0, 5.0]]]), 0.05, 0.1, k) for x, k in ((0.0, 0), (3.0, 1)))
    both = StrandPoints(*(np.concatenate(part) for part in zip(one, two, strict=True)))
    dark = Reflectance(0.1, 0.2, 0.15, 1.55, Spectrum.constant(0.2), element="cylinder")
    box = splat(both, (HAIR, dark), Fineness(0.25, 0.2)).box()
    assert box.materials == (HAIR, dark)
    assert box.bricks.material is not None


def test_one_seed_one_head_of_hair():
    first, again, other = (hair_of("nun", HAIR, 0.6, seed).box().bricks.density.values for seed in (1, 1, 2))
    assert np.array_equal(np.array(first), np.array(again))
    assert len(first) != len(other) or not np.array_equal(np.array(first), np.array(other))


def test_unknown_figures_are_refused():
    with pytest.raises(InputError, match="figures are angel, nun"):
        figure_skin("imp", "head", SKIN)
    with pytest.raises(InputError, match="nun shows head, hands"):
        figure_skin("nun", "feet", SKIN)
    with pytest.raises(InputError, match="no figure 'imp'"):
        hair_of("imp", HAIR)


def test_hair_covers_the_scalp_behind_the_parting():
    """No place there is farther from the middle of a lock, seen from outside, than half the width of a lock; 6 % of
    them were, up to 3 mm.
    """
    from scipy.spatial import KDTree

    middle, radii = np.array(SCALP)
    locks = fallen(WELCOME, LOCKS, CLOTHES, np.random.default_rng(1))
    points = np.concatenate([path[:end] for path, end in zip(*locks, strict=True)]) - WELCOME.head
    seen = (points @ head_axes(WELCOME).T - middle) / radii
    seen = middle + radii * seen / np.linalg.norm(seen, axis=1, keepdims=True)
    directions = np.random.default_rng(2).normal(size=(20_000, 3))
    scalp = middle + radii * directions / np.linalg.norm(directions, axis=1, keepdims=True)
    behind = scalp[(scalp[:, 1] > CROWN + 3.0) & (scalp[:, 2] > 0.0)]
    assert KDTree(seen).query(behind)[0].max() < LOCK_HALF_WIDTH
