"""Spectra of other programs are read as their text says, and as Mitsuba and colour-science read them."""

from pathlib import Path

import numpy as np
import pytest

from fuzz.records import SPDX
from hagoromo.app.info import info
from hagoromo.errors import InputError
from hagoromo.light.spectrum import Spectrum, read_spectrum_file

SPD = "# a lamp\n400 0.5\n500, 1 # peak\n\n600 0.25\n"


@pytest.mark.parametrize(("name", "text"), [("a.spdx", SPDX), ("a.xml", SPDX), ("a.spd", SPD)])
def test_a_spectrum_is_read_as_its_text_says(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    for spectrum in (read_spectrum_file(tmp_path / name), Spectrum.load(name, tmp_path)):
        assert spectrum.wavelengths.tolist() == [400.0, 500.0, 600.0]
        assert spectrum.values.tolist() == [0.5, 1.0, 0.25]
    assert info(tmp_path / name)["range_nm"] == [400.0, 600.0]
    with pytest.raises(InputError, match="points outside"):
        Spectrum.load(f"../{name}", tmp_path)


def test_mitsuba_reads_the_same_lines(tmp_path):
    import mitsuba as mi

    mi.set_variant("scalar_spectral")
    (tmp_path / "a.spd").write_text("400 0.5\n500 1\n600 0.25\n")
    waves, values = mi.spectrum_from_file(str(tmp_path / "a.spd"))
    spectrum = read_spectrum_file(tmp_path / "a.spd")
    assert np.array_equal(waves, spectrum.wavelengths) and np.array_equal(values, spectrum.values)


def test_a_file_of_the_standard_s_makers_is_read():
    """The lamp that colour-science ships: a fluorescent one, its mercury line at 546 nm."""
    from colour.io import tm2714

    file = Path(tm2714.__file__).parent / "tests" / "resources" / "Fluorescent.spdx"
    spectrum = read_spectrum_file(file)
    assert spectrum.at(400.0) == pytest.approx(0.034) and abs(spectrum.wavelengths[spectrum.values.argmax()] - 612) < 70


BAD = {
    "bomb.spdx": ('<!DOCTYPE a [<!ENTITY b "c">]>' + SPDX.split("?>")[1], "defines entities"),
    "cut.spdx": (SPDX[:-40], "cannot be read"),
    "three.spd": ("400 1 2\n500 1 2\n", "cannot be read"),
    "back.spd": ("500 1\n400 1\n", "must increase"),
    "metres.spd": ("0.4 1\n0.5 1\n", "nanometres"),
    "empty.spd": ("# none\n", "two or more"),
    "words.spd": ("red 1\n", "cannot be read"),
}


@pytest.mark.parametrize("name", BAD)
def test_what_is_no_spectrum_is_refused(tmp_path, name):
    text, said = BAD[name]
    (tmp_path / name).write_text(text)
    with pytest.raises(InputError, match=said):
        read_spectrum_file(tmp_path / name)
