"""Element kinds: which element each material of a medium is made of, and where an axis is a tangent."""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Bool, UInt, arrays, lookup
from hagoromo.reflectance.element import ELEMENTS
from hagoromo.volume.box import VolumeBox

BITS = 2  # of an element: its place in ELEMENTS


class Kinds:
    """Elements of the materials of all boxes: a tangent, of a cylinder, may have either sign; a normal may not."""

    def __init__(self, boxes: Sequence[VolumeBox]) -> None:
        elements = [[material.element for material in box.materials] for box in boxes]
        distinct = {element for each in elements for element in each}
        self.tangents = "cylinder" in distinct
        self.mixed = any(len(set(each)) > 1 for each, box in zip(elements, boxes, strict=True) if not box.texel)
        self._only = distinct == {"cylinder"}
        row = [ELEMENTS.index(e) for each in elements for e in each]
        self.count, self._row = len(row), lookup(arrays().UInt8, np.array(row, np.uint8))
        # few of them are read from the bits of one number
        bits = sum(e << BITS * k for k, e in enumerate(row)) if len(row) <= 32 // BITS else None
        self._bits = None if bits is None else dr.opaque(arrays().UInt, bits)

    def of(self, material: UInt) -> UInt:
        """The element of a material, numbered in the row of all boxes' materials: its place in ELEMENTS."""
        if self._bits is not None:
            return (self._bits >> (BITS * material)) & (2**BITS - 1)
        return arrays().UInt(dr.gather(arrays().UInt8, self._row, material))

    def tangent(self, material: UInt) -> Bool | None:
        """Where the axes of a material are tangents; None: nowhere."""
        if not self.tangents or self._only:
            return arrays().Bool(True) if self._only else None
        return self.of(material) == ELEMENTS.index("cylinder")

    def population(self, first: UInt, k: int) -> Bool | None:
        """As `tangent`, of population k of a texel whose materials are numbered from `first` on."""
        return self.tangent(dr.minimum(first + k, dr.opaque(arrays().UInt, self.count - 1)))
