"""Photographs of a painted relief at two dates: the camera and the lamps differ, and what happened to it is known.

The relief is a height over a plate, in metres. Light is a transcription of Tanaka eq. (2)–(6) that shares no line with
the product; each pixel is the mean of nine rays.
"""

from dataclasses import dataclass, field
from functools import cache
from typing import Any

import numpy as np
from scipy.ndimage import gaussian_filter, map_coordinates

import hagoromo as hg
from hagoromo.measurement.gloss.gloss_map import GlossMap
from hagoromo.measurement.material.body_map import BodyMap
from hagoromo.measurement.photographed import Photographed
from hagoromo.reflectance.material.material_estimate import MaterialEstimate
from tests.inverse.simulated_ball import BallMaterial, reflected

HALF = (0.017, 0.015)  # m, half sides of the plate
CELLS = 601  # of the table of its paint, along each side
REACH = 0.02  # m, half side of the table
FULL_WELL, READ_NOISE = 40_000.0, 6.0  # electrons
ERRORS = (0.006, 0.002, 1.5e-6, 0.1)  # of ln paint, of normals about an axis [rad], of points [m], of ln β
GLOSS = (0.5, 0.25, 1.5)  # β [1/sr], γ [rad], n


@dataclass(frozen=True)
class SimulatedRelief:
    """A relief. seed: of its shape and paint. patina: standard deviation of ln β over it, 0 for one gloss. What
    happened to discs (x, y, radius) [m]: fade: factors on the paint, flake: depth that is lost [m], polish: factor on
    β.
    """

    seed: int = 0
    patina: float = 0.0
    fade: dict = field(default_factory=dict)
    flake: dict = field(default_factory=dict)
    polish: dict = field(default_factory=dict)

    def height(self, x, y):
        """[m]"""
        random = np.random.default_rng(self.seed)
        found = np.zeros(np.shape(x))
        for _ in range(14):
            cx, cy, radius = *random.uniform(-0.015, 0.015, 2), random.uniform(0.002, 0.004)
            found += random.uniform(-0.25, 0.25) * radius * np.exp(-((x - cx) ** 2 + (y - cy) ** 2) / radius**2)
        for disc, depth in self.flake.items():
            found -= depth * self._inside(disc, x, y)
        return found

    def _inside(self, disc, x, y):
        """1 in the disc, 0 beside it, over an edge of 0.3 mm."""
        away = np.hypot(x - disc[0], y - disc[1]) - disc[2]
        return 0.5 * (1.0 - np.tanh(away / 1.5e-4))

    def paint(self, x, y):
        """α c_b (…, 3) [1/sr]"""
        means = (0.16, 0.12, 0.09)
        found = np.stack([m * np.exp(0.3 * _texture(self.seed, k, x, y)) for k, m in enumerate(means)], axis=-1)
        for disc, factor in self.fade.items():
            found = found * (1.0 + (np.asarray(factor) - 1.0) * self._inside(disc, x, y)[..., None])
        return found

    def beta(self, x, y):
        """β [1/sr]"""
        found = GLOSS[0] * np.exp(self.patina * _texture(self.seed, 3, x, y))
        for disc, factor in self.polish.items():
            found = found * (1.0 + (factor - 1.0) * self._inside(disc, x, y))
        return found


@cache
def _table(seed, layer):
    table = gaussian_filter(np.random.default_rng((seed, layer)).standard_normal((CELLS, CELLS)), CELLS / 40)
    return table / table.std()


def _texture(seed, layer, x, y):
    """A smooth pattern of mean 0 and standard deviation 1."""
    place = [(np.asarray(one) + REACH) * (CELLS - 1) / (2 * REACH) for one in (y, x)]
    return map_coordinates(_table(seed, layer), place, order=1, mode="nearest")


def relief_camera(size=96, eye=(0.0, 0.0, 0.4), roll=0.0, target=(0.0, 0.0, 0.0)):
    """A camera that sees the plate; roll [°] of its picture."""
    away = float(np.linalg.norm(np.subtract(eye, target)))
    focal = 0.45 * size * away / HALF[0]
    up = (np.sin(np.radians(roll)), np.cos(np.radians(roll)), 0.0)
    return hg.Camera(size, size, (focal, focal), (size / 2, size / 2)).look_at(eye, target, up=up)


def dome(count=12, turn=0.0, tilts=(30.0, 55.0)):
    """Unit vectors to far lamps, in rings."""
    k = np.arange(count)
    tilt, around = np.radians(np.array(tilts)[k % len(tilts)]), 2 * np.pi * k / count + np.radians(turn)
    return np.stack([np.sin(tilt) * np.cos(around), np.sin(tilt) * np.sin(around), np.cos(tilt)], axis=1)


def places(relief, camera, rows, columns):
    """Where rays meet the relief (…, 3) [m], its normals there, and whether they meet the plate."""
    ray = np.stack([(columns - camera.principal[0]) / camera.focal[0], (rows - camera.principal[1]) / camera.focal[1],
                    np.ones_like(rows)], axis=-1) @ camera.camera_to_world[:3, :3].T  # fmt: skip
    z = np.zeros(rows.shape)
    for _ in range(6):
        along = (z - camera.position[2]) / ray[..., 2]
        x, y = camera.position[0] + along * ray[..., 0], camera.position[1] + along * ray[..., 1]
        z = relief.height(x, y)
    step = 2e-5
    slope = [(relief.height(x + dx, y + dy) - relief.height(x - dx, y - dy)) / (2 * step)
             for dx, dy in ((step, 0.0), (0.0, step))]  # fmt: skip
    normals = np.stack([-slope[0], -slope[1], np.ones_like(z)], axis=-1)
    inside = (np.abs(x) < HALF[0]) & (np.abs(y) < HALF[1])
    return np.stack([x, y, z], axis=-1), normals / np.linalg.norm(normals, axis=-1, keepdims=True), inside


def relief_capture(relief, camera, lamps, seed, gloss=True):
    """The capture of unknown shape, one photograph per far lamp."""
    random = np.random.default_rng(seed)
    sub = (np.arange(3) + 0.5) / 3
    rows = (np.arange(camera.height)[:, None] + sub).ravel()
    columns = (np.arange(camera.width)[:, None] + sub).ravel()
    points, normals, inside = places(relief, camera, *np.meshgrid(rows, columns, indexing="ij"))
    to_eye = camera.position - points
    to_eye /= np.linalg.norm(to_eye, axis=-1, keepdims=True)
    paint, beta = relief.paint(points[..., 0], points[..., 1]), relief.beta(points[..., 0], points[..., 1])
    truth = BallMaterial((0.0, 0.0, 0.0), 1.0 if gloss else 0.0, *GLOSS[1:])
    mask, photographs = _of_pixels(inside.astype(float)) > 0.999, []
    for number, lamp in enumerate(lamps):
        toward = np.broadcast_to(lamp, normals.shape)
        light = np.maximum((normals * lamp).sum(-1), 0.0)[..., None] * paint
        light = light + beta[..., None] * reflected(normals, toward, to_eye, truth)
        light = _of_pixels(light * inside[..., None])
        exposure = 0.85 * FULL_WELL / light.max()
        counted = random.poisson(light * exposure) + random.normal(0.0, READ_NOISE, light.shape)
        variance = (np.maximum(counted, 0.0) + 1.0 + READ_NOISE**2) / exposure**2
        lit_by = (hg.Lamp(to_lamp=lamp, intensity=1.0),)
        photographs.append(hg.Photograph(counted / exposure, variance, mask, camera, lit_by, f"lamp {number}"))
    return hg.Capture(tuple(photographs), "relief")


def _of_pixels(values):
    """Means over the nine rays of each pixel."""
    height, width = values.shape[0] // 3, values.shape[1] // 3
    return values.reshape(height, 3, width, 3, *values.shape[2:]).mean(axis=(1, 3))


def relief_measurement(relief, camera, seed, moved=None, errors=True):
    """A measurement as `measure` would give it, made from the truth and noise of the errors that it states (ERRORS).

    moved: (4, 4) pose of the relief in the measurement's world; camera: as seen before that.
    """
    random = np.random.default_rng(seed)
    rows, columns = np.mgrid[: camera.height, : camera.width] + 0.5
    points, normals, inside = places(relief, camera, rows, columns)
    moved = np.eye(4) if moved is None else moved
    of_paint, of_normal, of_point, of_beta = ERRORS
    ray = (points - camera.position) / np.linalg.norm(points - camera.position, axis=-1, keepdims=True)
    body = relief.paint(points[..., 0], points[..., 1])
    body = body * (1.0 + of_paint * random.standard_normal(body.shape))
    beta = relief.beta(points[..., 0], points[..., 1]) * np.exp(of_beta * random.standard_normal(inside.shape))
    points = points + ray * of_point * random.standard_normal(inside.shape)[..., None]
    normals = normals + of_normal * random.standard_normal(normals.shape)
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    points, normals = points @ moved[:3, :3].T + moved[:3, 3], normals @ moved[:3, :3].T
    labels = np.where(inside, 0, -1)
    there = lambda values: np.where(inside[..., None], values, 0.0).astype(np.float32)  # noqa: E731
    material = _material(int(inside.sum()))
    flat = lambda value: np.where(inside, value, np.nan)  # noqa: E731
    gloss = GlossMap(flat(beta), flat(GLOSS[1]), flat(of_beta * beta), flat(0.05 * GLOSS[1]), body, of_paint * body)
    known = np.where(inside[..., None], body, np.nan)
    variances = [np.where(inside, one, np.inf).astype(np.float32) for one in (2 * of_normal**2, of_point**2)]
    lamps = tuple(hg.Lamp(to_lamp=one @ moved[:3, :3].T) for one in dome())
    maps = gloss if relief.patina else None
    painted = BodyMap(known, of_paint * known if errors else None, (material,), labels, gloss=maps)
    return hg.Measurement(
        (material,), labels, (), (), there(normals), there(points), painted,
        normal_variance=variances[0] if errors else None, distance_variance=variances[1] if errors else None,
        photographed=Photographed(camera.with_pose(camera.world_to_camera @ np.linalg.inv(moved)), lamps, "relief"),
    )  # fmt: skip


def _material(pixels):
    """One material of the relief's gloss, whose parameters have errors of 5 %."""
    values: dict[str, Any] = {
        "alpha": 0.12,
        "beta": GLOSS[0],
        "gamma": GLOSS[1],
        "n": GLOSS[2],
        "specular_albedo": 0.03,
    }
    colours: dict[str, Any] = {"body_colour": (1.3, 1.0, 0.7), "interface_colour": (1.0, 1.0, 1.0)}
    intervals = {key: (0.9 * value, 1.1 * value) for key, value in values.items()}
    intervals |= {key: tuple((0.9 * one, 1.1 * one) for one in value) for key, value in colours.items()}
    correlation = tuple(tuple(1.0 if i == j else 0.0 for j in range(4)) for i in range(4))
    return MaterialEstimate(
        "paint", pixels, **colours, **values, standard_error={key: 0.05 * value for key, value in values.items()},
        interval_95=intervals, correlation=correlation, identifiable=dict.fromkeys(values, True), chi_square=1.0,
    )  # fmt: skip
