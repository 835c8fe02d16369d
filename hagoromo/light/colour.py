"""Colour as people see it: CIE 1931 XYZ, linear sRGB, the 8-bit display, and the difference ΔE00.

XYZ is relative: Y = 1 is a perfect white diffuser under D65.
"""

from __future__ import annotations

from functools import cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.light.spectrum import Spectrum, integrate_product

# IEC 61966-2-1:1999, linear sRGB from XYZ (D65 white)
SRGB_FROM_XYZ = np.array(
    [[3.2406, -1.5372, -0.4986], [-0.9689, 1.8758, 0.0415], [0.0557, -0.2040, 1.0570]], dtype=np.float64
)


@cache
def colour_matching() -> tuple[Spectrum, Spectrum, Spectrum]:
    """CIE 1931 2° colour matching functions x̄, ȳ, z̄ (360–830 nm)."""
    import colour

    table = colour.MSDS_CMFS["CIE 1931 2 Degree Standard Observer"]
    x, y, z = (Spectrum(table.wavelengths, table.values[:, band]) for band in range(3))
    return x, y, z


def srgb_from_xyz(xyz: ArrayLike) -> NDArray[np.float64]:
    """Linear sRGB (..., 3) from XYZ (..., 3); out-of-gamut colours keep their negative values."""
    return np.asarray(xyz, dtype=np.float64) @ SRGB_FROM_XYZ.T


def xyz_from_srgb(rgb: ArrayLike) -> NDArray[np.float64]:
    """XYZ (..., 3) from linear sRGB (..., 3): the inverse of `srgb_from_xyz`."""
    return np.asarray(rgb, dtype=np.float64) @ np.linalg.inv(SRGB_FROM_XYZ).T


def linear_colour(spectrum: Spectrum, lamp: Spectrum) -> NDArray[np.float64]:
    """Linear sRGB of a spectrum times a lamp's, of which Y is 1."""
    white = integrate_product(lamp, colour_matching()[1])
    return srgb_from_xyz([integrate_product(spectrum, lamp, c) / white for c in colour_matching()])


def srgb_encode(linear: ArrayLike) -> NDArray[np.uint8]:
    """8-bit display values from linear sRGB of any shape; clipped to [0, 1] first, NaN shown as 0."""
    u = np.clip(np.nan_to_num(np.asarray(linear, dtype=np.float64)), 0.0, 1.0)
    return np.round(255.0 * srgb_curve(u)).astype(np.uint8)


def srgb_curve(linear: NDArray[np.floating]) -> NDArray[np.floating]:
    """Display values 0…1 of linear sRGB in [0, 1], of any shape: IEC 61966-2-1:1999."""
    return np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.maximum(linear, 0.0031308) ** (1 / 2.4) - 0.055)


def srgb_decode(display: ArrayLike) -> NDArray[np.float64]:
    """Linear sRGB in [0, 1] from 8-bit display values (uint8) of any shape: the inverse of `srgb_encode`."""
    v = np.asarray(display, dtype=np.float64) / 255.0
    # IEC 61966-2-1:1999
    return np.where(v <= 0.04045, v / 12.92, ((v + 0.055) / 1.055) ** 2.4)


def delta_e_2000(a: ArrayLike, b: ArrayLike) -> NDArray[np.float64]:
    """CIEDE2000 colour difference (...) between linear sRGB colours `a` and `b` (..., 3), white D65 = (1, 1, 1)."""
    import colour

    white = colour.XYZ_to_xy(xyz_from_srgb([1.0, 1.0, 1.0]))
    lab_a, lab_b = (colour.XYZ_to_Lab(xyz_from_srgb(rgb), white) for rgb in (a, b))
    return np.asarray(colour.delta_E(lab_a, lab_b, method="CIE 2000"), dtype=np.float64)
