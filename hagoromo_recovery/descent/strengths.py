"""Strengths: factors, near 1, on the light of each lamp and on each photograph, that photographs agree on.

A strength that is stated some per cent wrong, or an exposure time, is absorbed by the colours and normals of places
otherwise. The mean of all cannot be distinguished from brighter body colours: it stays as stated.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import drjit as dr
import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from hagoromo.backend import Float, UInt, arrays, lookup
from hagoromo.files.content import digest
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.transforms import record_from_lamp
from hagoromo_recovery.descent.gloss_step import CORRELATED, robust
from hagoromo_recovery.descent.pixel_table import Drawn, PixelTable
from hagoromo_recovery.field.matter_field import COLOURS

if TYPE_CHECKING:
    from hagoromo_recovery.descent.rendering import SeenLight

Array = NDArray[np.float64]
PRIOR = 0.05  # standard deviation of a factor's logarithm, known beforehand
LARGEST = 0.1  # change of a logarithm in a step, at most
DAMPED = 0.5  # share of a step of Gauss and Newton that is taken


class Strengths:
    """Logarithms of factors. lamps, exposure: whether lamps, and whether photographs, have one each.

    found: logarithms by lamp and photograph, as `logarithms` gives them.
    """

    def __init__(
        self, photographs: Sequence[Photograph], lamps: bool, exposure: bool, found: Mapping[str, float]
    ) -> None:
        self.lamps, self.exposure = lamps, exposure
        self.each = max((len(p.lamps) for p in photographs), default=0)
        names: dict[str, int] = {}
        # (2, photographs, each): number of the factor of a lamp, and of the photograph; −1 where there is none
        self.number = np.full((2, len(photographs), self.each), -1)
        for k, photograph in enumerate(photographs):
            for j, lamp in enumerate(photograph.lamps):
                for which, name in enumerate((self._of_lamp(lamp), self._of_photograph(photograph))):
                    if name:
                        self.number[which, k, j] = names.setdefault(name, len(names))
        self.names = list(names)
        self.values = np.array([found.get(name, 0.0) for name in self.names])

    def __str__(self) -> str:
        spread, most = np.sqrt(np.mean(self.values**2)), np.abs(self.values).max()
        what = " and ".join(word for word, on in (("lamp", self.lamps), ("photograph", self.exposure)) if on)
        return f"each {what} brighter or darker by {100 * spread:.1f} % (rms), {100 * most:.1f} % at most"

    @property
    def logarithms(self) -> dict[str, float]:
        """By lamp and photograph."""
        return dict(zip(self.names, self.values.tolist(), strict=True))

    def _of_lamp(self, lamp: Lamp) -> str:
        return "lamp " + digest(record_from_lamp(lamp)) if self.lamps else ""

    def _of_photograph(self, photograph: Photograph) -> str:
        pose = photograph.camera.world_to_camera.tolist()
        return "photograph " + digest([photograph.name, pose]) if self.exposure else ""

    @property
    def factors(self) -> Array:
        """(photographs, each) on the light of each lamp of each photograph."""
        with_none = np.append(self.values, 0.0)
        return np.exp(with_none[self.number].sum(axis=0))

    def on(self, photograph: UInt) -> list[Float]:
        """Factors on the light of lamps that rays with these numbers of photographs see."""
        jit = arrays()
        table = lookup(jit.Float, self.factors.astype(np.float32).ravel())
        return [dr.gather(jit.Float, table, photograph * self.each + k) for k in range(self.each)]

    def step(self, pixels: PixelTable, drawn: Drawn, light: SeenLight, fall: float) -> None:
        """Half a step of Gauss and Newton, times `fall`, by some pixels and their light."""
        rest = [value - seen for value, seen in zip(drawn.values, light.channels, strict=True)]
        weight = np.array(robust(drawn, rest, pixels.limit), np.float64)
        count = len(self.values)
        number = self.number[:, np.array(drawn.photograph)]  # (2, pixels, each)
        at, parts = np.concatenate(number.swapaxes(1, 2)), light.of_lamps  # of lamps, then of photographs
        by_channel = [(at, np.concatenate([parts[:, c]] * 2)) for c in range(COLOURS)]
        matrix, side = normal_equations(pixels, drawn, rest, weight, by_channel, count, CORRELATED)
        matrix, side = matrix + np.eye(count) / PRIOR**2, side - self.values / PRIOR**2
        change = fall * DAMPED * np.linalg.solve(matrix, side)
        self.values = self.values + np.clip(change, -LARGEST, LARGEST)
        for kind in self.number:
            own = np.unique(kind[kind >= 0])
            self.values[own] -= self.values[own].mean() if len(own) else 0.0

    def of(self, photograph: Photograph) -> Photograph:
        """A photograph with lamps as strong as was found; as stated, where nothing is known of them."""
        known, own = self.logarithms, self._of_photograph(photograph)
        lamps = []
        for lamp in photograph.lamps:
            factor = float(np.exp(known.get(self._of_lamp(lamp), 0.0) + known.get(own, 0.0)))
            intensity = tuple(factor * x for x in np.atleast_1d(lamp.intensity))
            lamps.append(replace(lamp, intensity=intensity if isinstance(lamp.intensity, tuple) else intensity[0]))
        return replace(photograph, lamps=tuple(lamps))


def normal_equations(
    pixels: PixelTable,
    drawn: Drawn,
    rest: Sequence[Float],
    weight: Array,
    by_channel: Sequence[tuple[NDArray[np.integer], Array]],
    count: int,
    alike: float,
) -> tuple[Array, Array]:
    """Normal matrix (count, count) and right side (count,) of some numbers of lamps, by drawn pixels for all of them.

    rest: residuals of channels. weight: (pixels,). by_channel: numbers (m, pixels) and slopes (m, pixels) of the light
    by them, −1 where there is none. alike: values that count as one, as their errors are alike.
    """
    copies = pixels.count / len(weight) / alike
    matrix, side = np.zeros((count, count)), np.zeros(count)
    lane = np.arange(len(weight))
    for own, (at, slope), channel in zip(drawn.weights, by_channel, rest, strict=True):
        by = copies * weight * np.array(own, np.float64)
        rows, known = np.broadcast_to(lane, at.shape), at >= 0
        slopes = csr_array((slope[known], (rows[known], at[known])), (len(weight), count))
        matrix += (slopes.T @ (slopes * by[:, None])).toarray()
        side += slopes.T @ (by * np.array(channel, np.float64))
    return matrix, side
