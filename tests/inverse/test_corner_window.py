"""Corner windows: as wide as edges that pass through the corner allow, no wider."""

import numpy as np
import pytest

from hagoromo.calibration.camera.board import (
    LARGEST_HALF_SIDE_PX,
    LEAST_HALF_SIDE_PX,
    Board,
    corner_windows,
    next_edge,
)
from tests.inverse import test_calibrate_camera as simulated

BOARD, TRUE = simulated.BOARD, simulated.TRUE


def grid(rows: int, columns: int, across, down) -> np.ndarray:
    row, column = np.mgrid[:rows, :columns]
    return row[..., None] * np.array(down, float) + column[..., None] * np.array(across, float)


def test_the_next_edge_of_upright_squares_is_a_side_away():
    np.testing.assert_allclose(next_edge(grid(5, 7, (31, 0), (0, 19))), 19.0)


def test_the_next_edge_of_squares_on_their_tip_is_half_a_diagonal_away():
    """A square window meets their sides first with its corners: where |x| = |y|, half of the way along each."""
    np.testing.assert_allclose(next_edge(grid(5, 7, (22, 22), (-22, 22))), 22.0)


def test_windows_are_narrow_at_the_rim_and_have_bounds():
    windows = corner_windows(grid(5, 7, (24, 0), (0, 24)))
    assert (windows[1:-1, 1:-1] == 12).all() and (windows[[0, -1]] == 8).all() and (windows[:, [0, -1]] == 8).all()
    assert (corner_windows(grid(3, 3, (4, 0), (0, 4))) == LEAST_HALF_SIDE_PX).all()
    assert (corner_windows(grid(5, 5, (200, 0), (0, 200))) == LARGEST_HALF_SIDE_PX).all()


@pytest.fixture
def cut(monkeypatch):
    """Boards whose outer squares are cut to half of their width, on a dark table."""
    whole = simulated.drawing

    def drawing(board: Board, legacy: bool = False) -> np.ndarray:
        picture = whole(board, legacy).copy()
        paper = np.zeros(picture.shape, bool)
        paper[120:-120, 120:-120] = True  # 80 px of margin and 40 of the outer squares
        return np.where(paper, picture, 90.0)

    monkeypatch.setattr(simulated, "drawing", drawing)


def errors(board: Board) -> np.ndarray:
    """Of the corners [px], (photographs, corners)."""
    middle = np.array([(board.columns - 1) * board.square / 2, (board.rows - 1) * board.square / 2, 0.0])
    random, found = np.random.default_rng(5), []
    for eye in simulated.EYES:
        view = TRUE.look_at(middle + eye, middle, (0, -1, 0))
        corners = board.find(simulated.photograph_of_board(view, board, random))
        assert corners is not None
        found.append(np.linalg.norm(corners.image + 0.5 - view.project(corners.points), axis=1))
    return np.array(found)


@pytest.mark.nightly
def test_a_board_that_is_cut_is_found_as_well_as_a_whole_one(cut):
    """To a twentieth of a pixel in the median, and no corner off by half a pixel; a wide window is drawn to the rim."""
    ours, wide = errors(BOARD), errors(Board(BOARD.columns, BOARD.rows, BOARD.square, window=11))
    assert np.median(ours) < 0.1 and ours.max() < 0.5
    assert wide.max() > 2.0
