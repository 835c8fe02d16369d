"""Field: the solved light of orders from one on that arrives at every place, and its look-up in the march."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import drjit as dr

from hagoromo.backend import Array3f, Float, arrays
from hagoromo.transport.field.band_colours import BandColours
from hagoromo.transport.field.second_order import NUMBERS
from hagoromo.transport.field.solve import Solution, Solver
from hagoromo.transport.sample import Element


class Field:
    """Incident light of orders ≥ 1 in the stored cells, as halves: nine numbers of every channel of a cell together.

    channels: the bands of every group of lamps. A plain object: loops do not take its values into their state.
    """

    def __init__(self, solver: Solver, solution: Solution, colours: BandColours) -> None:
        jit, cells, incident = arrays(), solver.stored, solution.incident
        self.residual, self.sweeps, scattering = solution.residual, solution.sweeps, solver.scattering
        self.cells, self.colours, self.scattering, self.channels = cells, colours, scattering, len(incident)
        columns = [number for numbers in incident for number in numbers]
        self.packets = -(-len(columns) // 4)
        columns += [dr.zeros(jit.Float, cells.count)] * (4 * self.packets - len(columns))
        largest = [max(float(dr.max(dr.abs(number))[0]) for number in numbers) for numbers in incident]
        self.scale = [dr.opaque(jit.Float, most or 1.0) for most in largest]
        lane, values = dr.arange(jit.UInt, cells.count), dr.zeros(jit.Float16, 4 * self.packets * cells.count)
        for k, column in enumerate(columns):
            scale = 1.0 / self.scale[k // NUMBERS] if k < len(incident) * NUMBERS else jit.Float(1)
            dr.scatter(values, jit.Float16(column * scale), lane * (4 * self.packets) + k)
        self.values = values
        dr.eval(values)

    @property
    def bytes(self) -> int:
        """Memory of the light and the table of cells [byte]."""
        return 2 * dr.width(self.values) + self.cells.bytes

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
        total = [jit.Array4f(0.0) for _ in range(self.packets)]
        known = jit.Float(0)
        for cell, weight in zip(cells, weights, strict=True):
            there = cell >= 0
            known += dr.select(there, weight, 0.0)
            for k in range(self.packets):
                packet = dr.gather(jit.Array4f16, self.values, jit.UInt(cell) * self.packets + k, there)
                total[k] = dr.fma(jit.Array4f(packet), weight, total[k])
        inverse = dr.rcp(dr.fmax(known, 1e-6))
        flat = [total[k // 4][k % 4] * inverse for k in range(self.channels * NUMBERS)]
        return [
            [number * self.scale[c] for number in flat[c * NUMBERS : (c + 1) * NUMBERS]] for c in range(self.channels)
        ]
