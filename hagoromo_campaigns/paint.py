"""Paint: body colours of two campaigns in the same channels, and their difference as people see it under any lamp.

Where cameras and lamps of both campaigns are alike, their channels are compared; else the likeliest spectra of AFTER,
as BEFORE's camera would read them. Without known responses three channels are taken for linear sRGB.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.response import WHITE_XYZ, Response, camera_white, response_matrix
from hagoromo.errors import InputError
from hagoromo.light.colour import SRGB_FROM_XYZ, delta_e_2000
from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.spectra.body_basis import body_basis
from hagoromo_campaigns.campaign import Campaign

Array = NDArray[np.float64]
AS_PHOTOGRAPHED = "as photographed"
DEFAULT_LAMP = "D65"
PLAUSIBLE = (0.1, 1.1)  # reflectance of the brightest places, within which colours are taken for absolute
BRIGHT_PERCENTILE = 99.5
SHOWN_WHITE = 0.8  # reflectance that the brightest places are given where the strength of the lamps is not known
SLOPE = 1e-3  # of ln values, by which slopes of ΔE00 are taken


@dataclass(frozen=True, eq=False)
class Paint:
    """before, after: (h, w, k) of each campaign, above 0, and the variances (h, w, k) of their logarithms.

    displays: name of a lamp → (3, k) from BEFORE's values to linear sRGB with a perfect white as (1, 1, 1).
    assumption: what is taken for given, in words.
    """

    before: Array
    before_variance: Array
    after: Array
    after_variance: Array
    displays: Mapping[str, Array]
    assumption: str

    def delta_e(self, label: str, before: Array, change: Array) -> Array:
        """ΔE00 (…) of values `before` (…, k) whose logarithms change by `change` (…, k), under a lamp."""
        to_display = self.displays[label]
        seen = [np.clip(values @ to_display.T, 0.0, None) for values in (before, before * np.exp(change))]
        return delta_e_2000(*seen)

    def delta_e_error(self, label: str, before: Array, change: Array, variance: Array) -> Array:
        """Standard error (…) of `delta_e` by the variance (…, k) of `change`."""
        start, total = self.delta_e(label, before, change), np.zeros(change.shape[:-1])
        for k in range(change.shape[-1]):
            step = np.zeros(change.shape[-1])
            step[k] = SLOPE
            total += ((self.delta_e(label, before, change + step) - start) / SLOPE) ** 2 * variance[..., k]
        return np.sqrt(total)


def paint(before: Campaign, after: Campaign, lamps: Sequence[str]) -> Paint:
    """The colours of two campaigns. lamps: names of illuminants under which they are compared; () for the default.

    `InputError` for lamps where a response is unknown, and for channels that cannot be compared.
    """
    responses = before.camera.response, after.camera.response
    if responses[0] is None and responses[1] is None:
        if lamps:
            raise InputError(
                f"lamps cannot be changed to {', '.join(lamps)}: the response of the cameras is not known; leave "
                "--lamp out, or measure captures that have one"
            )
        return _unknown(before, after)
    if responses[0] is None or responses[1] is None or before.lamp is None or after.lamp is None:
        lacks = before if responses[0] is None or before.lamp is None else after
        raise InputError(
            f"colours cannot be compared: {lacks.name} does not say the response of its camera, or its lamps, and the "
            "other does; measure a capture that has both"
        )
    spectra = {name: Spectrum.named(name) for name in (lamps or (DEFAULT_LAMP,))}
    displays = _displays(responses[0], before.lamp, spectra)
    white, said = _white(before, next(iter(displays.values())))
    value, variance = after.body, after.body_variance
    if not (responses[0].equals(responses[1]) and before.lamp.equals(after.lamp)):
        basis = body_basis(responses[1], after.lamp)
        readings = response_matrix(basis, before.lamp, responses[0])
        readings = readings / camera_white(before.lamp, responses[0])[:, None]  # body colours are relative to white
        value, variance = _through(readings, value, variance)
        said += (
            "; the cameras, or the spectra of the lamps, of both differ: the likeliest spectra of AFTER are compared "
            "as BEFORE's camera would read them"
        )
    shown = {name: white * matrix for name, matrix in displays.items()}
    return Paint(before.body, before.body_variance, value, variance, shown, said)


def _unknown(before: Campaign, after: Campaign) -> Paint:
    count = before.body.shape[2]
    if count != after.body.shape[2]:
        raise InputError(
            f"{before.name} has {count} channels of colour and {after.name} {after.body.shape[2]}, of unknown "
            "response: they cannot be compared; give the response of the cameras to their captures"
        )
    to_display = np.eye(3) if count == 3 else np.full((3, count), 1.0 / count)
    white, said = _white(before, to_display)
    said += "; the response of the cameras is not known: channels are taken for linear sRGB, and for the same in both"
    values = (before.body, before.body_variance), (after.body, after.body_variance)
    return Paint(*values[0], *values[1], {AS_PHOTOGRAPHED: white * to_display}, said)


def _displays(response: Response, lamp: Spectrum, lamps: Mapping[str, Spectrum]) -> dict[str, Array]:
    """(3, C) from body colours, per unit of reflectance, to linear sRGB with each of `lamps` as white."""
    basis, observer = body_basis(response, lamp), Response.load("cie1931")
    return {
        name: SRGB_FROM_XYZ @ (response_matrix(basis, by, observer) * (WHITE_XYZ / camera_white(by, observer))[:, None])
        for name, by in lamps.items()
    }


def _through(matrix: Array, body: Array, variance: Array) -> tuple[Array, Array]:
    """Values (h, w, k) by `matrix` (k, C) of `body` (h, w, C), above 0, and the variance of their logarithms."""
    value = body @ matrix.T
    with np.errstate(invalid="ignore"):
        value = np.where(value > 0.0, value, np.nan)
        return value, (variance * body**2) @ (matrix**2).T / value**2


def _white(before: Campaign, to_display: Array) -> tuple[float, str]:
    """Factor from body colours [1/sr] to reflectance, and what it takes for given."""
    seen = math.pi * (before.body[before.known] @ to_display.T).max(axis=1)
    bright = float(np.percentile(seen, BRIGHT_PERCENTILE))
    if PLAUSIBLE[0] <= bright <= PLAUSIBLE[1]:
        return math.pi, "lamps are as strong as stated: colours are those of reflectances"
    said = f"the strength of the lamps is not known: the brightest places are taken for reflectances of {SHOWN_WHITE:g}"
    return math.pi * SHOWN_WHITE / max(bright, 1e-30), said
