"""Leave one lamp out: everything is solved again without one photograph, which is then predicted and compared.

Ordinary least squares of Lambert's law follows the same protocol. It is repeated with the flat-field correction of the
lamps, and with interpolated residuals of neighbouring lamps, to show the effect of each step.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.measurement.normals.normals import least_squares_fit
from studies.cast_shadow import lit_share
from studies.predicted_photograph import disagreement, forecast

Array = NDArray[np.float64]
NORMAL_METHODS = {
    "lambert": "Lambert, plain least squares",
    "lambert_even": "the same, lamps evened out",
    "lambert_neighbours": "the same, and the neighbours' disagreement",
    "model": "ours: robust normals, gloss; attached shadows",
    "model_shadows": "ours, and cast shadows of the integrated surface",
    "ours": "ours, and the neighbours' disagreement",
}
YARDSTICK, OURS = "lambert", "ours"


@dataclass(frozen=True, eq=False)
class KeptAside:
    """One lamp held out: its number, the photograph, predictions (h, w, C) by method in the photograph's values.

    solved, points (h, w, 3): normals and surface solved without it.
    """

    lamp: int
    photograph: hg.Photograph
    predictions: Mapping[str, NDArray[np.float64]]
    solved: hg.NormalMap
    points: NDArray[np.float64]


def score(photograph: hg.Photograph, prediction: NDArray[np.floating]) -> tuple[float, float]:
    """Relative RMSE and PSNR [dB, peak 1] of a prediction (h, w, C), over all valid pixels of the object."""
    true = photograph.values[photograph.mask].astype(np.float64)
    rmse = float(np.sqrt(np.mean((prediction[photograph.mask] - true) ** 2)))
    return rmse / float(np.sqrt(np.mean(true**2))), -20.0 * float(np.log10(rmse))


def keep_aside(capture: hg.Capture, even: hg.Capture, field: Array, lamp: int) -> KeptAside:
    """Predict photograph `lamp` of `capture` from the others.

    even: the capture with the lamps measured on the other objects, flat-fielded by `field` (K, h, w).
    """
    photograph, camera = capture.photographs[lamp], capture.photographs[lamp].camera
    stated, to_lamp = (np.asarray(one.photographs[lamp].lamps[0].to_lamp) for one in (capture, even))
    plain, others = hg.views_from_capture(_without(capture, lamp)), hg.views_from_capture(_without(even, lamp))
    distance = float(np.linalg.norm(camera.position))
    fitted = hg.solve_normals(_without(even, lamp))
    points = hg.points_from_normals(fitted.normals, camera, distance, fitted.variance)
    lambert, lambert_even = least_squares_fit(plain), least_squares_fit(others)
    own, pixels = forecast(fitted.fit, fitted.views, to_lamp), fitted.views
    lit = lit_share(points, camera, to_lamp)[pixels.rows, pixels.columns]
    flat = field[lamp][pixels.rows, pixels.columns]
    yardstick = forecast(lambert_even, others, to_lamp)
    values = {
        "lambert_even": flat * yardstick,
        "lambert_neighbours": flat * np.maximum(yardstick + disagreement(lambert_even, others, to_lamp), 0.0),
        "model": flat * own,
        "model_shadows": flat * own * lit,
        "ours": flat * np.maximum(own + disagreement(fitted.fit, pixels, to_lamp), 0.0),
    }
    predictions = {method: _image(pixels, value) for method, value in values.items()}
    predictions["lambert"] = _image(plain, forecast(lambert, plain, stated))
    return KeptAside(lamp, photograph, predictions, fitted, points)


def _image(pixels: hg.Views, values: Array) -> NDArray[np.float64]:
    """(h, w, C) in the photograph's values; 0 where the photographs show nothing."""
    return pixels.image((values * pixels.light[0]).T)


def _without(capture: hg.Capture, lamp: int) -> hg.Capture:
    return replace(capture, photographs=tuple(p for k, p in enumerate(capture.photographs) if k != lamp))
