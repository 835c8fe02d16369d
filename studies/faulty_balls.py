"""Simulated balls whose lamps, reflectance and pixels are not quite as a capture says, with their true normals.

Enters: a condition of CONDITIONS, lamps, a seed. Leaves: a capture as a camera far away takes it, with 8 bits, and the
truth at the centre of every pixel. A pixel is the mean of FINER² points on the ball, or of what is behind it, and the
mask has the pixels whose centre is on the ball. The lobe is that of the fits (Gaussian facets), or one that they do not
have: of Trowbridge and Reitz, whose tails are longer.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.backend import arrays

Array = NDArray[Any]
FOCAL = 1e6  # px: a ball is seen along one direction; depth is off by 5e-4 px
PIXEL = 5e-4  # m
FINER = 3  # points along a side of a pixel
FULL_WELL, READ_NOISE, BITS = 20_000.0, 10.0, 8  # electrons
METERED = 0.85  # of white: the 99.8th percentile of the brightest photograph
BODY = (0.30, 0.24, 0.20)  # α c_b in the three channels, over which patches vary by VARIED
VARIED = 0.2
BACKGROUND = 0.01  # of the body's light: what the pixels of the rim have beside the ball
F0 = 0.04  # of the interface at normal incidence
BETA, GAMMA = 0.6, 0.2  # of the lobe that the fits have [rad]


@dataclass(frozen=True)
class BallFaults:
    """What is wrong: standard deviations of the lamps' directions [°] and of their strengths; roughness of a lobe that
    the fits do not have, 0 for one that they have.
    """

    direction_deg: float = 0.0
    strength: float = 0.0
    roughness: float = 0.0


CONDITIONS = {
    "noise": BallFaults(),
    "lamps": BallFaults(direction_deg=1.0, strength=0.03),
    "lobe": BallFaults(roughness=0.35),
    "all": BallFaults(direction_deg=1.0, strength=0.03, roughness=0.35),
}


@dataclass(frozen=True, eq=False)
class FaultyBall:
    """capture: as it is stated. normals (h, w, 3), radii (h, w): true ones of the pixels' centres, and their distance
    from the middle over the ball's radius. body (h, w, C): α c_b. depth (h, w) [m] towards the camera. 0 beside it.
    """

    capture: hg.Capture
    normals: Array
    radii: Array
    body: Array
    depth: Array


def lamp_directions(count: int) -> Array:
    """(count, 3) unit, around the camera at two heights, in turn 25° and 45° from its axis."""
    angle = 2.0 * np.pi * (np.arange(count) + 0.3) / count
    away = np.radians(np.where(np.arange(count) % 2, 25.0, 45.0))
    return np.stack([np.sin(away) * np.cos(angle), np.sin(away) * np.sin(angle), np.cos(away)], axis=1)


def faulty_ball(condition: BallFaults, lamps: int, seed: int, size: int = 72) -> FaultyBall:
    """Photographs of a ball under lamps that differ from the stated ones as `condition` says."""
    random = np.random.default_rng([seed, lamps])
    stated = lamp_directions(lamps)
    # two components across the direction, of half its variance each
    moved = stated + np.radians(condition.direction_deg) / np.sqrt(2.0) * random.normal(size=stated.shape)
    moved /= np.linalg.norm(moved, axis=1, keepdims=True)
    strength = np.exp(condition.strength * random.normal(size=lamps))
    radius = 0.46 * size
    fine, on_ball = _normals(size, radius, FINER)
    body = _body(fine, on_ball, random)
    light = [
        s * _pixels(np.where(on_ball[..., None], _shaded(fine, body, towards, condition), BACKGROUND * np.array(BODY)))
        for towards, s in zip(moved, strength, strict=True)
    ]
    return _photographed(light, stated, radius, _pixels(body), seed)


def _photographed(light: list[Array], stated: Array, radius: float, body: Array, seed: int) -> FaultyBall:
    size = len(body)
    white = max(float(np.percentile(one, 99.8)) for one in light) / METERED
    sensor = hg.Sensor(FULL_WELL / white, FULL_WELL, READ_NOISE, FULL_WELL / (2.0**BITS - 1.0), 0.0, BITS)
    camera = hg.Camera(size, size, (FOCAL, FOCAL), (size / 2, size / 2), sensor=sensor, name="simulated")
    camera = camera.look_at((0.0, 0.0, FOCAL * PIXEL), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    normals, on_ball = _normals(size, radius, 1)
    shots = []
    for k, (value, towards) in enumerate(zip(light, stated, strict=True)):
        developed = hg.develop_raw(hg.expose_raw(value, sensor, 1000 * seed + k), sensor)
        lamp = hg.Lamp(to_lamp=tuple(towards.tolist()), name=f"lamp {k}")
        mask = on_ball & developed.valid
        shots.append(hg.Photograph(developed.values, developed.variance, mask, camera, (lamp,), lamp.name))
    flat = np.where(on_ball[..., None], normals, 0.0)
    depth = PIXEL * radius * flat[..., 2]
    radii = np.hypot(normals[..., 0], normals[..., 1])
    return FaultyBall(
        hg.Capture(tuple(shots), "faulty ball"), flat, radii, np.where(on_ball[..., None], body, 0), depth
    )


def _normals(size: int, radius: float, finer: int) -> tuple[Array, NDArray[np.bool_]]:
    """(n, n, 3) normals at points of a grid of `finer` to a pixel, and whether they are on the ball."""
    rows, columns = (np.mgrid[: size * finer, : size * finer] + 0.5) / finer
    x, y = (columns - size / 2.0) / radius, (size / 2.0 - rows) / radius
    height = 1.0 - x * x - y * y
    return np.stack([x, y, np.sqrt(np.maximum(height, 0.0))], axis=2), height > 0.0


def _body(normals: Array, on_ball: NDArray[np.bool_], random: np.random.Generator) -> Array:
    """(n, n, C) α c_b: patches of a smooth random pattern."""
    waves = sum(
        np.sin(normals[..., :2] @ random.uniform(-9.0, 9.0, 2) + random.uniform(0.0, 2.0 * np.pi)) for _ in range(4)
    )
    level = 1.0 + VARIED * np.sign(np.asarray(waves))
    return np.where(on_ball[..., None], level[..., None] * np.array(BODY), 0.0)


def _shaded(normals: Array, body: Array, to_lamp: Array, condition: BallFaults) -> Array:
    """(n, n, C) radiance under a lamp of irradiance 1, seen along z."""
    incidence, view = np.maximum(normals @ to_lamp, 0.0), np.maximum(normals[..., 2], 1e-3)
    value = body * incidence[..., None]
    lobe = _outside(normals, incidence, view, to_lamp, condition.roughness) if condition.roughness else None
    return value + (_inside(normals, to_lamp) if lobe is None else lobe)[..., None]


def _inside(normals: Array, to_lamp: Array) -> Array:
    """(n, n) light of the lobe that the fits have, cosθ_i in it."""
    jit: Any = arrays()
    vectors = jit.Array3f(normals.reshape(-1, 3).T.astype(np.float32))
    terms = hg.torrance_sparrow(vectors, jit.Array3f(*to_lamp.tolist()), jit.Array3f(0, 0, 1), 1.0, BETA, GAMMA, 1.5)
    return terms.interface.numpy().reshape(normals.shape[:2]).astype(np.float64)


def _outside(normals: Array, incidence: Array, view: Array, to_lamp: Array, roughness: float) -> Array:
    """(n, n) light of a lobe of Trowbridge and Reitz, cosθ_i in it."""
    half = to_lamp + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    square, a = np.maximum(normals @ half, 0.0) ** 2, roughness**2
    density = a**2 / (np.pi * (square * (a**2 - 1.0) + 1.0) ** 2)
    masked = [2.0 * c / (c + np.sqrt(a**2 + (1.0 - a**2) * c * c)) for c in (np.maximum(incidence, 1e-9), view)]
    fresnel = F0 + (1.0 - F0) * (1.0 - half[2]) ** 5
    return density * fresnel * masked[0] * masked[1] / (4.0 * view) * (incidence > 0.0)


def _pixels(fine: Array) -> Array:
    """Means over the points of each pixel."""
    side = len(fine) // FINER
    return fine.reshape(side, FINER, side, FINER, -1).mean(axis=(1, 3))
