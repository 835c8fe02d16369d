"""Views: the frame of a structure, its scale by things of known size, and the lamps of its photographs."""

import numpy as np
import pytest
from scipy.stats import chi2

import hagoromo as hg
from hagoromo.calibration.views.known_length import FoundScale, read_marks, scale_of
from hagoromo.calibration.views.reconstruct import ALL_PAIRS, NEIGHBOURS, StatedLens, pairs_of
from hagoromo.errors import InputError
from tests.inverse.simulated_views import BOARD, MIDDLE, RADIUS, BoardMarks, camera, picture, ring, structure

SIZE = 7.3  # units of the structure per metre
VIEWS = ring(7)


def no_picture(name: str) -> np.ndarray:
    raise AssertionError(f"{name} is not needed")


def test_residuals_do_not_depend_on_the_axes_and_the_unit():
    one, other = structure(VIEWS), structure(VIEWS, SIZE)
    for name in VIEWS:
        np.testing.assert_allclose(one.residuals(name), other.residuals(name), atol=1e-6)
    assert 0.3 < one.rms_of_all < 0.6  # noise of 0.3 px in both directions: 0.42 px


def test_upright_is_z_up_with_the_object_at_the_origin_and_cameras_at_one_unit():
    found = structure(VIEWS, SIZE).upright()
    places = np.stack([view.position for view in found.views.values()])
    assert np.linalg.norm(places, axis=1).mean() == pytest.approx(1.0)
    np.testing.assert_allclose(places[:, 2], places[0, 2], atol=1e-9)  # the ring is level again
    assert places[0, 2] > 0.1
    axes = np.stack([view.world_to_camera[2, :3] for view in found.views.values()])
    across = np.linalg.norm(np.cross(axes, places), axis=1)
    assert across.max() < 1e-9  # all look at the origin


def test_photographs_that_look_away_from_each_other_are_refused():
    away = {
        name: view.with_pose(np.diag([-1.0, 1.0, -1.0, 1.0]) @ view.world_to_camera) for name, view in VIEWS.items()
    }
    with pytest.raises(InputError, match="do not look at one place"):
        structure(away).upright()


def marked(noise: float, seed: int, count: int = 5) -> FoundScale:
    random, known = np.random.default_rng(seed), BoardMarks()
    marks = {
        name: tuple(np.array(known.seen_by(view)) + random.normal(scale=max(noise, 1e-12), size=4))
        for name, view in list(VIEWS.items())[:count]
    }
    return scale_of(hg.KnownLength(known.length, marks), structure(VIEWS, SIZE), no_picture)


def test_a_marked_length_gives_the_scale():
    exact = marked(0.0, 1)
    assert exact.metres == pytest.approx(1.0 / SIZE, rel=1e-7)
    assert exact.error > 1e-3 and exact.rms < 1e-3  # nobody marks better than a pixel: 1 px is 0.3 % of 300 px


@pytest.mark.by_night("5-60")
@pytest.mark.parametrize(("count", "seeds"), [(2, 12), (5, 60)])
def test_the_standard_error_of_the_scale_is_not_too_small(count, seeds):
    found = [marked(1.5, seed, count) for seed in range(seeds)]
    deviations = [(one.metres * SIZE - 1.0) / one.error for one in found]
    assert np.sum(np.square(deviations)) < chi2.ppf(0.999, len(found))


def test_a_board_gives_the_scale_also_where_it_was_read_the_other_way_round():
    chosen = {name: VIEWS[name] for name in ("view04.png", "view05.png", "view06.png")}
    pictures = {name: picture(view) for name, view in chosen.items()}
    pictures["view05.png"] = pictures["view05.png"][::-1, ::-1].copy()  # turned: its corners come in reverse order

    class TurnedBoard(type(BOARD)):
        def find(self, photograph):
            found = BOARD.find(photograph)
            if found is None or photograph is not pictures["view05.png"]:
                return found
            return found._replace(image=np.array([399.0, 299.0], np.float32) - found.image)

    board = TurnedBoard(BOARD.columns, BOARD.rows, BOARD.square)
    found = scale_of(board, structure(chosen, SIZE), lambda name: pictures[name])
    assert len(found.photographs) == 3 and found.rms < 0.5
    assert abs(found.metres * SIZE - 1.0) < 4.0 * found.error < 0.02


def test_a_ball_gives_the_scale():
    turn = np.linspace(0.0, 2.0 * np.pi, 90)
    circles = {}
    for name, view in list(VIEWS.items())[::2]:
        to_ball = MIDDLE - view.position
        distance = np.linalg.norm(to_ball)
        right, down = view.world_to_camera[0, :3], np.cross(to_ball / distance, view.world_to_camera[0, :3])
        touching = np.arcsin(RADIUS / distance)
        ways = np.cos(touching) * to_ball / distance + np.sin(touching) * (
            np.cos(turn)[:, None] * right + np.sin(turn)[:, None] * down
        )
        edge = view.project(view.position + ways)
        middle = 0.5 * (edge.min(axis=0) + edge.max(axis=0))
        circles[name] = (*middle.tolist(), float(np.linalg.norm(edge - middle, axis=1).mean()))
    found = scale_of(hg.KnownBall(RADIUS, circles), structure(VIEWS, SIZE), no_picture)
    assert found.metres * SIZE == pytest.approx(1.0, abs=2e-3)  # a circle stands for an ellipse
    assert 1e-3 < found.error < 0.02


@pytest.mark.parametrize(
    ("given", "said"),
    [
        (hg.KnownLength(0.1, {"view00.png": (1, 2, 3, 4)}), "marks 1 photographs that could be placed"),
        (hg.KnownLength(0.1, {"elsewhere.png": (1, 2, 3, 4)}), "none of the photographs"),
        (hg.KnownBall(0.1, {}), "--ball marks 0"),
    ],
)
def test_too_little_of_known_size_is_refused(given, said):
    with pytest.raises(InputError, match=said):
        scale_of(given, structure(VIEWS), no_picture)


def test_a_mark_in_another_place_is_named():
    known = BoardMarks()
    marks = {name: known.seen_by(view) for name, view in VIEWS.items()}
    x1, y1, x2, y2 = marks["view02.png"]
    marks["view02.png"] = x1, y1, x2 + 90.0, y2
    with pytest.raises(InputError, match=r"view02.png shows it \d+ px from where the other photographs have it"):
        scale_of(hg.KnownLength(known.length, marks), structure(VIEWS, SIZE), no_picture)


@pytest.mark.parametrize("entry", ["a.jpg,1,2,3", "a.jpg,1,2,3,-4", "1,2,3,4", "a.jpg,1,2,3,nan", ""])
def test_marks_of_another_form_are_refused(entry):
    with pytest.raises(InputError, match="PHOTOGRAPH,x1,y1,x2,y2"):
        read_marks([entry], 4, "--length-between")
    with pytest.raises(InputError, match="twice"):
        read_marks(["a,b.jpg,1,2,3,4", "a,b.jpg,1,2,3,5"], 4, "--length-between")


def test_a_flash_moves_with_the_camera():
    lit, said = hg.ViewLight(flash=(0.02, -0.05, 0.01), intensity=3.0).of(VIEWS)
    for name, view in VIEWS.items():
        (lamp,) = lit[name]
        in_camera = view.world_to_camera[:3, :3] @ lamp.place + view.world_to_camera[:3, 3]
        np.testing.assert_allclose(in_camera, (0.02, -0.05, 0.01), atol=1e-12)
        assert lamp.near and lamp.intensity == 3.0
    assert "flash" in said


def test_lamps_are_fixed_to_the_camera_or_in_space():
    lamps = (hg.Lamp((0.1, 0.2, 0.3), axis=(0, 0, 1)), hg.Lamp(to_lamp=(0.0, 0.6, -0.8), intensity=2.0))
    moving, _ = hg.ViewLight(lamps=lamps).of(VIEWS)
    still, said = hg.ViewLight(lamps=lamps, fixed_to="view03").of(VIEWS)
    for name, view in VIEWS.items():
        rotation = view.world_to_camera[:3, :3]
        np.testing.assert_allclose(rotation @ moving[name][1].place, (0.0, 0.6, -0.8), atol=1e-12)
        np.testing.assert_allclose(rotation @ np.asarray(moving[name][0].axis), (0.0, 0.0, 1.0), atol=1e-12)
        assert [lamp.place.tolist() for lamp in still[name]] == [lamp.place.tolist() for lamp in still["view00.png"]]
    np.testing.assert_allclose(still["view00.png"][1].place, moving["view03.png"][1].place)
    assert "view03" in said
    own, said = hg.ViewLight(lamps=[hg.Lamp(to_lamp=(0, 0, -1), name=f"{n[:-4]}.jpg") for n in VIEWS]).of(VIEWS)
    assert all(lit[0].name == f"{name[:-4]}.jpg" and len(lit) == 1 for name, lit in own.items())
    with pytest.raises(InputError, match="no photograph that could be placed"):
        hg.ViewLight(lamps=lamps, fixed_to="view99").of(VIEWS)


def test_few_photographs_are_matched_in_all_pairs_and_many_with_their_neighbours():
    assert len(pairs_of(7)) == 21
    many = pairs_of(ALL_PAIRS + 1)
    assert (0, ALL_PAIRS) in many and (0, NEIGHBOURS) in many and (0, NEIGHBOURS + 1) not in many
    assert len(many) == len(set(many)) == NEIGHBOURS * (ALL_PAIRS + 1)


def test_the_lens_of_a_file_keeps_its_figures_in_reduced_pictures():

    view = camera(0.0)
    model, figures = StatedLens((400, 300), camera=view).model((200, 150), 1)
    assert model == "FULL_OPENCV" and figures[:5] == [210.0, 210.0, 100.0, 75.0, -0.12]
    assert StatedLens((400, 300), focal=420.0).model((200, 150), 2) == ("RADIAL", [210.0, 100.0, 75.0, 0.0, 0.0])
    assert StatedLens((400, 300)).model((200, 150), 0) == ("SIMPLE_PINHOLE", [])


def test_a_photograph_whose_board_is_found_beside_it_is_left_out(monkeypatch):
    """Something hid a corner; with three photographs nobody knows which of them is wrong."""
    found = structure(VIEWS, SIZE)

    def corners(board, points, name):
        image = VIEWS[name].project(points + np.array([-0.03, -0.09, 0.0]))
        return image + 20.0 * (np.arange(len(points)) == 4)[:, None] * (name == list(VIEWS)[2])

    monkeypatch.setattr("hagoromo.calibration.views.known_length._corners", corners)
    scale = scale_of(BOARD, found, lambda name: name)  # type: ignore[arg-type, return-value]
    assert abs(scale.metres * SIZE - 1.0) < 1e-6
    assert set(scale.photographs) == set(VIEWS) - {list(VIEWS)[2]}
    few = structure({name: VIEWS[name] for name in list(VIEWS)[:3]}, SIZE)
    with pytest.raises(InputError, match="not in one place"):
        scale_of(BOARD, few, lambda name: name)  # type: ignore[arg-type, return-value]
