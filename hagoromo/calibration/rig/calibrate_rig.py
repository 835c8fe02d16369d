"""Calibration of a rig: what objects or cards say of the lamps of a fixed set-up, taken together.

Lamps beside one another as a solved object shows them: the photometric fit has their strengths and fall-off.

Lamps beside one another as a flat matte card shows them, which fills the mask of the photographs.

    ln value_kc(p) = ln body_c(p) + ln E stated + ln max(n · l_k, 0) + ln e_kc + a_k · p

The body of each place of the card is free: it may be stained. The normal of the card must be known, as a tilt looks
like lamps of other strengths.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.measurement.lamp_departure import solve_uneven_lamps
from hagoromo.measurement.measure import distance_to
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.measurement.normals.views import check_lamps
from hagoromo.measurement.surface.solved_surface import coarse_or_whole
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.rig import Array, Rig, RigLampRecord, as_rows
from hagoromo.progress import Progress, part_of, silent

SCATTER_ROUNDS = 10  # of estimating how far captures differ; it has settled to a part in a thousand then
BLOCKS, PARTS = 32, 4  # the picture's width in blocks, whose means are fitted, and in parts, taken as independent
FEWEST_BLOCKS = 12
LEAST_INCIDENCE = 0.1  # cosine: the strength of a lamp that grazes the card is uncertain
NORMAL_ERROR = np.radians(1.0)  # of the stated normal of the card


def calibrate_rig(
    captures: Sequence[Capture | str | Path],
    *,
    card: bool = False,
    normal: ArrayLike | None = None,
    distance: float | None = None,
    progress: Progress = silent,
) -> Rig:
    """The strengths of the lamps beside one another and the fall-off of their light, from one capture or several.

    Each capture, or folder of one, shows an object under all the lamps, one in each photograph; its shape is solved.
    Photographs in a folder that need more than 4 GiB are read one at a time, as means over squares of pixels.
    card: it shows a flat matte card in the mask instead, which faces `normal` (3,), world (default: the camera), to 1°.
    distance [m]: as in `measure`. With several captures, what differs between them is part of the errors.

    `InputError` for captures under different lamps or of different views, for objects of known shape, and as `measure`
    does.
    """
    if not captures:
        raise InputError("a rig needs a capture of an object, or of a card: give one or more")
    if normal is not None and not card:
        raise InputError("normal (--normal) is that of a flat card: give card (--card), too")
    readings = []
    for number, source in enumerate(captures):
        capture = source if isinstance(source, Capture) else coarse_or_whole(source)
        progress(number / len(captures), capture.name)
        part = part_of(progress, number / len(captures), 1.0 / len(captures))
        readings.append(
            card_readings(capture, None if normal is None else np.asarray(normal, np.float64))
            if card
            else _of_object(capture, distance, part)
        )
    progress(1.0, "")
    return rig_of(readings)


def _of_object(capture: Capture, distance: float | None, progress: Progress) -> LampReadings:
    if capture.points is not None and capture.normals is not None:
        raise InputError(
            f"capture {capture.name!r} has a known shape, under which lamps are taken as stated: leave its points and "
            "normals out"
        )
    away = distance_to(capture.photographs[0], distance)
    return object_readings(capture, solve_uneven_lamps(capture, away, progress))


def rig_of(readings: Sequence[LampReadings]) -> Rig:
    """The rig of one or several readings of the same lamps; `InputError` for other lamps or another view."""
    first = readings[0]
    stated = Rig(
        first.size, tuple(RigLampRecord(**_where(one), strength=(1.0,) * first.colour.shape[1]) for one in first.lamps)
    )
    same = [first, *(_in_order(one, stated) for one in readings[1:])]
    level = np.stack([one.level - one.level.mean(axis=0) for one in same])  # (S, K, 3) at the places of the objects
    variance, moves = np.stack([one.variance for one in same]), np.stack([one.moved() for one in same])
    mean, covariance = _together(level, variance, moves)
    mean = mean - mean.mean(axis=0)
    turn, turn_error = _turns(same)
    colour = np.mean([one.colour - one.colour.mean(axis=0) for one in same], axis=0)
    lamps = tuple(
        RigLampRecord(
            **_where(lamp),
            strength=tuple(np.exp(mean[k, 0] + colour[k]).tolist()),
            slope=(float(mean[k, 1]), float(mean[k, 2])),
            turn=tuple(turn[k].tolist()),
            covariance=as_rows(covariance[k]),
            turn_error=float(turn_error[k]),
        )
        for k, lamp in enumerate(first.lamps)
    )
    return Rig(first.size, lamps, tuple(one.name for one in same))


def _where(lamp: Lamp) -> dict[str, Any]:
    """The keys of a lamp of the rig that say which one it is."""
    vector = {"to_lamp": lamp.to_lamp, "position": lamp.position}
    return {"name": lamp.name} | {key: tuple(of.tolist()) for key, of in vector.items() if of is not None}


def _in_order(readings: LampReadings, rig: Rig) -> LampReadings:
    """Readings of the lamps in the order of `rig`."""
    width, height = readings.size
    rig.place((height, width))
    if readings.colour.shape[1] != len(rig.lamps[0].strength):
        raise InputError(f"capture {readings.name!r} has another number of channels than the first: give it apart")
    found = [rig.lamps.index(rig.lamp_of(lamp)) for lamp in readings.lamps]
    if sorted(found) != list(range(len(rig.lamps))):
        raise InputError(
            f"capture {readings.name!r} has {len(found)} lamps, the first capture {len(rig.lamps)}: a rig needs the "
            "same lamps in all, one photograph each"
        )
    return readings.ordered(np.argsort(found).tolist())


def _together(level: Array, variance: Array, moves: Array) -> tuple[Array, Array]:
    """Mean (K, 3) in the middle of the picture of levels (S, K, 3) at the places of S objects, and its covariance.

    Captures differ by more than their errors: by a variance that is the same for all lamps, and is estimated with the
    mean (DerSimonian 1986). It is part of the covariance, that of a further capture.
    """
    count, lamps = level.shape[:2]
    extra = np.zeros(3)
    for _ in range(SCATTER_ROUNDS if count > 1 else 1):
        own = np.einsum("sij,skj,slj->skil", moves, variance + extra, moves)
        weight = np.linalg.inv(own)
        covariance = np.linalg.inv(weight.sum(axis=0))
        mean = np.einsum("kij,skjl,slm,skm->ki", covariance, weight, moves, level)
        if count > 1:
            left = np.linalg.solve(moves[:, None], mean[None, :, :, None])[..., 0] - level
            extra = np.maximum((left**2).sum(axis=(0, 1)) / (lamps * (count - 1)) - variance.mean(axis=(0, 1)), 0.0)
    return mean, covariance + np.diag(extra)


def _turns(readings: Sequence[LampReadings]) -> tuple[Array, Array]:
    """Mean turn (K, 3) of far lamps, and its standard error (K,)."""
    error = np.stack([one.turn_error for one in readings])
    weight = np.where(error > 0.0, 1.0 / np.maximum(error, 1e-12) ** 2, 1.0)
    turn = np.einsum("sk,ski->ki", weight / weight.sum(axis=0), np.stack([one.turn for one in readings]))
    return turn, np.where((error > 0.0).all(axis=0), weight.sum(axis=0) ** -0.5, 0.0)


def object_readings(capture: Capture, solved: NormalMap) -> LampReadings:
    """The lamps of `capture`, whose normals are `solved`."""
    views, fit = solved.views, solved.fit
    if fit.lamp_variance is None:
        raise InputError(f"the lamps of capture {capture.name!r} were not fitted: calibrate the rig on another object")
    height, width = views.shape
    radius = np.sqrt(len(views.rows) / np.pi)
    middle = np.array([views.columns.mean(), views.rows.mean()]) + 0.5
    half, stated = width / 2, tuple(one.lamps[0] for one in capture.photographs)
    level = np.column_stack([fit.strength, fit.slope * (half / radius)])
    level += _by_place(capture, solved)
    far = np.array([lamp.position is None for lamp in stated])
    return LampReadings(
        capture.name,
        (width, height),
        stated,
        (middle - np.array([width, height]) / 2) / half,
        level,
        fit.lamp_variance[:, :3] * np.array([1.0, half / radius, half / radius]) ** 2,
        _colour(solved),
        np.where(far[:, None], fit.shift, 0.0),
        np.where(far, np.sqrt(fit.lamp_variance[:, 3:].mean(axis=1)), 0.0),
    )


def _by_place(capture: Capture, solved: NormalMap) -> Array:
    """(K, 3) ln of a near lamp's irradiance where the fit has the lamp over that of the stated lamp, and its slope."""
    views, found = solved.views, []
    columns = np.column_stack([np.ones(len(views.rows)), views.place])
    scale = np.array([1.0, *(2 * [views.shape[1] / 2 / np.sqrt(len(views.rows) / np.pi)])])
    for photograph, lamp in zip(capture.photographs, views.lamps, strict=True):
        stated = photograph.lamps[0]
        if stated.position is None:
            found.append(np.zeros(3))
            continue
        before, after = (one.direction_and_irradiance(views.points)[1] for one in (stated, lamp))
        ratio = np.log(np.maximum(after, 1e-30) / np.maximum(before, 1e-30))
        found.append(scale * np.linalg.lstsq(columns, ratio.reshape(len(columns), -1).mean(axis=1), rcond=None)[0])
    return np.array(found)


def _colour(solved: NormalMap) -> Array:
    """(K, C) ln of the channels' strengths over their mean: medians over the object."""
    views, fit = solved.views, solved.fit
    model = fit.evenness(views.place)[:, None] * predicted(fit, views.to_lamp, views.to_eye)
    known = views.used[:, None] & (views.values > 0.0) & (model > 0.0)
    ratio = np.where(known, np.log(np.where(known, views.values / np.where(known, model, 1.0), 1.0)), np.nan)
    count = known.sum(axis=2)
    ratio = np.where(count[..., None] > 0, ratio, 0.0)
    colour = np.nanmedian(ratio, axis=2)
    return colour - colour.mean(axis=1, keepdims=True)


def card_readings(capture: Capture, normal: Array | None = None) -> LampReadings:
    """The lamps of `capture`, photographs of a card that faces `normal` (3,) (default: the camera)."""
    photographs = capture.photographs
    check_lamps(photographs, fewest=2)
    camera = photographs[0].camera
    normal = -camera.camera_to_world[:3, 2] if normal is None else np.asarray(normal, np.float64)
    normal = normal / np.linalg.norm(normal)
    height, width = photographs[0].values.shape[:2]
    mask = np.all([one.mask & (one.values > 0.0).all(axis=2) for one in photographs], axis=0)
    points = _points(capture, normal, mask)
    rows, columns = np.nonzero(mask)
    p = np.column_stack([columns + 0.5 - width / 2, rows + 0.5 - height / 2]) / (width / 2)
    block = np.unique(np.floor((p + 1.0) * BLOCKS / 2).astype(int) @ np.array([1, 4 * BLOCKS]), return_inverse=True)[1]
    if not len(p) or block.max() + 1 < FEWEST_BLOCKS:
        raise InputError(
            f"capture {capture.name!r} shows no card that is valid in all photographs: mask the card, and expose it "
            "below white"
        )
    count = np.bincount(block)
    means = np.stack([np.bincount(block, one) / count for one in p.T], axis=1)
    logs, incidence = zip(*(_log(one, mask, points, normal, block) for one in photographs), strict=True)
    values = np.stack(logs) - np.mean(logs, axis=0)  # (K, C, blocks)
    place = means.mean(axis=0)
    level, variance = _plane(values.mean(axis=1), means - place)
    variance[:, 0] += (NORMAL_ERROR * np.sqrt(np.maximum(np.array(incidence) ** -2.0 - 1.0, 0.0))) ** 2
    colour = np.median(values, axis=2)
    lamps = tuple(one.lamps[0] for one in photographs)
    none = np.zeros((len(lamps), 3))
    colour = colour - colour.mean(axis=1, keepdims=True)
    return LampReadings(capture.name, (width, height), lamps, place, level, variance, colour, none, none[:, 0])


def _log(
    photograph: Photograph, mask: NDArray[np.bool_], points: Array, normal: Array, block: NDArray[np.intp]
) -> tuple[Array, float]:
    """(C, blocks) means of ln of the values over what an even lamp would give, and the mean cosine of incidence."""
    lamp = photograph.lamps[0]
    to_lamp, irradiance = lamp.direction_and_irradiance(points)
    cosine = to_lamp @ normal
    if cosine.min() < LEAST_INCIDENCE:
        raise InputError(
            f"lamp {lamp.name!r} does not light the card from its front: turn the card, or state its normal (--normal)"
        )
    even = irradiance.reshape(len(points), -1) * cosine[:, None]
    logs = np.log(photograph.values[mask] / even)
    return np.stack([np.bincount(block, one) / np.bincount(block) for one in logs.T]), float(cosine.mean())


def _plane(values: Array, place: Array) -> tuple[Array, Array]:
    """Level and slope (K, 3) of values (K, blocks) at `place` (blocks, 2), and their variances.

    Blocks of one part of the picture count as one: errors of the model are the same there.
    """
    columns = np.column_stack([np.ones(len(place)), place])
    inverse = np.linalg.inv(columns.T @ columns + 1e-12 * np.eye(3))
    level = values @ columns @ inverse
    part = np.unique(np.floor((place + 1.0) * PARTS / 2).astype(int) @ np.array([1, 4 * PARTS]), return_inverse=True)[1]
    variance = np.empty(level.shape)
    for k, left in enumerate(values - level @ columns.T):
        score = np.stack([np.bincount(part, left * one) for one in columns.T], axis=1)
        variance[k] = np.diag(inverse @ (score.T @ score) @ inverse)
    return level, variance


def _points(capture: Capture, normal: Array, mask: NDArray[np.bool_]) -> Array:
    """(P, 3) points of the card: of the capture, else of the plane through the world's origin."""
    if capture.points is not None:
        return capture.points[mask].astype(np.float64)
    camera, rays = capture.photographs[0].camera, capture.photographs[0].camera.pixel_directions()[mask]
    near = any(lamp.position is not None for one in capture.photographs for lamp in one.lamps)
    away = float(camera.position @ normal)
    if near and abs(away) < 1e-9:
        raise InputError("near lamps need to know where the card is: put the world's origin on it")
    return camera.position - rays * (away / (rays @ normal))[:, None]


@dataclass(frozen=True, eq=False)
class LampReadings:
    """K lamps on one object or card.

    name: of the capture. size: of its pictures [px]. lamps: as stated. level: (K, 3) ln strength at `place` (2,), the
    middle of the object in p of `Rig`, and slope by p. variance: (K, 3) of it. colour: (K, C) ln of the channels'
    strengths over their mean. turn: (K, 3) of far lamps' directions [rad], and turn_error (K,).
    """

    name: str
    size: tuple[int, int]
    lamps: tuple[Lamp, ...]
    place: Array
    level: Array
    variance: Array
    colour: Array
    turn: Array
    turn_error: Array

    def ordered(self, order: list[int]) -> LampReadings:
        """The lamps in another order."""
        parts = {name: getattr(self, name)[order] for name in ("level", "variance", "colour", "turn", "turn_error")}
        return replace(self, lamps=tuple(self.lamps[k] for k in order), **parts)

    def moved(self) -> Array:
        """(3, 3) matrix from `level` to the same in the middle of the picture."""
        return np.array([[1.0, -self.place[0], -self.place[1]], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
