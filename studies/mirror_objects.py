"""Simulated objects with narrow highlights, of few pixels: a ball and a wavy dome under many lamps of some width.

The truth is written down here once more and shares no line with the product. The lobe is a narrow one with long tails
(Trowbridge & Reitz 1975) on a haze that falls off exponentially, which no sum of the fits' lobes is. Body and lobe are
means over the pixel's area, the lobe over the lamp's disc, too; then come the blur of the optics, shot noise, read
noise, 12 bits, and a white at which highlights are clipped. Lamps are off their stated directions and strengths.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg

Array = NDArray[np.float64]
FOCAL, PIXEL = 1e5, 5e-4  # px and m: seen from afar
OBJECTS = ("ball", "wavy")
WIDE, NARROW = (1.2, np.radians(5.0)), (40.0, 0.024)  # β [1/sr] and scale [rad] of the haze and of the narrow lobe
EPSILON, INDEX = 0.03, 1.5  # exponent of the body, and refractive index
BODY = np.array([0.10, 0.07, 0.05])  # α c_b [1/sr]
LAMP_DIAMETER, LARGEST_TILT = 1.5, 55.0  # ° of a lamp's disc, and of a lamp from the camera's axis
DIRECTION_ERROR, STRENGTH_ERROR = 0.15, 0.003  # °, and relative, of the stated lamps
FULL_WELL, READ_NOISE, LEVELS = 10_000.0, 8.0, 4095.0  # electrons, and numbers of 12 bits
WHITE = 0.6  # of the median, over the photographs, of their largest value
BLUR = 0.35  # [px] standard deviation of the optics
PARTS, RINGS = 8, 3  # of a side of a pixel, and of a lamp's disc
NEAR = 10.0  # ° of φ within which the lamp's disc is resolved
WAVES = ((5.0, 2.0, 0.020, 0.3), (-3.0, 6.0, 0.018, 1.1), (9.0, 7.0, 0.006, 2.0), (2.0, -11.0, 0.006, 0.7))


@dataclass(frozen=True, eq=False)
class MirrorObject:
    """The capture, without its shape; the true normals (h, w, 3), 0 beside the object, and directions of the lamps
    (K, 3); and the photographs without noise (K, h, w, C), clipped at white.
    """

    capture: hg.Capture
    normals: Array
    lamps: Array
    noiseless: Array


def mirror_object(name: str, size: int = 154, lamps: int = 96, seed: int = 0) -> MirrorObject:
    """An object of OBJECTS, of `size` px, under so many lamps."""
    random = np.random.default_rng([seed, OBJECTS.index(name)])
    camera = hg.Camera(size, size, (FOCAL, FOCAL), (size / 2, size / 2), name="simulated")
    camera = camera.look_at((0.0, 0.0, FOCAL * PIXEL), (0.0, 0.0, 0.0), up=(0.0, 1.0, 0.0))
    normals, inside, place = _surface(name, size)
    share = _means(inside.astype(np.float64))
    mask = share > 0.999
    rows, columns = np.nonzero(share > 0.0)
    within = np.arange(PARTS)
    index = rows[:, None, None] * PARTS + within[:, None], columns[:, None, None] * PARTS + within
    parts, counted = normals[index].reshape(len(rows), PARTS**2, 3), inside[index].reshape(len(rows), PARTS**2)
    x, y = np.moveaxis(_means(place), 2, 0)[:, rows, columns]
    body = (1.0 + 0.15 * np.sin(2.5 * x + 1.0) * np.cos(3.0 * y))[:, None] * BODY
    towards, values = _directions(lamps, random), np.zeros((lamps, size, size, 3))
    for value, to_lamp in zip(values, towards, strict=True):
        lit, lobes = ((one * counted).mean(axis=1) for one in _reflected(parts, to_lamp))
        value[rows, columns] = np.pi * (body * lit[:, None] + lobes[:, None])
    values = np.stack([_blurred(one) for one in values])
    white = WHITE * float(np.median(values[:, mask].max(axis=(1, 2))))
    photographs = []
    for number, (direction, true) in enumerate(zip(towards, values, strict=True)):
        true = true * (1.0 + STRENGTH_ERROR * random.normal())
        electrons = random.poisson(true / white * FULL_WELL) + random.normal(0.0, READ_NOISE, true.shape)
        read = np.minimum(np.rint(electrons / FULL_WELL * LEVELS) / LEVELS, 1.0)
        variance = np.maximum(read, 0.0) / FULL_WELL + (READ_NOISE / FULL_WELL) ** 2 + 1.0 / LEVELS**2 / 12.0
        stated = direction + np.radians(DIRECTION_ERROR) * random.normal(size=3)
        lamp = hg.Lamp(to_lamp=stated / np.linalg.norm(stated), intensity=np.pi / white, name=f"lamp {number}")
        valid = mask & (read < 1.0).all(axis=2)
        photographs.append(hg.Photograph(read, variance, valid, camera, (lamp,), f"{name} {number}"))
    mean = _means(normals)
    mean /= np.linalg.norm(mean, axis=2, keepdims=True)
    capture = hg.Capture(tuple(photographs), name)
    return MirrorObject(capture, np.where(mask[..., None], mean, 0.0), towards, np.minimum(values / white, 1.0))


def _surface(name: str, size: int) -> tuple[Array, NDArray[np.bool_], Array]:
    """Normals (n, n, 3), what is on the object (n, n), and places (n, n, 2) in radii, of the parts of all pixels."""
    radius = 0.46 * size
    down, across = (np.mgrid[: size * PARTS, : size * PARTS] + 0.5) / PARTS - size / 2
    x, y = across / radius, -down / radius
    radius2 = x * x + y * y
    if name == "ball":
        normals = np.stack([x, y, np.sqrt(np.maximum(1.0 - radius2, 1e-6))], axis=2)
    else:
        high = np.sqrt(np.maximum(1.05 - radius2, 1e-3))
        slopes = np.stack([-0.75 * x / high, -0.75 * y / high], axis=2)
        for along_x, along_y, height, phase in WAVES:
            slope = height * np.cos(along_x * x + along_y * y + phase)
            slopes += slope[..., None] * np.array([along_x, along_y])
        normals = np.concatenate([-slopes, np.ones((*x.shape, 1))], axis=2)
    normals /= np.linalg.norm(normals, axis=2, keepdims=True)
    return normals, radius2 < 0.995, np.stack([x, y], axis=2)


def _means(parts: Array) -> Array:
    """(h, w, …) means over the parts of each pixel."""
    size = len(parts) // PARTS
    return parts.reshape(size, PARTS, size, PARTS, *parts.shape[2:]).mean(axis=(1, 3))


def _directions(count: int, random: np.random.Generator) -> Array:
    """(count, 3) unit, evenly over a cap about the camera's axis (world: z to the camera)."""
    k = np.arange(count) + 0.5
    cosine = 1.0 - (1.0 - np.cos(np.radians(LARGEST_TILT))) * k / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * k + random.uniform(0.0, 2.0 * np.pi)
    sine = np.sqrt(1.0 - cosine**2)
    return np.stack([sine * np.cos(turn), sine * np.sin(turn), cosine], axis=1)


def _reflected(normals: Array, to_lamp: Array) -> tuple[Array, Array]:
    """(…,) what a body of 1 and the lobes send to the eye, the lobes as means over the lamp's disc near highlights."""
    lit, lobes, phi = _law(normals, to_lamp)
    near = np.flatnonzero((phi.min(axis=1) < np.radians(NEAR)) & (lobes.max(axis=1) > 0.0))
    first = np.cross(to_lamp, [0.0, 1.0, 0.0])
    first /= np.linalg.norm(first)
    second, disc = np.cross(to_lamp, first), []
    for ring in range(RINGS):
        away = np.radians(LAMP_DIAMETER / 2.0) * np.sqrt((ring + 0.5) / RINGS)
        turn = 2.0 * np.pi * (np.arange(6 + 6 * ring) + 0.5 * ring) / (6 + 6 * ring)
        points = to_lamp + away * (np.cos(turn)[:, None] * first + np.sin(turn)[:, None] * second)
        disc += [(one / np.linalg.norm(one), 1.0 / (RINGS * len(turn))) for one in points]
    lobes[near] = sum(weight * _law(normals[near], one)[1] for one, weight in disc)
    return lit, lobes


def _law(normals: Array, to_lamp: Array) -> tuple[Array, Array, Array]:
    """Body and lobes under a lamp of no width, seen along z, and the half angle φ [rad]; (…,) each."""
    half = to_lamp + np.array([0.0, 0.0, 1.0])
    half /= np.linalg.norm(half)
    cos_i, cos_r, cos_q, cos_h = normals @ to_lamp, normals[..., 2], float(half[2]), normals @ half
    phi = np.arccos(np.clip(cos_h, -1.0, 1.0))
    g = np.sqrt(INDEX**2 + cos_q**2 - 1.0)
    fresnel = 0.5 * ((g - cos_q) / (g + cos_q)) ** 2
    fresnel *= 1.0 + ((cos_q * (g + cos_q) - 1.0) / (cos_q * (g - cos_q) + 1.0)) ** 2
    masked = np.maximum(np.minimum(1.0, 2.0 * cos_h * np.minimum(cos_i, cos_r) / cos_q), 0.0)
    lit = (cos_i > 0.0) & (cos_r > 0.0)
    tangent = np.tan(np.minimum(phi, 1.5))
    density = NARROW[0] * (1.0 + (tangent / NARROW[1]) ** 2) ** -2.0 + WIDE[0] * np.exp(-tangent / WIDE[1])
    body = np.where(lit, cos_i * np.maximum(cos_i * cos_r, 4e-4) ** EPSILON, 0.0)
    return body, np.where(lit, density * fresnel * masked / np.where(lit, cos_r, 1.0), 0.0), phi


def _blurred(values: Array) -> Array:
    from scipy.ndimage import gaussian_filter

    return np.asarray(gaussian_filter(values, (BLUR, BLUR, 0.0)), np.float64)
