"""Yardstick: least-squares Lambert on the same photographs, with normals of its own, under a lamp that was held out."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from hagoromo.measurement.measurement import Measurement
from hagoromo.measurement.normals.normals import least_squares_lambert
from hagoromo.measurement.normals.views import Views, views_from_capture
from hagoromo.measurement.sight import light_of
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.photograph import Photograph

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class Yardstick:
    """Lambertian normals (P, 3) and body colours (C, P) of the pixels of `views`."""

    views: Views
    normals: Array
    body: Array

    def values(self, photograph: Photograph) -> Array:
        """(h, w, C) what Lambert's law gives under the lamps of `photograph`, without shadows; 0 where unknown."""
        total = np.zeros((len(self.views.rows), len(self.body)))
        for lamp in photograph.lamps:
            to_lamp, light = light_of(lamp, photograph.camera, len(self.body), self.views.points)
            incidence = np.maximum(np.einsum("pi,pi->p", self.normals, to_lamp), 0.0)
            total += self.body.T * incidence[:, None] * light
        return np.asarray(self.views.image(total), np.float64)


def yardstick_of(capture: Capture, measurement: Measurement) -> Yardstick | None:
    """The yardstick of the photographs of `capture`, whose shape `measurement` solved; None where it was given."""
    if measurement.normal_variance is None or measurement.points is None:
        return None
    views = views_from_capture(replace(capture, points=measurement.points))
    return Yardstick(views, *least_squares_lambert(views))
