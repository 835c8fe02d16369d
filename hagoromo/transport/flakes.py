"""Flakes: extinction by the projected area of the elements, in the boxes that ask for it (MODEL §3, "Extinction").

σ(ω) = τ ρ A(a·ω), after Jakob et al. (2010) and Heitz et al. (2015), with A of `reflectance.element.projected_area`.
In a box of isotropic extinction A is 1.
"""

from __future__ import annotations

from collections.abc import Sequence

import drjit as dr
import numpy as np

from hagoromo.backend import Array3f, Bool, Float, UInt, arrays, lookup
from hagoromo.reflectance.element import ELEMENTS, projected_area
from hagoromo.volume.box import VolumeBox
from hagoromo.volume.texel import MOST_POPULATIONS

ISOTROPIC = len(ELEMENTS)  # stands in place of an element for the materials of boxes of isotropic extinction


class Flakes:
    """Projected areas by material number, counted over the materials of all boxes."""

    def __init__(self, boxes: Sequence[VolumeBox]) -> None:
        jit = arrays()
        projected = [box.extinction == "projected" for box in boxes]
        kinds = [
            ELEMENTS.index(material.element) if flag else ISOTROPIC
            for box, flag in zip(boxes, projected, strict=True)
            for material in box.materials
        ]
        self.kinds = tuple(sorted(set(kinds)))  # a kernel holds the formulas of these only
        beyond = [kinds[-1]] * MOST_POPULATIONS  # populations that the last box lacks are looked up, too
        self.kind_of = lookup(jit.UInt, np.array(kinds + beyond, np.uint32))
        self.projected = None if all(projected) else lookup(jit.UInt, np.array(projected, np.uint32))

    def in_box(self, box: UInt) -> Bool:
        """Whether box number `box` has projected extinction."""
        return arrays().Bool(True) if self.projected is None else dr.gather(arrays().UInt, self.projected, box) > 0

    def area(self, material: UInt, axis: Array3f, direction: Array3f) -> Float:
        """Projected area A along `direction` of the element of a material with `axis`; both unit, in the same axes."""
        cosine, area = dr.dot(axis, direction), None
        kind = dr.gather(arrays().UInt, self.kind_of, material) if len(self.kinds) > 1 else None
        for k in self.kinds:
            own = arrays().Float(1.0 if k == ISOTROPIC else projected_area(ELEMENTS[k], cosine))
            area = own if area is None else dr.select(kind == k, own, area)
        assert area is not None
        return area


def flakes_of(boxes: Sequence[VolumeBox]) -> Flakes | None:
    """The projected areas of the boxes; None where all have isotropic extinction, so that kernels do without."""
    return Flakes(boxes) if any(box.extinction == "projected" for box in boxes) else None
