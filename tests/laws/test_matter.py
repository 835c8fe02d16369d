"""Matter is what its recipe says: one seed one result, outward axes, distances and noise that keep their word."""

from itertools import pairwise
from typing import Any

import drjit as dr
import numpy as np
import pytest

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.matter.build import build
from hagoromo.matter.shape import (
    capsule,
    distance_and_normal,
    ellipsoid,
    limb,
    plane,
    rounded_box,
    sheet,
    smooth_union,
    sphere,
)
from hagoromo.volume.box import VolumeBox
from hagoromo_matter.noise import cellular_noise, gradient_noise, random, value_noise
from tests.judges import sampler_follows_density

MATERIAL = {"alpha": 0.2, "beta": 0.1, "gamma": 0.2, "n": 1.5, "body_colour": 0.8}
BALL, SMALL_BALL = ({"form": "sphere", "radius_mm": radius} for radius in (7.0, 1.1))
CLOTH = {"width_mm": 5.0, "height_mm": 4.0, "voxel_mm": 0.09, "variants": 2, "material": MATERIAL}
BENT = np.array([(-0.5, 0.0, 0.0), (0.0, 0.0, 0.0), (0.3, 0.4, 0.0)])  # a line with a corner
RECIPES = {
    "skin": {"kind": "skin", "size_mm": 2.3, "voxel_mm": 0.04, "material": MATERIAL},
    "skin on a ball": {"kind": "skin", "shape": SMALL_BALL, "voxel_mm": 0.04, "material": MATERIAL},
    "cloth": {"kind": "cloth", **CLOTH},
    "cloth in folds": {"kind": "cloth", "lay": "hanging", "folds": 2, "fold_depth_mm": 1.0, **CLOTH},
    "cloth, a patch": {"kind": "cloth", "lay": "patch", **CLOTH},
    "knit": {"kind": "knit", **CLOTH},
    "feather": {"kind": "feather", "voxel_mm": 0.4, "material": MATERIAL},
    "vane": {"kind": "feather", "patch_mm": [1.1, 1.3], "voxel_mm": 0.03, "material": MATERIAL},
}  # fmt: skip


def points(count: int, reach: float, seed: int = 5):
    draw = np.random.default_rng(seed).uniform(-reach, reach, (3, count)).astype(np.float32)
    return arrays().Array3f(*draw)


def dense(box: VolumeBox) -> tuple[np.ndarray, np.ndarray]:
    density, axis = box.bricks.dense()
    return density.astype(float), axis.astype(float)


def same_bits(one: VolumeBox, other: VolumeBox) -> bool:
    """Bricks and, where a box has one, every level of the texel."""
    if not all(np.array_equal(a, b) for a, b in zip(dense(one), dense(other), strict=True)):
        return False
    if one.texel is None or other.texel is None:
        return one.texel is other.texel
    levels = zip(one.texel.levels, other.texel.levels, strict=True)
    return all(np.array_equal(a, b) for pair in levels for a, b in zip(*map(arrays_of, pair), strict=True))


def arrays_of(level: Any) -> list[np.ndarray]:
    """The arrays of a record."""
    return [value for value in vars(level).values() if isinstance(value, np.ndarray)]


def places(box: VolumeBox) -> np.ndarray:
    """World points of all voxels [mm]: (nz, ny, nx, 3)."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in box.bricks.shape), indexing="ij"), axis=-1)[..., ::-1]
    return 1e3 * ((index + 0.5) * box.voxel_size + box.pose[:3, 3])


@pytest.mark.by_night("feather", "knit", "cloth", "cloth in folds", "skin on a ball", "cloth, a patch")
@pytest.mark.parametrize("name", RECIPES)
def test_one_seed_one_result_and_axes_are_unit(name, few_match_points):
    """Bits are compared whole; an axis is kept to ½/1023, ½/1023 and ½/511, so its length to their sum at worst."""
    first, again, other = (build(RECIPES[name] | {"seed": seed}) for seed in (3, 3, 4))
    assert same_bits(first, again)
    assert not same_bits(first, other)
    density, axis = dense(first)
    lengths = np.linalg.norm(axis[density > 0], axis=-1)
    assert lengths.size > 100
    assert np.abs(lengths - 1).max() < 1 / 1023 + 0.5 / 511


def test_a_solid_has_its_volume_and_outward_axes():
    """A ball 30 voxels across: soft edges enlarge it by h²/r² = 0.4 %; axes are kept to 0.05° and 0.2 % of length."""
    box = build({"kind": "solid", "shape": BALL | {"radius_mm": 7.5}, "voxel_mm": 0.5, "material": MATERIAL})
    density, axis = dense(box)
    assert density.sum() * 0.5**3 == pytest.approx(4 / 3 * np.pi * 7.5**3, rel=0.01)
    offset = places(box) - (0.0, 0.0, 7.5)
    surface = (density > 0.05) & (density < 0.95)
    lengths = np.linalg.norm(axis, axis=-1)[surface]
    outward = (axis * offset).sum(axis=-1)[surface] / np.linalg.norm(offset, axis=-1)[surface] / lengths
    assert outward.min() > 0.9999 and lengths == pytest.approx(1.0, abs=2e-3)


def test_a_recipe_file_is_built_like_its_tables(tmp_path):
    (tmp_path / "ball.toml").write_text(
        'kind = "solid"\nname = "ball"\nvoxel_mm = 1.0\nmean_free_path_mm = 0.5\n'
        '[shape]\nform = "sphere"\nradius_mm = 7\n'
        "[material]\nalpha = 0.2\nbeta = 0.1\ngamma = 0.2\nn = 1.5\nbody_colour = 0.8\n"
    )
    box = build(tmp_path / "ball.toml")
    assert (box.name, box.tau, box.voxel_size) == ("ball", pytest.approx(2000.0), pytest.approx(1e-3))
    assert box.materials[0].element == "plane"
    assert box.provenance["recipe"]["shape"] == {"form": "sphere", "radius_mm": 7}
    table = {"kind": "solid", "shape": BALL, "voxel_mm": 1.0, "material": MATERIAL}
    assert same_bits(box, build(table))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"kind": "fur"}, "kind must be one of"),
        ({"color": 1}, "unknown key 'color'"),
        ({"voxel_mm": -0.1}, "voxel_mm must be a number above 0"),
        ({"voxel_mm": 1e-4}, "too fine"),
        ({"warp": {"diameter_mm": float("nan")}}, "diameter_mm must be"),
        ({"warp": {"diameter_mm": 5.0}}, "beyond the packing limit"),
        ({"warp_per_cm": 60.0}, "do not fit"),
        ({"lay": "hanging", "fold_depth_mm": 900.0}, "do not fit"),
        ({"fold_depth_mm": -1.0}, "fold_depth_mm must be a number from 0 to"),
        ({"seed": 1.5}, "seed must be a whole number"),
        ({"resolution": 0}, "resolution must be a number above 0"),
        ({"uneven": 1.0}, "from 0 to 0.2"),
        ({"material": MATERIAL | {"alpha": 0.9}}, "energy conservation"),
        ({"material": {"alpha": 0.9}}, "lacks the key"),
    ],
)
def test_bad_recipes_are_refused_in_one_line(change, message):
    with pytest.raises(InputError, match=message) as refused:
        build(RECIPES["cloth"] | change)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("shape", "message"),
    [
        ({"form": "cone"}, "form must be one of"),
        ({"form": "box", "size_mm": [1, 0, 1]}, "size_mm must be a list of 3 numbers above 0"),
        ({"form": "box", "size_mm": [1, 1, 1], "rounding_mm": 2}, "at most half"),
        ({"form": "mesh", "file": "a.ply", "height_mm": 3.0}, "does not exist"),
    ],
)
def test_shapes_that_cannot_be_are_refused(shape, message):
    with pytest.raises(InputError, match=message):
        build(RECIPES["skin on a ball"] | {"shape": shape})


@pytest.mark.parametrize(
    ("shape", "exact"),
    [
        (lambda p: sphere(p, (0.1, 0.2, 0.3), 0.7), True),
        (lambda p: capsule(p, (0, 0, 0), (0.3, 0.5, 0.4), 0.3), True),
        (lambda p: rounded_box(p, (0, 0, 0), (0.5, 0.4, 0.3), 0.1), True),
        (lambda p: plane(p, (0.6, 0.0, 0.8), 0.1), True),
        (lambda p: sheet(sphere(p, (0, 0, 0), 0.7), 0.1), True),
        (lambda p: smooth_union(sphere(p, (0, 0, 0), 0.5), sphere(p, (0.6, 0, 0), 0.4), 0.2), False),
        (lambda p: limb(p, BENT, lambda way: 0.3 - 0.05 * way, 0.1), False),
        (lambda p: ellipsoid(p, (0, 0, 0), (0.7, 0.5, 0.4)), False),
    ],
)
def test_distances_change_by_no_more_than_the_way(shape, exact):
    """|f(a) − f(b)| ≤ |a − b| for distances; near all surfaces f / |∇f| along the normal leads to them."""
    a, b = points(20_000, 1.2, 1), points(20_000, 1.2, 2)
    if exact:
        assert np.array(dr.abs(shape(a) - shape(b)) - dr.norm(a - b)).max() < 1e-5
    distance, normal = distance_and_normal(shape, a)
    near = np.abs(np.array(distance)) < 0.03
    assert near.sum() > 100
    # second order in the distance: ½ κ d² with curvatures up to 5 on the smallest ellipsoid
    assert np.abs(np.array(shape(a - normal * distance)))[near].max() < 0.5 * 8 * 0.03**2
    assert np.array(dr.norm(normal)) == pytest.approx(1.0, abs=1e-5)


def test_a_limb_does_not_swell_at_its_joints():
    """Of two bones in line it is nowhere larger than the capsule of both, and of any two nowhere smaller than their
    union by more than the largest x / (1 + eˣ) of the bend, W(1/e) = 0.2785: the distance to a mean is at most the mean
    of the distances. Where one bone is by far the nearer it is the capsule of that.
    """
    p, bend = points(20_000, 1.2, 3), 0.05
    line = np.array([(-0.4, 0.0, 0.0), (0.1, 0.0, 0.0), (0.6, 0.0, 0.0)])
    straight, bent = (np.array(limb(p, joints, lambda way: 0.3 + 0.0 * way, bend)) for joints in (line, BENT))
    larger = straight - np.array(capsule(p, line[0], line[2], 0.3))
    assert larger.min() > -2e-6 and larger.max() < 0.2785 * bend
    one, other = (capsule(p, start, end, 0.3) for start, end in pairwise(BENT))
    whole = np.array(dr.fmin(one, other))
    assert (bent - whole).max() < 0.2785 * bend + 2e-6
    clear = np.array(dr.abs(one - other)) > 8.0 * bend
    assert clear.sum() > 1000
    assert np.abs(bent - whole)[clear].max() < 2e-3  # exp(−8) of the distance between the feet, at most 1.2


@pytest.mark.parametrize("noise", [value_noise, gradient_noise, lambda p, s: cellular_noise(p, s).nearest])
def test_noise_is_smooth_and_its_slope_is_its_derivative(noise):
    """Central differences at h = 1e-2: error ½h²f''' ≈ 1e-2 at worst, far less in the median; cells have ridges."""
    place, step = points(4096, 5.0), arrays().Array3f(1e-2, 0, 0)
    moved = type(place)(place)
    dr.enable_grad(moved)
    dr.backward(noise(moved, 3))
    slope = np.array(dr.grad(moved))[0]
    difference = np.array((noise(place + step, 3) - noise(place - step, 3)) / 2e-2)
    assert np.median(np.abs(slope - difference)) < 2e-3
    assert np.array(noise(place, 3) != noise(place, 4)).mean() > 0.99


def test_random_numbers_are_uniform():
    """Chi-square over 64 bins of 2¹⁶ neighbouring cells, at a fixed seed: p above 1 % (significance 1 %)."""
    jit = arrays()
    index = dr.arange(jit.Int, 1 << 16)
    drawn = np.array(random((index % 256, index // 256, -3), 11))
    counts, _ = np.histogram(drawn, bins=64, range=(0.0, 1.0))
    assert sampler_follows_density(counts, np.full(64, drawn.size / 64), significance=0.01)
    assert np.corrcoef(drawn[:-1], drawn[1:])[0, 1] == pytest.approx(0.0, abs=4 / 256)  # 4 standard errors
