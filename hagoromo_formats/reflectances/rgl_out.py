"""Write tables of RGL: our reflectance as a .bsdf that Mitsuba's `measured` and `read_rgl` read.

Dupuy and Jakob, "An Adaptive Parameterization for Efficient Material Acquisition and Rendering" (2018). A value is
f cosθ_o 4σ(ω_i)/D(ω_m) at the place u, where the half vector ω_m is drawn from the facets of density D that are seen
from ω_i. D is our choice: it has as many places for each ratio of θ_m to the widths of the lobes, so that highlights
and body are both resolved.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.files.whole import whole_file
from hagoromo.reflectance.reflectance import Reflectance

TENSOR_FILE = b"tensor_file\0\1\0"  # first bytes, with the version
KINDS = {np.dtype(np.uint8): 1, np.dtype(np.float32): 10}  # of arrays, in the file
INCIDENCES, GRAZING = 48, np.radians(89.0)  # angles ω_i of the table, and the largest of them
DENSER = 1.5  # power that brings incidences nearer to each other at grazing
PLACES = 64  # of u in both directions, for each ω_i
WARP = 48, 256  # nodes of the density of visible normals: of φ_m and of √θ_m
FINE = 2048  # nodes of D and σ over √θ
WIDEST = 1.0  # [rad] of D's parts, for the body
CORE = 0.15  # of a part's width: D is even within
LEAST = 1e-4  # of D at θ_m = 90°, where cosθ is 0
Array = NDArray[np.float64]


def write_rgl(
    path: str | Path,
    reflectance: Reflectance,
    wavelengths: ArrayLike,
    field: Literal["spectra", "rgb"] = "spectra",
    gain: float = 1.0,
    force: bool = False,
) -> None:
    """Write the table of a plane's reflectance at `wavelengths` [nm], float32, whole or not at all.

    field: "spectra", or "rgb": the values at three wavelengths are red, green and blue. Mitsuba reads the one in its
    spectral variants, the other in its rgb variants. gain: factor on the values, for those of a reflectance that
    gives back more light than it receives. Who reads it interpolates. For directions within 80° of the normal
    and γ from 0.05 rad, Mitsuba's values are off by 0.2 % in the median, by less than 7 % in 99 of 100 directions, and
    by up to a half where both are beyond 70°. Of γ = 0.005 rad, they are too bright where the lobe is below a
    thousandth of its peak.
    """
    gloss = [reflectance.gamma, *(gamma for _, gamma in reflectance.lobes)] if reflectance.beta > 0.0 else []
    given = np.asarray(wavelengths, np.float64)

    def sent(to_lamp: Array, to_eye: Array) -> Array:
        return gain * reflectance.evaluate([0.0, 0.0, 1.0], to_lamp, to_eye, given)

    write_rgl_table(path, sent, gloss, given, field, reflectance.name or "reflectance", force)


def write_rgl_table(
    path: str | Path,
    sent: Callable[[Array, Array], Array],
    widths: Sequence[float],
    wavelengths: Array,
    field: Literal["spectra", "rgb"] = "spectra",
    name: str = "table",
    force: bool = False,
) -> None:
    """As `write_rgl`, of any isotropic and reciprocal reflectance.

    sent: unit directions (N, 3) to lamp and eye → f, the BRDF times cosθ_i, (N, C) [1/sr]; 0 for eyes below the
    horizon. widths: of its lobes [rad], as many places for each.
    """
    u = np.linspace(0.0, 1.0, FINE)
    polar = 0.5 * np.pi * u**2
    density = facets_of(widths, polar)
    area = projected_area(density, polar)
    incidences = GRAZING * (1.0 - np.linspace(1.0, 0.0, INCIDENCES) ** DENSER)
    visible = visible_normals(density, polar, incidences)
    first, second, half = _places(visible, incidences)
    values = sent(second, first)  # the cosine is that of ω_o, and f is reciprocal
    scale = 4.0 * np.interp(_root(np.arccos(first[:, 2])), u, area) / np.interp(_root(half), u, density)
    shape = (1, INCIDENCES, PLACES, PLACES)
    spectra = np.moveaxis((values * scale[:, None]).reshape(*shape, wavelengths.size), 4, 2)
    fields: dict[str, NDArray[Any]] = {
        "description": np.frombuffer(name.encode(), np.uint8),
        "phi_i": np.zeros(1),
        "theta_i": incidences,
        "sigma": np.stack([area, area]),
        "ndf": np.stack([density, density]),
        "vndf": visible[None],
        "luminance": np.maximum(spectra.mean(axis=2), 1e-6 * spectra.max()),
        field: spectra,
        "jacobian": np.ones(1, np.uint8),
    }
    if field == "spectra":
        fields["wavelengths"] = wavelengths
    with whole_file(path, force) as partial:
        partial.write_bytes(tensor_file(fields))


def facets_of(widths: Sequence[float], polar: Array) -> Array:
    """D [1/sr] of half vectors at the angles `polar` [rad], ∫ D cosθ dω = 1: as many places for each ratio of angles.

    A part for each width w, and a wide one: cosθ/(θ √(1 + θ²/w²)), whose places are even in θ up to w and
    in ln θ beyond.
    """
    weight = 2.0 * np.pi * np.sin(polar) * np.cos(polar)
    mixed = np.zeros_like(polar)
    for width in (*widths, WIDEST):
        part = (np.cos(polar) + LEAST) / np.sqrt((polar**2 + (CORE * width) ** 2) * (1.0 + (polar / width) ** 2))
        mixed += part / np.trapezoid(part * weight, polar)
    return mixed / np.trapezoid(mixed * weight, polar)


def projected_area(density: Array, polar: Array) -> Array:
    """σ of the facets seen from the angles `polar`: ∫ D max(ω·m, 0) dω_m, 1 along the normal."""
    weight = density * np.sin(polar)
    return np.array([np.trapezoid(weight * _facing(angle, polar), polar) for angle in polar])


def _facing(angle: float, polar: Array) -> Array:
    """∫ max(ω·m, 0) dφ of facets at the angles `polar`, seen from `angle`: ω·m = a + b cosφ, from −φ₀ to φ₀."""
    a, b = np.cos(angle) * np.cos(polar), np.sin(angle) * np.sin(polar)
    edge = np.arccos(np.clip(-a / np.maximum(b, 1e-12), -1.0, 1.0))
    return 2.0 * (a * edge + b * np.sin(edge))


def visible_normals(density: Array, polar: Array, incidences: Array) -> Array:
    """Density (incidence, φ, √θ) of the facets that are seen, on the unit square: D max(ω·m, 0) times its area."""
    turn, u = np.linspace(-np.pi, np.pi, WARP[0]), np.linspace(0.0, 1.0, WARP[1])
    angle = 0.5 * np.pi * u**2
    of_angle = np.interp(u, _root(polar), density) * np.sin(angle) * u
    height, side = np.cos(incidences)[:, None, None], np.sin(incidences)[:, None, None]
    facing = height * np.cos(angle) + side * np.sin(angle) * np.cos(turn)[:, None]
    return of_angle * np.maximum(facing, 0.0)


def _places(visible: Array, incidences: Array) -> tuple[Array, Array, Array]:
    """Unit ω_i and ω_o (N, 3) and θ_m (N,) [rad] of the places: N over incidence, then u of φ_m, then u of θ_m."""
    drawn = np.array([_warped(density) for density in visible]).reshape(-1, 2)
    incidence = np.repeat(incidences, PLACES * PLACES)
    half, turn = 0.5 * np.pi * drawn[:, 1] ** 2, (2.0 * drawn[:, 0] - 1.0) * np.pi
    lamp = np.stack([np.sin(incidence), 0.0 * incidence, np.cos(incidence)], 1)
    middle = np.stack([np.sin(half) * np.cos(turn), np.sin(half) * np.sin(turn), np.cos(half)], 1)
    return lamp, 2.0 * np.einsum("ni,ni->n", lamp, middle)[:, None] * middle - lamp, half


def _warped(density: Array) -> Array:
    """Where the places of the unit square (PLACES, PLACES, 2) come to lie by a density on nodes, linear between them.

    The row is drawn first, then the column, as the readers of the format do.
    """
    grid = np.linspace(0.0, 1.0, PLACES)
    rows = _quantiles(density.sum(axis=1) - 0.5 * (density[:, 0] + density[:, -1]), grid)
    low = np.minimum(rows.astype(int), len(density) - 2)
    at_rows = density[low] + (rows - low)[:, None] * (density[low + 1] - density[low])
    columns = np.array([_quantiles(one, grid) for one in at_rows])
    return np.stack([np.broadcast_to(rows[:, None], columns.shape) / (len(density) - 1),
                     columns / (density.shape[1] - 1)], -1)  # fmt: skip


def _quantiles(density: Array, shares: Array) -> Array:
    """Places, in steps of nodes, up to which lie the `shares` of a density that is linear between its nodes."""
    steps = 0.5 * (density[1:] + density[:-1])
    below = np.r_[0.0, np.cumsum(steps)]
    wanted = shares * below[-1]
    cell = np.clip(np.searchsorted(below, wanted, "right") - 1, 0, len(steps) - 1)
    rest, first, rise = wanted - below[cell], density[cell], density[cell + 1] - density[cell]
    root = first + np.sqrt(np.maximum(first**2 + 2.0 * rise * rest, 0.0))
    return cell + np.clip(2.0 * rest / np.maximum(root, 1e-300), 0.0, 1.0)


def _root(polar: Array) -> Array:
    """√θ, 1 at the horizon: what the format has in place of θ."""
    return np.sqrt(polar * (2.0 / np.pi))


def tensor_file(fields: dict[str, NDArray[Any]]) -> bytes:
    """The bytes of a file of named arrays, numbers as float32 but for those of 8 bits: Mitsuba's TensorFile."""
    stored = {name: np.ascontiguousarray(one, one.dtype if one.dtype == np.uint8 else "<f4") for name, one in
              fields.items()}  # fmt: skip
    place = len(TENSOR_FILE) + 4 + sum(13 + len(name) + 8 * one.ndim for name, one in stored.items())
    head, body = [TENSOR_FILE, len(stored).to_bytes(4, "little")], []
    for name, one in stored.items():
        head += [
            len(name).to_bytes(2, "little"),
            name.encode(),
            one.ndim.to_bytes(2, "little"),
            bytes([KINDS[one.dtype]]),
        ]
        head.append(np.array([place, *one.shape], "<u8").tobytes())
        body.append(one.tobytes())
        place += one.nbytes
    return b"".join(head + body)
