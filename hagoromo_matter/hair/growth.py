"""Growth: hairs that grow on a shape, are combed, hang down and gather in locks. All in mm.

A hair starts along its lean from the skin and turns, over `bend_mm`, to where it is combed: down and to the back along
the skin, away from the parting; beyond the skin it hangs. Locks draw hairs to one of them, the more the farther from
the root. The front is −y; heights are shares of the shape's.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from hagoromo.backend import arrays, column
from hagoromo.errors import InputError
from hagoromo.files.memory import require
from hagoromo.files.record import Fraction, NotNegative, Positive, about, from_to
from hagoromo.matter.shape import Shape, distance_and_normal
from hagoromo_matter.hair.fibres import Curves

MOST_HAIRS, MOST_LOCKS = 1_000_000, 100_000
STEPS = 48  # segments of a hair
BYTES_PER_POINT = 400.0
BAND_MM = 1.5  # points this close to the skin are moved onto it, and become roots
TRIES, TRIES_AT_ONCE = 400, 1 << 18  # how often points are drawn, and how many
LEAST_TRIES = 12  # after which the share that found a place shows whether enough of them will
FALL_MM = 15.0  # [mm] from the skin on, over which combing gives way to the fall
TAPER = 0.5  # of the diameter that a tip keeps


class Growth(NamedTuple):
    """What grows on a shape, and how it is combed.

    A scalp has some 100 000 hairs, 0.05–0.1 mm thick (Robbins 2012, "Chemical and Physical Behavior of Human Hair").
    """

    hairs: Annotated[int, from_to(1, MOST_HAIRS), about("number of hairs")] = 60_000
    diameter_mm: Annotated[Positive, about("diameter of a hair at its root [mm]")] = 0.08
    length_mm: Annotated[Positive, about("length of the longest hairs [mm]")] = 160.0
    uneven: Annotated[Fraction, about("share by which the shortest hairs are shorter")] = 0.25
    front: Annotated[Fraction, about("height of the hairline in front, as a share of the shape's height")] = 0.75
    back: Annotated[Fraction, about("height of the hairline behind, as a share of the shape's height")] = 0.25
    lean_deg: Annotated[NotNegative, about("lean of hairs at the root, from the skin's normal [°]")] = 55.0
    bend_mm: Annotated[Positive, about("length over which a hair turns to where it is combed [mm]")] = 12.0
    parting_mm: Annotated[float, about("place of the parting along x [mm]")] = 25.0
    parted: Annotated[NotNegative, about("strength of the parting; 0: combed to the back")] = 1.2
    volume_mm: Annotated[NotNegative, about("thickness of the hair over the skin [mm]")] = 9.0
    locks: Annotated[int, from_to(0, MOST_LOCKS), about("number of locks that hairs gather in; 0: none")] = 500
    gathered: Annotated[Fraction, about("share of the way that hairs have come to their lock at the tips")] = 0.7
    wave_mm: Annotated[NotNegative, about("half width of the waves of a lock [mm]")] = 1.5
    wave_length_mm: Annotated[Positive, about("length of a wave [mm]")] = 45.0
    stray_mm: Annotated[NotNegative, about("how far single hairs stray from their lock at the tip [mm]")] = 4.0


def grown(shape: Shape, extent: Any, growth: Growth, seed: int) -> Curves:
    """The hairs on `shape`, which lies within `extent` (corners) [mm]; `InputError` where none finds a place."""
    require(BYTES_PER_POINT * growth.hairs * (STEPS + 1), f"{growth.hairs} hairs")
    draw = np.random.default_rng((seed, 61))
    root, normal = _roots(shape, extent, growth, draw)
    length = growth.length_mm * (1.0 - growth.uneven * draw.random(len(root)))
    points = _combed(shape, root, normal, length, growth, draw)
    if growth.locks:
        points = _gathered(points, growth, draw)
    clear = 0.5 * growth.diameter_mm
    points = _cut(_held_off(shape, points.reshape(-1, 3), clear).reshape(points.shape), length)
    points = _held_off(shape, points.reshape(-1, 3), clear).reshape(points.shape)  # chords between points dip in
    taper = np.linspace(1.0, TAPER, STEPS + 1)
    diameter = growth.diameter_mm * np.tile(taper, len(points))
    return Curves(points.reshape(-1, 3), np.arange(len(points) + 1) * (STEPS + 1), diameter)


def _roots(shape: Shape, extent: Any, growth: Growth, draw: np.random.Generator) -> tuple[NDArray, NDArray]:
    """Roots, evenly strewn over the skin behind the hairline, and the skin's normal there: (hairs, 3) both."""
    low, high = (np.asarray(corner, float) for corner in extent)
    roots: list[tuple[NDArray, NDArray]] = []
    found = 0
    for number in range(TRIES):
        place = low + (high - low) * draw.random((TRIES_AT_ONCE, 3))
        away, normal = _skin(shape, place)
        place, normal, away = (values[np.abs(away) < BAND_MM] for values in (place, normal, away))
        place = place - normal * away[:, None]
        kept = _is_hairy(place, low, high, growth)
        roots.append((place[kept], normal[kept]))
        found += int(kept.sum())
        if found >= growth.hairs:
            place, normal = (np.concatenate(values)[: growth.hairs] for values in zip(*roots, strict=True))
            return place, normal
        if number >= LEAST_TRIES and found * TRIES < growth.hairs * number:
            break
    raise InputError(
        f"{found} of {growth.hairs} hairs find a place on the shape: give a lower hairline (front, back) or fewer hairs"
    )


def _is_hairy(place: NDArray, low: NDArray, high: NDArray, growth: Growth) -> NDArray[np.bool_]:
    """Whether points of the skin lie above the hairline."""
    middle = 0.5 * (low + high)
    out = place[:, :2] - middle[:2]
    frontal = 0.5 - 0.5 * out[:, 1] / np.maximum(np.linalg.norm(out, axis=1), 1e-9)  # 1 in front, 0 behind
    line = growth.back + (growth.front - growth.back) * frontal * frontal * (3.0 - 2.0 * frontal)
    return (place[:, 2] - low[2]) / (high[2] - low[2]) > line


def _combed(
    shape: Shape, root: NDArray, normal: NDArray, length: NDArray, growth: Growth, draw: np.random.Generator
) -> NDArray[np.float64]:
    """Points of the hairs, (hairs, STEPS + 1, 3), as they are combed."""
    points, step = [root], (length / STEPS)[:, None]
    layer = growth.volume_mm * np.sqrt(draw.random(len(root)))
    stray = draw.normal(size=(2, len(root), 3)) * (growth.stray_mm / growth.length_mm)
    lean = math.radians(growth.lean_deg)
    way = _unit(math.cos(lean) * normal + math.sin(lean) * _along(_comb(root, normal, growth), normal))
    place = root
    for number in range(STEPS):
        away, normal = _skin(shape, place)
        comb = _comb(place, normal, growth)
        combed, fallen = _along(comb, normal), np.clip((away - layer) / FALL_MM, 0.0, 1.0)[:, None]
        wanted = _unit((1.0 - fallen) * combed + fallen * np.array([0.0, 0.0, -1.0]))
        wanted = _unit(wanted + stray[0] + stray[1] * math.sin(9.0 * number / STEPS))
        way = _unit(way + np.minimum(step / growth.bend_mm, 1.0) * (wanted - way))
        place = place + step * way
        rise = np.minimum(1.0, (number + 1) * step[:, 0] / growth.bend_mm)  # the layer is reached over a bend
        place = _held_off(shape, place, rise * layer)
        points.append(place)
    return np.stack(points, axis=1)


def _comb(place: NDArray, normal: NDArray, growth: Growth) -> NDArray[np.float64]:
    """Where hairs are combed to: down; on top also to the back and away from the parting."""
    top = np.clip(normal[:, 2], 0.0, 1.0)
    side = np.tanh((place[:, 0] - growth.parting_mm) / 3.0)
    return np.stack([growth.parted * top * side, 0.7 * top, -np.ones(len(place))], axis=-1)


def _gathered(points: NDArray, growth: Growth, draw: np.random.Generator) -> NDArray[np.float64]:
    """Hairs drawn to the middle hair of their lock, which waves."""
    root = points[:, 0]
    middles = draw.permutation(len(root))[: growth.locks]
    lock = np.asarray(KDTree(root[middles]).query(root)[1])
    share = np.linspace(0.0, 1.0, points.shape[1])[None, :, None]
    middle = points[middles]
    steps = np.linalg.norm(np.diff(middle, axis=1), axis=2)
    along = np.concatenate([np.zeros((len(middle), 1)), np.cumsum(steps, axis=1)], axis=1)
    turn = 2.0 * np.pi * (along / growth.wave_length_mm + draw.random((len(middle), 1)))
    way = _unit(np.gradient(middle, axis=1))
    aside = _unit(np.cross(way, np.array([0.31, 0.95, 0.05])))
    above = np.cross(way, aside)
    wave = growth.wave_mm * share * (aside * np.sin(turn)[..., None] + 0.5 * above * np.cos(turn)[..., None])
    pull = growth.gathered * share**0.7 * (0.75 + 0.25 * draw.random((len(root), 1, 1)))
    return points + pull * (middle[lock] - points) + wave[lock]


def _cut(points: NDArray, length: NDArray) -> NDArray[np.float64]:
    """Hairs cut where they have become longer than their length: locks and the skin have drawn them out."""
    steps = np.linalg.norm(np.diff(points, axis=1), axis=2)
    along = np.concatenate([np.zeros((len(points), 1)), np.cumsum(steps, axis=1)], axis=1)
    share = np.linspace(0.0, 1.0, points.shape[1])
    kept = points.copy()
    for hair in np.flatnonzero(along[:, -1] > length):
        for k in range(3):
            kept[hair, :, k] = np.interp(share * length[hair], along[hair], points[hair, :, k])
    return kept


def _held_off(shape: Shape, place: NDArray, clear: Any) -> NDArray[np.float64]:
    """Points moved out to `clear` [mm] above the skin."""
    away, normal = _skin(shape, place)
    return place + normal * np.maximum(clear - away, 0.0)[:, None]


def _skin(shape: Shape, place: NDArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Distance from the skin and its normal at points (n, 3)."""
    jit = arrays()
    point = jit.Array3f(*(column(jit.Float, np.asarray(each, np.float32)) for each in place.T))
    away, normal = distance_and_normal(shape, point)
    return np.array(away, np.float64), np.array(normal, np.float64).T


def _along(vector: NDArray, normal: NDArray) -> NDArray[np.float64]:
    """The unit part of vectors along a surface."""
    return _unit(vector - normal * (vector * normal).sum(axis=-1, keepdims=True))


def _unit(vector: NDArray) -> NDArray[np.float64]:
    return vector / np.maximum(np.linalg.norm(vector, axis=-1, keepdims=True), 1e-12)
