"""A simulated rig with near lamps: a perspective camera, an exactly known surface, one lamp per photograph.

Enters: lamps and camera, a depth of the camera's (x/z, y/z) as a formula, a material. Leaves: the photographs as a
sensor would take them (attached and cast shadows, highlights, light between the parts of the surface, photon noise,
bits) and the exact normals and points. Camera frame is the world: x right, y down, z away.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.backend import arrays

Array = NDArray[Any]
Depth = Callable[[Array, Array], Array]

SURFACE_DISTANCE = 0.7  # m, of the middle of the surface
FULL_WELL, READ_NOISE = 20_000.0, 8.0  # electrons
EXPOSED_SHARE = 0.7  # of white: the 98th percentile of all photographs
ON_THE_WAY = np.linspace(0.004, 1.0, 160) ** 1.5  # shares of the way to a lamp at which its shadow is looked for
SHADOW_CLEARANCE = 1e-3  # of its depth that a ray must pass behind the surface to be blocked
PATCH = 6  # px: side of the patches that light each other


@dataclass(frozen=True, eq=False)
class NearRig:
    """One camera, and near lamps [m] in its frame."""

    camera: hg.Camera
    lamps: tuple[hg.Lamp, ...]


@dataclass(frozen=True)
class Finish:
    """How a surface looks: α c_b of its two colours, β, γ [rad] and n of its gloss; whether its parts light another."""

    gamma: float
    beta: float = 0.5
    n: float = 1.5
    colours: tuple[tuple[float, float, float], ...] = ((0.16, 0.11, 0.08), (0.07, 0.10, 0.15))
    interreflection: bool = False


@dataclass(frozen=True, eq=False)
class TrueShape:
    """normals, points (h, w, 3) exact, world, 0 where nothing is; labels (h, w) of the colours, −1 where nothing is."""

    normals: Array
    points: Array
    labels: NDArray[np.intp]


def ring_rig(width: int = 120, height: int = 96, count: int = 10) -> NearRig:
    """LEDs on two rings around the lens, aimed at the middle of the scene."""
    focal = 1.6 * width
    camera = _camera(width, height, (focal, focal), (width / 2.0 + 1.5, height / 2.0 - 0.7))
    lamps = []
    for k in range(count):
        angle, far = 2.0 * np.pi * (k + 0.3) / count, 0.30 if k % 2 else 0.16
        place = np.array([far * np.cos(angle), far * np.sin(angle), 0.05 + 0.1 * (k % 3)])
        axis = np.array([0.0, 0.0, SURFACE_DISTANCE]) - place
        lamps.append(hg.Lamp(place, intensity=1.0 + 0.2 * (k % 4), name=f"led {k}", axis=axis, axis_power=1.0))
    return NearRig(camera, tuple(lamps))


def read_rig(folder: str | Path, smaller: float = 20.0) -> NearRig:
    """The calibrated LEDs in `folder` (near_ps_leds: light.mat, camera.mat, mm), its photographs made smaller."""
    from scipy.io import loadmat

    light, matrix = loadmat(Path(folder) / "light.mat"), loadmat(Path(folder) / "camera.mat")["K"] / smaller
    width, height = int(2.0 * matrix[0, 2]), int(2.0 * matrix[1, 2])
    camera = _camera(width, height, (matrix[0, 0], matrix[1, 1]), (matrix[0, 2], matrix[1, 2]))
    brightness = light["Phi"] / light["Phi"].mean()
    lamps = [
        hg.Lamp(1e-3 * place, intensity=bright, name=f"led {k}", axis=axis, axis_power=float(power))
        for k, (place, axis, power, bright) in enumerate(
            zip(light["S"], light["Dir"], light["mu"][:, 0], brightness, strict=True)
        )
    ]
    return NearRig(camera, tuple(lamps))


def sphere(x: Array, y: Array, radius: float = 0.12) -> Array:
    """Depth [m] of a ball around the middle; NaN beside it, and where it is seen beyond 80°."""
    middle = SURFACE_DISTANCE + 0.5 * radius
    square = 1.0 + x * x + y * y
    inside = middle**2 - square * (middle**2 - radius**2)
    with np.errstate(invalid="ignore"):
        depth = (middle - np.sqrt(inside)) / square
    # cosine to the eye at the ball: √inside / (radius √square)
    return np.where(inside > (np.cos(np.radians(80.0)) * radius) ** 2 * square, depth, np.nan)


def waves(x: Array, y: Array) -> Array:
    """Depth [m] of a wavy sheet with a block that stands 30 mm before it."""
    swell = 0.006 * np.sin(28.0 * x + 1.0) * np.cos(24.0 * y) + 0.004 * np.sin(55.0 * y + 20.0 * x)
    block = (np.abs(x - 0.05) < 0.09) & (np.abs(y + 0.03) < 0.07)
    return SURFACE_DISTANCE + 0.04 * x + swell - np.where(block, 0.03, 0.0)


def simulate(rig: NearRig, depth: Depth, look: Finish, bits: int = 12, seed: int = 0) -> tuple[hg.Capture, TrueShape]:
    """The photographs of `depth` under each lamp of the rig, and the truth."""
    truth = exact(rig.camera, depth)
    known = truth.labels >= 0
    points, normals = truth.points[known], truth.normals[known]
    body = np.array(look.colours)[truth.labels[known]]
    between = _between(points, normals, body, known) if look.interreflection else None
    light = []
    for lamp in rig.lamps:
        blocked = _shadowed(points, lamp, depth)
        value = shaded(truth, lamp, look) * ~blocked[:, None]
        if between is not None:
            diffuse = shaded(truth, lamp, replace(look, beta=0.0)) * ~blocked[:, None]
            value = value + body * between(diffuse)
        light.append(value)
    white = float(np.percentile(np.concatenate(light), 98)) / EXPOSED_SHARE
    gain = FULL_WELL / (2.0**bits - 1.0)
    sensor = hg.Sensor(FULL_WELL / white, FULL_WELL, READ_NOISE, gain, 0.0, bits)
    camera = replace(rig.camera, sensor=sensor)
    photographs = []
    for k, (lamp, value) in enumerate(zip(rig.lamps, light, strict=True)):
        signal = np.zeros((*known.shape, 3))
        signal[known] = value
        developed = hg.develop_raw(hg.expose_raw(signal, sensor, 1000 * seed + k), sensor)
        shot = developed.values, developed.variance, known & developed.valid
        photographs.append(hg.Photograph(*shot, camera, (lamp,), lamp.name))
    return hg.Capture(tuple(photographs), "simulated"), truth


def shaded(truth: TrueShape, lamp: hg.Lamp, look: Finish) -> Array:
    """(P, 3) values of the known points under a lamp that nothing blocks."""
    known = truth.labels >= 0
    points, normals = truth.points[known], truth.normals[known]
    to_lamp, irradiance = lamp.direction_and_irradiance(points)
    body, interface = _weights(normals, to_lamp, points, look)
    colour = np.array(look.colours)[truth.labels[known]]
    return irradiance.reshape(len(points), -1) * (body[:, None] * colour + interface[:, None])


def exact(camera: hg.Camera, depth: Depth) -> TrueShape:
    """Points and normals of `depth` at the middle of every pixel; its slopes to 1e-9 by central differences."""
    columns, rows = np.meshgrid(np.arange(camera.width) + 0.5, np.arange(camera.height) + 0.5)
    x = (columns - camera.principal[0]) / camera.focal[0]
    y = (rows - camera.principal[1]) / camera.focal[1]
    h = 1e-6
    z = depth(x, y)
    by_x = (depth(x + h, y) - depth(x - h, y)) / (2.0 * h)
    by_y = (depth(x, y + h) - depth(x, y - h)) / (2.0 * h)
    across = np.stack([z + x * by_x, y * by_x, by_x], axis=2)
    down = np.stack([x * by_y, z + y * by_y, by_y], axis=2)
    normals = -np.cross(across, down)
    with np.errstate(invalid="ignore"):
        normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    known = np.isfinite(normals).all(axis=2)
    checks = (np.floor(columns / 13.0) + np.floor(rows / 11.0)).astype(np.intp) % 2
    points = np.stack([x * z, y * z, z], axis=2)
    zero = known[..., None]
    return TrueShape(np.where(zero, normals, 0.0), np.where(zero, points, 0.0), np.where(known, checks, -1))


def _camera(width: int, height: int, focal: tuple[float, float], principal: tuple[float, float]) -> hg.Camera:
    camera = hg.Camera(width, height, focal, principal)
    return camera.look_at((0.0, 0.0, 0.0), (0.0, 0.0, 1.0), up=(0.0, -1.0, 0.0))


def _weights(normals: Array, to_lamp: Array, points: Array, look: Finish) -> tuple[Array, Array]:
    """Body and interface weights of eq. (2) at each point, cosθ_i in them."""
    jit: Any = arrays()
    to_eye = -points / np.linalg.norm(points, axis=1, keepdims=True)
    n, towards, eye = (jit.Array3f(vectors.T.astype(np.float32)) for vectors in (normals, to_lamp, to_eye))
    terms = hg.torrance_sparrow(n, towards, eye, 1.0, look.beta, jit.Float(look.gamma), look.n)
    return terms.body.numpy().astype(np.float64), terms.interface.numpy().astype(np.float64)


def _shadowed(points: Array, lamp: hg.Lamp, depth: Depth) -> NDArray[np.bool_]:
    """(P,) whether the visible surface blocks the lamp at its points."""
    assert lamp.position is not None
    hidden = np.zeros(len(points), np.bool_)
    for share in ON_THE_WAY[:-1]:
        place = points + share * (lamp.position - points)
        in_front = place[:, 2] > 0.05  # m: nothing stands nearer to the lens
        surface_depth = depth(place[:, 0] / np.maximum(place[:, 2], 0.05), place[:, 1] / np.maximum(place[:, 2], 0.05))
        with np.errstate(invalid="ignore"):
            hidden |= in_front & (place[:, 2] > surface_depth * (1.0 + SHADOW_CLEARANCE))
    return hidden


def _between(points: Array, normals: Array, body: Array, known: NDArray[np.bool_]) -> Callable[[Array], Array]:
    """Interreflected light over π: two bounces between patches of the surface.

    Patches exchange light if they face each other; occlusion between them is ignored.
    """
    rows, columns = np.nonzero(known)
    _, patch = np.unique((rows // PATCH) * 10_000 + columns // PATCH, return_inverse=True)
    count = np.bincount(patch)

    def means(values: Array) -> Array:
        return np.stack([np.bincount(patch, column) for column in values.T], axis=1) / count[:, None]

    place, facing, colour = means(points), means(normals), means(body)
    facing /= np.linalg.norm(facing, axis=1, keepdims=True)
    pixel = np.sqrt(np.median(np.sum(np.diff(points, axis=0) ** 2, axis=1)))
    area = count * pixel**2 / np.maximum(-np.einsum("pi,pi->p", facing, place) / np.linalg.norm(place, axis=1), 0.2)
    offset = place[None] - place[:, None]
    square = np.maximum(np.einsum("ijk,ijk->ij", offset, offset), (PATCH * pixel) ** 2)
    leaving = np.maximum(np.einsum("ijk,ik->ij", offset, facing), 0.0)
    arriving = np.maximum(-np.einsum("ijk,jk->ij", offset, facing), 0.0)
    exchange = leaving * arriving / square**2 * area[None]
    np.fill_diagonal(exchange, 0.0)

    def back(sent: Array) -> Array:
        first = exchange @ means(sent)
        return (first + exchange @ (colour * first))[patch]

    return back
