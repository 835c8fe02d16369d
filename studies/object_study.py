"""Study of one object of the real photographs: every lamp held out in turn, normals, materials, relief."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

import hagoromo as hg
from hagoromo.measurement.normals.gloss_estimate import measurement_of
from studies.leave_one_out import NORMAL_METHODS, OURS, YARDSTICK, KeptAside, keep_aside, score
from studies.rig import LampUnevenness, evened, flat_field
from studies.uw_psm import sphere_normals

Array = NDArray[np.float64]
SPHERE = "gray"  # the object whose normals are known
INNER_RADIUS_SHARE = 0.95  # of its radius: beyond, pixels are seen at grazing angles and mix with the ground
RELIEF_RAYS = 4  # rays a pixel of the relief's picture
# Bands inside those of `smooth_rgb_basis`: a camera whose channels read its coefficients.
CHANNEL_BANDS_NM = ((620.0, 700.0), (530.0, 555.0), (400.0, 460.0))  # nm


@dataclass(frozen=True, eq=False)
class ObjectStudy:
    """One object: scores (lamps, 2) of every method, see `score`; normals' errors [°] where the truth is known; the
    measurement from all lamps; the lamp shown, of middling error; its relief (h, w, 3), rendered, and that one's score.
    """

    name: str
    scores: dict[str, Array]
    normal_errors: dict[str, dict[str, float]] | None
    measurement: hg.Measurement
    shown: KeptAside
    relief: NDArray[np.float32]
    relief_score: tuple[float, float]

    def record(self) -> dict[str, Any]:
        """Plain figures."""
        means = {
            method: {"relative_rmse": float(score[:, 0].mean()), "psnr": float(score[:, 1].mean())}
            for method, score in self.scores.items()
        }
        return {
            "mean": means,
            "gain": 1.0 - means[OURS]["relative_rmse"] / means[YARDSTICK]["relative_rmse"],
            "lamps": {method: score.tolist() for method, score in self.scores.items()},
            "normal_errors_deg": self.normal_errors,
            "relief": dict(zip(("relative_rmse", "psnr"), self.relief_score, strict=True)) | {"lamp": self.shown.lamp},
            "materials": [
                {
                    "pixels": m.pixels, "alpha": m.alpha, "beta": m.beta, "gamma": m.gamma,
                    "identifiable": dict(m.identifiable), "remarks": list(m.remarks),
                }
                for m in self.measurement.materials
            ],
        }  # fmt: skip


def study_object(
    folder: str | Path,
    capture: hg.Capture,
    others: Sequence[LampUnevenness],
    aside: Sequence[int],
    progress: hg.Progress = hg.silent,
) -> ObjectStudy:
    """Study of one object with the lamps in `aside` held out in turn.

    others: the lamps as measured on the other objects.
    """
    field = flat_field(others, (capture.photographs[0].camera.height, capture.photographs[0].camera.width))
    even = evened(capture, others, field)
    solved = hg.solve_normals(even)
    each = []
    for i, lamp in enumerate(aside):
        progress(i / (len(aside) + 1), f"{capture.name} without lamp {lamp}")
        kept = keep_aside(capture, even, field, lamp)
        each.append([score(kept.photograph, kept.predictions[method]) for method in NORMAL_METHODS])
    scores = dict(zip(NORMAL_METHODS, np.moveaxis(np.array(each), 1, 0), strict=True))
    order = np.argsort(scores[OURS][:, 0])
    shown = keep_aside(capture, even, field, aside[int(order[len(order) // 2])])
    picture = relief_picture(even, shown, field)
    errors = _normal_errors(folder, capture, solved) if capture.name == SPHERE else None
    measured = measurement_of(even, solved)
    return ObjectStudy(capture.name, scores, errors, measured, shown, picture, score(shown.photograph, picture))


def relief_picture(even: hg.Capture, kept: KeptAside, field: Array) -> NDArray[np.float32]:
    """(h, w, 3) the relief that was solved without a lamp, as volume boxes under it, in the photograph's values."""
    photograph, camera = kept.photograph, kept.photograph.camera
    others = hg.Capture(tuple(p for p in even.photographs if p.name != photograph.name), even.name)
    measured = measurement_of(others, kept.solved)
    relief = hg.Relief(kept.points, kept.solved.normals, kept.solved.body, measured.labels)
    box = hg.relief_plan(relief, camera, [m.reflectance() for m in measured.materials]).named(even.name, {}).box()
    image = hg.render(hg.Scene(camera, photograph.lamps, (box,)), hg.Settings(samples=RELIEF_RAYS))
    return image.expose(_basis_camera()) * field[kept.lamp][..., None].astype(np.float32)


def _basis_camera() -> hg.Response:
    """A camera that reads white as 1 and the coefficients of `smooth_rgb_basis` as they are."""
    wavelengths = np.arange(400.0, 700.5, 0.5)
    bands = np.stack([(wavelengths > low) & (wavelengths < high) for low, high in CHANNEL_BANDS_NM], axis=1).astype(
        np.float64
    )
    bands /= hg.camera_white(hg.Spectrum.constant(1.0), hg.Response(wavelengths, bands))
    return hg.Response(wavelengths, bands, name="basis")


def _normal_errors(folder: str | Path, capture: hg.Capture, solved: hg.NormalMap) -> dict[str, dict[str, float]]:
    """Errors of the sphere's normals [°]: mean and median over its pixels, mean in its inner INNER_RADIUS_SHARE."""
    true, pixels = sphere_normals(folder, capture.name), hg.views_from_capture(capture)
    maps = {
        "Lambert, plain least squares": pixels.image(hg.least_squares_lambert(pixels)[0]),
        "ours, from this object alone": hg.solve_normals(capture).normals,
        "ours, lamps measured on the other objects first": solved.normals,
    }
    known = np.linalg.norm(true, axis=2) > 0.5
    errors = {}
    for name, normals in maps.items():
        both = known & (np.linalg.norm(normals, axis=2) > 0.5)
        angle = np.degrees(np.arccos(np.clip(np.einsum("pi,pi->p", normals[both], true[both]), -1.0, 1.0)))
        inner = np.hypot(*true[both][:, :2].T) < INNER_RADIUS_SHARE
        errors[name] = {
            "mean": float(angle.mean()),
            "median": float(np.median(angle)),
            "mean_inner": float(angle[inner].mean()),
            "pixels": int(both.sum()),
        }
    return errors
