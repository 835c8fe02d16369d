"""Field: the solved light of orders from one on that arrives at every place, and its look-up in the march."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import drjit as dr
import numpy as np
from numpy.typing import NDArray

from hagoromo.backend import Array3f, Float, arrays, column, lookup
from hagoromo.errors import InputError
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.cells import Cells, StoredCells
from hagoromo.transport.field.scattering import ScatteringTables
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.sent_light import Numbers
from hagoromo.transport.field.solve import FieldSolution, Solver
from hagoromo.transport.sample import Element


@dataclass(frozen=True, eq=False)
class StoredField:
    """What a `Field` is made of again: its cells, and its light as halves, as it stands in memory."""

    cells: StoredCells
    scale: tuple[float, ...]
    values: NDArray[np.float16]
    last: NDArray[np.float16]
    residual: float
    sweeps: int


class HalvesOfLight:
    """Nine numbers of every channel and stored cell as halves, all of a cell together.

    values: packets of four of them. last: the last number of a cell beside the packets, where three quarters of one
    were empty. scale: of each channel, by which halves are multiplied.
    """

    def __init__(self, values: Float, last: Float, scale: Sequence[float]) -> None:
        self.values, self.last = values, last
        self.scale = [dr.opaque(arrays().Float, number) for number in scale]
        self.packets = packets_of(len(scale))
        self.scales = tuple(scale)

    @classmethod
    def of(cls, incident: Numbers, count: int) -> HalvesOfLight:
        """Of the light of `count` stored cells."""
        jit, packets = arrays(), packets_of(len(incident))
        scale = [max(float(dr.max(dr.abs(n))[0]) for n in numbers) or 1.0 for numbers in incident]
        factors = [dr.opaque(jit.Float, number) for number in scale]
        columns = [number for numbers in incident for number in numbers]
        scaled = [jit.Float16(each * (1.0 / factors[k // NUMBERS])) for k, each in enumerate(columns)]
        lane, values = dr.arange(jit.UInt, count), dr.zeros(jit.Float16, 4 * packets * count)
        for k, each in enumerate(scaled[: 4 * packets]):
            dr.scatter(values, each, lane * (4 * packets) + k)
        last = scaled[-1] if len(columns) > 4 * packets else jit.Float16()
        dr.eval(values, last)
        return cls(values, last, scale)


def packets_of(channels: int) -> int:
    """Packets of four numbers of a cell; one number is kept beside them where three quarters of the last were empty."""
    numbers = channels * NUMBERS
    return numbers // 4 if numbers % 4 == 1 else -(-numbers // 4)


class Field:
    """Incident light of orders ≥ 1 in the stored cells, as halves.

    channels: the bands of every group of lamps. A plain object: loops do not take its values into their state.
    """

    def __init__(
        self, cells: Cells, light: HalvesOfLight, scattering: ScatteringTables, colours: BandColours,
        residual: float, sweeps: int,
    ) -> None:  # fmt: skip
        """residual, sweeps: of the solution, see `FieldSolution`."""
        self.cells, self.colours, self.scattering, self.channels = cells, colours, scattering, len(light.scale)
        self.light, self.residual, self.sweeps = light, residual, sweeps
        self.values, self.last, self.scale, self.packets = light.values, light.last, light.scale, light.packets

    @classmethod
    def solved(cls, solver: Solver, solution: FieldSolution, colours: BandColours) -> Field:
        """The field of a solution."""
        light = HalvesOfLight.of(solution.incident, solver.stored.count)
        return cls(solver.stored, light, solver.scattering, colours, solution.residual, solution.sweeps)

    @classmethod
    def of(cls, stored: StoredField, scattering: ScatteringTables, colours: BandColours, channels: int) -> Field:
        """The field that `stored` gave, with its bits. `InputError` where its sizes are not those of `channels`."""
        jit, cells = arrays(), Cells.of(stored.cells)
        each = 4 * packets_of(channels)
        sizes = [(stored.values, each), (stored.last, int(channels * NUMBERS > each))]
        fit = all(a.dtype == np.float16 and a.shape == (count * cells.count,) for a, count in sizes)
        if not fit or len(stored.scale) != channels or not np.isfinite(stored.scale).all():
            raise InputError(
                f"light of {len(stored.scale)} channels in {cells.count} cells has numbers that do not fit"
            )
        values, last = lookup(jit.Float16, stored.values), column(jit.Float16, stored.last)
        light = HalvesOfLight(values, last, stored.scale)
        return cls(cells, light, scattering, colours, stored.residual, stored.sweeps)

    def stored(self) -> StoredField:
        """What the field is made of again."""
        values, last = np.array(self.values), np.array(self.last)
        return StoredField(self.cells.stored(), self.light.scales, values, last, self.residual, self.sweeps)

    @property
    def bytes(self) -> int:
        """Memory of the light and the table of cells [byte]."""
        return 2 * (dr.width(self.values) + dr.width(self.last)) + self.cells.bytes

    def record(self) -> dict[str, Any]:
        """Figures of the solution, as plain values."""
        figures = {"cell": self.cells.size, "cells": self.cells.count, "sweeps": self.sweeps}
        return figures | {"residual": self.residual, "bytes": self.bytes}

    def scattered(
        self, point: Array3f, to_eye: Array3f, elements: Sequence[Element], coefficients: Sequence[Sequence[Float]]
    ) -> list[Float]:
        """∫ f L dω of the field's light L at a sample, towards the eye: radiance of every channel."""
        factors = [[arrays().Float(0)] * NUMBERS for _ in range(self.colours.count)]
        for element, own in zip(elements, coefficients, strict=True):
            colours = self.colours.of(own)
            for part in range(self.scattering.parts):
                towards = self.scattering.towards(element.material, part, element.axis, to_eye)
                for band, old in enumerate(factors):
                    each = colours[part * len(factors) + band] * element.share
                    factors[band] = [dr.fma(each, new, sofar) for new, sofar in zip(towards, old, strict=True)]
        incident = self.incident(point)
        return [
            dr.fmax(sum(f * n for f, n in zip(factors[k % len(factors)], numbers, strict=True)), 0.0)
            for k, numbers in enumerate(incident)
        ]

    def taken(self, gain: Float, smooth: Sequence[Float]) -> None:
        """Nothing to do: derivatives need it, see `look_up_back`."""

    def incident(self, point: Array3f) -> list[list[Float]]:
        """The nine numbers of the incident light of every channel, between the eight cells around a point."""
        jit = arrays()
        cells, weights = self.cells.around(self.cells.place(point))
        total, last = [jit.Array4f(0.0) for _ in range(self.packets)], jit.Float(0)
        known = jit.Float(0)
        for cell, weight in zip(cells, weights, strict=True):
            there = cell >= 0
            known += dr.select(there, weight, 0.0)
            for k in range(self.packets):
                packet = dr.gather(jit.Array4f16, self.values, jit.UInt(cell) * self.packets + k, there)
                total[k] = dr.fma(jit.Array4f(packet), weight, total[k])
            if dr.width(self.last):
                number = dr.gather(jit.Float16, self.last, jit.UInt(cell), there)
                last = dr.fma(jit.Float(number), weight, last)
        inverse = dr.rcp(dr.fmax(known, 1e-6))
        flat = [
            number * inverse for number in [*(x for packet in total for x in packet), last][: self.channels * NUMBERS]
        ]
        return [
            [number * self.scale[c] for number in flat[c * NUMBERS : (c + 1) * NUMBERS]] for c in range(self.channels)
        ]
