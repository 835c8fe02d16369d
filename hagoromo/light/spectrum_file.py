"""Spectra of other programs: IES TM-27-14 (.spdx, .xml, by colour-science) and lines of wavelength and value (.spd)."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np

from hagoromo.errors import InputError
from hagoromo.files.checks import read_bytes, sized_file
from hagoromo.files.reading import reading
from hagoromo.light.spectrum import Spectrum

LARGEST = 1 << 22  # bytes
GROWTH = 60.0  # memory of the words, in sizes of the file
TM27 = (".spdx", ".xml")
PLAIN = (".spd",)
FORBIDDEN = re.compile(rb"<!\s*(DOCTYPE|ENTITY)", re.IGNORECASE)  # entities may grow, or name other files
MICROMETRES = 10.0  # a largest wavelength below it is no nanometre


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
