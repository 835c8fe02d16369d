"""Photographs of a ball under lamps that are on one after the other, simulated in light above white and then clipped.

Enters: a condition and a diameter. Leaves: 8-bit photographs of the ball, its mask, the true directions to the lamps.
The ball mirrors lamps of a degree or more, a dim room and what stands still in it. Scratches shine where the slopes of
their grooves reach the half vector, dust is lit from the lamp's side, a lens adds wings, spikes and defocus around
everything that is bright; then the sensor clips, and a file of 8 bits follows, often JPEG. Directions are x right, y
up, z to the camera; places on the ball are its normals.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import count

import numpy as np
from numpy.typing import NDArray

from studies.ball_conditions import BallCondition

Array = NDArray[np.float64]
Picture = NDArray[np.uint8]
Spectrum = NDArray[np.complex128]
FRONT = np.array([0.0, 0.0, 1.0])
MARGIN = 14  # [px] around the ball
TILTS, RIM_TILTS, RIM_SHARE = (5.0, 85.0), (85.0, 105.0), 0.1  # [°] of lamps from the camera's way; share at the rim
APART = 15.0  # [°] between a lamp and a second highlight, at least
SLOPES, GRAZING = 0.35, 0.06  # [rad] of the slopes of grooves, across and along them: standard deviations
WINGS, WING_POWER = 1.2, 1.4  # [px] where the lens's wings begin; of 1 + (r / WINGS)²
SPIKE_WIDTH, SPIKE_REACH = 0.5, 0.5  # [px]; of the diameter
SHOT, READ = 0.01, 0.004  # noise at white and in the dark, of white


@dataclass(frozen=True, eq=False)
class BallSet:
    """photographs by name; mask, white on the ball; lamps (K, 3) unit; centre (x, y) and radius of the ball [px]."""

    photographs: dict[str, Picture]
    mask: Picture
    lamps: Array
    centre: Array
    radius: float


@dataclass(frozen=True, eq=False)
class _Rays:
    """`fine` × `fine` rays a pixel: on (h, w) the ball, normal and mirrored (h, w, 3), image point (h, w, 2) [px]."""

    on: NDArray[np.bool_]
    normal: Array
    mirrored: Array
    point: Array
    centre: Array
    radius: float
    fine: int


def ball_set(condition: BallCondition, diameter: int, lamps: int, random: np.random.Generator) -> BallSet:
    """Photographs of one ball of `diameter` [px] under `lamps` far lamps, linear or in sRGB by chance."""
    rays = _rays(diameter, random)
    directions = np.array([_lamp(random) for _ in range(lamps)])
    still, wall = _still(rays, condition, directions, random)
    scratches, dust, lens = _scratches(condition, random), _dust(condition, random), _lens(rays, condition, random)
    srgb, quality = bool(random.random() < 0.5), int(random.integers(80, 98)) if condition.jpeg else None
    body, gloss = random.uniform(*condition.body), random.uniform(*condition.gloss)
    photographs = {}
    for number, lamp in zip(count(), directions):
        light = still + _lit_room(rays, condition, random) * _fresnel(rays, condition)
        light += _diffuse(rays, lamp, body) + _lamp_image(rays, condition, lamp, gloss, lens, random)
        light = _on_surface(light, rays, lamp, scratches, dust)
        seen = _blurred(np.where(rays.on, light, wall), lens) + _streaks(rays, condition, lamp, random)
        photographs[f"{number}"] = _file(_pixels(seen, rays.fine), srgb, quality, random)
    mask = np.where(_pixels(rays.on.astype(np.float64), rays.fine) >= 0.5, 255, 0).astype(np.uint8)
    return BallSet(photographs, mask, directions, rays.centre, rays.radius)


def _rays(diameter: int, random: np.random.Generator) -> _Rays:
    fine = 3 if diameter < 200 else 2
    side, radius = diameter + 2 * MARGIN, 0.5 * diameter + random.uniform(-0.5, 0.5)
    centre = 0.5 * side + random.uniform(-0.5, 0.5, 2)
    row, column = np.mgrid[: side * fine, : side * fine]
    point = np.stack([column + 0.5, row + 0.5], axis=-1) / fine
    x, y = np.moveaxis((point - centre) / radius, -1, 0)
    normal = np.stack([x, -y, np.sqrt(np.maximum(1.0 - x**2 - y**2, 0.0))], axis=-1)
    return _Rays(x**2 + y**2 < 1.0, normal, 2.0 * normal[..., 2:] * normal - FRONT, point, centre, radius, fine)


def _lamp(random: np.random.Generator) -> Array:
    """(3,) direction, uniform over the solid angle of TILTS, or for some of RIM_TILTS."""
    near, far = np.cos(np.radians(RIM_TILTS if random.random() < RIM_SHARE else TILTS))
    return _direction(random.uniform(far, near), random)


def _direction(towards: float, random: np.random.Generator) -> Array:
    """(3,) unit, with a component `towards` the camera."""
    turn, aside = random.uniform(0.0, 2.0 * np.pi), np.sqrt(1.0 - towards**2)
    return np.array([aside * np.cos(turn), aside * np.sin(turn), towards])


def _angle(directions: Array, other: Array) -> Array:
    return np.arccos(np.clip(directions @ other, -1.0, 1.0))


def _disc(angle: Array, width: float, soft: float) -> Array:
    """1 within `width` [rad], 0 beyond, over some `soft`."""
    return 1.0 / (1.0 + np.exp(np.clip((angle - width) / soft, -30.0, 30.0)))


def _fresnel(rays: _Rays, condition: BallCondition) -> Array:
    return condition.fresnel + (1.0 - condition.fresnel) * (1.0 - rays.normal[..., 2]) ** 5  # Schlick


def _still(rays: _Rays, condition: BallCondition, lamps: Array, random: np.random.Generator) -> tuple[Array, Array]:
    """What does not change with the lamp: mirrored patches, camera, second highlights, the stand; the wall behind."""
    room = np.full(rays.on.shape, random.uniform(0.005, 0.05))
    for _ in range(random.integers(0, 5)):
        off = _angle(rays.mirrored, _direction(random.uniform(-1.0, 1.0), random))
        room += random.uniform(0.0, 0.12) * _disc(off, random.uniform(0.05, 0.5), 0.01)
    room *= 1.0 - 0.8 * _disc(_angle(rays.mirrored, FRONT), random.uniform(0.05, 0.15), 0.01)
    wanted = random.integers(condition.second[0], condition.second[1] + 1)
    while wanted:
        place = _direction(random.uniform(-0.2, 0.98), random)
        if np.degrees(_angle(lamps, place)).min() > APART:
            wide = np.radians(random.uniform(0.7, 5.0))
            room += random.uniform(*condition.second_light) * _disc(_angle(rays.mirrored, place), wide, 0.003)
            wanted -= 1
    room *= _fresnel(rays, condition)
    room = np.where(rays.normal[..., 1] < random.uniform(-0.98, -0.9), random.uniform(0.0, 0.1), room)
    wall = random.uniform(0.0, 0.15) * (random.random() < 0.7) * np.linspace(0.5, 1.5, len(room))[:, None]
    return room, np.broadcast_to(wall, room.shape)


def _lit_room(rays: _Rays, condition: BallCondition, random: np.random.Generator) -> Array:
    """The table below the ball and some things around it, in the light of this lamp."""
    level, horizon = random.uniform(*condition.room), random.uniform(-0.6, -0.1)
    room = level * _disc(rays.mirrored[..., 1] - horizon, 0.0, 0.02)
    for _ in range(random.integers(0, 4)):
        off = _angle(rays.mirrored, _direction(random.uniform(-1.0, 0.6), random))
        room += random.uniform(*condition.room) * _disc(off, random.uniform(0.05, 0.3), 0.01)
    return room


def _diffuse(rays: _Rays, lamp: Array, body: float) -> Array:
    """Light that entered the body and left it: less of it at grazing angles (Fresnel)."""
    cosine = np.maximum(rays.normal @ lamp, 0.0)
    return body * cosine * (1.0 - (1.0 - cosine) ** 5) * (1.0 - (1.0 - rays.normal[..., 2]) ** 5)


def _lamp_image(
    rays: _Rays, condition: BallCondition, lamp: Array, gloss: float, lens: Spectrum, random: np.random.Generator
) -> Array:
    """The lamp's mirror image, whose peak in the photograph is drawn from `over`."""
    half = np.radians(random.uniform(*condition.lamp_deg))
    if gloss > 0.0:
        middle = lamp + FRONT
        image = _disc(_angle(rays.normal, middle / np.linalg.norm(middle)), 0.5 * half, 0.7 * gloss)
    else:
        image = _disc(_angle(rays.mirrored, lamp), half, 0.003)
    image = image * rays.on * _fresnel(rays, condition) / condition.fresnel
    return image * 10.0 ** random.uniform(*condition.over) / max(_blurred(image, lens).max(), 1e-12)


def _scratches(condition: BallCondition, random: np.random.Generator) -> list[tuple[Array, float, Array, float, float]]:
    """Arcs of circles: plane, its offset, the middle of the arc, least cosine to it, and light."""
    found = []
    low, high = np.log(condition.scratch_light)
    for _ in range(random.integers(condition.scratches[0], condition.scratches[1] + 1)):
        middle = _direction(random.uniform(0.0, 1.0), random)
        plane = random.normal(size=3)
        plane /= np.linalg.norm(plane)
        length = np.cos(random.uniform(0.05, 0.8))
        found.append((plane, float(plane @ middle), middle, float(length), float(np.exp(random.uniform(low, high)))))
    return found


def _dust(condition: BallCondition, random: np.random.Generator) -> list[tuple[Array, float, float]]:
    """Specks: place, radius [px], light; one of negative light hides so much of what the ball mirrors."""
    many = random.integers(condition.dust[0], condition.dust[1] + 1)
    return [
        (_direction(np.sqrt(random.uniform(0.0, 1.0)), random), random.uniform(0.4, 1.3), random.uniform(-0.4, 0.6))
        for _ in range(many)
    ]


def _on_surface(light: Array, rays: _Rays, lamp: Array, scratches: list, dust: list) -> Array:
    """`light` with that of scratches and dust."""
    half = (lamp + FRONT) / np.linalg.norm(lamp + FRONT)
    off = _angle(rays.normal, half)
    for plane, offset, middle, reach, level in scratches:
        across = (rays.normal @ plane - offset) * rays.radius  # [px], but for the slant
        rows, columns = np.nonzero((np.abs(across) < 1.5) & (rays.normal @ middle > reach) & rays.on)
        along = np.cross(plane, rays.normal[rows, columns])
        along /= np.linalg.norm(along, axis=1, keepdims=True) + 1e-12
        shown = np.exp(-0.5 * (along @ half / GRAZING) ** 2 - 0.5 * (off[rows, columns] / SLOPES) ** 2)
        light[rows, columns] += level * shown * np.exp(-0.5 * (across[rows, columns] / 0.5) ** 2)
    for place, size, level in dust:
        x, y = rays.centre + rays.radius * place[:2] * (1.0, -1.0)
        reach = 4.0 * size
        part = tuple(slice(max(int((at - reach) * rays.fine), 0), int((at + reach) * rays.fine) + 1) for at in (y, x))
        away = np.hypot(rays.point[part][..., 0] - x, rays.point[part][..., 1] - y)
        shown = np.exp(-0.5 * (away / size) ** 2)
        light[part] *= 1.0 + min(2.0 * level, 0.0) * shown
        light[part] += max(level, 0.0) * max(float(place @ lamp), 0.0) * shown
    return light


def _lens(rays: _Rays, condition: BallCondition, random: np.random.Generator) -> Spectrum:
    """Spectrum of the point spread: core, defocus, wings, and spikes to two sides each."""
    height, width = rays.on.shape
    y, x = (np.fft.fftfreq(n, 1.0 / n)[:, None] / rays.fine for n in (height, width))
    x = x.T
    away = np.hypot(x, y)
    core = np.exp(-0.5 * (away / random.uniform(0.35, 0.7)) ** 2)
    disc = (away <= max(random.uniform(*condition.defocus), 0.4 / rays.fine)).astype(np.float64)
    wings = (1.0 + (away / WINGS) ** 2) ** -WING_POWER
    spikes = np.zeros_like(away)
    turn, arms = random.uniform(0.0, np.pi), int(random.integers(2, 6))
    for angle in turn + np.pi * np.arange(arms) / arms:
        along, aside = x * np.cos(angle) + y * np.sin(angle), y * np.cos(angle) - x * np.sin(angle)
        fall = np.exp(-np.abs(along) / (SPIKE_REACH * random.uniform(0.1, 1.0) * rays.radius)) / (2.0 + np.abs(along))
        spikes += random.uniform(0.3, 1.0) * fall * np.exp(-0.5 * (aside / SPIKE_WIDTH) ** 2)
    shares = random.uniform(*condition.wings), random.uniform(*condition.spikes)
    core, disc, wings, spikes = (np.fft.rfft2(part / part.sum()) for part in (core, disc, wings, spikes))
    return core * disc * (1.0 - sum(shares)) + core * (shares[0] * wings + shares[1] * spikes)


def _blurred(light: Array, lens: Spectrum) -> Array:
    return np.fft.irfft2(np.fft.rfft2(light) * lens, light.shape)


def _streaks(rays: _Rays, condition: BallCondition, lamp: Array, random: np.random.Generator) -> Array:
    """Streaks from the lamp's image to one side each, on the ball only."""
    light = np.zeros(rays.on.shape)
    half = (lamp + FRONT) / np.linalg.norm(lamp + FRONT)
    off = rays.point - (rays.centre + rays.radius * half[:2] * (1.0, -1.0))
    for _ in range(random.integers(condition.streaks[0], condition.streaks[1] + 1)):
        turn, width, reach = random.uniform(0.0, 2.0 * np.pi), random.uniform(0.5, 1.4), random.uniform(0.1, 0.6)
        along = off @ (np.cos(turn), np.sin(turn))
        aside = off @ (-np.sin(turn), np.cos(turn))
        fade = np.clip(1.0 - along / (reach * rays.radius), 0.0, 1.0) ** random.uniform(0.2, 1.0) * (along > 0.0)
        light += random.uniform(*condition.streak_light) * fade * np.exp(-0.5 * (aside / width) ** 2)
    return light * rays.on


def _pixels(fine: Array, rays: int) -> Array:
    height, width = (n // rays for n in fine.shape)
    return fine.reshape(height, rays, width, rays).mean(axis=(1, 3))


def _file(light: Array, srgb: bool, quality: int | None, random: np.random.Generator) -> Picture:
    """8 bits, after noise and clipping; through JPEG of `quality`."""
    light = light + random.normal(size=light.shape) * np.hypot(READ, SHOT * np.sqrt(np.maximum(light, 0.0)))
    light = np.clip(light, 0.0, 1.0)
    if srgb:
        light = np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1.0 / 2.4) - 0.055)
    numbers = np.rint(255.0 * light).astype(np.uint8)
    if quality is None:
        return numbers
    import cv2

    packed = cv2.imencode(".jpg", numbers, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), np.uint8)
