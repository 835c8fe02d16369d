"""Field: the solved light of orders from one on that arrives at every place, and its look-up in the march."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.solve import FieldSolution, Solver
from hagoromo.transport.sample import Element


class Field:
    """Incident light of orders ≥ 1 in the stored cells, as halves: nine numbers of every channel of a cell together.

    channels: the bands of every group of lamps. A plain object: loops do not take its values into their state.
    """

    def __init__(self, solver: Solver, solution: FieldSolution, colours: BandColours) -> None:
        jit, cells, incident = arrays(), solver.stored, solution.incident
        self.residual, self.sweeps, scattering = solution.residual, solution.sweeps, solver.scattering
        self.cells, self.colours, self.scattering, self.channels = cells, colours, scattering, len(incident)
        columns = [number for numbers in incident for number in numbers]
        alone = len(columns) % 4 == 1  # the last number is kept beside the packets, or three quarters of one were empty
        self.packets = len(columns) // 4 if alone else -(-len(columns) // 4)
        largest = [max(float(dr.max(dr.abs(number))[0]) for number in numbers) for numbers in incident]
        self.scale = [dr.opaque(jit.Float, most or 1.0) for most in largest]
        lane, values = dr.arange(jit.UInt, cells.count), dr.zeros(jit.Float16, 4 * self.packets * cells.count)
        scaled = [jit.Float16(column * (1.0 / self.scale[k // NUMBERS])) for k, column in enumerate(columns)]
        for k, column in enumerate(scaled[: 4 * self.packets]):
            dr.scatter(values, column, lane * (4 * self.packets) + k)
        self.values, self.last = values, scaled[-1] if alone else jit.Float16()
        dr.eval(values, self.last)

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
