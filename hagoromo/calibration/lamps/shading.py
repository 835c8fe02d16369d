"""Shading: the direction to a lamp from the diffuse light of a ball that is no mirror, such as glazed clay or plastic.

v = a + b max(N·L, 0)^p: p is 1 for linear numbers, about 0.5 for sRGB. The fit is robust, so a highlight does not draw
it. It is right to some degrees, as no body is quite Lambertian; that is enough to say where the highlight is.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from hagoromo.calibration.lamps.ball import Array, Ball
from hagoromo.calibration.lamps.light_on_ball import Light, LightOnBall, enlarged, reduced
from hagoromo.least_squares.fit_status import scipy_status

SIDE, PREDICTED = 40, 160  # [px] of the reduced ball that is fitted, and of the one whose light is predicted
INNER = 0.92  # of the radius: pixels outside are steep, and mirror much
CLIPPED, FEWEST = 0.98, 60  # of white; pixels that are not
LEAST_GAIN, LARGEST_MISFIT = 0.03, 0.06  # of white; of the gain: scatter of the residuals
POWERS, LIMITS = (0.4, 1.6), (0.3, 1.8)  # of N·L on a body; limits of the fit: a mirrored room has a power at a limit
SHADING_ERROR = 3.0  # [°] by which bodies that are not Lambertian mislead
SHADING_STEPS = 300  # largest number of evaluations of the fit
LOSS = 0.03  # of the range of the values: where robust weights begin
NEARBY, AROUND = 12.0, 25.0  # [°] from the shading's direction: the middle of the highlight, and all of it, are nearer


@dataclass(frozen=True, eq=False)
class BallShading:
    """to_lamp (3,) unit and its standard error [°]; ambient a, gain b [white], and power p of the fit.

    is_body: whether the power is that of a body. Where the lamp is near the camera no dark side shows the power.
    """

    to_lamp: Array
    standard_error_deg: float
    ambient: float
    gain: float
    power: float

    @property
    def is_body(self) -> bool:
        """Whether this is a body's shading, and no mirrored room."""
        return POWERS[0] < self.power < POWERS[1]

    def predicted(self, normals: Array) -> Array:
        """(n,) light [white] at normals (n, 3)."""
        return self.ambient + self.gain * np.maximum(normals @ self.to_lamp, 0.0) ** self.power


def shading_of(seen: LightOnBall, ball: Ball) -> BallShading | None:
    """The shading of the ball; None where its light is not that of a body under one lamp."""
    from scipy.optimize import least_squares

    values, normals = _body(seen, ball)
    if len(values) < FEWEST:
        return None
    low, high = np.percentile(values, [2.0, 98.0])
    spread = float(high - low)
    if spread < LEAST_GAIN:
        return None
    design = np.c_[normals, np.ones(len(normals))]
    start = np.linalg.lstsq(design, values, rcond=None)[0][:3]
    start = start / max(float(np.linalg.norm(start)), 1e-12)
    across = np.linalg.svd(start[None])[2][1:]

    def shading(parameters: Array) -> BallShading:
        towards = start + parameters[:2] @ across
        unit = towards / np.linalg.norm(towards)
        return BallShading(unit, SHADING_ERROR, parameters[2], parameters[3], float(np.exp(parameters[4])))

    bounds = [[-3.0, -3.0, -1.0, 0.0, np.log(LIMITS[0])], [3.0, 3.0, 1.0, 4.0, np.log(LIMITS[1])]]
    fit = least_squares(
        lambda parameters: shading(parameters).predicted(normals) - values,
        [0.0, 0.0, float(np.clip(low, -0.9, 0.9)), min(spread, 3.9), np.log(0.8)],
        bounds=bounds, loss="soft_l1", f_scale=LOSS * spread, max_nfev=SHADING_STEPS,
    )  # fmt: skip
    found = shading(fit.x)
    residuals = found.predicted(normals) - values
    misfit = 1.4826 * float(np.median(np.abs(residuals - np.median(residuals))))
    fits = scipy_status(fit).converged and found.gain > LEAST_GAIN and misfit < LARGEST_MISFIT * found.gain
    return found if fits else None


def above_shading(seen: LightOnBall, ball: Ball, shading: BallShading) -> tuple[Light, Light]:
    """(h, w) light [white] above the shading, around where the lamp's image is, and the same where that can be."""
    coarse, _ = reduced(seen.light, PREDICTED)
    shown = ball.mirrored(_centres(seen, coarse.shape))
    cosine = shown.to_lamp @ shading.to_lamp
    maps = shading.predicted(shown.normal), cosine > np.cos(np.radians(AROUND)), cosine > np.cos(np.radians(NEARBY))
    body, around, near = (enlarged(one.astype(np.float32).reshape(coarse.shape), seen.light.shape) for one in maps)
    above = np.where(seen.on & (around > 0.5), np.maximum(seen.light - body, 0.0), np.float32(0.0))
    return above, np.where(near > 0.5, above, np.float32(0.0))


def _body(seen: LightOnBall, ball: Ball) -> tuple[Array, Array]:
    """Light (n,) [white] and normals (n, 3) of the reduced ball, without what is clipped."""
    values, _ = reduced(seen.light, SIDE)
    clipped, _ = reduced((seen.light >= CLIPPED * seen.light.max()).astype(np.float32), SIDE)
    centres = _centres(seen, values.shape)
    away = np.hypot(*(centres - ball.outline(64).mean(axis=0)).T)
    used = (away < INNER * ball.radius) & (clipped.ravel() < 0.02)
    return values.ravel()[used].astype(np.float64), ball.mirrored(centres[used]).normal


def _centres(seen: LightOnBall, shape: tuple[int, ...]) -> Array:
    """(n, 2) image points (x, y) [px] of the pixels of the box, reduced to `shape`."""
    rows, columns = ((np.arange(few) + 0.5) * many / few for few, many in zip(shape, seen.light.shape, strict=True))
    y, x = np.meshgrid(rows, columns, indexing="ij")
    return np.stack([x.ravel(), y.ravel()], axis=1) + seen.corner[::-1].astype(np.float64)
