"""Draped cloth obeys what holds for cloth: it keeps its length, hangs as a chain, lies on bodies and not in them."""

import subprocess
import sys
from typing import Any

import drjit as dr
import numpy as np
import pytest
import trimesh
from scipy.optimize import brentq
from scipy.spatial import KDTree

from hagoromo.backend import arrays
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum
from hagoromo.matter.shape import capsule, rounded_box, sphere
from hagoromo.reflectance.reflectance import Reflectance
from hagoromo.volume.box import VolumeBox
from hagoromo_matter.drape import drape
from hagoromo_matter.drape.collider import Collider
from hagoromo_matter.drape.contact import LARGEST_CONTACTS, NEIGHBOUR_ROWS, Contacts
from hagoromo_matter.drape.cut import Cut
from hagoromo_matter.drape.dressed import DEEP, dressed
from hagoromo_matter.drape.hanging import hanging
from hagoromo_matter.drape.settle import ClothMechanics, Fall, settled
from hagoromo_matter.drape.sheet import Sheet
from hagoromo_matter.drape.sheet_chart import sheet_chart
from hagoromo_matter.drape.tube import Folds, upper_hem, upright
from hagoromo_matter.figure import wardrobe
from hagoromo_matter.figure.body import bust
from hagoromo_matter.figure.garment import garments
from hagoromo_matter.figure.gown import CLOTH, GOWN, NECK, TILT
from hagoromo_matter.figure.habit import BUST, LINEN, STEP, TUNIC, WOOL, _coif
from hagoromo_matter.figure.mannequin import trunk
from hagoromo_matter.figure.pose import PRAYER, WELCOME
from hagoromo_matter.solid.solid import MeshSurface

BALL = (0.0, 0.0, 15.0), 15.0
FIBRE = Reflectance(0.25, 0.3, 0.3, 1.5, Spectrum.constant(0.5), element="cylinder")
NOTHING = Collider([], (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), 1.0)


def ball() -> Collider:
    return Collider([lambda p: sphere(p, *BALL)], (-35.0, -35.0, -2.0), (35.0, 35.0, 35.0), 1.0)


def flat(width: float, height: float, z: float, **record) -> Cut:
    """A level cloth around the axis z."""

    def start(s, t):
        return np.stack(np.broadcast_arrays(width * (s - 0.5), height * (t - 0.5), z), axis=-1)

    return Cut(width, height, start, **record)


@pytest.fixture(scope="module")
def over_ball() -> Sheet:
    return settled(
        [flat(53.0, 47.0, 31.0)], ball(), ClothMechanics(bending=2.0), Fall(spacing=1.7, seconds=0.5, levels=1)
    )[0]


def strains(sheet: Sheet, width: float, height: float) -> np.ndarray:
    """Of all springs along the yarns."""
    rows, columns = sheet.u.shape
    across = np.linalg.norm(np.diff(sheet.points, axis=1), axis=2) * (columns - 1) / width - 1.0
    down = np.linalg.norm(np.diff(sheet.points, axis=0), axis=2) * (rows - 1) / height - 1.0
    return np.concatenate([across.ravel(), down.ravel()])


def in_space(points: np.ndarray):
    return arrays().Array3f(*np.ascontiguousarray(points.T, np.float32))


def distance_to_mesh(mesh: trimesh.Trimesh, points: np.ndarray) -> np.ndarray:
    """Least distance to the 32 triangles whose middles are nearest: the others are farther on an even grid."""
    near = np.asarray(KDTree(mesh.triangles_center).query(points, k=32)[1]).T
    closest = [trimesh.triangles.closest_point(mesh.triangles[faces], points) for faces in near]
    return np.min([np.linalg.norm(found - points, axis=1) for found in closest], axis=0)


def test_settled_cloth_is_not_stretched(over_ball):
    """2 % is allowed where the cloth carries most; on the mean far less, and nowhere above 6 %, where it is pinched."""
    strain = np.abs(strains(over_ball, 53.0, 47.0))
    assert strain.mean() < 0.01
    assert strain.max() < 0.06


def test_cloth_lies_on_the_body_and_on_the_floor_and_not_in_them(over_ball):
    """Kept clear by 0.6 mm: lattice distances round the ball by step²/8R = 0.01 mm, a fall of the last step by less."""
    above = np.linalg.norm(over_ball.points - BALL[0], axis=2) - BALL[1]
    assert above.min() > 0.5
    assert over_ball.points[..., 2].min() > 0.59
    assert np.count_nonzero(above < 0.7) > 100  # it rests on the ball


@pytest.fixture
def few_points(monkeypatch):
    monkeypatch.setattr(drape, "POINTS", 26)


def test_cloth_falls_over_a_mesh_as_over_the_ball_that_it_is(few_points, tmp_path, monkeypatch):
    """An icosphere of 1280 faces, up to 0.06 mm within the ball: what rests on it is that far off; without strain.

    As near as on the ball, for which nothing is guarded against thin parts.
    """
    monkeypatch.setattr(drape, "GUARD", 0.0)
    trimesh.creation.icosphere(3, 12.0).export(tmp_path / "ball.ply")
    mesh = MeshSurface(tmp_path / "ball.ply", 24.0)
    over_mesh = drape.over_body((50.0, 46.0), mesh.signed_distance, mesh.low - 3.0, mesh.high + 3.0)
    above = [np.linalg.norm(s.points - (0, 0, 12), axis=2) - 12 for s in (over_mesh, drape.over_ball((50, 46), 12))]
    for one in above:
        assert one.min() > 0.45 and np.count_nonzero(one < 0.75) > 100
    rests = (above[0] < 0.75) & (above[1] < 0.75)
    assert rests.sum() > 100 and np.median(np.abs(above[0] - above[1])[rests]) < 0.06
    assert over_mesh.points[..., 2].min() > 0.59 and np.abs(strains(over_mesh, 50.0, 46.0)).mean() < 0.01


@pytest.mark.nightly
def test_a_body_that_stands_through_the_cloth_is_said(few_points):
    """A needle of 1 mm; a plate of 1 mm on edge, as wide as the cloth, carries it: its points cannot slip past it."""

    def plate(p):
        return rounded_box(p, (0.0, 0.0, 10.0), (0.5, 30.0, 10.0), 0.3)

    hanging = drape.over_body((40, 40), plate, (-3, -33, -3), (3, 33, 23))
    assert hanging.points[..., 2].max() > 20.5
    with pytest.warns(UserWarning, match=r"stands through 0\.00\d+ of the cloth, where it is too pointed"):
        drape.over_body((40, 40), lambda p: capsule(p, (0, 0, 0), (0, 0, 20), 0.5), (-3, -3, -3), (3, 3, 23))


def test_cloth_that_falls_off_its_body_is_said(few_points):
    """A ball beside the axis on which the cloth falls; a point of the floor is no body."""
    with pytest.raises(InputError, match=r"20 × 20 mm fell off the body, 9 mm high: give a larger one"):
        drape.over_body((20, 20), lambda p: sphere(p, (40.0, 0.0, 4.0), 4.0), (30, -6, -1), (46, 6, 9))


@pytest.mark.parametrize("reach", [1e-9, 1.8])
def test_contacts_are_the_nearest_points_that_are_no_neighbours(reach):
    """Against every pair by itself: a tube and an open sheet, on a grid of halves, so that distances are equal."""
    random, shapes = np.random.default_rng(1), ((7, 9), (8, 6))
    grids = [0.5 * random.permutation(200)[: rows * columns].reshape(rows, columns) for rows, columns in shapes]
    places = [np.stack([0.5 * (grid // 0.5 // 16), grid % 8.0, grid % 1.5], axis=-1) for grid in grids]
    sheets = [
        Sheet(place.astype(np.float64), np.zeros(place.shape[:2]), np.zeros(place.shape[:2]), around)
        for place, around in zip(places, (9.0, 0.0), strict=True)
    ]
    apart, narrow = random.random(63 + 48) < 0.3, np.full(63 + 48, 0.8)
    points = np.concatenate([place.reshape(-1, 3) for place in places])
    found = Contacts(sheets, apart, narrow).candidates(points, reach)
    where = [(k, *place) for k, shape in enumerate(shapes) for place in np.ndindex(shape)]
    touched = 0
    for own, (sheet, row, column) in enumerate(where):
        near = []
        for other, (sheet2, row2, column2) in enumerate(where):
            across = abs(column - column2)
            across = min(across, 9 - across) if sheet == 0 else across
            beside = sheet == sheet2 and abs(row - row2) <= NEIGHBOUR_ROWS and across * 0.8 <= NEIGHBOUR_ROWS
            strange = sheet != sheet2 and (apart[own] or apart[other])
            distance = np.linalg.norm(points[own] - points[other])
            if distance <= reach and not beside and not strange:
                near.append((distance, other))
        touched += len(near)
        nearest = [other for _, other in sorted(near)][:LARGEST_CONTACTS]
        assert found[:, own].tolist() == nearest + [own] * (LARGEST_CONTACTS - len(nearest))
    assert (touched > 8 * len(where)) == (reach > 1.0)


def test_folds_do_not_pass_through_each_other(over_ball):
    """Points farther than two rows or columns from each other on the cloth stay half a spacing apart and more."""
    points = over_ball.points.reshape(-1, 3)
    one, other = KDTree(points).query_pairs(0.5 * 1.7, output_type="ndarray").T
    columns = over_ball.u.shape[1]
    apart = np.maximum(np.abs(one // columns - other // columns), np.abs(one % columns - other % columns))
    assert not np.count_nonzero(apart > 2)


@pytest.mark.by_night("55.0")
@pytest.mark.parametrize("span", [41.0, 55.0])
def test_a_strip_held_at_both_ends_hangs_as_a_catenary(span):
    """A limp strip of 67 mm: z = a cosh(x/a), 2 a sinh(span/2a) its length with the strain it shows.

    Tolerance: 1 % of its length, for its bending length of 1 mm and the springs' own 2 %.
    """
    length, wide = 67.0, 9.0

    def start(s, t):
        x = span * (s - 0.5)
        deep = 0.5 * np.sqrt(length**2 - span**2) * (1.0 - np.abs(2.0 * s - 1.0))
        return np.stack(np.broadcast_arrays(x, wide * (t - 0.5), 60.0 - deep), axis=-1)

    strip = Cut(length, wide, start, held=lambda s, t: np.where((s == 0) | (s == 1), 1.0, 0.0 * t))
    sheet = settled([strip], NOTHING, ClothMechanics(bending=1.0), Fall(1.1, 1.2, 1))[0]
    chain = sheet.points[len(sheet.points) // 2]
    whole = np.linalg.norm(np.diff(chain, axis=0), axis=1).sum()
    assert whole == pytest.approx(length, rel=0.02)
    a = brentq(lambda a: 2.0 * a * np.sinh(0.5 * span / a) - whole, 0.1 * span, 10.0 * span)
    catenary = 60.0 + a * (np.cosh(chain[:, 0] / a) - np.cosh(0.5 * span / a))
    assert np.abs(chain[:, 2] - catenary).max() < 0.01 * length


def test_the_chart_tells_the_distance_to_the_cloth(over_ball):
    """Against the nearest triangle of the refined sheet; a triangle of 0.4 mm sags 0.02 mm under a fold of 1 mm."""
    fine = over_ball.refined(4)
    mesh = trimesh.Trimesh(fine.points.reshape(-1, 3), fine.faces(), process=False)
    draw = np.random.default_rng(3)
    asked = draw.permutation(mesh.vertices)[:3001] + draw.uniform(-0.9, 0.9, (3001, 3))
    chart, bound, (low, high) = sheet_chart([over_ball], reach_mm=2.0)
    place = chart(in_space(asked))
    truth, inside = distance_to_mesh(mesh, asked), np.array(place.presence) > 0
    assert inside.mean() > 0.9
    error = np.abs(np.abs(np.array(place.height)) - truth)[inside]
    assert np.quantile(error, 0.99) < 0.04
    assert error.mean() < 0.01
    assert (np.array(bound(in_space(asked))) <= truth).all()
    assert (np.array(low) < mesh.vertices.min(axis=0) - 1.9).all()
    assert (np.array(high) > mesh.vertices.max(axis=0) + 1.9).all()


def test_u_and_v_are_lengths_on_the_cloth_and_the_frame_is_right_handed(over_ball):
    """Differences of u and v over ±0.05 mm on the cloth itself: shear tilts them by up to 0.2, strain by its 1 %."""
    draw = np.random.default_rng(4)
    asked = draw.permutation(over_ball.refined(3).points[9:-9, 9:-9].reshape(-1, 3))[:2003]
    chart = sheet_chart([over_ball], reach_mm=2.0)[0]
    slopes = []
    for axis in np.eye(3):
        ahead, behind = chart(in_space(asked + 0.05 * axis)), chart(in_space(asked - 0.05 * axis))
        slopes.append([np.array(getattr(ahead, name) - getattr(behind, name)) * 10.0 for name in "uv"])
    (u, v), place = np.moveaxis(np.array(slopes), 0, 2), chart(in_space(asked))
    normal, along = np.array(place.normal).T, np.array(place.along_u).T
    assert np.median(np.linalg.norm(u, axis=1)) == pytest.approx(1.0, abs=0.02)
    assert np.median(np.linalg.norm(v, axis=1)) == pytest.approx(1.0, abs=0.02)
    assert np.median(np.abs((u * v).sum(axis=1))) < 0.1
    assert np.median((v * np.cross(normal, along)).sum(axis=1)) > 0.98
    assert np.abs((normal * along).sum(axis=1)).max() < 1e-5


def test_a_flat_square_is_its_own_chart():
    """Exact: u, v and height are the coordinates, and presence ends at the hems."""
    s = np.linspace(0.0, 12.0, 13)
    u, v = np.meshgrid(s, s)
    square = Sheet(np.stack([u, v, np.full_like(u, 5.0)], axis=-1), u, v)
    asked = np.random.default_rng(5).uniform((-1.0, -1.0, 4.0), (13.0, 13.0, 6.0), (999, 3))
    place = sheet_chart([square], reach_mm=2.5, edge_mm=0.5)[0](in_space(asked))
    assert np.array(place.u) == pytest.approx(asked[:, 0], abs=1e-4)
    assert np.array(place.v) == pytest.approx(asked[:, 1], abs=1e-4)
    assert np.array(place.height) == pytest.approx(asked[:, 2] - 5.0, abs=1e-4)
    hem = np.minimum(asked[:, :2], 12.0 - asked[:, :2]).min(axis=1)
    assert np.array(place.presence) == pytest.approx(np.clip(hem / 0.5, 0.0, 1.0), abs=1e-3)


def test_hems_lie_in_the_gaps_between_yarns():
    """Presence ½ at the multiples of the pitch, along u and v, nearest to where it would be: half an edge in."""
    s, pitch = np.linspace(0.0, 12.0, 13), (0.5, 0.53)
    u, v = np.meshgrid(s, s)
    square = Sheet(np.stack([u, v, np.full_like(u, 5.0)], axis=-1), u, v)
    at = np.linspace(0.0, 12.0, 1201)
    chart = sheet_chart([square], reach_mm=2.5, edge_mm=1.05, pitch_mm=pitch)[0]
    for axis in (0, 1):
        asked = np.full((len(at), 3), (6.0, 6.0, 5.0))
        asked[:, axis] = at
        there = at[np.array(chart(in_space(asked)).presence) >= 0.5]
        for hem, usual in ((there[0], 0.525), (there[-1], 12.0 - 0.525)):
            assert abs(hem / pitch[axis] - round(hem / pitch[axis])) < 0.03 and abs(hem - usual) <= 0.5 * pitch[axis]


@pytest.mark.parametrize("patch_first", [True, False])
def test_a_hem_cuts_no_hole_into_the_cloth_beneath(patch_first):
    """A patch 0.4 mm over a level cloth: on either side of its cut, one of both is charted, with its exact height."""
    cloth, patch = flat(20.0, 16.0, 5.0).sheet(1.0), flat(8.0, 6.0, 5.4).sheet(1.0)
    chart = sheet_chart([patch, cloth] if patch_first else [cloth, patch], reach_mm=2.0, edge_mm=2.0)[0]
    asked = np.random.default_rng(7).uniform((-6.0, -5.0, 5.25), (6.0, 5.0, 5.6), (999, 3))  # nearer to the patch
    place = chart(in_space(asked))
    uncut = (np.abs(asked[:, :2]) < (3.0, 2.0)).all(axis=1)  # half an edge within the patch
    assert 0.1 < uncut.mean() < 0.9
    presence, height = np.array(place.presence), np.array(place.height)
    assert presence[uncut].min() >= 0.5 and presence[~uncut] == pytest.approx(1.0)
    assert height == pytest.approx(asked[:, 2] - np.where(uncut, 5.4, 5.0), abs=1e-4)


def test_a_tube_closes_on_whole_periods():
    """A cylinder of 40.8 mm around: u grows by 41 periods of 1 mm where it closes, height is the way to the axis."""
    turn, z = np.arange(48) * 2 * np.pi / 48, np.linspace(0.0, 11.0, 17)
    radius = 40.8 / (2 * np.pi)
    points = np.stack(np.broadcast_arrays(radius * np.cos(turn), radius * np.sin(turn), z[:, None]), axis=-1)
    u, v = np.broadcast_arrays(turn * radius, z[:, None])
    chart = sheet_chart([Sheet(points, u, v, 40.8)], reach_mm=2.0, period_mm=(1.0, 1.0))[0]
    angle = np.linspace(-0.3, 0.3, 7)[:, None] * [1.0, 1.0] + [-1e-3, 1e-3]
    out = radius + 0.7
    place = chart(in_space(np.stack([out * np.cos(angle), out * np.sin(angle), 0 * angle + 5.0], -1).reshape(-1, 3)))
    expected = np.mod(angle.ravel() * 41.0 / (2 * np.pi), 41.0)
    assert np.array(place.u) == pytest.approx(expected, abs=0.01)
    assert np.array(place.height) == pytest.approx(0.7, abs=0.01)
    assert np.array(place.presence) == pytest.approx(1.0)


def test_a_dressed_body_has_the_nearest_cloth_of_all():
    """Against the distance to every point of a level sheet, near, far, above, below and beside it; of 32 bits."""
    u, v = np.meshgrid(np.arange(-20.0, 20.5, 1.2), np.arange(-16.0, 16.5, 1.2))
    sheet = Sheet(np.stack([u, v, np.full(u.shape, 3.0)], axis=-1), u, v, 0.0)
    places = np.random.default_rng(3).uniform(-40.0, 40.0, (20000, 3)) * (1.0, 1.0, 0.4)
    far = np.full(len(places), np.inf)
    for point in sheet.points.reshape(-1, 3):
        np.minimum(far, np.linalg.norm(places - point, axis=1), out=far)
    far = np.where(far < DEEP, np.where(places[:, 2] > 3.0, far, -far), DEEP)
    jit = arrays()
    found = np.array(dressed(lambda p: 0.0 * p.x + 1e3, [sheet])(jit.Array3f(*places.T.astype(np.float32))))
    assert (found < 0).any() and (found == np.float32(DEEP)).any()
    assert found == pytest.approx(far, abs=1e-4)


def test_a_solid_that_is_common_to_bodies_is_part_of_each():
    """As if it were joined to each before."""

    def apart(p):
        return sphere(p, (9.0, 0.0, 4.0), 3.0)

    space = (-15.0, -15.0, -2.0), (15.0, 15.0, 32.0), 2.0
    bodies = [lambda p: sphere(p, *BALL), lambda p: p.z + 1.0]
    joined = Collider([lambda p, one=one: dr.fmin(one(p), apart(p)) for one in bodies], *space)
    assert np.array_equal(Collider(bodies, *space, apart).values.numpy(), joined.values.numpy())


def test_one_seed_one_drape():
    cut, fall = flat(23.0, 19.0, 31.0), Fall(1.3, 0.1, 2)
    first, again = (settled([cut], ball(), ClothMechanics(), fall)[0].points for _ in range(2))
    assert np.array_equal(first, again)
    other = settled([cut], ball(), ClothMechanics(), fall._replace(seed=1))[0].points
    assert not np.array_equal(first, other)


LITTERED = """
import gc
import numpy as np
from hagoromo.backend import arrays, lookup
from hagoromo_matter.drape.collider import Collider
from hagoromo_matter.drape.contact import LARGEST_CONTACTS, NEIGHBOUR_ROWS, Contacts
from hagoromo_matter.drape.cut import Cut
from hagoromo_matter.drape.settle import ClothMechanics, Fall, settled

class Ring:
    def __init__(self):
        self.itself, self.numbers = self, lookup(arrays().Float, np.arange(1000.0))

class Nothing(Collider):
    def distance_and_normal(self, point, layer):  # within the recorded step
        gc.set_threshold(1)
        rings = [[] for _ in range(1000)]
        return super().distance_and_normal(point, layer)

def start(s, t):
    return np.stack(np.broadcast_arrays(20.0 * s, 20.0 * t, 31.0), axis=-1)

gc.collect()
gc.set_threshold(10**6)
for _ in range(100):
    Ring()  # an array that only the collector frees
nothing = Nothing([], (-1.0, -1.0, -1.0), (1.0, 1.0, 1.0), 1.0)
settled([Cut(20.0, 20.0, start)], nothing, ClothMechanics(), Fall(2.0, 0.02, 1))
"""


def test_litter_of_others_does_not_end_the_simulation():
    """Arrays that share NumPy's memory, freed by the collector while a step is recorded, once aborted the process."""
    ended = subprocess.run([sys.executable, "-c", LITTERED], capture_output=True, text=True, timeout=300, check=False)
    assert ended.returncode == 0, ended.stderr


def test_a_hanging_piece_keeps_the_length_of_its_rows_and_opens_to_the_hem():
    """Within what chords of 1.5 mm cut off folds of 6 mm; it stands on z = 0, as high as the cloth."""
    sheet = hanging((41.0, 37.0), 2, 6.0, seed=2)
    lengths = np.linalg.norm(np.diff(sheet.points, axis=1), axis=2).sum(axis=1)
    assert lengths == pytest.approx(np.full(len(lengths), 41.0), rel=0.01)
    assert (sheet.points[..., 2].min(), sheet.points[..., 2].max()) == (0.0, 37.0)
    upper, lower = np.ptp(sheet.points[-1, :, 0]), np.ptp(sheet.points[0, :, 0])
    assert upper < lower < 41.0  # gathered above


@pytest.mark.parametrize(("rows", "fabric", "pose"), [(GOWN, CLOTH, WELCOME), (TUNIC, WOOL, PRAYER)])
def test_necklines_are_held_outside_the_neck_and_its_muscles(rows, fabric, pose):
    """What is held stays where it begins, inside a body or not: as far from the trunk as cloth is kept, and close."""
    hem = upright(rows, (1.0, NECK), TILT, Folds(17, 1), held=upper_hem).sheet(1.6).points[-1]
    distance = np.array(trunk(in_space(hem), pose))
    assert fabric.clear - 0.01 < distance.min() and distance.max() < fabric.clear + 1.5


def test_the_coif_is_held_under_the_chin_and_not_in_it():
    """Its edge, from 120° to either side of the top of the face on, is half a millimetre and more out of the skin."""
    edge = _coif(PRAYER).sheet(1.1).points[0]
    below = np.abs(np.linspace(-180.0, 180.0, len(edge), endpoint=False)) > 120.0
    assert np.array(bust(in_space(edge[below]), PRAYER)).min() > LINEN.clear


def test_the_coif_is_cut_no_narrower_than_its_way():
    """Over the head and down over the throat: cut a third narrower, it was drawn up, and bunched under the chin."""
    coif = _coif(PRAYER)
    s, t = np.linspace(0.0, 1.0, 721), np.linspace(0.0, 1.0, 5)
    way = np.linalg.norm(np.diff(coif.start(s[None], t[:, None]), axis=1), axis=2).sum(axis=1)
    assert (coif.width * coif.narrowing(t) / way > 0.9).all()


@pytest.mark.slow  # half a minute each
@pytest.mark.parametrize(("figure", "names"), [("angel", ["robe"]), ("nun", ["habit", "linen", "veil"])])
def test_figures_are_dressed_from_the_neck_to_the_ground(figure, names):
    """On a coarse grid: little strain, 1 % at most of its points slipped into the trunk, all within its room."""
    clothes = garments(figure, resolution=0.4, seed=1)
    assert list(clothes) == names
    tunic = clothes[names[0]][0]
    down = np.linalg.norm(np.diff(tunic.points, axis=0), axis=2) / np.diff(tunic.v, axis=0) - 1.0
    assert np.abs(down).mean() < 0.02
    pose, more = (WELCOME, {}) if figure == "angel" else (PRAYER, {"bust": BUST, "step": STEP})
    inside = np.array(trunk(in_space(tunic.points.reshape(-1, 3)), pose, **dict[str, Any](more))) < -0.3
    assert inside.mean() < 0.01
    points = np.concatenate([sheet.points.reshape(-1, 3) for sheets in clothes.values() for sheet in sheets])
    assert points[:, 2].min() == pytest.approx(0.6, abs=0.2)
    assert 215.0 < points[:, 2].max() < 272.0
    assert np.abs(points[:, :2]).max() < 75.0


@pytest.mark.slow  # half a minute
def test_the_nuns_collar_reaches_under_her_coif():
    """Up to 75° from the front its upper hem is above the lower hem of the coif: no neck shows between them."""
    collar, coif = garments("nun", resolution=0.4, seed=1)["linen"]
    upper, lower = collar.points[-1], coif.points[-1]
    turn, below = (np.arctan2(hem[:, 0], 0.5 - hem[:, 1]) for hem in (upper, lower))
    in_front = np.abs(below) < np.radians(75.0)
    over = np.interp(below[in_front], np.sort(turn), upper[np.argsort(turn), 2]) - lower[in_front, 2]
    assert over.min() > 0.0


def kept(box: VolumeBox) -> tuple[np.ndarray, np.ndarray]:
    """World points of the voxels of a chart, and the heights over the cloth that they hold, (n, 3) and (n) [mm]."""
    share, axis = box.bricks.dense()
    there = (np.linalg.norm(axis, axis=-1) > 0.5) & (share > 0.1) & (share < 1.0)
    low, high = box.band
    return voxel_points(box)[there], 1e3 * (low + share[there].astype(float) * (high - low))


def voxel_points(box: VolumeBox) -> np.ndarray:
    """Middles of all voxels [mm]."""
    index = np.stack(np.meshgrid(*(np.arange(n) for n in box.bricks.shape), indexing="ij"), axis=-1)[..., ::-1]
    return 1e3 * ((index + 0.5) * box.voxel_size + box.pose[:3, 3])


def test_a_garment_is_a_box_of_cloth_around_its_sheets(monkeypatch, few_match_points):
    """A level piece in place of the nun's linen, which takes a minute to drape: its chart tells heights over it.

    To a step of a half float over the band, in every column of voxels over its area.
    """
    monkeypatch.setattr(wardrobe, "draped", lambda *_: {"linen": [flat(15.0, 11.0, 20.0).sheet(1.0)]})
    box = wardrobe.garment_of("nun", "linen", FIBRE, 0.4).box()
    assert box.texel is not None and {m.element for m in box.materials} == {"cylinder"}
    points, heights = kept(box)
    over = (np.abs(points) < (7.5, 5.5, np.inf)).all(axis=1) & (np.abs(points[:, 2] - 20.0) < 1.5)
    off, high = points[over, 2] - 20.0, heights[over]
    band_mm = 1e3 * (box.band[1] - box.band[0])
    assert np.abs(off - high).max() < band_mm / 2048  # the upper side is u × v
    columns = voxel_points(box)[0, :, :, :2]
    assert len(np.unique(points[over, :2], axis=0)) == (np.abs(columns) < (7.5, 5.5)).all(axis=-1).sum() > 150


@pytest.mark.slow  # a minute each
@pytest.mark.parametrize(("figure", "name", "height"), [("angel", "robe", 200.0), ("nun", "linen", 40.0)])
def test_garments_of_figures_are_boxes(figure, name, height):
    """As the demo has them, but coarser."""
    box = wardrobe.garment_of(figure, name, FIBRE, 0.4).box()
    points, _ = kept(box)
    assert box.texel is not None and np.ptp(points[:, 2]) > height and np.abs(points[:, :2]).max() < 80.0


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        (lambda: flat(-1.0, 5.0, 1.0), "sizes above 0"),
        (lambda: settled([flat(20.0, 20.0, 1.0)], NOTHING, ClothMechanics(bending=-1.0)), "none below 0"),
        (lambda: settled([flat(20.0, 20.0, 1.0)], NOTHING, ClothMechanics(), Fall(spacing=0.0)), "spacing above 0"),
        (
            lambda: settled([flat(20.0, 20.0, 1.0)], NOTHING, ClothMechanics(), Fall(spacing=7.0)),
            "half its shorter edge",
        ),
        (lambda: Sheet(np.zeros((3, 9, 3)), np.zeros((3, 9)), np.zeros((3, 9))), "4 × 4"),
        (lambda: sheet_chart([], 1.0), "0 sheets"),
        (lambda: hanging((20.0, 20.0), 9, 9.0), "do not fit"),
        (lambda: drape.over_ball((20.0, 20.0), -1.0), "radius_mm"),
        (lambda: garments("imp"), "no figure 'imp'"),
        (lambda: garments("nun", resolution=9.0), "resolution is 9"),
        (lambda: Collider([], (0, 0, 0), (1, 1, 1), -1.0), "step"),
    ],
)
def test_bad_drapes_are_refused_in_one_line(wrong, message):
    with pytest.raises(InputError, match=message) as refused:
        wrong()
    assert "\n" not in str(refused.value)
