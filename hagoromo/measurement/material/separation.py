"""Dichromatic separation: a photograph separated into the diffuse (body) and specular (interface) parts of its light.

A value is v = m_b c + m_s e + noise, with c the body's colour and e the light's in the channels of the camera. m_s is
estimated from the colours by weighted least squares (Klinker, Shafer & Kanade 1988) and from the measured materials;
the two are combined by their variances, so the materials decide for a grey body and the colours for a coloured one.
The rest is the body.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hagoromo.files.exr import write_exr
from hagoromo.files.png import write_png
from hagoromo.light.colour import srgb_encode
from hagoromo.measurement.material.body_map import SeparatedParts
from hagoromo.measurement.sight import Array
from hagoromo.photograph.photograph import Photograph

TRUST = 0.3  # relative error assumed for the materials' interface part
FLOOR = 0.01  # of the value: error of that part where the materials have no highlight
COLOUR_ERROR = 0.02  # relative error assumed for the colours c and e


@dataclass(frozen=True, eq=False)
class Separation:
    """Parts (h, w, C) of photograph `number` of a capture, NaN where no material is known or the pixel is invalid."""

    number: int
    body: Array
    interface: Array


def separated(photograph: Photograph, parts: SeparatedParts, number: int) -> Separation:
    """The parts of `photograph`, which sum to its values; neither is negative except for noise."""
    values = np.where(photograph.mask[..., None], photograph.values.astype(np.float64), np.nan)
    with np.errstate(invalid="ignore", divide="ignore"):
        c = parts.body / np.linalg.norm(parts.body, axis=2, keepdims=True)
        e = parts.light / np.linalg.norm(parts.light, axis=2, keepdims=True)
        weight = 1.0 / (photograph.variance + (COLOUR_ERROR * values) ** 2)
        cc, ce, ee = ((weight * one * other).sum(axis=2) for one, other in ((c, c), (c, e), (e, e)))
        cv, ev = ((weight * one * values).sum(axis=2) for one in (c, e))
        determinant = np.maximum(cc * ee - ce**2, 1e-9 * cc * ee)
        by_colour, variance = (cc * ev - ce * cv) / determinant, cc / determinant
        by_material = (parts.interface * e).sum(axis=2)
        spread = (TRUST * by_material) ** 2 + FLOOR**2 * (values**2).sum(axis=2)
        strength = (by_colour / variance + by_material / spread) / (1.0 / variance + 1.0 / spread)
        most = np.min(np.where(e > 0.0, values / np.where(e > 0.0, e, 1.0), np.inf), axis=2)
        interface = np.clip(strength, 0.0, np.maximum(most, 0.0))[..., None] * e
    return Separation(number, values - interface, interface)


def write_separation(of: Separation, names: Sequence[str], home: Path) -> None:
    """separation_NN.exr (channels body.R, …, interface.R, …, linear, 0 where unknown) and a PNG of each part."""
    parts = {"body": np.nan_to_num(of.body), "interface": np.nan_to_num(of.interface)}
    channels = {f"{part}.{name}": one[..., k] for part, one in parts.items() for k, name in enumerate(names)}
    write_exr(home / f"separation_{of.number:02d}.exr", channels)
    known = np.isfinite(of.body).all(axis=2)
    brightest = float(np.percentile((parts["body"] + parts["interface"])[known], 99)) if known.any() else 1.0
    for part, one in parts.items():
        shown = one if one.shape[2] == 3 else np.repeat(one.mean(axis=2, keepdims=True), 3, axis=2)
        write_png(home / f"separation_{of.number:02d}_{part}.png", srgb_encode(shown / max(brightest, 1e-300)))
