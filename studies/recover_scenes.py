"""Captures of simulated objects for `recover`: exact shapes, seen from all around, under near lamps.

The truth shares no line with the march: rays meet the signed distance of the shape itself, by sphere tracing, and its
shadow rays as well. Photographs are means of 2 × 2 rays a pixel, with shot noise, read noise and 12 bits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

import hagoromo as hg
from hagoromo.backend import arrays
from hagoromo.matter import shape as sd
from hagoromo.reflectance.torrance_sparrow import torrance_sparrow

Array = NDArray[np.float64]
DISTANCE = 0.6  # m, of cameras
RADIUS = 0.05  # m, about that of the object
FOCAL = 5.2  # in widths of a photograph
ALPHA = 1.0 / np.pi
SURFACE, MOST_STEPS = 2e-6, 1500  # m from the surface that counts as on it; steps of a ray along a flat face
OVERSAMPLED = 2  # rays along a side of a pixel


class TrueSensor(NamedTuple):
    """full_well, read_noise: of a pixel [electrons]. bits: of its values."""

    full_well: float = 20_000.0
    read_noise: float = 8.0
    bits: int = 12


USUAL_SENSOR = TrueSensor()


class TrueObject:
    """An object: β [1/sr], γ [rad], n; where it is (`distance`) and its body colour (`colours`), at points [m].

    flat: whether it has one colour everywhere. Its gloss conserves energy at every angle.
    """

    def __init__(self, beta: float = 2.2, gamma: float = 0.1, n: float = 1.5, flat: bool = False) -> None:
        self.beta, self.gamma, self.n, self.flat = beta, gamma, n, flat

    def distance(self, p: Any) -> Any:
        """Signed distance [m]: a jug-like body with two arms and a ring, which shade each other."""
        body = sd.ellipsoid(p, (0.0, 0.0, -0.008), (0.026, 0.022, 0.03))
        head = sd.sphere(p, (0.004, 0.002, 0.032), 0.014)
        arm = sd.capsule(p, (0.018, -0.01, 0.004), (0.036, -0.022, 0.024), 0.006)
        other = sd.capsule(p, (-0.018, 0.006, 0.0), (-0.038, 0.014, -0.012), 0.0065)
        shape = sd.smooth_union(body, head, 0.008)
        return sd.smooth_union(sd.smooth_union(shape, arm, 0.006), other, 0.006)

    def gloss(self, p: Any) -> tuple[Any, Any]:
        """β and γ at points."""
        return self.beta, self.gamma

    def colours(self, p: Any) -> list[Any]:
        """Body colour at points: three smooth patterns."""
        if self.flat:
            return [0.5 + 0.0 * p.x, 0.4 + 0.0 * p.x, 0.3 + 0.0 * p.x]
        return [
            0.4 + 0.2 * dr.sin(150.0 * p.x + 2.0) * dr.cos(110.0 * p.z),
            0.36 + 0.18 * dr.sin(170.0 * p.y) * dr.cos(90.0 * p.x + 1.0),
            0.34 + 0.22 * dr.cos(130.0 * p.z + 60.0 * p.x),
        ]


@dataclass(frozen=True)
class Shots:
    """Where cameras and lamps are. views: directions from the object (n, 3). lamps: of each view, positions [m]. focal:
    in widths of a photograph. far: whether lamps shine from infinity, from the directions of their positions.
    """

    views: Array
    lamps: list[Array]
    pixels: int = 160
    focal: float = FOCAL
    far: bool = False

    def lamp(self, place: Array) -> hg.Lamp:
        """That of a position (3,) [m]: a white plane that faces it has about the light of 1 in the middle."""
        if self.far:
            return hg.Lamp(to_lamp=place, intensity=np.pi)
        return hg.Lamp(position=place, intensity=np.pi * float(place @ place))


@dataclass(frozen=True)
class Simulated:
    """A capture, and the exact light of each photograph (h, w, 3), its normals (h, w, 3) and points, NaN beside it.

    shares: (h, w) of each pixel that the object covers. strengths, places: true ones of the photographs' first lamps.
    cameras: the true ones, where the capture has others.
    """

    capture: hg.Capture
    exact: list[Array] = field(default_factory=list)
    normals: list[Array] = field(default_factory=list)
    points: list[Array] = field(default_factory=list)
    strengths: list[float] = field(default_factory=list)
    places: list[Array] = field(default_factory=list)
    cameras: list[hg.Camera] = field(default_factory=list)
    shares: list[Array] = field(default_factory=list)


def around(count: int, seed: int = 0, turn: float = 0.0) -> Array:
    """Directions (count, 3) spread evenly over the ball (Fibonacci), the poles left out."""
    number = np.arange(count) + 0.5
    z = 0.92 * (1.0 - 2.0 * number / count)
    angle = np.pi * (3.0 - np.sqrt(5.0)) * number + turn
    r = np.sqrt(1.0 - z * z)
    return np.stack([r * np.cos(angle), r * np.sin(angle), z], axis=1)


def near_lamp(view: Array, low: float, high: float, random: np.random.Generator, distance: float = 0.5) -> Array:
    """Position (3,) [m] of a lamp `low` to `high` degrees off the eye as seen from the object."""
    angle, turn = np.radians(random.uniform(low, high)), random.uniform(0.0, 2.0 * np.pi)
    side = np.cross(view, [0.0, 0.0, 1.0])
    side /= np.linalg.norm(side)
    up = np.cross(side, view)
    return distance * (np.cos(angle) * view + np.sin(angle) * (np.cos(turn) * side + np.sin(turn) * up))


def shots(count: int, low: float, high: float, seed: int, pixels: int = 160, lamps: int = 1) -> Shots:
    """`count` views all around, each under `lamps` near lamps of their own, one photograph each."""
    random = np.random.default_rng(seed)
    views = around(count, turn=0.7 * seed)
    return Shots(views, [np.stack([near_lamp(v, low, high, random) for _ in range(lamps)]) for v in views], pixels)


def standing(count: int, lamps: int, pixels: int = 160, distance: float = 0.5) -> Shots:
    """`count` views all around; of `lamps` lamps, which stand still, those light a view that stand before it."""
    places, views = around(lamps, turn=0.2), around(count, turn=0.7)
    return Shots(views, [distance * places[places @ view > 0.05] for view in views], pixels)


def simulated(
    truth: TrueObject, taken: Shots, seed: int = 0, noise: bool = True, sensor: TrueSensor = USUAL_SENSOR
) -> Simulated:
    """Photographs of an object, one for each view and lamp."""
    random, out = np.random.default_rng(seed), Simulated(hg.Capture((_nothing(),)))
    photographs: list[hg.Photograph] = []
    for view, lamps in zip(taken.views, taken.lamps, strict=True):
        focal = taken.focal * taken.pixels
        camera = hg.Camera(
            taken.pixels, taken.pixels, (focal, focal), (taken.pixels / 2, taken.pixels / 2), name="simulated"
        ).look_at(tuple(DISTANCE * view), (0.0, 0.0, 0.0))
        for place in lamps:
            lamp = taken.lamp(place)
            light, share, normals, points = _light(truth, camera, lamp)
            made = (out.exact, light), (out.normals, normals), (out.points, points), (out.shares, share)
            for held, new in made:
                held.append(new)
            drawn, number = random if noise else None, len(photographs)
            photographs.append(photograph_of(light, share, camera, lamp, drawn, number, sensor=sensor))
    capture, lamps = hg.Capture(tuple(photographs), "simulated"), [p.lamps[0] for p in photographs]
    strengths, places = [float(np.mean(lamp.intensity)) for lamp in lamps], [lamp.place for lamp in lamps]
    return Simulated(capture, out.exact, out.normals, out.points, strengths, places, shares=out.shares)


def misstated(taken: Simulated, pixels: float, share: float, seed: int = 0) -> Simulated:
    """The same photographs with wrong statements: poses, each view's alike in all its photographs, turned and shifted
    by `pixels` (rms of each axis), and lamps too strong or too weak by `share` (rms).
    """
    random, poses, photographs = np.random.default_rng(seed), {}, []
    for photograph in taken.capture.photographs:
        camera = photograph.camera
        pose = poses.get(camera.world_to_camera.tobytes())
        if pose is None:
            angle = pixels / min(camera.focal)
            pose = camera.world_to_camera.copy()
            pose[:3] = Rotation.from_rotvec(random.normal(0.0, angle, 3)).as_matrix() @ pose[:3]
            pose[:3, 3] += random.normal(0.0, angle * DISTANCE, 3)
            poses[camera.world_to_camera.tobytes()] = pose
        wrong = [
            replace(lamp, intensity=float(np.mean(lamp.intensity)) * np.exp(random.normal(0.0, share)))
            for lamp in photograph.lamps
        ]
        photographs.append(replace(photograph, camera=camera.with_pose(pose), lamps=tuple(wrong)))
    capture = replace(taken.capture, photographs=tuple(photographs))
    return replace(taken, capture=capture, cameras=[p.camera for p in taken.capture.photographs])


def misplaced(taken: Simulated, share: float, seed: int = 0) -> Simulated:
    """The same photographs with each lamp stated elsewhere, by `share` of its distance (rms of each axis)."""
    random, shifts, photographs = np.random.default_rng(seed), {}, []
    for photograph in taken.capture.photographs:
        for lamp in photograph.lamps:
            if tuple(lamp.place) not in shifts:
                shifts[tuple(lamp.place)] = random.normal(0.0, share * float(np.linalg.norm(lamp.place)), 3)
        lamps = tuple(lamp.shifted(shifts[tuple(lamp.place)]) for lamp in photograph.lamps)
        photographs.append(replace(photograph, lamps=lamps))
    return replace(taken, capture=replace(taken.capture, photographs=tuple(photographs)))


def aligned(seen: Simulated, true: Sequence[hg.Camera], found: Sequence[hg.Camera]) -> Simulated:
    """The same views, normals, points and lamps in the axes of cameras that were found, where others are true.

    Nothing that photographs show depends on where all cameras together and the object stand in the world. The small
    rigid motion is the one after which true points lie where they should in the pictures of the cameras found.
    """
    points = np.concatenate([p[np.isfinite(p[..., 0])] for p in seen.points])[::97]
    rows, rest = [], []
    for one, other in zip(true, found, strict=True):
        r, t = other.world_to_camera[:3, :3], other.world_to_camera[:3, 3]
        off = points @ one.world_to_camera[:3, :3].T + one.world_to_camera[:3, 3] - (points @ r.T + t)
        by_turn = np.stack([np.cross(axis, points) @ r.T for axis in np.eye(3)], axis=2)
        rows.append(np.concatenate([by_turn, np.broadcast_to(r, by_turn.shape)], axis=2)[:, :2])
        rest.append(off[:, :2])  # across the picture
    least = np.linalg.lstsq(np.concatenate(rows).reshape(-1, 6), np.concatenate(rest).ravel(), rcond=None)[0]
    w, t = least[:3], least[3:]
    motion = np.eye(4)
    motion[:3, :3], motion[:3, 3] = Rotation.from_rotvec(w).as_matrix(), t
    moved = [
        replace(
            p,
            camera=p.camera.with_pose(p.camera.world_to_camera @ np.linalg.inv(motion)),
            lamps=tuple(replace(lamp, position=motion[:3, :3] @ lamp.place + t) for lamp in p.lamps),
        )
        for p in seen.capture.photographs
    ]
    normals = [n @ motion[:3, :3].T for n in seen.normals]
    return Simulated(
        hg.Capture(tuple(moved), seen.capture.name),
        seen.exact,
        normals,
        [p @ motion[:3, :3].T + t for p in seen.points],
    )


def _nothing() -> hg.Photograph:
    camera = hg.Camera(1, 1, (1.0, 1.0), (0.5, 0.5))
    return hg.Photograph(np.zeros((1, 1, 3), np.float32), np.ones((1, 1, 3), np.float32), np.ones((1, 1), bool), camera)


def _light(truth: TrueObject, camera: hg.Camera, lamp: hg.Lamp) -> tuple[Array, Array, Array, Array]:
    """Light of each pixel (h, w, 3), the share of it that the object covers, and normals and points of its middle."""
    jit = arrays()
    k, h, w = OVERSAMPLED, camera.height, camera.width
    number = dr.arange(jit.UInt, h * w * k * k)
    inner, pixel = number % (k * k), number // (k * k)
    x = jit.Float(pixel % w) + (jit.Float(inner % k) + 0.5) / k
    y = jit.Float(pixel // w) + (jit.Float(inner // k) + 0.5) / k
    origin, direction = camera.rays(x, y)
    light, hit = _seen(truth, origin, direction, lamp)
    means = [np.array(each).reshape(h, w, k * k).mean(axis=2) for each in light]
    share = np.array(dr.select(hit, jit.Float(1), 0)).reshape(h, w, k * k).mean(axis=2)
    number = dr.arange(jit.UInt, h * w)
    origin, direction = camera.rays(jit.Float(number % w) + 0.5, jit.Float(number // w) + 0.5)
    way, hit = _met(truth, origin, direction, 2.0 * DISTANCE)
    point = origin + direction * way
    normal = _normal(truth, point)
    there = np.array(hit).reshape(h, w, 1)
    normals, points = (np.array(each).T.reshape(h, w, 3) for each in (normal, point))
    return np.stack(means, axis=2), share, np.where(there, normals, np.nan), np.where(there, points, np.nan)


def _seen(truth: TrueObject, origin: Any, direction: Any, lamp: hg.Lamp) -> tuple[list[Any], Any]:
    """Light along rays, and whether they meet the object."""
    jit = arrays()
    way, hit = _met(truth, origin, direction, 2.0 * DISTANCE)
    point = origin + direction * way
    normal = _normal(truth, point)
    towards = jit.Array3f(*(float(x) for x in lamp.place))
    offset = towards - point if lamp.near else 2.0 * DISTANCE * towards
    distance = dr.norm(offset)
    to_lamp = offset / distance
    fall = distance * distance if lamp.near else 1.0
    _, shaded = _met(truth, point + normal * 2e-5, to_lamp, distance)
    beta, gamma = truth.gloss(point)
    weights = torrance_sparrow(normal, to_lamp, -direction, ALPHA, beta, gamma, truth.n)
    arriving = dr.select(hit & ~shaded, float(np.max(lamp.intensity)) / fall, 0.0)
    return [arriving * (weights.body * c + weights.interface) for c in truth.colours(point)], hit


@dr.syntax
def _met(truth: TrueObject, origin: Any, direction: Any, far: Any) -> tuple[Any, Any]:
    """Way to the surface along rays [m], and whether it is nearer than `far`."""
    jit = arrays()
    way = dr.zeros(jit.Float, dr.width(direction))
    hit = jit.Bool(False) & (way > 0)
    count = dr.zeros(jit.UInt, dr.width(direction))
    while (way < far) & ~hit & (count < MOST_STEPS):
        distance = truth.distance(origin + direction * way)
        hit = distance < SURFACE
        way += dr.select(hit, 0.0, 0.8 * distance)
        count += 1
    return way, hit


def _normal(truth: TrueObject, point: Any) -> Any:
    jit, step, parts = arrays(), 2e-5, []
    for k in range(3):
        shift = jit.Array3f(*(step * float(j == k) for j in range(3)))
        parts.append(truth.distance(point + shift) - truth.distance(point - shift))
    return dr.normalize(jit.Array3f(*parts))


def photograph_of(
    light: Array,
    share: Array,
    camera: hg.Camera,
    lamp: hg.Lamp,
    random: np.random.Generator | None,
    number: int,
    covered: float = 0.5,
    sensor: TrueSensor = USUAL_SENSOR,
) -> hg.Photograph:
    """What a camera makes of light, with the object's mask: pixels of which it covers that share."""
    white = float(np.percentile(light[share > 0.5], 99.8)) if (share > 0.5).any() else 1.0
    full_well, read_noise, bits = sensor
    electrons = light / white * full_well
    if random is not None:
        electrons = random.poisson(np.maximum(electrons, 0.0)) + random.normal(0.0, read_noise, light.shape)
    steps = 2.0**bits - 1.0
    read = np.minimum(np.rint(electrons / full_well * steps) / steps, 1.0)
    variance = np.maximum(read, 0.0) / full_well + (read_noise / full_well) ** 2 + 1.0 / steps**2 / 12.0
    silhouette = share >= covered
    valid = silhouette & (read < 1.0).all(axis=2)
    values, spread = (each.astype(np.float32) for each in (read * white, variance * white**2))
    return hg.Photograph(values, spread, valid, camera, (lamp,), f"view {number}", silhouette=silhouette)


def stacked(captures: Sequence[hg.Capture], name: str) -> hg.Capture:
    """All photographs of several captures."""
    return hg.Capture(tuple(p for c in captures for p in c.photographs), name)
