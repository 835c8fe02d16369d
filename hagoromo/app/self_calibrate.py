"""`hagoromo calibrate lamps --object`: photographs of any matte object, a lamp each, no ball → lamps.json."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Literal

import numpy as np
from numpy.typing import NDArray

from hagoromo.app.calibrate_lamps import LAMP
from hagoromo.app.lamp_photographs import Photographs
from hagoromo.calibration.lamps.uncalibrated import SelfCalibration, self_calibrate
from hagoromo.calibration.lamps.uncalibrated.refined import refined_lamps
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.files.record import write_json
from hagoromo.files.whole import whole_file

SIDES = "a hollow object under lamps mirrored about the line of sight would look the same"


def self_calibrate_to(
    photographs: Sequence[Path],
    mask: Path,
    out: Path,
    camera: Path | None,
    transfer: Literal["linear", "srgb"] | None,
    force: bool,
    progress: Callable[[float, str], None] | None = None,
) -> list[str]:
    """Write lamps.json to `out`; gives what was found, in lines."""
    if len(photographs) == 0:
        raise InputError("no photograph of the object is given: give one per lamp")
    with whole_file(out, force) as partial:
        lens = None if camera is None else read_camera(camera)
        shown = read_picture(mask)
        on_object = np.asarray(shown.reshape(*shown.shape[:2], -1)[..., :3].max(axis=2) > 0.5 * shown.max())
        light = Photographs(photographs, transfer, linear=True)
        found = calibrated_by_object(light, on_object, lens, progress)
        records = found.records()
        told = {
            "convex": found.convex,
            "ambiguity": SIDES if lens is None else "taken for convex at its outline",
            "integrability": found.integrability,
            "condition": found.condition,
        }
        lamps = [{key: record[key] for key in LAMP if key in record} for record in records]
        write_json(partial, {"lamps": lamps, "object": told, "readings": records})
    lines = []
    for name, (x, y, z), error in zip(found.names, found.to_lamp, found.standard_error_deg, strict=True):
        lines.append(f"{name}: to_lamp ({x:.4f}, {y:.4f}, {z:.4f}), standard error {error:.1f}°")
    lines.append(
        f"the object is taken for convex: {100 * found.convex:.0f} % of its outline turns away"
        + ("" if lens else f"; {SIDES}")
    )
    return [*lines, f"{len(lines) - 1} lamps, condition number of their directions {found.condition:.2f}"]


def calibrated_by_object(
    photographs: Mapping[str, NDArray],
    mask: NDArray[np.bool_],
    camera: Camera | None = None,
    progress: Callable[[float, str], None] | None = None,
) -> SelfCalibration:
    """Lamps by shading alone, then refined together with surface, albedos and gloss."""
    tell = progress or (lambda share, step: None)
    start = self_calibrate(photographs, mask, camera, progress=lambda share, step: tell(0.5 * share, step))
    return refined_lamps(photographs, mask, camera, start, lambda share, step: tell(0.5 + 0.5 * share, step))
