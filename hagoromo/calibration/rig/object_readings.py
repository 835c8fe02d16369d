"""Lamps beside one another as a solved object shows them: the photometric fit has their strengths and fall-off."""

from __future__ import annotations

import numpy as np

from hagoromo.calibration.rig.lamp_readings import LampReadings
from hagoromo.errors import InputError
from hagoromo.measurement.normals.normals import NormalMap
from hagoromo.measurement.normals.photometric_model import predicted
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.rig import Array


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
