"""Colour unit: the value in which body colours are counted while they are found.

Where body colours and the gloss begin, their steps, and what is known of them beforehand, are those of a usual albedo.
An object may be darker, and the strengths of its lamps, or without lamps its light, may be in another unit than the
values of the photographs. So values are divided by one number until the object is found. Light is linear: body colours
and β are multiplied by it afterwards, and the unit of the lamps' strengths changes nothing else.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.sight import light_of
from hagoromo_recovery.matter_shape import MatterShape
from hagoromo_recovery.outline.object_view import ObjectView
from hagoromo_recovery.shading.shading import each_gloss

USUAL = 0.3  # value of a place under light of π, as most objects have it: that of their body colour, and less aslant
BRIGHT = 75  # percentile of the values in a silhouette, and of photographs, that stands for what faces the lamp


def colour_unit(views: Sequence[ObjectView], middle: NDArray[np.float64]) -> float:
    """Value of bright places over the usual one; 1 where there are none. middle: (3,) [m] of the object."""
    bright = []
    for view in views:
        shot = view.photograph
        values = shot.values[shot.mask & view.silhouette]
        if values.size:
            camera, channels = shot.camera, values.shape[1]
            lamps = [light_of(lamp, camera, channels, middle[None])[1].mean() for lamp in shot.lamps]
            light = float(np.sum(lamps)) / np.pi if lamps else 1.0
            bright.append(float(np.percentile(np.nan_to_num(values).mean(axis=1), BRIGHT)) / max(light, 1e-30))
    found = float(np.percentile(bright, BRIGHT)) / USUAL if bright else 1.0
    return found if found > 0.0 else 1.0


def counted_in(view: ObjectView, unit: float) -> ObjectView:
    """A view whose values are counted in a unit."""
    photograph = view.photograph
    values, variance = photograph.values / unit, photograph.variance / unit**2
    changed = replace(photograph, values=values.astype(np.float32), variance=variance.astype(np.float32))
    return replace(view, photograph=changed)


def counted_back(shape: MatterShape, unit: float) -> MatterShape:
    """What was found of such views, as the values are."""
    gloss = shape.gloss.copy()
    for beta, *_ in each_gloss(gloss):
        gloss[beta] += np.log(unit)
    return replace(shape, colours=(shape.colours * unit).astype(np.float32), gloss=gloss)
