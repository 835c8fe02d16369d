"""The bench of the spectra study: cameras, lamps and filters on one side, surfaces with known spectra on the other.

Cameras: camspec's 28, from a CSV (camera, wavelength_nm, R, G, B). Everything is a matrix over `WAVELENGTHS`.
"""

from __future__ import annotations

import csv
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.reflectance.spectra.prior_spectra import WAVELENGTHS

OTHERS = Path("camera_sensitivities") / "rawtoaces"
CAMERAS = Path("camera_sensitivities") / "camspec_28_cameras.csv"  # in a folder of data
TARGETS = ("D65", "A", "FL11")  # lamps under which the colour is predicted
YELLOW, CYAN = "D65 through yellow", "D65 through cyan"
SOURCES = {"D65": ("D65",), "D65 + A": ("D65", "A"), "D65 + FL11": ("D65", "FL11"), "filters": ("D65", YELLOW, CYAN)}
SPECTRA_NOISE = 0.003  # standard deviation of a reading, relative to it
COLUMNS = ["camera", "wavelength_nm", "R", "G", "B"]
Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class SpectraBench:
    """What cameras read relative to white, camera → lamp → (3, wavelengths), and the CIE colours of the targets.

    colours: lamp → (3, wavelengths), XYZ with Y = 1 for a perfect white diffuser.
    """

    cameras: dict[str, dict[str, Array]]
    colours: dict[str, Array]

    def readings(self, camera: str, sources: str) -> Array:
        """(channels, wavelengths) of one camera under all the lamps of `SOURCES[sources]`."""
        return np.concatenate([self.cameras[camera][lamp] for lamp in SOURCES[sources]])


def read_bench(path: str | Path, every: int = 1) -> SpectraBench:
    """The bench with every n-th camera of camspec's CSV."""
    names = list(read_cameras(path).items())[::every]
    lamps = {lamp: _lamp(lamp) for lamp in dict.fromkeys((*TARGETS, YELLOW, CYAN))}
    cameras = {
        name: {lamp: hg.reading_matrix(spectrum, response) for lamp, spectrum in lamps.items()}
        for name, response in names
    }
    observer = hg.Response.load("cie1931")
    colours = {}
    for lamp in TARGETS:
        reads = hg.camera_white(lamps[lamp], observer)
        colours[lamp] = hg.reading_matrix(lamps[lamp], observer) * (reads / reads[1])[:, None]
    return SpectraBench(cameras, colours)


def read_cameras(path: str | Path) -> dict[str, hg.Response]:
    """Camera → response, from a CSV whose rows are camera, wavelength [nm], R, G, B."""
    rows = list(csv.reader(Path(path).read_text(encoding="utf-8").splitlines()))
    if not rows or rows[0] != COLUMNS:
        raise hg.InputError(f"{path} must have the columns {','.join(COLUMNS)}")
    curves: dict[str, list[list[float]]] = {}
    for line, row in enumerate(rows[1:], 2):
        try:
            name, *numbers = row[0], *(float(cell) for cell in row[1:5])
        except (ValueError, IndexError) as error:
            raise hg.InputError(f"{path} line {line} is no camera and four numbers: {','.join(row):.60}") from error
        curves.setdefault(name, []).append(numbers)
    return {name: hg.Response(np.array(of)[:, 0], np.array(of)[:, 1:], name=name) for name, of in curves.items()}


def read_rawtoaces(folder: str | Path) -> dict[str, hg.Response]:
    """Camera → response, from rawtoaces' JSON files of cameras, each λ [nm] → (R, G, B)."""
    cameras = {}
    for path in sorted(Path(folder).glob("*_380_780_5.json")):
        record = hg.read_json(path)
        try:
            curves = record["spectral_data"]["data"]["main"]
            wavelengths = [float(key) for key in curves]
        except (KeyError, TypeError, ValueError) as error:
            raise hg.InputError(f"{path} has no curves spectral_data, data, main by wavelength") from error
        cameras[path.stem] = hg.Response(wavelengths, list(curves.values()), name=path.stem)
    return cameras


@cache
def chart(name: str = "BabelColor Average") -> Array:
    """(24, wavelengths): the patches of a ColorChecker as colour-science lists them."""
    import colour

    curves = colour.SDS_COLOURCHECKERS[name].values()
    return np.array([np.interp(WAVELENGTHS, curve.wavelengths, curve.values) for curve in curves])


def noisy(exact: Array, random: np.random.Generator) -> Array:
    """Readings (surfaces, channels) with noise."""
    return exact * (1.0 + SPECTRA_NOISE * random.standard_normal(exact.shape))


def delta_e(estimated: Array, true: Array, white_xyz: Array) -> Array:
    """CIEDE2000 between XYZ (..., 3) with CIELAB's white that of the lamp."""
    import colour

    to_lab = [_lab(np.maximum(xyz, 0.0) / white_xyz) for xyz in (estimated, true)]
    return np.asarray(colour.delta_E(*to_lab, method="CIE 2000"), np.float64)


def _lab(ratio: Array) -> Array:
    """CIELAB (CIE 15:2004) from XYZ relative to white (..., 3)."""
    curve = np.where(ratio > (6 / 29) ** 3, np.cbrt(ratio), ratio * (29 / 6) ** 2 / 3 + 4 / 29)
    x, y, z = np.moveaxis(curve, -1, 0)
    return np.stack([116 * y - 16, 500 * (x - y), 200 * (y - z)], axis=-1)


def _lamp(name: str) -> hg.Spectrum:
    """A lamp by name; the filters are smooth edges: yellow passes above 530 nm, cyan below 590 nm."""
    if name not in (YELLOW, CYAN):
        return hg.Spectrum.named(name)
    edge, sign = (530.0, 1.0) if name == YELLOW else (590.0, -1.0)
    fine = np.arange(380.0, 731.0, 5.0)
    return hg.Spectrum(fine, 0.9 / (1.0 + np.exp(-sign * (fine - edge) / 8.0))) * hg.Spectrum.named("D65")
