"""Spectrum: values at wavelengths, linear between them and 0 outside; its integrals are exact.

Enters: arrays, CSV files, names of colour-science's illuminants. Wavelengths are in nm.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, read_bytes, sized_file
from hagoromo.files.reading import reading
from hagoromo.files.record import Record, about, decode, like

VISIBLE = (400.0, 700.0)  # [nm], the limits of Tanaka eq. (10), of cameras
CONSTANT_RANGE = (360.0, 830.0)  # [nm], the range of the CIE 1931 colour matching functions
OTHER_FILES = (".spd", ".spdx", ".xml")  # see `read_spectrum_file`
WAVELENGTH_COLUMNS = ("wavelength_nm", "wavelength", "nm", "lambda")
LARGEST = 1 << 22  # bytes
GROWTH = 60.0  # memory of the words, in sizes of the file
TM27 = (".spdx", ".xml")
PLAIN = (".spd",)
FORBIDDEN = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)  # entities may grow, or name other files
MICROMETRES = 10.0  # a largest wavelength below it is no nanometre


class SpectrumRecord(Record, frozen=True, kw_only=True):
    """A spectrum: values at wavelengths, linear between them and 0 outside."""

    wavelengths: Annotated[tuple[float, ...], about("wavelengths, increasing [nm]")]
    values: Annotated[tuple[float, ...], about("value at each wavelength")]


SOURCE = like(SpectrumRecord, number={"type": "number"}, name={"type": "string"})  # what `Spectrum.load` takes


def checked_spectrum(value: Any, what: str) -> Spectrum:
    """`value`, if it is a Spectrum; else an `InputError` that says how to make one of a number."""
    if not isinstance(value, Spectrum):
        how = f"hg.Spectrum.constant({value:g})" if isinstance(value, (int, float)) else "hg.Spectrum.load(file)"
        raise InputError(f"{what} is {value!r:.60}: give a Spectrum, as {how}")
    return value


@dataclass(frozen=True, eq=False)
class Spectrum:
    """Piecewise linear function of the wavelength.

    wavelengths: (n,) [nm], strictly increasing, n ≥ 2. values: (n,), finite.
    Raises `InputError` when they are not.

    >>> float(Spectrum([400, 500, 600], [0, 1, 0]).at(450))
    0.5
    """

    wavelengths: NDArray[np.float64]
    values: NDArray[np.float64]

    def __init__(self, wavelengths: ArrayLike, values: ArrayLike) -> None:
        object.__setattr__(self, "wavelengths", _frozen(wavelengths))
        object.__setattr__(self, "values", _frozen(values))
        if self.wavelengths.ndim != 1 or self.wavelengths.shape != self.values.shape or len(self.wavelengths) < 2:
            shapes = f"{self.wavelengths.shape} and {self.values.shape}"
            raise InputError(f"a spectrum needs two or more wavelengths with a value each: given shapes {shapes}")
        if not (np.isfinite(self.wavelengths).all() and np.isfinite(self.values).all()):
            raise InputError("a spectrum has a wavelength or value that is not finite: remove it")
        if (np.diff(self.wavelengths) <= 0).any():
            at = self.wavelengths[1:][np.diff(self.wavelengths) <= 0][0]
            raise InputError(f"the wavelengths of a spectrum must increase: they do not at {at:g} nm")

    def __repr__(self) -> str:
        """The range of the wavelengths and of the values."""
        low, high = self.values.min(), self.values.max()
        values = f"{low:.4g}" if low == high else f"{len(self.values)} values of {low:.4g}–{high:.4g}"
        return f"Spectrum({self.wavelengths[0]:g}–{self.wavelengths[-1]:g} nm, {values})"

    def _repr_png_(self) -> bytes:
        """The curve, in a notebook."""
        from hagoromo.files.plot import curves_png

        return curves_png(self.wavelengths, {"": self.values}, "value")

    @staticmethod
    def constant(value: float) -> Spectrum:
        """`value` at 360–830 nm."""
        return Spectrum(CONSTANT_RANGE, (value, value))

    @staticmethod
    def from_csv(path: str | Path, column: str | None = None) -> Spectrum:
        """Spectrum in a CSV file: a wavelength column (`wavelength_nm`, or the first) and `column`.

        Without `column` the table must have one other column only, or `InputError` names them.
        """
        from hagoromo.files.table import read_table

        table = read_table(path)
        key = next((name for name in WAVELENGTH_COLUMNS if name in table), next(iter(table)))
        wavelengths = table.pop(key)
        name = next(iter(table), None) if column is None and len(table) <= 1 else column
        if name not in table:
            asked = "no column chosen" if column is None else f"no column {column!r}"
            raise InputError(f"{path}: {asked}: beside {key} it has {', '.join(table) or 'none'}")
        try:
            return Spectrum(wavelengths, table[name])
        except InputError as error:
            raise InputError(f"{path}: {error}") from error

    @staticmethod
    def named(name: str) -> Spectrum:
        """Spectrum of one of colour-science's illuminants or light sources, such as D65, A, E or FL2, as tabulated."""
        return _named(name)

    @staticmethod
    def load(source: Any, folder: str | Path | None = None) -> Spectrum:
        """Spectrum from what a record may hold: a number, a name, a path or `{"wavelengths", "values"}`.

        Paths end in .csv, .spd (a wavelength and a value a line), .spdx or .xml (IES TM-27-14).
        folder: where the record lies; a path is then relative to it and may not leave it.
        """
        if isinstance(source, Spectrum):
            return source
        if isinstance(source, (int, float)) and not isinstance(source, bool):
            return Spectrum.constant(source)
        if isinstance(source, Mapping):
            record = decode(source, SpectrumRecord, "spectrum")
            return Spectrum(record.wavelengths, record.values)
        if isinstance(source, (str, Path)):
            if str(source).lower().endswith(".csv"):
                return Spectrum.from_csv(source if folder is None else inside(folder, str(source)))
            if str(source).lower().endswith(OTHER_FILES):
                return read_spectrum_file(source if folder is None else inside(folder, str(source)))
            return Spectrum.named(str(source))
        raise InputError(f"a spectrum is a number, a name, a CSV path or wavelengths and values: given {source!r:.60}")

    def at(self, wavelength: ArrayLike) -> NDArray[np.float64]:
        """Values at `wavelength` [nm], of the same shape; 0 outside the range."""
        return np.interp(np.asarray(wavelength, dtype=np.float64), self.wavelengths, self.values, left=0.0, right=0.0)

    def held(self, lo: float, hi: float) -> Spectrum:
        """With its end values held as far as [lo, hi] nm: of a reflectance, the value nearest to an unmeasured one.

        CIE 15 recommends it where a reflectance was measured over a part of 360–830 nm.

        >>> hg.Spectrum([400, 700], [0.2, 0.6]).held(360, 830).at([380, 780]).tolist()
        [0.2, 0.6]
        """
        knots = self.wavelengths
        if lo >= knots[0] and hi <= knots[-1]:
            return self
        wide = np.concatenate([[lo] if lo < knots[0] else [], knots, [hi] if hi > knots[-1] else []])
        return Spectrum(wide, np.interp(wide, knots, self.values))

    def equals(self, other: Spectrum, up_to_factor: bool = False) -> bool:
        """Whether both have the same values at the same wavelengths; up_to_factor: or values in proportion, to 1e-5."""
        if not np.array_equal(self.wavelengths, other.wavelengths):
            return False
        if up_to_factor:
            return np.allclose(other.values * self.values.sum(), self.values * other.values.sum())
        return np.array_equal(self.values, other.values)

    def scaled(self, factor: float) -> Spectrum:
        """This spectrum times a number."""
        return Spectrum(self.wavelengths, self.values * float(factor))

    def __mul__(self, other: float | Spectrum) -> Spectrum:
        """Product with a number or a spectrum; that of two spectra is exact at the knots of both, linear between.

        For the exact integral of a product see `integrate_product`.
        """
        if not isinstance(other, Spectrum):
            return self.scaled(other)
        lo, hi = _overlap((self, other), -np.inf, np.inf)
        if lo >= hi:
            raise InputError("two spectra without a common wavelength have no product: extend one of them")
        knots = _knots((self, other), lo, hi)
        return Spectrum(knots, self.at(knots) * other.at(knots))

    __rmul__ = __mul__

    def mean(self, lo: float = VISIBLE[0], hi: float = VISIBLE[1]) -> float:
        """Mean value over [lo, hi] nm."""
        return integrate_product(self, lo=lo, hi=hi) / (hi - lo)

    def record(self) -> dict[str, list[float]]:
        """What `load` reads back: `{"wavelengths": [...], "values": [...]}`."""
        return {"wavelengths": self.wavelengths.tolist(), "values": self.values.tolist()}


def integrate_product(*spectra: Spectrum, lo: float = -np.inf, hi: float = np.inf) -> float:
    """∫ s₁(λ) s₂(λ) … dλ over [lo, hi] nm (default: wherever all spectra reach), exact.

    Gauss–Legendre between the knots of all the spectra.
    Between knots the product of m linear functions is a polynomial of degree m; ⌊m/2⌋ + 1 points integrate degree
    2⌊m/2⌋ + 1 ≥ m exactly.

    >>> ramp = Spectrum([400, 700], [0, 1])
    >>> round(integrate_product(ramp, ramp), 9)
    100.0
    """
    lo, hi = _overlap(spectra, lo, hi)
    if lo >= hi:
        return 0.0
    knots = _knots(spectra, lo, hi)
    nodes, weights = np.polynomial.legendre.leggauss(len(spectra) // 2 + 1)
    half, middle = np.diff(knots)[:, None] / 2, (knots[1:] + knots[:-1])[:, None] / 2
    at = middle + half * nodes
    product = np.prod([spectrum.at(at) for spectrum in spectra], axis=0)
    return float(np.sum(half * weights * product))


def smooth_rgb_basis() -> tuple[Spectrum, Spectrum, Spectrum]:
    """Three smooth bands (R, G, B) that sum to 1 over 380–730 nm: a body colour known by its camera colour only.

    Each passes into the next by a raised cosine: blue to green over 460–530 nm, green to red over 555–625 nm.
    """
    wavelengths = np.arange(380.0, 731.0, 5.0)
    not_blue = _raised_cosine(wavelengths, 460.0, 530.0)
    red = _raised_cosine(wavelengths, 555.0, 625.0)
    return Spectrum(wavelengths, red), Spectrum(wavelengths, not_blue - red), Spectrum(wavelengths, 1.0 - not_blue)


@cache
def _named(name: str) -> Spectrum:
    import colour

    known = {**colour.SDS_LIGHT_SOURCES, **colour.SDS_ILLUMINANTS}
    if name not in known:
        near = difflib.get_close_matches(name, known, 3, 0.0)
        raise InputError(f"no illuminant or light source is named {name!r}: the nearest names are {', '.join(near)}")
    return Spectrum(known[name].wavelengths, known[name].values)


def _overlap(spectra: tuple[Spectrum, ...], lo: float, hi: float) -> tuple[float, float]:
    return max([lo, *(s.wavelengths[0] for s in spectra)]), min([hi, *(s.wavelengths[-1] for s in spectra)])


def _knots(spectra: tuple[Spectrum, ...], lo: float, hi: float) -> NDArray[np.float64]:
    knots = np.unique(np.concatenate([[lo, hi], *(s.wavelengths for s in spectra)]))
    return knots[(knots >= lo) & (knots <= hi)]


def _raised_cosine(wavelengths: NDArray[np.float64], start: float, end: float) -> NDArray[np.float64]:
    """0 below `start`, 1 above `end` [nm], half a cosine wave between."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip((wavelengths - start) / (end - start), 0.0, 1.0))


def _frozen(values: ArrayLike) -> NDArray[np.float64]:
    try:
        array = np.array(values, dtype=np.float64)
    except (TypeError, ValueError, OverflowError) as error:
        raise InputError(f"a spectrum needs numbers: given {values!r:.60}") from error
    array.flags.writeable = False
    return array


def read_spectrum_file(path: str | Path) -> Spectrum:
    """The spectrum in a .spdx, .xml or .spd file [nm]; `InputError` for another or a damaged one."""
    path = Path(path)
    data = read_bytes(sized_file(path, LARGEST, "a file of a spectrum"), GROWTH)
    with reading(path, "a spectrum"):
        waves, values = _tm27(path, data) if path.suffix.lower() in TM27 else _lines(data)
        if len(waves) and max(waves) < MICROMETRES:
            raise InputError(f"{path} has wavelengths up to {max(waves):g}: give them in nanometres")
        try:
            return Spectrum(waves, values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error


def _tm27(path: Path, data: bytes) -> tuple[list[float], list[float]]:
    import colour

    if FORBIDDEN.search(data):
        raise InputError(f"{path} defines entities, which no spectrum needs: it is refused")
    read = colour.SpectralDistribution_IESTM2714(str(path)).read()
    return np.asarray(read.wavelengths).tolist(), np.asarray(read.values).tolist()


def _lines(data: bytes) -> tuple[list[float], list[float]]:
    """Two numbers a line, as of PBRT and Mitsuba; what stands behind # is no number."""
    lines = (line.split("#")[0].replace(",", " ").split() for line in data.decode("utf-8-sig").splitlines())
    rows = [(float(wave), float(value)) for wave, value in (line for line in lines if line)]
    return [wave for wave, _ in rows], [value for _, value in rows]
