"""Palette: the distinct spectra of a scene, on which pictures keep their weights (MODEL §5)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Protocol

from hagoromo.light.spectrum import Spectrum
from hagoromo.reflectance.reflectance import Reflectance


class PaletteLamp(Protocol):
    """A lamp of any kind as a palette knows it."""

    @property
    def name(self) -> str:
        """Its name; empty for none."""
        ...

    @property
    def spectrum(self) -> Spectrum:
        """The relative spectrum of its light."""
        ...


@dataclass(frozen=True)
class Palette:
    """The distinct spectra of a scene's body colours, interface colours and lamps.

    transmitted, twice: the colours of light that has passed through elements once, and those squared, of light that has
    gone twice as far in clear fibres; empty where no element transmits.
    bands: in pictures of all orders, the hat functions that light of higher orders is kept in (`transport/path/bands`).
    lamps: the spectrum of each group of lamps. lamp_names, lamp_groups: name and group of every lamp, in the order of
    the scene; empty where they are not known, as in images of version 0.2.
    """

    bodies: tuple[Spectrum, ...]
    interfaces: tuple[Spectrum, ...]
    lamps: tuple[Spectrum, ...]
    lamp_names: tuple[str, ...] = ()
    lamp_groups: tuple[int, ...] = ()
    bands: tuple[Spectrum, ...] = ()
    transmitted: tuple[Spectrum, ...] = ()
    twice: tuple[Spectrum, ...] = ()

    @property
    def colours(self) -> tuple[Spectrum, ...]:
        """Bodies, interfaces, transmitted ones, then bands: the channels of one lamp group, in order."""
        return self.bodies + self.interfaces + self.transmitted + self.twice + self.bands

    @property
    def parts(self) -> tuple[int, ...]:
        """Of every colour but the bands, the weight of `AllWeights` that it belongs to, by its number."""
        each = self.bodies, self.interfaces, self.transmitted, self.twice
        return tuple(part for part, colours in enumerate(each) for _ in colours)

    @property
    def channels(self) -> int:
        """Number of weights of a pixel."""
        return len(self.lamps) * len(self.colours)

    def with_lamps(self, lamps: Sequence[PaletteLamp], separate: bool = False) -> Palette:
        """With the groups of `lamps`: those of one spectrum together, or each lamp its own (`separate`)."""
        spectra = [lamp.spectrum for lamp in lamps]
        distinct_spectra = tuple(spectra) if separate else distinct(spectra)
        groups = range(len(lamps)) if separate else [position_of(one, distinct_spectra) for one in spectra]
        names = tuple(lamp.name or f"lamp {k + 1}" for k, lamp in enumerate(lamps))
        return replace(self, lamps=distinct_spectra, lamp_names=names, lamp_groups=tuple(groups))


def palette_of(reflectances: Sequence[Reflectance], bases: Sequence[Spectrum], lamps: Sequence[Spectrum]) -> Palette:
    """The distinct spectra of some reflectances, further body colours and lamps."""
    bodies = [r.shown_body_colour for r in reflectances]
    once = distinct([r.transmitted[0] for r in reflectances if r.transmits])
    twice = distinct([r.transmitted[1] for r in reflectances if r.clear_share > 0.0])
    interfaces = distinct([r.interface_colour for r in reflectances])
    return Palette(distinct([*bodies, *bases]), interfaces, distinct(lamps), transmitted=once, twice=twice)


def distinct(spectra: Sequence[Spectrum]) -> tuple[Spectrum, ...]:
    """Spectra without repeats, in order."""
    return tuple({_key(s): s for s in reversed(spectra)}[key] for key in dict.fromkeys(_key(s) for s in spectra))


def position_of(spectrum: Spectrum, among: Sequence[Spectrum]) -> int:
    """Where a spectrum stands in a palette."""
    return [_key(s) for s in among].index(_key(spectrum))


def _key(spectrum: Spectrum) -> tuple[bytes, bytes]:
    return spectrum.wavelengths.tobytes(), spectrum.values.tobytes()
