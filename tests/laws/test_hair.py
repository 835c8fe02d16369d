"""Hair is what its curves say: volume, way, the shadow of opaque fibres; what grows stays out of the skin."""

import numpy as np
import pytest

from hagoromo.errors import InputError
from hagoromo.matter.build import build
from hagoromo.matter.shape import sphere
from hagoromo_matter.hair.fibres import Curves, one_fibre
from hagoromo_matter.hair.growth import Growth, grown
from hagoromo_matter.recipes.hair import opaque_path

HAIR = {"alpha": 0.1, "beta": 0.3, "gamma": 0.15, "n": 1.55, "body_colour": 0.2, "transmission": 0.4, "clearness": 0.8}
BALL = {"form": "sphere", "radius_mm": 20.0}
KNOTS = np.random.default_rng(3).normal(size=(7, 5, 3)) * (3.0, 4.0, 6.0)  # seven curves of five points [mm]


def obj_of(curves: np.ndarray) -> str:
    rows = [f"v {x:.6f} {y:.6f} {z:.6f}" for x, y, z in curves.reshape(-1, 3)]
    count = curves.shape[1]
    rows += ["l " + " ".join(str(k * count + j + 1) for j in range(count)) for k in range(len(curves))]
    return "\n".join(rows) + "\n"


def built(folder, curves=KNOTS, **more):
    (folder / "a.obj").write_text(obj_of(curves))
    table = {"file": str(folder / "a.obj"), "diameter_mm": more.pop("diameter_mm", 0.2)}
    return build({"kind": "hair", "curves": table, "material": HAIR, "voxel_mm": 0.5, **more})


@pytest.mark.parametrize(("diameter", "voxel"), [(0.05, 0.5), (0.6, 0.5), (1.3, 0.2)])
def test_fibres_keep_their_volume(tmp_path, diameter, voxel):
    """π/4 d² on every length, thinner or thicker than a voxel; halves round to 5e-4."""
    length = np.linalg.norm(np.diff(KNOTS, axis=1), axis=2).sum()
    box = built(tmp_path, diameter_mm=diameter, voxel_mm=voxel)
    volume = one_fibre(diameter, voxel) * box.bricks.dense()[0].sum(dtype=float) * (1e3 * box.voxel_size) ** 3
    assert volume == pytest.approx(0.25 * np.pi * diameter**2 * length, rel=1e-3)


def test_axes_run_along_fibres_whatever_way_they_were_drawn(tmp_path):
    """Two fibres side by side, drawn in opposite ways: their tangents do not cancel."""
    way = np.array([2.0, 3.0, 5.0]) / np.sqrt(38.0)
    one = way * np.linspace(0.0, 12.0, 4)[:, None]
    box = built(tmp_path, np.stack([one, one[::-1] + np.array([0.1, 0.0, 0.0])]))
    density, axis = box.bricks.dense()
    axis = axis[density > 0].astype(float)
    along = np.abs(axis @ way) / np.linalg.norm(axis, axis=1)
    assert along.min() > np.cos(np.radians(1.0))  # components are rounded to steps of 1/512


@pytest.mark.parametrize("extinction", ["projected", "isotropic"])
def test_fibres_cast_the_shadow_of_opaque_ones(tmp_path, extinction):
    """Thin fibres seen from across them hide d per length: ∫ σ dV is their shadow, and its mean over all directions."""
    upright = np.stack([[(x, 0.0, z) for z in np.linspace(0.0, 9.0, 4)] for x in range(5)]).astype(float)
    box = built(tmp_path, upright, diameter_mm=0.07, extinction=extinction)
    density, _ = box.bricks.dense()
    sigma_volume = box.tau * 1e-3 * density.sum(dtype=float) * (1e3 * box.voxel_size) ** 3
    shadow = 5 * 9.0 * 0.07  # mm² across them; π/4 of it on average over all directions
    share = 2.0 / np.pi if extinction == "projected" else 4.0 / np.pi
    assert share * sigma_volume == pytest.approx(shadow, rel=2e-3)


def test_fibres_that_voxels_resolve_are_opaque():
    assert opaque_path(1.0, 0.2, True) == pytest.approx(0.125)  # eight paths across
    assert opaque_path(0.1, 0.2, True) == pytest.approx(0.05)


def test_hair_grows_behind_the_hairline_and_out_of_the_skin():
    """On a ball of 40 mm: roots on it and above the line, points outside, lengths as told, one seed one head."""
    growth = Growth(hairs=300, length_mm=70.0, locks=20, front=0.8, back=0.3, uneven=0.2, stray_mm=0.0, wave_mm=0.0)

    def ball(point):
        return sphere(point, (0.0, 0.0, 40.0), 40.0)

    extent = (-40.0, -40.0, 0.0), (40.0, 40.0, 80.0)
    hairs = grown(ball, extent, growth, 5)
    points = hairs.points.reshape(300, -1, 3)
    away = np.linalg.norm(points - (0.0, 0.0, 40.0), axis=2) - 40.0
    assert away.min() > 0.5 * growth.diameter_mm - 1e-3
    assert np.abs(away[:, 0]).max() < 0.1
    assert points[:, 0, 2].min() > 0.3 * 80.0
    assert points[points[:, 0, 1] < -20.0, 0, 2].min() > 0.5 * 80.0  # the face is free
    length = np.linalg.norm(np.diff(points, axis=1), axis=2).sum(axis=1)
    assert np.all(length < 1.01 * 70.0)
    assert length.mean() > 0.7 * 0.9 * 70.0
    again = grown(ball, extent, growth, 5)
    np.testing.assert_array_equal(hairs.points, again.points)


def test_grown_hair_stands_on_the_floor_and_on_its_shape():
    recipe = {
        "kind": "hair", "shape": BALL, "material": HAIR, "voxel_mm": 1.0,
        "hairs": 60, "length_mm": 60.0, "locks": 4, "extinction": "projected",
    }  # fmt: skip
    floor, own = build(recipe), build(recipe | {"origin": "own"})
    assert -3e-3 < floor.pose[2, 3] < 0
    assert own.pose[2, 3] < -10e-3  # tips hang below the ball
    assert floor.materials[0].element == "cylinder"
    assert floor.materials[0].transmission == 0.4


@pytest.mark.parametrize(
    ("more", "said"),
    [({}, "either"), ({"shape": BALL, "hairs": 10, "front": 1.0, "back": 1.0}, "0 of 10"),
     ({"shape": BALL, "hairs": 9, "diameter_mm": 90.0}, "too fine")],
)  # fmt: skip
def test_hair_that_cannot_be_is_refused(more, said):
    with pytest.raises(InputError, match=said):
        build({"kind": "hair", "material": HAIR, **more})


def test_a_mean_diameter_is_that_of_the_extinction():
    points = np.array([[0.0, 0, 0], [0, 0, 1.0], [5.0, 0, 0], [5.0, 0, 1.0]])
    curves = Curves(points, np.array([0, 2, 4]), np.array([1.0, 1.0, 3.0, 3.0]))
    assert curves.mean_diameter == pytest.approx((1 + 9) / (1 + 3))
