"""Photographs of a hollow cup from above: its inside is behind a step of depth that no normal shows.

The cup is a cylinder with a bore and a flat floor, its axis the world's z. Rays meet it in closed form, those to lamps
too, so that cast shadows are exact. Light is Lambert's; each pixel is the mean of nine rays.
"""

from dataclasses import dataclass

import numpy as np

import hagoromo as hg

RADIUS, TALL, WALL, FLOOR = 0.04, 0.07, 0.006, 0.006  # m
AWAY = 0.9  # m, of the camera
FULL_WELL = 40_000.0  # electrons
FAR = 1e9


@dataclass(frozen=True)
class Cup:
    """Sizes [m]: radius of the outside, height, thickness of the wall and of the floor."""

    radius: float = RADIUS
    tall: float = TALL
    wall: float = WALL
    floor: float = FLOOR

    def hit(self, start, way):
        """(…,) distance to the first place that a ray meets, FAR if none, and the outer normal there (…, 3)."""
        best, normals = np.full(start.shape[:-1], FAR), np.zeros(start.shape)
        inner = self.radius - self.wall
        for radius, low, sign in ((self.radius, 0.0, 1.0), (inner, self.floor, -1.0)):
            a = (way[..., :2] ** 2).sum(-1)
            b = (start[..., :2] * way[..., :2]).sum(-1)
            c = (start[..., :2] ** 2).sum(-1) - radius**2
            root = np.sqrt(np.maximum(b * b - a * c, 0.0))
            for side in (-1.0, 1.0):
                along = (-b + side * root) / np.maximum(a, 1e-300)
                place = start + along[..., None] * way
                normal = sign * place * (1.0, 1.0, 0.0) / radius
                meets = (b * b > a * c) & (place[..., 2] > low) & (place[..., 2] < self.tall)
                best, normals = _nearer(best, normals, along, normal, meets, way)
        for level, least, most in ((self.tall, inner, self.radius), (self.floor, 0.0, inner)):
            along = (level - start[..., 2]) / np.where(np.abs(way[..., 2]) > 1e-12, way[..., 2], 1e-12)
            place = start + along[..., None] * way
            away = np.hypot(place[..., 0], place[..., 1])
            normal = np.broadcast_to([0.0, 0.0, 1.0], place.shape)
            best, normals = _nearer(best, normals, along, normal, (away >= least) & (away < most), way)
        return best, normals


def _nearer(best, normals, along, normal, meets, way):
    chosen = meets & (along > 1e-7) & (along < best) & ((normal * way).sum(-1) < 0.0)
    return np.where(chosen, along, best), np.where(chosen[..., None], normal, normals)


@dataclass(frozen=True)
class BallOnPlate:
    """A ball on a plate: its radius, and half of the plate's sides [m]. What it shades, it truly shades."""

    radius: float = 0.02
    half: float = 0.05

    def hit(self, start, way):
        """See `Cup.hit`."""
        best, normals = np.full(start.shape[:-1], FAR), np.zeros(start.shape)
        along = -start[..., 2] / np.where(np.abs(way[..., 2]) > 1e-12, way[..., 2], 1e-12)
        place = start + along[..., None] * way
        meets = np.abs(place[..., :2]).max(-1) < self.half
        best, normals = _nearer(best, normals, along, np.broadcast_to([0.0, 0.0, 1.0], place.shape), meets, way)
        off = start - (0.0, 0.0, self.radius)
        b, c = (off * way).sum(-1), (off**2).sum(-1) - self.radius**2
        along = -b - np.sqrt(np.maximum(b * b - c, 0.0))
        normal = (off + along[..., None] * way) / self.radius
        return _nearer(best, normals, along, normal, b * b > c, way)


def camera_above(elevation, size=80, tall=TALL, filled=0.042):
    """A camera `elevation` [°] above the floor of the cup."""
    up = np.radians(elevation)
    eye = np.array([0.0, -np.cos(up), np.sin(up)]) * AWAY + (0.0, 0.0, tall / 2)
    focal = 0.42 * size * AWAY / filled
    return hg.Camera(size, size, (focal, focal), (size / 2, size / 2)).look_at(eye, (0.0, 0.0, tall / 2))


def dome(count=16, tilts=(25.0, 50.0), towards=(0.0, 0.0, 1.0)):
    """(count, 3) unit vectors to far lamps, in rings around `towards`."""
    k, towards = np.arange(count), np.asarray(towards) / np.linalg.norm(towards)
    tilt, around = np.radians(np.array(tilts)[k % len(tilts)]), 2 * np.pi * k / count
    side = np.cross(towards, (1.0, 0.0, 0.0))
    side /= np.linalg.norm(side)
    aside = np.cos(around)[:, None] * np.cross(side, towards) + np.sin(around)[:, None] * side
    return np.sin(tilt)[:, None] * aside + np.cos(tilt)[:, None] * towards


@dataclass(frozen=True)
class SeenShape:
    """points and normals (h, w, 3) [m] at the middle of each pixel; known (h, w): all of whose nine rays meet it."""

    shape: Cup | BallOnPlate
    points: np.ndarray
    normals: np.ndarray
    known: np.ndarray

    def lit(self, lamp):
        """(h, w) whether a far lamp lights the middle of the pixel: no cast shadow, and not turned away."""
        start = self.points + 1e-6 * self.normals
        free = self.shape.hit(start, np.broadcast_to(lamp, start.shape))[0] >= FAR
        return free & (self.normals @ lamp > 0.0) & self.known


def photographed(shape, camera, lamps, seed=0, albedo=(0.5, 0.4, 0.3)):
    """The capture of unknown shape under far lamps, and the truth."""
    random, eye = np.random.default_rng(seed), camera.position
    third = np.arange(3) / 3 + 1 / 6
    rows = (np.arange(camera.height)[:, None] + third).ravel()
    columns = (np.arange(camera.width)[:, None] + third).ravel()
    image = np.stack(np.meshgrid(columns, rows), axis=-1)
    ray = camera.unproject(image)
    along, normals = shape.hit(np.broadcast_to(eye, ray.shape), ray)
    met = along < FAR
    points = np.where(met[..., None], eye + np.where(met, along, 0.0)[..., None] * ray, 0.0)
    whole = _of_pixels(met.astype(float)) > 0.999
    photographs = []
    for number, lamp in enumerate(lamps):
        start = points + 1e-6 * normals
        free = shape.hit(start, np.broadcast_to(lamp, start.shape))[0] >= FAR
        light = np.where(met & free, np.maximum(normals @ lamp, 0.0), 0.0)
        light = _of_pixels(light)[..., None] * np.asarray(albedo) / np.pi
        exposure = 0.9 * FULL_WELL * np.pi / max(albedo)
        counted = random.poisson(light * exposure) + random.normal(0.0, 3.0, light.shape)
        values, variance = counted / exposure, (np.maximum(counted, 0.0) + 10.0) / exposure**2
        lit_by = (hg.Lamp(to_lamp=lamp, intensity=1.0),)
        photographs.append(hg.Photograph(values, variance, whole, camera, lit_by, f"lamp {number}"))
    centre = np.s_[1::3, 1::3]
    seen = SeenShape(shape, points[centre], normals[centre], whole)
    return hg.Capture(tuple(photographs), "cup"), seen


def _of_pixels(values):
    height, width = values.shape[0] // 3, values.shape[1] // 3
    return values.reshape(height, 3, width, 3, *values.shape[2:]).mean(axis=(1, 3))
