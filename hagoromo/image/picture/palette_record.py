"""The palette of a picture as text in its EXR: the spectra that its weights belong to, and the names of its lamps."""

from __future__ import annotations

from typing import Annotated, Any

from hagoromo.errors import InputError
from hagoromo.files.record import Count, ForeignRecord, about, decode, json_value
from hagoromo.light.spectrum import Spectrum, SpectrumRecord
from hagoromo.transport.palette import Palette

KEYS = ("bodies", "interfaces", "lamps")
FURTHER_KEYS = ("bands", "transmitted", "twice")  # of the images that have such colours
Spectra = list[SpectrumRecord]


class PaletteRecord(ForeignRecord, frozen=True, kw_only=True):
    """Files of version 0.2 do not name the lamps; only images of all orders have bands, of elements that transmit
    transmitted colours.
    """

    bodies: Annotated[Spectra, about("spectra of the bodies")]
    interfaces: Annotated[Spectra, about("spectra of the interfaces")]
    lamps: Annotated[Spectra, about("spectra of the groups of lamps")]
    bands: Annotated[Spectra, about("functions that light of higher orders is kept in")] = []
    transmitted: Annotated[Spectra, about("spectra of what light has passed through")] = []
    twice: Annotated[Spectra, about("the same where it went twice as far")] = []
    lamp_names: Annotated[list[str], about("name of every lamp")] = []
    lamp_groups: Annotated[list[Count], about("group of every lamp")] = []


def record_of_palette(palette: Palette) -> dict[str, Any]:
    """What `palette_of_text` reads back."""
    spectra = {key: [s.record() for s in getattr(palette, key)] for key in KEYS}
    for key in FURTHER_KEYS:
        spectra |= {key: [s.record() for s in own]} if (own := getattr(palette, key)) else {}
    return spectra | {"lamp_names": list(palette.lamp_names), "lamp_groups": list(palette.lamp_groups)}


def palette_of_text(text: str, where: str) -> Palette:
    """The palette in a text that came from `where`; `InputError` where it is none."""
    given = decode(json_value(text, where), PaletteRecord, where)
    spectra = {
        key: tuple(Spectrum(each.wavelengths, each.values) for each in getattr(given, key))
        for key in (*KEYS, *FURTHER_KEYS)
    }
    if len(given.lamp_names) != len(given.lamp_groups) or (
        given.lamp_groups and set(given.lamp_groups) != set(range(len(given.lamps)))
    ):
        raise InputError(f"{where}: its lamp_groups do not fit its lamps")
    return Palette(**spectra, lamp_names=tuple(given.lamp_names), lamp_groups=tuple(given.lamp_groups))
