"""Calibration of a rig: what objects or cards say of the lamps of a fixed set-up, taken together."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from hagoromo.calibration.rig.card_readings import card_readings
from hagoromo.calibration.rig.lamp_readings import LampReadings
from hagoromo.calibration.rig.object_readings import object_readings
from hagoromo.errors import InputError
from hagoromo.light.lamp import Lamp
from hagoromo.measurement.measure import distance_to
from hagoromo.measurement.surface.large_capture import coarse_or_whole
from hagoromo.measurement.surface.uneven_lamps import solve_uneven_lamps
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.rig import Array, Rig, RigLampRecord, as_rows
from hagoromo.progress import Progress, part_of, silent

SCATTER_ROUNDS = 10  # of estimating how far captures differ; it has settled to a part in a thousand then


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
