"""Band colours: the colours of a palette at the wavelengths of the bands that light of higher orders is solved in."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Float, arrays, lookup
from hagoromo.transport.palette import Palette
from hagoromo.transport.path.bands import Bands


class BandColours:
    """Colours of elements in every band, from their coefficients on a palette."""

    def __init__(self, bands: Bands, palette: Palette) -> None:
        self.count, self.of_part = bands.count, palette.parts
        self.parts = 1 + max(self.of_part)
        self.columns = self.parts * self.count  # numbers of `of`
        self.values = lookup(arrays().Float, bands.of(palette.colours).astype(np.float32))

    def of(self, coefficients: Sequence[Float]) -> list[Float]:
        """Body colour in every band, then interface colour in every band, then transmitted ones."""
        parts = [[j for j, own in enumerate(self.of_part) if own == part] for part in range(self.parts)]
        return [sum(coefficients[j] * self._value(j, k) for j in part) for part in parts for k in range(self.count)]

    def values_of(self, band: int) -> list[Float]:
        """Values of all colours of the palette in a band."""
        return [self._value(j, band) for j in range(len(self.of_part))]

    def _value(self, colour: int, band: int) -> Float:
        jit = arrays()
        return dr.gather(jit.Float, self.values, jit.UInt(colour * self.count + band))


class ColoursAndShares(BandColours):
    """Band colours with the coefficients behind them, for derivatives by the colours of the palette."""

    def __init__(self, bands: Bands, palette: Palette) -> None:
        super().__init__(bands, palette)
        self.columns += len(self.of_part)

    def of(self, coefficients: Sequence[Float]) -> list[Float]:
        """As that of `BandColours`, then the coefficients."""
        return [*super().of(coefficients), *coefficients[: len(self.of_part)]]
