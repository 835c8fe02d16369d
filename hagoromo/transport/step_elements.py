"""Elements of a step: those of its matter that the light of its one lit sample falls on, each with its share.

Where matter differs within a step, one place does not stand for all of it.
"""

from __future__ import annotations

import math
from dataclasses import replace

import drjit as dr

from hagoromo.backend import Array3f, Float, UInt, arrays, clip
from hagoromo.transport.crossing import MarchInterval, share_at_depth
from hagoromo.transport.medium import Medium
from hagoromo.transport.sample import Element

PLACES = (-2.0 / math.sqrt(3.0), 0.0, 2.0 / math.sqrt(3.0))  # of a step in rough matter, see `elements_along`
PARTS = 16  # of a step with two materials, of which each is of one


def mean_of_decay(fall: Float) -> Float:
    """∫_0^1 exp(−fall · x) dx."""
    thin = dr.abs(fall) < 2e-2
    safe = dr.select(thin, 1.0, fall)
    return dr.select(thin, 1.0 - fall * (0.5 - fall * (1.0 / 6.0)), (1.0 - dr.exp(-safe)) / safe)


def centroid(depth: Float) -> Float:
    """Centroid of exp(−depth · x) over 0…1: its middle in thin matter, its front in dense."""
    thick = dr.fmax(depth, 1e-2)
    return dr.select(depth > 1e-2, 1.0 / thick - 1.0 / (dr.exp(thick) - 1.0), 0.5 - depth / 12.0)


def elements_along(medium: Medium, step: MarchInterval, direction: Array3f) -> list[Element]:
    """Elements at several places of a step, each with its share: in rough matter those of one place are no mean.

    Light that arrives changes less: that of one place stands for all. Rough matter has no texels.
    """
    middle, spread = centroid(step.depth), dr.rsqrt(12.0 + step.depth * step.depth)  # and deviation of exp(−D)
    elements: list[Element] = []
    for place in PLACES:
        share = share_at_depth(clip(dr.fma(place, spread, middle), 0.0, 1.0), step.growth)
        here = medium.sample(step, dr.fma(share, step.end - step.begin, step.begin))
        each, _ = medium.elements(here, direction)
        elements += [replace(element, share=element.share * (1.0 / len(PLACES))) for element in each]
    return elements


def elements_of_parts(medium: Medium, step: MarchInterval, direction: Array3f) -> list[Element]:
    """Elements of the two materials of a step, each with its share; that of the sample is the first. Where a step
    begins and ends in the material of its sample, the second is nowhere.

    Borders lie about the middle between voxels, and steps begin at voxels: one material for a step would too often be
    that of its front.
    """
    jit, whole, middle = arrays(), step.end - step.begin, centroid(step.depth)

    def here(share: Float) -> MarchInterval:
        return medium.sample(step, dr.fma(share_at_depth(share, step.growth), whole, step.begin))

    own = medium.material(here(middle))
    ends = [medium.material(medium.sample(step, end)) for end in (step.begin, step.end)]
    two = (ends[0] != own) | (ends[1] != own)

    def parts(own: UInt) -> tuple[Float, Float, Float, UInt]:
        """Share of the material `own`; where in the depth of the step it is, and where another; its number."""
        share, first, second, other = jit.Float(0), jit.Float(0), jit.Float(0), jit.UInt(own)
        each = mean_of_decay(step.depth / PARTS) / (PARTS * mean_of_decay(step.depth))
        for k in range(PARTS):
            place, part = (k + 0.5) / PARTS, each * dr.exp(-step.depth * (k / PARTS))
            number = medium.material(here(jit.Float(place)))
            same = number == own
            share += dr.select(same, part, 0.0)
            first += dr.select(same, part * place, 0.0)
            second += dr.select(same, 0.0, part * place)
            other = dr.select(same, other, number)
        return share, first / dr.fmax(share, 1e-6), second / dr.fmax(1.0 - share, 1e-6), other

    share, first_at, second_at, number = dr.if_stmt(
        (own,), two, parts, lambda own: (jit.Float(1), jit.Float(middle), jit.Float(0), jit.UInt(own))
    )
    first = medium.elements(here(dr.select(two, first_at, middle)), direction)[0][0]
    axis = dr.if_stmt(
        (second_at, number), two,
        lambda at, number: medium.axis(here(at), number), lambda at, number: jit.Array3f(first.axis),
    )  # fmt: skip
    first = replace(first, material=own, share=share)
    return [first, replace(first, axis=axis, material=number, share=1.0 - share, there=two)]
