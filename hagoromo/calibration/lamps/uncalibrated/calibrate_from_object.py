"""Calibration of far lamps from photographs of a matte object, one lamp each, without a ball."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.lamp_photographs import Transfer8, lamp_photographs
from hagoromo.calibration.lamps.uncalibrated.far_lamps import SelfCalibration, self_calibrate
from hagoromo.calibration.lamps.uncalibrated.refined import refined_lamps
from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.errors import InputError
from hagoromo.files.picture import read_picture
from hagoromo.progress import Progress, part_of, silent


def calibrate_lamps_from_object(
    photographs: Sequence[str | Path] | Mapping[str, NDArray],
    mask: str | Path | NDArray,
    *,
    camera: Camera | str | Path | None = None,
    transfer: Transfer8 | None = None,
    progress: Progress = silent,
) -> SelfCalibration:
    """Directions and relative strengths of far lamps, each with its error, from the object's own shading.

    photographs: five or more of one view, one lamp each: files, or name → (height, width, channels), linear, NaN where
    clipped. mask: a picture that is white on the object, or an array (height, width). camera: a `Camera` or its file;
    without it the view is orthographic, and lamps have the axes x right, y up, z to the camera. transfer: of 8-bit
    files. The object is assumed to be convex at its outline; its gloss and roughness are fitted too.

    `InputError` where too little of the object shows, the lamps lie in one plane with it, or its surface is flat.
    """
    if len(photographs) == 0:
        raise InputError("no photograph of the object is given: give one per lamp")
    lens = camera if isinstance(camera, Camera) or camera is None else read_camera(camera)
    light = lamp_photographs(photographs, transfer, linear=True)
    start = self_calibrate(light, _inside(mask), lens, progress=part_of(progress, 0.0, 0.5))
    refined = refined_lamps(light, _inside(mask), lens, start, part_of(progress, 0.5, 0.5))
    return replace(refined, perspective=lens is not None)


def _inside(mask: str | Path | NDArray) -> NDArray[np.bool_]:
    """(height, width), true where the mask is brighter than half its brightest value."""
    picture = read_picture(mask) if isinstance(mask, (str, Path)) else np.asarray(mask)
    grey = picture.reshape(*picture.shape[:2], -1)[..., :3].max(axis=2)
    return np.asarray(grey > 0.5 * picture.max(), np.bool_)
