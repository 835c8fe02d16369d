"""Simulated photographs of many views, by ray tracing in NumPy: a ball and a floor of noise, a chessboard on the floor.

Cameras stand on a ring and look at the ball. All is exact: poses, the lens with its distortion, the board, the ball.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import map_coordinates

import hagoromo as hg
from hagoromo.calibration.views.structure import Sightings, Structure
from hagoromo.camera.pose import pose_of

RADIUS, MIDDLE = 0.05, np.array([0.0, 0.0, 0.05])  # [m] the ball, which lies on the floor z = 0
BOARD = hg.Board(7, 5, square=0.012)
CORNER = np.array([-0.048, -0.13])  # [m] (x, y) of the board's first inner corner
CELLS = (0.004, 0.011)  # [m] of the noise
SAMPLES = 2  # a side of a pixel, squared


def camera(turn: float, width: int = 400, height: int = 300, k1: float = -0.12, rise: float = 0.55) -> hg.Camera:
    """A camera on the ring, at an angle [rad] around z and above the floor."""
    ahead = -np.array([np.cos(rise) * np.cos(turn), np.cos(rise) * np.sin(turn), np.sin(rise)])
    right = np.cross(ahead, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    rotation = np.stack([right, np.cross(ahead, right), ahead])
    focal, place = 1.05 * width, MIDDLE + np.array([0.0, -0.02, -0.02]) - 0.42 * ahead
    lens = hg.Camera(width, height, (focal, focal), (width / 2, height / 2), (k1, 0.0, 0.0, 0.0))
    return lens.with_pose(pose_of(rotation, -rotation @ place))


def ring(count: int, **lens: float) -> dict[str, hg.Camera]:
    """Name of the photograph → its camera, all around."""
    return {f"view{k:02d}.png": camera(2.0 * np.pi * k / count, **lens) for k in range(count)}  # type: ignore[arg-type]


def picture(view: hg.Camera, with_ball: bool = True) -> np.ndarray:
    """The photograph (height, width, 3), 8 bits."""
    step = (np.arange(SAMPLES) + 0.5) / SAMPLES
    total = np.zeros((view.height, view.width))
    for down in step:
        for along in step:
            x, y = np.meshgrid(np.arange(view.width) + along, np.arange(view.height) + down)
            total += _light(view.position, view.unproject(np.stack([x, y], axis=-1)), with_ball)
    grey = np.rint(255.0 * total / SAMPLES**2).astype(np.uint8)
    return np.repeat(grey[..., None], 3, axis=2)


def mask(view: hg.Camera) -> np.ndarray:
    """(height, width) where the ball is."""
    return np.isfinite(_to_ball(view.position, view.pixel_directions()))


@dataclass(frozen=True)
class BoardMarks:
    """Two places [m], and the board's corners."""

    one: tuple[float, float, float] = (0.03, -0.08, 0.0)
    other: tuple[float, float, float] = (-0.07, -0.02, 0.0)

    @property
    def length(self) -> float:
        return float(np.linalg.norm(np.subtract(self.one, self.other)))

    def seen_by(self, view: hg.Camera) -> tuple[float, ...]:
        return tuple(view.project(np.array([self.one, self.other])).ravel().tolist())


def structure(views: dict[str, hg.Camera], size: float = 1.0, seed: int = 3, noise: float = 0.3) -> Structure:
    """The structure of these views in other axes and another unit, as COLMAP gives one. noise: of its points [px]."""
    random = np.random.default_rng(seed)
    places = random.normal(size=(60, 3))
    places = MIDDLE + RADIUS * places / np.linalg.norm(places, axis=1, keepdims=True)
    seen = {}
    for name, view in views.items():
        towards = places - view.position
        shown = np.flatnonzero(np.einsum("ni,ni->n", towards, places - MIDDLE) < 0.0)
        seen[name] = Sightings(shown, view.project(places[shown]) + random.normal(scale=noise, size=(len(shown), 2)))
    turn = np.linalg.qr(random.normal(size=(3, 3)))[0]
    turn *= np.sign(np.linalg.det(turn))
    return Structure(views, places, seen).moved(turn, np.array([0.3, -2.0, 0.7]), size)


def _light(eye: np.ndarray, ways: np.ndarray, with_ball: bool) -> np.ndarray:
    with np.errstate(divide="ignore", invalid="ignore"):
        floor = np.where(ways[..., 2] < 0.0, -eye[2] / ways[..., 2], np.inf)
    ball = _to_ball(eye, ways) if with_ball else np.full(floor.shape, np.inf)
    ball = np.where(np.isfinite(ball), ball, np.inf)
    nearest = np.minimum(floor, ball)
    places = eye + np.where(np.isfinite(nearest), nearest, 0.0)[..., None] * ways
    light = _noise(places)
    at = (places[..., :2] - CORNER) / BOARD.square + 1.0
    rim = ((at > -1.0) & (at < np.array([BOARD.columns + 2.0, BOARD.rows + 2.0]))).all(axis=-1)
    inside = ((at > 0.0) & (at < np.array([BOARD.columns + 1.0, BOARD.rows + 1.0]))).all(axis=-1)
    square = np.where(np.floor(at).astype(int).sum(axis=-1) % 2 == 0, 0.05, 0.95)
    light = np.where((floor <= ball) & rim, np.where(inside, square, 0.95), light)
    return np.where(np.isfinite(nearest), light, 0.0)


def _to_ball(eye: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """Distance to the ball along unit directions; NaN where it is missed."""
    across = ways @ (eye - MIDDLE)
    with np.errstate(invalid="ignore"):
        return -across - np.sqrt(across**2 - (eye - MIDDLE) @ (eye - MIDDLE) + RADIUS**2)


def _noise(places: np.ndarray) -> np.ndarray:
    random = np.random.default_rng(11)
    light = np.zeros(places.shape[:-1])
    for cell in CELLS:
        table = random.uniform(0.1, 0.9, (48, 48, 48))
        light += map_coordinates(table, np.moveaxis(places / cell, -1, 0), order=1, mode="grid-wrap")
    return light / len(CELLS)
