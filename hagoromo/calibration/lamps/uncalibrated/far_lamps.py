"""Far lamps from photographs of an object of unknown shape: low rank, integrability, then the bas-relief ambiguity.

Integrability is evaluated at several scales, and the one where it holds best is used. The stated error combines the
shift of the lamps when tiles of the object are resampled (bootstrap), at other scales, and, for lamps of similar
strength, without the entropy of albedo, with a third of the bound on the tilt by integrability's own residual (Wedin
1972): for every real object the model is wrong by more than the noise.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps import check_spread
from hagoromo.calibration.lamps.lamp_calibration import check_of_object
from hagoromo.calibration.lamps.uncalibrated.bas_relief import ObjectPrior
from hagoromo.calibration.lamps.uncalibrated.low_rank import Array
from hagoromo.calibration.lamps.uncalibrated.scale import FLIP, colours, reduced, scales_of
from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.record import decode, read_json, save_json, written_by
from hagoromo.least_squares.fit_status import FitStatus
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.lamp_files import LampsRecord
from hagoromo.progress import Progress, silent

MOST_PIXELS = 40_000  # of the object at the finest scale
USABLE = 1.7  # ratio to the best scale's residual up to which another scale is an independent estimate
DRAWS = 8  # of the bootstrap
ALIKE = 0.1  # standard deviation of ln strength up to which lamps may be of equal strength, whatever the albedo
FINEST_DEG = 1.0  # [°] error of the relief by pixels of the outline, half of which are background
BOUND_SHARE = 1.0 / 3.0  # a bound is taken as three standard errors
MIRRORED = "a hollow object under lamps mirrored about the line of sight would look the same"
USUAL, NO_ALBEDO = ObjectPrior(), ObjectPrior(alike=0.05, entropy=False)


@dataclass(frozen=True, eq=False)
class SelfCalibration:
    """to_lamp (K, 3) unit; strength (K,) or (K, C), median 1 in each channel; standard errors [°] and of ln strength.

    convex: share of the outline at which the surface turns away, as that of closed objects does; at 0.5 the hollow
    surface under lamps mirrored about the line of sight is as likely. integrability: residual, 0 (exact) to 1.
    condition: of the directions. perspective: whether a camera was given. statuses: how each of the fits ended that
    the result depends on. Axes: x right, y up, z to the camera; with a camera, world.
    """

    names: tuple[str, ...]
    to_lamp: Array
    strength: Array
    standard_error_deg: Array
    strength_error: Array
    convex: float
    integrability: float
    condition: float
    perspective: bool = False
    statuses: Mapping[str, FitStatus] = field(default_factory=dict)
    settings: Mapping[str, Any] = field(default_factory=dict)
    seed: int = 0

    def __repr__(self) -> str:
        """The number of lamps and their standard errors."""
        errors = f"{self.standard_error_deg.min():.1f}–{self.standard_error_deg.max():.1f}°"
        return f"SelfCalibration({len(self.names)} lamps, standard errors {errors})"

    @property
    def lamps(self) -> tuple[Lamp, ...]:
        """The lamps, far ones, for a capture."""
        entries = zip(self.names, self.to_lamp, self.strength, strict=True)
        return tuple(Lamp(to_lamp=way, intensity=strength, name=name) for name, way, strength in entries)

    def record(self) -> dict[str, Any]:
        """The content of lamps.json."""
        readings = self.records()
        return {
            "hagoromo": written_by(self.settings, self.seed),
            "lamps": [{key: one[key] for key in ("name", "to_lamp", "intensity")} for one in readings],
            "object": {
                "convex": self.convex,
                "ambiguity": "taken for convex at its outline" if self.perspective else MIRRORED,
                "integrability": self.integrability,
                "condition": self.condition,
                "convergence": {name: status.record() for name, status in self.statuses.items()},
            },
            "readings": readings,
        }

    def save(self, path: str | Path, force: bool = False) -> Path:
        """Write lamps.json, which `load_lamps` reads; `InputError` where it exists without `force`."""
        return save_json(path, self.record(), force)

    @staticmethod
    def load(path: str | Path) -> SelfCalibration:
        """The calibration that `save` wrote; `load_lamps` gives its lamps alone. `InputError` for another file."""
        record = decode(read_json(path), LampsRecord, str(path))
        try:
            check_of_object(record, str(path))
            return _from_record(record)
        except (KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"{path} is no lamps.json of an object ({error!r}): read its lamps by load_lamps"
            ) from error

    def remarks(self) -> list[str]:
        """One line for each fit that did not converge."""
        return [status.remark(name) for name, status in self.statuses.items() if not status.converged]

    def records(self) -> list[dict[str, Any]]:
        """Entries of lamps.json."""
        return [
            {
                "name": name,
                "to_lamp": self.to_lamp[k].tolist(),
                "intensity": self.strength[k].tolist(),
                "standard_error_deg": float(self.standard_error_deg[k]),
                "intensity_relative_error": float(self.strength_error[k]),
                "intensity_from": "the object, relative",
            }
            for k, name in enumerate(self.names)
        ]


def _from_record(record: LampsRecord) -> SelfCalibration:
    known, readings = record.object, record.readings
    if known is None or not readings:
        raise ValueError("no object")
    return SelfCalibration(
        tuple(one["name"] for one in readings),
        np.array([one["to_lamp"] for one in readings]),
        np.array([one["intensity"] for one in readings]),
        np.array([one["standard_error_deg"] for one in readings]),
        np.array([one["intensity_relative_error"] for one in readings]),
        known["convex"],
        known["integrability"],
        known["condition"],
        known["ambiguity"] != MIRRORED,
        {name: FitStatus.from_record(one) for name, one in known.get("convergence", {}).items()},
        record.hagoromo.settings,
        record.hagoromo.seed or 0,
    )


def self_calibrate(
    photographs: Mapping[str, NDArray],
    mask: NDArray[np.bool_],
    camera: Camera | None = None,
    seed: int = 0,
    progress: Progress = silent,
) -> SelfCalibration:
    """One far lamp per photograph of an object.

    photographs: name → (height, width, channels), linear, NaN where clipped. mask: (height, width), the object, best
    up to its outline against the background. camera: None for an orthographic view. `InputError` where too little of
    the object is visible, lamps lie in one plane with it, or its surface is unsuitable (flat, or too rough).
    """
    light, on_object, tangent = reduced(photographs, mask, camera, MOST_PIXELS)
    scales = scales_of(light.mean(axis=3), on_object, tangent, progress)
    best = scales[0]
    solution = best.solved(USUAL)
    lamps, convex = solution.lamps, best.turned_away(solution.pixels)
    flip = FLIP if convex < 0.5 else np.ones(3)
    opinions = [scale.solved(USUAL).lamps for scale in scales[1:] if scale.ratio < USABLE * best.ratio]
    own = np.log(np.linalg.norm(lamps, axis=1))
    if np.std(own) < ALIKE:
        opinions.append(best.solved(NO_ALBEDO).lamps)
    random = np.random.default_rng(seed)
    draws = []
    for i in range(DRAWS):
        progress(0.6 + 0.4 * i / DRAWS, "errors")
        draws.append(best.drawn(random).solved(USUAL, solution).lamps)
    angle, ratio = (np.hypot(a, b) for a, b in zip(_apart(lamps, opinions), _apart(lamps, draws), strict=True))
    to_lamp = lamps * flip / np.linalg.norm(lamps, axis=1, keepdims=True)
    strength = np.linalg.norm(lamps, axis=1, keepdims=True) * colours(light[:, on_object])
    if camera is not None:
        to_lamp = to_lamp * [1.0, -1.0, -1.0] @ camera.camera_to_world[:3, :3].T
    progress(1.0, "")
    return SelfCalibration(
        tuple(photographs),
        to_lamp,
        strength / np.median(strength, axis=0),
        np.hypot(np.degrees(np.hypot(angle, BOUND_SHARE * best.ratio)), FINEST_DEG),
        np.hypot(ratio, BOUND_SHARE * best.ratio),
        max(convex, 1.0 - convex),
        best.ratio,
        check_spread(to_lamp).condition,
        statuses={
            "lamps and pixels of low rank": best.factors.status,
            "integrability": best.status,
            "the bas-relief": solution.status,
        },
        seed=seed,
    )


def _apart(lamps: Array, others: list[Array]) -> tuple[Array, Array]:
    """Root mean squares (K,) of the angles [rad] to the lamps of `others`, convex or hollow, and of ln strength."""
    angles, ratios = [np.zeros(len(lamps))], [np.zeros(len(lamps))]
    length = np.linalg.norm(lamps, axis=1)
    for other in others:
        own = np.linalg.norm(other, axis=1)
        cosines = [np.sum(lamps * other * way, axis=1) / length / own for way in (np.ones(3), FLIP)]
        angles.append(np.arccos(np.clip(max(cosines, key=np.sum), -1.0, 1.0)))
        ratio = np.log(own / length)
        ratios.append(ratio - np.median(ratio))
    count = max(len(others), 1)
    return np.sqrt(np.sum(np.square(angles), axis=0) / count), np.sqrt(np.sum(np.square(ratios), axis=0) / count)
