"""Pixel gradient: what some pixels ask of a field, added to its gradients in whole numbers."""

from __future__ import annotations

import drjit as dr

from hagoromo_recovery.descent.gloss_step import robust
from hagoromo_recovery.descent.pixel_table import Drawn
from hagoromo_recovery.descent.rendering import Rendering, SeenLight
from hagoromo_recovery.field.matter_field import COLOURS

SILHOUETTE = 100.0  # of a pixel's opacity, in units of its squared error


def add_gradient(rendering: Rendering, drawn: Drawn, count: int, limit: float) -> SeenLight:
    """Add the gradient of the mean squared error of some pixels to those of the field; gives their light.

    count: pixels that the mean is of; these may be a part of them. Gradients are whole numbers, so those of all parts
    have the sum of the whole, to the bit. limit: see `robust`.
    """
    light = rendering.light(drawn)
    rest = [a - b for a, b in zip(light.channels, drawn.values, strict=True)]
    doubt = robust(drawn, rest, limit)
    by = [(2.0 / 3.0 / count) * w * r * doubt for w, r in zip(drawn.weights, rest, strict=True)]
    by_light = [factor * by[k % COLOURS] for k, factor in enumerate(light.factors)]
    clear = dr.exp(-light.seen.depth)
    weight = rendering.field.outline_weight(drawn)
    by_depth = (2.0 * SILHOUETTE / count) * weight * ((1.0 - clear) - drawn.share) * clear
    dr.eval(by_light, by_depth)
    with dr.suspend_grad():
        rendering.march.adjoint(drawn.rays, light.seen, by_light, by_depth)
    return light
