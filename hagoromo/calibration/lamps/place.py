"""Place: the position of a near lamp from its mirror images on balls in several places, or that the lamp is far.

Every ball gives a ray: from the point P of its surface that mirrors the lamp, in the direction L. With M the mean of
the points, the lamp is parametrised by the direction d from M and the inverse q of its distance, X = M + d/q, since q
is well determined for a far lamp too, where it is 0 within its error.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.ball import Array
from hagoromo.calibration.lamps.reading import LampReading, figure_errors, slopes
from hagoromo.errors import InputError
from hagoromo.least_squares.fit_status import FitStatus, Status

NEAR = 3.0  # standard errors above which 1/distance differs from 0
ASTRAY = 12.0  # standard errors (rms) between rays and lamp: more indicate two lamps or a wrong radius
LAMP_PLACE_STEPS = 12  # of Gauss and Newton: q starts at 0, and each step roughly squares its error
LAMP_PLACE_STANDSTILL = 1e-3  # [standard error] largest last step of a fit that has converged


@dataclass(frozen=True, eq=False)
class LampPlace:
    """A lamp located by several balls.

    middle: (3,) [m], world, mean of the points that mirror it. to_lamp: (3,) unit, from there, and its standard error
    [°]. position: (3,) [m] and covariance (3, 3) [m²]; None for a lamp whose rays are parallel within errors.
    inverse_distance [1/m] from the middle and its standard error. misfit: rms of the rays' misses over their errors.
    """

    name: str
    middle: Array
    to_lamp: Array
    standard_error_deg: float
    position: Array | None
    covariance: Array | None
    inverse_distance: float
    inverse_distance_error: float
    misfit: float
    readings: tuple[LampReading, ...]

    @property
    def standard_error(self) -> Array | None:
        """(3,) [m] of the position."""
        return None if self.covariance is None else np.sqrt(np.diag(self.covariance))

    def record(self) -> dict[str, Any]:
        """An entry of lamps.json: the keys of a capture's lamp, then its errors and readings."""
        far = self.position is None or self.covariance is None
        place = {"to_lamp": self.to_lamp.tolist()} if far else {"position": self.position.tolist()}  # type: ignore
        known = {} if far else {"covariance_m2": self.covariance.tolist()}  # type: ignore
        return {
            "name": self.name,
            **place,
            "intensity": 1.0,
            "standard_error_deg": self.standard_error_deg,
            **known,
            "inverse_distance_per_m": self.inverse_distance,
            "inverse_distance_error_per_m": self.inverse_distance_error,
            "misfit": self.misfit,
            "balls": [reading.record() for reading in self.readings],
        }


def locate_lamp(readings: Sequence[LampReading], radius: float) -> LampPlace:
    """The lamp that all `readings` show, each on a ball of `radius` [m] seen through one calibrated camera.

    `InputError` for one ball, balls without a camera, or rays that do not meet in one lamp.
    """
    if not (np.isfinite(radius) and radius > 0.0):
        raise InputError(f"the radius of the ball is {radius} m: give a length above 0")
    if len(readings) < 2 or any(reading.ball.camera is None for reading in readings):
        raise InputError(
            "the place of a near lamp needs two balls, or one in two places, and a calibrated camera (--camera)"
        )
    rays = [_Ray(reading, radius) for reading in readings]
    middle = np.mean([ray.origin for ray in rays], axis=0)
    near, misfit, covariance, status = _fit(rays, middle, True)
    q, error = near[3], float(np.sqrt(covariance[2, 2]))
    name = readings[0].name
    if misfit > ASTRAY or q < -2.0 * NEAR * error:
        raise InputError(
            f"{name}: the rays of {len(rays)} balls miss each other by {misfit:.0f} times their errors "
            f"(1/distance {q:.3g} ± {error:.2g} per m): is the radius right, and one lamp on in each photograph?"
        )
    if q < NEAR * error:
        far, misfit, covariance, status = _fit(rays, middle, False)
        _check_converged(name, status)
        degrees = float(np.degrees(np.sqrt(np.trace(covariance[:2, :2]))))
        return LampPlace(name, middle, far[:3], degrees, None, None, q, error, misfit, tuple(readings))
    _check_converged(name, status)
    d, across = near[:3], _across(near[:3])
    slope = np.column_stack([across.T / q, -d / q**2])  # of X = M + d/q
    degrees = float(np.degrees(np.sqrt(np.trace(covariance[:2, :2]))))
    spread = slope @ covariance @ slope.T
    return LampPlace(name, middle, d, degrees, middle + d / q, spread, q, error, misfit, tuple(readings))


class _Ray:
    """origin (3,) [m], direction (3,), and their slopes (5, 3) by the measured coordinates, with errors (5,)."""

    def __init__(self, reading: LampReading, radius: float) -> None:
        ball, camera = reading.ball, reading.ball.camera
        assert camera is not None
        shown = ball.mirrored([reading.highlight.centre])
        self.origin = camera.position + radius * (shown.centre + shown.normal[0])
        self.direction = reading.to_lamp
        of_place, self.of_direction = slopes(reading.highlight, ball)
        self.of_origin = radius * of_place
        self.errors = figure_errors(reading.highlight, ball)

    def miss(self, towards: Array, q: float, middle: Array) -> tuple[Array, Array]:
        """Distance (2,) by which the ray misses the lamp, and its covariance (2, 2)."""
        wanted = towards + q * (middle - self.origin)
        length = np.linalg.norm(wanted)
        wanted = wanted / length
        across = _across(wanted)
        slope = -self.of_direction @ across.T - q / length * self.of_origin @ across.T  # (5, 2)
        slope = slope * self.errors[:, None]
        return across @ (wanted - self.direction), slope.T @ slope


def _fit(rays: Sequence[_Ray], middle: Array, near: bool) -> tuple[Array, float, Array, FitStatus]:
    """(d, q) (4,), misfit, the covariance (3, 3) of d's two turns and q, and how the fit ended.

    q stays 0 unless `near`. The last step is in standard errors.
    """
    towards = np.mean([ray.direction for ray in rays], axis=0)
    towards, q = towards / np.linalg.norm(towards), 0.0
    count = 3 if near else 2
    loss, normal, push, last = 0.0, np.eye(3), np.zeros(count), np.inf
    for _ in range(LAMP_PLACE_STEPS):
        across, tiny = _across(towards), 1e-6 * np.eye(3)
        normal, push, loss = np.zeros((count, count)), np.zeros(count), 0.0
        for ray in rays:
            miss, covariance = ray.miss(towards, q, middle)
            tilts = [ray.miss(_turned(towards, across, step[:2]), q + step[2], middle)[0] for step in tiny]
            slope = np.stack([(tilt - miss) / 1e-6 for tilt in tilts[:count]], axis=1)
            weighed = slope.T @ np.linalg.inv(covariance)
            normal += weighed @ slope
            push -= weighed @ miss
            loss += float(miss @ np.linalg.solve(covariance, miss))
        change = np.linalg.solve(normal, push)
        last = float(np.sqrt(max(change @ normal @ change, 0.0)))
        towards = _turned(towards, across, change[:2])
        q += float(change[2]) if near else 0.0
    freedom = max(2 * len(rays) - count, 1)
    misfit = float(np.sqrt(loss / freedom))
    covariance = np.zeros((3, 3))
    covariance[:count, :count] = np.linalg.inv(normal) * max(misfit, 1.0) ** 2
    converged = last < LAMP_PLACE_STANDSTILL * max(misfit, 1.0)
    status = Status.CONVERGED if converged else Status.OUT_OF_STEPS
    gradient = float(np.linalg.norm(push))
    ended = FitStatus(status, LAMP_PLACE_STEPS, 0.5 * loss, gradient, last)
    return np.r_[towards, q], misfit, covariance, ended


def _check_converged(name: str, status: FitStatus) -> None:
    if not status.converged:
        raise InputError(f"{status.remark(name)}: move the balls farther apart, or photograph one more")


def _turned(towards: Array, across: Array, by: NDArray) -> Array:
    turned = towards + by @ across
    return turned / np.linalg.norm(turned)


def _across(towards: Array) -> Array:
    """(2, 3) two unit vectors at right angles to `towards` and to each other."""
    first = np.cross(np.eye(3)[np.argmin(np.abs(towards))], towards)
    first /= np.linalg.norm(first)
    return np.stack([first, np.cross(towards, first)])
