"""Encoding: test whether photographs of unknown response are linear in light, follow a power law, or sRGB.

Each hypothesis decodes the recorded values. Normals, gloss and lamps are then fitted, and the fit is encoded again and
compared with the recorded values. A body flatter than Lambert's law resembles an exponent, so a single object is not
conclusive: the response is common to all objects.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.measurement.normals.normals import solve_fit
from hagoromo.measurement.normals.photometric_model import Prior, predicted

Array = NDArray[np.float64]
EXPONENTS = (0.75, 0.87, 1.0, 1.15, 1.32)  # light = recorded^exponent
PIXELS = 2000  # number of pixels of each object in the fit
LAMBERT = Prior(roughness=1e-3, exponent=1e-3)


def encoding_study(captures: Mapping[str, hg.Capture], progress: hg.Progress = hg.silent) -> dict[str, Any]:
    """Relative residual of every object under every hypothesis; the exponent that each asks for, their mean and error.

    The photographs hold recorded values, 1 at white. Returns {"residuals": {object: {hypothesis: …}}, "exponents":
    {object: …}, "mean", "standard_error"}, the exponents those of light = recorded^exponent.
    """
    residuals: dict[str, dict[str, float]] = {}
    for i, (name, capture) in enumerate(captures.items()):
        progress(i / len(captures), name)
        pixels = hg.views_from_capture(capture)
        count = len(pixels.rows)
        pixels = pixels.pixels(np.sort(np.random.default_rng(0).choice(count, min(PIXELS, count), replace=False)))
        recorded = pixels.values * pixels.light
        powers = {f"{power:g}": _residual(pixels, recorded, recorded**power, 1.0 / power) for power in EXPONENTS}
        residuals[name] = powers | {"sRGB": _residual(pixels, recorded, hg.srgb_decode(255.0 * recorded), None)}
    wanted = {name: _lowest({k: v for k, v in of.items() if k != "sRGB"}) for name, of in residuals.items()}
    values = np.array(list(wanted.values()))
    error = float(values.std(ddof=1) / np.sqrt(len(values))) if len(values) > 1 else None
    return {"residuals": residuals, "exponents": wanted, "mean": float(values.mean()), "standard_error": error}


def _residual(pixels: hg.Views, recorded: Array, light: Array, back: float | None) -> float:
    """Median relative residual in recorded values, where `light` is what they stand for; back: exponent, or sRGB."""
    slope = np.maximum(light, 1e-4) / np.maximum(recorded, 1e-4)
    decoded = replace(pixels, values=light / pixels.light, variance=pixels.variance * slope**2)
    normals, body = hg.robust_lambert(decoded)
    labels = np.zeros(pixels.shape, np.int64)
    decoded, fit = solve_fit(decoded, labels, normals, body, LAMBERT)
    model = fit.evenness(decoded.place)[:, None] * predicted(fit, decoded.to_lamp, pixels.to_eye) * decoded.light
    encoded = _srgb_encoded(model) if back is None else model**back
    size = np.maximum(recorded, recorded.mean(axis=0))
    return float(np.median((np.abs(encoded - recorded) / size)[np.broadcast_to(pixels.used[:, None], size.shape)]))


def _srgb_encoded(light: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB's display values 0…1 of linear light (IEC 61966-2-1)."""
    return np.where(light <= 0.0031308, 12.92 * light, 1.055 * np.maximum(light, 1e-9) ** (1 / 2.4) - 0.055)


def _lowest(residuals: Mapping[str, float]) -> float:
    """The exponent of the least residual: the vertex of a parabola in logarithms through the three lowest points."""
    exponent, height = np.log([float(key) for key in residuals]), np.log(list(residuals.values()))
    middle = int(np.clip(np.argmin(height), 1, len(exponent) - 2))
    a, b, _ = np.polyfit(exponent[middle - 1 : middle + 2], height[middle - 1 : middle + 2], 2)
    vertex = -b / (2.0 * a) if a > 0.0 else exponent[np.argmin(height)]
    return float(np.exp(np.clip(vertex, exponent[0], exponent[-1])))
