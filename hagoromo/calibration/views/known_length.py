"""The scale of a structure by something of known size: two marked points, a calibration board, or a ball.

Each is fitted to the photographs that show it, with the cameras held, by residuals in pixels; two photographs at least
must show it. The standard error of the scale comes from the spread of these residuals: that of single points, or, where
it is larger, that between photographs.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.camera.board import Board
from hagoromo.calibration.views.structure import Structure
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import scipy_status

Array = NDArray[np.float64]
Metres = Callable[[Array], tuple[float, Array]]
LEAST_SHOWN = 2  # photographs that fix a place in space
LEAST_AGREEING = 3  # photographs of a board that must agree for one that contradicts them to be left out
BY_HAND = 1.0  # [px] standard error of what a person marks, at least
BY_PROGRAM = 0.05  # [px] of corners of a board, at least
CONTRADICTION = 0.02  # of the longer side of a photograph, by which its marks may be off
AROUND = 24  # points of a ball's outline that stand for it
NUMBER = r"(\d{1,6}(?:\.\d{1,6})?)"


class FoundScale(NamedTuple):
    """metres: of one unit of the structure. error: standard error, relative. rms: of the residuals [px]. source: in
    words. photographs: that show it.
    """

    metres: float
    error: float
    rms: float
    source: str
    photographs: tuple[str, ...]


@dataclass(frozen=True)
class KnownLength:
    """A length [m] between two points. marks: photograph → (x, y) of the one and (x, y) of the other [px]."""

    length: float
    marks: Mapping[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        """Check the length."""
        _check_length(self.length, "the length (--length)")


@dataclass(frozen=True)
class KnownBall:
    """A ball of a radius [m]. circles: photograph → x, y and radius of its outline [px]."""

    radius: float
    circles: Mapping[str, tuple[float, ...]]

    def __post_init__(self) -> None:
        """Check the radius."""
        _check_length(self.radius, "the radius of the ball (--radius)")


def read_marks(stated: Sequence[str], numbers: int, option: str) -> dict[str, tuple[float, ...]]:
    """Photograph → numbers, of entries such as "DSC_0007.jpg,120,340.5,410,338"; `InputError` for another form."""
    pattern = re.compile("(.+)" + f",{NUMBER}" * numbers)
    marks: dict[str, tuple[float, ...]] = {}
    for entry in stated:
        found = pattern.fullmatch(entry)
        if found is None:
            what = "x1,y1,x2,y2" if numbers == 4 else "x,y,radius"
            raise InputError(f"{option} is {entry!r:.60}: give PHOTOGRAPH,{what} in pixels")
        if found[1] in marks:
            raise InputError(f"{option} marks {found[1]} twice: mark it once")
        marks[found[1]] = tuple(float(figure) for figure in found.groups()[1:])
    return marks


def scale_of(
    given: KnownLength | KnownBall | Board, structure: Structure, picture: Callable[[str], NDArray]
) -> FoundScale:
    """The scale of a structure. picture: name of a photograph → its pixels, in which a board is sought.

    `InputError` where fewer than two placed photographs show it, or the fit does not converge.
    """
    if isinstance(given, KnownBall):
        return _by_ball(given, structure)
    if isinstance(given, KnownLength):
        placed = _placed(given.marks, structure, "--length-between")
        seen = {name: np.array(marks).reshape(2, 2) for name, marks in placed.items()}
        return _by_length(given.length, seen, structure)
    points = np.zeros((given.rows * given.columns, 3))
    row, column = np.mgrid[: given.rows, : given.columns]
    points[:, 0], points[:, 1] = given.square * column.ravel(), given.square * row.ravel()
    found = {
        name: corners for name in structure.views if (corners := _corners(given, points, picture(name))) is not None
    }
    if len(found) < LEAST_SHOWN:
        raise InputError(
            f"a {given} was found in {len(found)} of {len(structure.views)} photographs, and scale needs "
            f"{LEAST_SHOWN}: check board (--board), or give another scale"
        )
    if not given.marker:
        found = _in_one_order(found, structure)
    return _by_board(points, found, structure, f"a {given}")


def _placed(marks: Mapping[str, tuple[float, ...]], structure: Structure, option: str) -> dict[str, tuple[float, ...]]:
    """The marks of photographs that have a camera; names may leave their suffix out."""
    named = {key: name for name in structure.views for key in (name, name.rsplit(".", 1)[0])}
    unknown = [name for name in marks if name not in named]
    left = [name for name in unknown if name in {n for k in structure.left_out for n in (k, k.rsplit(".", 1)[0])}]
    if len(unknown) > len(left):
        other = next(name for name in unknown if name not in left)
        raise InputError(f"{option} names {other!r:.60}, which is none of the photographs: give the name of its file")
    placed = {named[name]: figures for name, figures in marks.items() if name in named}
    if len(placed) < LEAST_SHOWN:
        raise InputError(
            f"{option} marks {len(placed)} photographs that could be placed: mark the same in {LEAST_SHOWN} at least"
        )
    return placed


def _corners(board: Board, points: Array, picture: NDArray) -> Array | None:
    """(n, 2) image of all corners of the board [px], NaN where it is not seen; None without a board."""
    found = board.find(picture)
    if found is None:
        return None
    near = np.argmin(((points[:, None] - found.points[None]) ** 2).sum(axis=2), axis=0)
    image = np.full((len(points), 2), np.nan)
    image[near] = found.image + 0.5  # OpenCV's origin is the centre of the first pixel
    return image


def _in_one_order(found: Mapping[str, Array], structure: Structure) -> dict[str, Array]:
    """Corners of a chessboard in one order: it looks the same when it is turned by half a turn."""
    names = list(found)
    ordered = {names[0]: found[names[0]]}
    for name in names[1:]:
        choices = [found[name], found[name][::-1]]
        misfits = []
        for choice in choices:
            both = ordered | {name: choice}
            places = triangulated(both, structure)
            misfits.append(np.nansum([(structure.views[n].project(places) - image) ** 2 for n, image in both.items()]))
        ordered[name] = choices[int(np.argmin(misfits))]
    return ordered


def triangulated(seen: Mapping[str, Array], structure: Structure) -> Array:
    """(n, 3) places nearest to the rays through image points, name → (n, 2) [px], NaN where one is not seen."""
    matrix, right = 0.0, 0.0
    for name, image in seen.items():
        camera = structure.views[name]
        ways = np.nan_to_num(camera.unproject(image))
        across = np.isfinite(image[:, :1, None]) * (np.eye(3) - ways[:, :, None] * ways[:, None, :])
        matrix, right = matrix + across, right + across @ camera.position
    return np.einsum("nij,nj->ni", np.linalg.pinv(matrix), right)


def _by_length(length: float, seen: Mapping[str, Array], structure: Structure) -> FoundScale:
    """The scale by two points of known distance [m]: both are placed freely."""

    def residuals(x: Array, name: str) -> Array:
        return (structure.views[name].project(x.reshape(2, 3)) - seen[name]).ravel()

    def metres(x: Array) -> tuple[float, Array]:
        apart = x[3:] - x[:3]
        units = max(float(np.linalg.norm(apart)), 1e-30)
        return length / units, np.concatenate([apart, -apart]) / units**2

    start = triangulated(seen, structure).ravel()
    return _ScaleFit(residuals, metres, f"a length of {length:g} m", BY_HAND).scale(start, _shown_by(seen, structure))


def _by_board(points: Array, seen: Mapping[str, Array], structure: Structure, source: str) -> FoundScale:
    """The scale by a board. A photograph that contradicts the others, as where something hides a part of the board and
    a corner is found beside it, is left out as long as LEAST_AGREEING are left.
    """
    left = dict(seen)
    while True:
        try:
            return _by_points(points, left, structure, source)
        except _Contradiction as found:
            if len(left) <= LEAST_AGREEING:
                raise
            del left[found.photograph]


def _by_points(points: Array, seen: Mapping[str, Array], structure: Structure, source: str) -> FoundScale:
    """The scale by points (n, 3) [m] of known distances: they are placed as one rigid body of a free size."""
    from scipy.spatial.transform import Rotation

    places = triangulated(seen, structure)
    known = np.isfinite(places).all(axis=1) & (np.sum([np.isfinite(i[:, 0]) for i in seen.values()], axis=0) > 1)
    if known.sum() < 2:
        raise InputError(f"{source} gives no scale: its points must be shown by {LEAST_SHOWN} photographs at least")
    own, other = (each - each[known].mean(axis=0) for each in (points, places))
    u, _, vt = np.linalg.svd(other[known].T @ own[known])
    turn = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))]) @ vt
    size = np.sqrt((other[known] ** 2).sum() / (own[known] ** 2).sum())
    start = np.concatenate([[np.log(size)], Rotation.from_matrix(turn).as_rotvec(), places[known].mean(axis=0)])

    def residuals(x: Array, name: str) -> Array:
        placed = np.exp(x[0]) * own @ Rotation.from_rotvec(x[1:4]).as_matrix().T + x[4:]
        return (structure.views[name].project(placed) - seen[name])[np.isfinite(seen[name][:, 0])].ravel()

    return _ScaleFit(residuals, _by_first(1.0), source, BY_PROGRAM).scale(start, _shown_by(seen, structure))


def _by_ball(given: KnownBall, structure: Structure) -> FoundScale:
    """The scale by the outlines of a ball: they are cones of rays that touch it."""
    placed = _placed(given.circles, structure, "--ball")
    ring = np.linspace(0.0, 2.0 * np.pi, AROUND, endpoint=False)
    rays = {}
    for name, (x, y, radius) in placed.items():
        edge = np.array([x, y]) + radius * np.stack([np.cos(ring), np.sin(ring)], axis=1)
        rays[name] = structure.views[name].unproject(edge)
    middle = triangulated({name: np.array([[x, y]]) for name, (x, y, _) in placed.items()}, structure)[0]
    sizes = [
        np.linalg.norm(middle - structure.views[name].position) * radius / np.mean(structure.views[name].focal)
        for name, (_, _, radius) in placed.items()
    ]
    start = np.concatenate([[np.log(np.mean(sizes))], middle])

    def residuals(x: Array, name: str) -> Array:
        camera = structure.views[name]
        to_ball = x[1:] - camera.position
        distance = np.linalg.norm(to_ball)
        angle = np.arccos(np.clip(rays[name] @ to_ball / distance, -1.0, 1.0))
        touching = np.arcsin(np.clip(np.exp(x[0]) / distance, 0.0, 1.0))
        return np.mean(camera.focal) * (angle - touching) / np.sqrt(AROUND / 3.0)  # three numbers were read

    source = f"a ball of {given.radius:g} m"
    return _ScaleFit(residuals, _by_first(given.radius), source, BY_HAND).scale(start, _shown_by(placed, structure))


def _shown_by(seen: Mapping[str, object], structure: Structure) -> dict[str, Camera]:
    """The cameras of the photographs that show something."""
    return {name: structure.views[name] for name in seen}


def _by_first(length: float) -> Metres:
    """The scale of a fit whose first parameter is the logarithm of a `length` in the unit of the structure."""
    return lambda x: (length * np.exp(-x[0]), -np.eye(len(x))[0])


class _Contradiction(InputError):
    """photograph: the one that shows something where the others do not have it."""

    def __init__(self, photograph: str, message: str) -> None:
        super().__init__(message)
        self.photograph = photograph


class _ScaleFit(NamedTuple):
    """residuals: parameters, name of a photograph → residuals [px]. metres: parameters → scale, and the gradient of its
    logarithm. source: in words. least: standard error of a residual, at least [px].
    """

    residuals: Callable[[Array, str], Array]
    metres: Metres
    source: str
    least: float

    def scale(self, start: Array, cameras: Mapping[str, Camera]) -> FoundScale:
        """The scale by least squares of all photographs. `InputError` where they contradict each other."""
        from scipy.optimize import least_squares

        def of_all(x: Array) -> Array:
            return np.concatenate([self.residuals(x, name) for name in cameras])

        fit = least_squares(of_all, start, x_scale="jac")
        if not scipy_status(fit).converged:
            raise InputError(f"{self.source} gives no scale: its fit does not converge; check what is marked")
        parts = {name: self.residuals(fit.x, name) for name in cameras}
        self._check(parts, cameras)
        size, gradient = self.metres(fit.x)
        influence = np.linalg.pinv(fit.jac.T @ fit.jac) @ gradient
        free = max(len(fit.fun) - len(fit.x), 1)
        variance = max(float((fit.fun**2).sum()) / free, self.least**2) * float(gradient @ influence)
        jacobians = np.split(fit.jac, np.cumsum([len(part) for part in parts.values()])[:-1])
        pulls = [float(influence @ own.T @ part) for own, part in zip(jacobians, parts.values(), strict=True)]
        between = len(parts) / (len(parts) - 1.0) * float(np.square(pulls).sum())
        rms = float(np.sqrt(2.0 * (fit.fun**2).mean()))
        return FoundScale(float(size), float(np.sqrt(max(variance, between))), rms, self.source, tuple(cameras))

    def _check(self, parts: Mapping[str, Array], cameras: Mapping[str, Camera]) -> None:
        worst = max(parts, key=lambda name: float(np.abs(parts[name]).max()))
        off, camera = float(np.abs(parts[worst]).max()), cameras[worst]
        if off > CONTRADICTION * max(camera.width, camera.height):
            raise _Contradiction(
                worst,
                f"{self.source} is not in one place: {worst} shows it {off:.0f} px from where the other photographs "
                "have it; check what is marked there, and that it did not move",
            )


def _check_length(length: float, what: str) -> None:
    if not (np.isfinite(length) and 0.0 < length < 1e6):
        raise InputError(f"{what} is {length} m: give a length above 0")
