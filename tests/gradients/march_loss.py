"""A loss by what rays see of matter, and its gradients by the adjoint of the march."""

import drjit as dr
import numpy as np

from hagoromo.backend import arrays, evaluate, lookup


def column(values):
    return lookup(arrays().Float, np.ascontiguousarray(values, np.float32))


def loss(march, rays, weights):
    with dr.suspend_grad():
        seen = march.seen(rays)
    light = sum(np.array(w, np.float64) @ np.array(c, np.float64) for w, c in zip(weights, seen.light, strict=True))
    return light + 0.3 * np.exp(-np.array(seen.depth, np.float64)).sum()


def add_gradients(field, march, rays, weights):
    """Those of `loss`, in the field."""
    field.no_gradients()
    with dr.suspend_grad():
        seen = march.seen(rays)
        evaluate(seen)
        march.adjoint(rays, seen, weights, -0.3 * dr.exp(-seen.depth))
