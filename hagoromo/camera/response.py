"""Colour response of a camera R_c(λ), and its reading of light: ρ_c = ∫ S(λ) E(λ) R_c(λ) dλ (MODEL §5, eq. 10).

Enters: spectral sensitivities, by name or CSV. All curves are piecewise linear and all integrals are exact. The limits
of the integral belong to the response: 400–700 nm of a camera, as in the paper, 360–830 nm of the CIE's observer.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.light.colour import colour_matching, srgb_from_xyz
from hagoromo.light.spectrum import VISIBLE, WAVELENGTH_COLUMNS, Spectrum, integrate_product

LARGEST_VALUE = 1e15  # of a curve, relative
OBSERVER_CHANNELS = ("X", "Y", "Z")  # colour matching functions
KEPT_READINGS = 512  # integrals of eq. (10) that are not computed again: a viewer asks for the same ones many times
LIMITS_LINE = re.compile(r"# *limits_nm *= *(\d+(?:\.\d+)?) *, *(\d+(?:\.\d+)?)")  # the first line of a CSV
# Two-sided Gaussians of the stand-in for the EOS 300D: height, centre [nm], widths below and above it [nm].
CANON_EOS_300D = {
    "R": ((0.66, 588.0, 15.0, 31.0), (0.18, 654.0, 37.0, 10.0)),
    "G": ((1.00, 528.0, 32.0, 39.0), (0.15, 473.0, 43.0, 10.0)),
    "B": ((0.94, 477.0, 14.0, 29.0), (0.79, 449.0, 34.0, 12.0)),
}
WHITE_XYZ = np.array([0.95047, 1.0, 1.08883])  # XYZ of D65, the display's white


@dataclass(frozen=True, eq=False)
class Response:
    """Spectral sensitivities of a sensor's channels, linear between the wavelengths and 0 outside.

    wavelengths: (n,) [nm], strictly increasing. values: (n, channels), finite, relative. channels: their names.
    limits: lowest and highest wavelength of eq. (10) [nm]; 400–700 by default, as in the paper, and for an observer
    (channels X, Y, Z) the range of its wavelengths. `InputError` for limits that do not increase.

    >>> camera = hg.Response.load("canon_eos_300d")
    >>> camera.channels, [int(camera.wavelengths[k]) for k in camera.values.argmax(axis=0)]  # most sensitive at [nm]
    (('R', 'G', 'B'), [590, 530, 475])
    """

    wavelengths: NDArray[np.float64]
    values: NDArray[np.float64]
    channels: tuple[str, ...]
    name: str
    limits: tuple[float, float]

    def __init__(
        self,
        wavelengths: ArrayLike,
        values: ArrayLike,
        channels: Sequence[str] = ("R", "G", "B"),
        name: str = "",
        limits: tuple[float, float] | None = None,
    ) -> None:
        values = np.array(values, np.float64)
        if values.ndim != 2 or values.shape[1] != len(channels) or len(set(channels)) != len(channels):
            raise InputError(f"response of shape {values.shape}, channels {tuple(channels)}: name each column once")
        if np.abs(values).max(initial=0.0) > LARGEST_VALUE:
            raise InputError(f"response {name!r} has values above {LARGEST_VALUE:g}: scale them down")
        curves = [Spectrum(wavelengths, column) for column in values.T]
        values.flags.writeable = False
        object.__setattr__(self, "wavelengths", curves[0].wavelengths)
        object.__setattr__(self, "values", values)
        object.__setattr__(self, "channels", tuple(channels))
        object.__setattr__(self, "name", name)
        object.__setattr__(self, "limits", _limits(limits, curves[0].wavelengths, self.channels))

    def __repr__(self) -> str:
        """The name, the channels and the range of the wavelengths."""
        first, last = self.wavelengths[[0, -1]]
        return f"Response({self.name!r}, channels {' '.join(self.channels)}, {first:g}–{last:g} nm)"

    def _repr_png_(self) -> bytes:
        """The curves, in a notebook."""
        from hagoromo.files.plot import curves_png

        return curves_png(
            self.wavelengths, dict(zip(self.channels, self.values.T, strict=True)), "relative sensitivity"
        )

    def equals(self, other: Response | None) -> bool:
        """Whether both give the same readings of every light, channel by channel; names do not count."""
        if other is None:
            return False
        same = self.limits == other.limits and self.channels == other.channels
        same = same and np.array_equal(self.wavelengths, other.wavelengths)
        return same and np.array_equal(self.values, other.values)

    @staticmethod
    def load(source: str | Path, folder: str | Path | None = None) -> Response:
        """Response by name or from a CSV file (wavelength column first, then one column per channel).

        folder: where a file that names the CSV lies; the CSV must be inside it. A first line such as
        "# limits_nm = 360, 1000" states its limits.

        Names: "cie1931" (colour matching functions x̄ ȳ z̄), "canon_eos_300d", and colour-science's measured cameras.
        "canon_eos_300d" is a smooth stand-in, not a measurement: per channel two Gaussians with unequal flanks, fitted
        once to the curves of the camspec database (Jiang et al. 2013, "What is the space of spectral sensitivity
        functions for digital color cameras?"); correlation 0.998 (R), 0.999 (G) and 0.9996 (B) with them.
        """
        if str(source).lower().endswith(".csv"):
            return _from_csv(Path(source) if folder is None else inside(folder, str(source)))
        return _named(str(source))

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write the curves to a CSV, `wavelength_nm` and a column per channel, which `load` reads.

        `InputError` for a name that does not end in .csv, or a file that exists without `force`.
        """
        from hagoromo.files.whole import whole_file

        if Path(path).suffix.lower() != ".csv":
            raise InputError(f"{path} is to be a table: give a name that ends in .csv")
        with whole_file(path, force) as partial:
            self.write_table(partial)
        return Path(path)

    def write_table(self, path: Path) -> None:
        """Write the CSV of `save` to `path`, with the limits in its first line where they are not the default."""
        from hagoromo.files.table import write_table

        low, high = self.limits
        stated = self.limits != _limits(None, self.wavelengths, self.channels)
        columns = dict(zip(self.channels, self.values.T, strict=True))
        comment = f"limits_nm = {low!r}, {high!r}" if stated else ""
        write_table(path, {"wavelength_nm": self.wavelengths, **columns}, comment)

    def with_limits(self, low: float, high: float) -> Response:
        """The same curves, read from `low` to `high` nm in eq. (10): for bands beyond the visible, say."""
        return replace(self, limits=(low, high))

    def curve(self, channel: int) -> Spectrum:
        """R_c(λ) of one channel."""
        return Spectrum(self.wavelengths, self.values[:, channel])


def camera_response(
    reflectance: Spectrum, lamp: Spectrum, response: Response, lo: float | None = None, hi: float | None = None
) -> NDArray[np.float64]:
    """ρ_c (channels,) of a surface with spectrum `reflectance` S under `lamp` E, over [lo, hi] nm.

    lo, hi: by default `response.limits`. S keeps its end values where it is not known, see `Spectrum.held`; E and R are
    0 there. The unit is that of S·E·R·nm.
    """
    lo, hi = _range(response, lo, hi)
    surface = reflectance.held(lo, hi)
    # Tanaka eq. (10)
    return np.array(_reading((_Curve.of(surface), _Curve.of(lamp)), response, lo, hi))


def response_matrix(
    bases: Sequence[Spectrum], lamp: Spectrum, response: Response, lo: float | None = None, hi: float | None = None
) -> NDArray[np.float64]:
    """∫ B_j E R_c dλ (channels, bases): ρ of the surface Σ_j b_j B_j(λ) is this matrix times b."""
    return np.stack([camera_response(basis, lamp, response, lo, hi) for basis in bases], axis=1)


def camera_white(
    lamp: Spectrum, response: Response, lo: float | None = None, hi: float | None = None
) -> NDArray[np.float64]:
    """∫ E R_c dλ (channels,): reading of a perfect white, S = 1 at every wavelength, under `lamp`, over [lo, hi] nm."""
    lo, hi = _range(response, lo, hi)
    return np.array(_reading((_Curve.of(lamp),), response, lo, hi))


def white_of(lamp: Spectrum, response: Response | None, channels: int) -> NDArray[np.float64]:
    """(channels,) `camera_white`; 1 where no response is known."""
    return np.ones(channels) if response is None else camera_white(lamp, response)


@dataclass(frozen=True)
class _Curve:
    """A spectrum, equal to every other one of the same bits."""

    bits: tuple[bytes, bytes]
    spectrum: Spectrum = field(compare=False)

    @staticmethod
    def of(spectrum: Spectrum) -> _Curve:
        return _Curve((spectrum.wavelengths.tobytes(), spectrum.values.tobytes()), spectrum)


@lru_cache(KEPT_READINGS)
def _reading(factors: tuple[_Curve, ...], response: Response, lo: float, hi: float) -> tuple[float, ...]:
    """The integral of the product of some spectra with each curve of the response, from lo to hi [nm]."""
    spectra = [factor.spectrum for factor in factors]
    return tuple(integrate_product(*spectra, curve, lo=lo, hi=hi) for curve in _curves(response))


def _range(response: Response, lo: float | None, hi: float | None) -> tuple[float, float]:
    return response.limits[0] if lo is None else lo, response.limits[1] if hi is None else hi


def _limits(
    stated: tuple[float, float] | None, wavelengths: NDArray[np.float64], channels: tuple[str, ...]
) -> tuple[float, float]:
    if stated is None:
        observer = channels == OBSERVER_CHANNELS
        return (float(wavelengths[0]), float(wavelengths[-1])) if observer else VISIBLE
    low, high = (float(limit) for limit in stated)
    if not (math.isfinite(high - low) and low < high):
        raise InputError(f"the limits of a response are {low:g} and {high:g} nm: give a lower and a higher wavelength")
    return low, high


def _curves(response: Response) -> list[Spectrum]:
    return [response.curve(channel) for channel in range(len(response.channels))]


def _from_csv(path: Path) -> Response:
    from hagoromo.files.table import read_table_and_comment

    table, comment = read_table_and_comment(path)
    key = next((name for name in WAVELENGTH_COLUMNS if name in table), next(iter(table)))
    wavelengths = table.pop(key)
    if not table:
        raise InputError(f"{path} has the column {key} only: add one column per channel")
    stated = LIMITS_LINE.fullmatch(comment.strip())
    try:
        limits = None if stated is None else (float(stated[1]), float(stated[2]))
        return Response(wavelengths, np.stack(list(table.values()), axis=1), tuple(table), path.stem, limits)
    except InputError as error:
        raise InputError(f"{path}: {error}") from error


def _named(name: str) -> Response:
    own: dict[str, Callable[[], Response]] = {"cie1931": _cie_1931, "canon_eos_300d": _canon_eos_300d}
    if name in own:
        return own[name]()
    import colour

    measured = colour.MSDS_CAMERA_SENSITIVITIES
    if name not in measured:
        known = ", ".join([*own, *sorted(measured)])
        raise InputError(f"no camera response is called {name!r}: choose one of {known}, or a CSV file")
    return Response(measured[name].wavelengths, measured[name].values, name=name)


@cache
def _cie_1931() -> Response:
    curves = colour_matching()
    return Response(curves[0].wavelengths, np.stack([c.values for c in curves], axis=1), ("X", "Y", "Z"), "cie1931")


@cache
def _canon_eos_300d() -> Response:
    wavelengths = np.arange(380.0, 741.0, 5.0)
    values = np.stack([_gaussians(wavelengths, CANON_EOS_300D[channel]) for channel in "RGB"], axis=1)
    return Response(wavelengths, values, name="canon_eos_300d")


def _gaussians(wavelengths: NDArray[np.float64], terms: Sequence[tuple[float, ...]]) -> NDArray[np.float64]:
    total = np.zeros_like(wavelengths)
    for height, centre, below, above in terms:
        off = (wavelengths - centre) / np.where(wavelengths < centre, below, above)
        total += height * np.exp(-0.5 * off**2)
    return total


@lru_cache(maxsize=32)
def srgb_from_camera(response: Response, lamp: Spectrum) -> NDArray[np.float64]:
    """(3, 3): camera values ρ of eq. (10) under `lamp` → linear sRGB with the lamp as white (1, 1, 1).

    Least squares over the 24 spectra of a ColorChecker; the lamp's own colour is exact. `InputError` for a channel that
    reads no light of the lamp.
    """
    import colour

    chart = colour.SDS_COLOURCHECKERS["BabelColor Average"].values()
    patches = [Spectrum(patch.wavelengths, patch.values) for patch in chart]
    observer, ones = Response.load("cie1931"), camera_white(lamp, response)
    if not np.all(ones > 0.0):
        blind = [channel for channel, white in zip(response.channels, ones, strict=True) if not white > 0.0]
        raise InputError(f"channel {', '.join(blind)} has no response to this lamp: check curves and spectrum")
    measured = np.array([camera_response(patch, lamp, response) / ones for patch in patches])
    xyz = np.array([camera_response(patch, lamp, observer) / camera_white(lamp, observer) for patch in patches])
    wanted = srgb_from_xyz(xyz * WHITE_XYZ)
    # rows sum to 1: M = [a, b, 1 − a − b]
    basis = measured[:, :2] - measured[:, 2:]
    rows = np.linalg.lstsq(basis, wanted - measured[:, 2:], rcond=None)[0].T
    return np.concatenate([rows, 1.0 - rows.sum(axis=1, keepdims=True)], axis=1) / ones
