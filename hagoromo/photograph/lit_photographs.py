"""Capture of photographs: one view under one lamp each, with camera, response and masks → Capture, or its folder."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import overload

from hagoromo.camera.camera import Camera
from hagoromo.camera.response import Response
from hagoromo.files.memory import require
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import BYTES_PER_VALUE, Capture
from hagoromo.photograph.capture_folder import Captured, write_capture
from hagoromo.photograph.developing import AS_IN_THE_FILES, Developing
from hagoromo.photograph.development.transfer import Transfer
from hagoromo.photograph.object_mask import Thumbnails
from hagoromo.photograph.session import Masks, Session, session
from hagoromo.progress import Progress, silent


@overload
def capture(
    photographs: Sequence[str | Path],
    lamps: str | Path | Sequence[Lamp],
    camera: Camera | str | Path | None = ...,
    response: Response | str | Path | None = ...,
    masks: Masks = ...,
    *,
    spectrum: Spectrum | str | Path | None = ...,
    intensity: float | Sequence[float] | None = ...,
    undistorted: bool = ...,
    transfer: str | Path | Transfer | None = ...,
    name: str = ...,
    developing: Developing = ...,
    out: None = None,
) -> Capture: ...
@overload
def capture(
    photographs: Sequence[str | Path],
    lamps: str | Path | Sequence[Lamp],
    camera: Camera | str | Path | None = ...,
    response: Response | str | Path | None = ...,
    masks: Masks = ...,
    *,
    spectrum: Spectrum | str | Path | None = ...,
    intensity: float | Sequence[float] | None = ...,
    undistorted: bool = ...,
    transfer: str | Path | Transfer | None = ...,
    name: str = ...,
    developing: Developing = ...,
    out: str | Path,
    force: bool = ...,
    progress: Progress = ...,
) -> Captured: ...
def capture(
    photographs: Sequence[str | Path],
    lamps: str | Path | Sequence[Lamp],
    camera: Camera | str | Path | None = None,
    response: Response | str | Path | None = None,
    masks: Masks = (),
    *,
    spectrum: Spectrum | str | Path | None = None,
    intensity: float | Sequence[float] | None = None,
    undistorted: bool = False,
    transfer: str | Path | Transfer | None = None,
    name: str = "",
    developing: Developing = AS_IN_THE_FILES,
    out: str | Path | None = None,
    force: bool = False,
    progress: Progress = silent,
) -> Capture | Captured:
    """The capture of photographs that one camera took from one place, with one lamp on in each, in memory or a folder.

    photographs: RAW, TIFF, JPEG or PNG as the camera left them, or EXR files of `develop`. lamps: lamps.json, an .lp,
    or `Lamp`s. A photograph is assigned the lamp with the name of its file (without suffix); if no name matches, lamps
    are assigned in order. camera: a `Camera` or its file; world axes are then the camera's (x right, y down, z forward;
    with an .lp those of the .lp). Without it the focal length of the EXIF is used, or else, or for "orthographic", an
    orthographic view; world axes are then x right, y up, z to the camera, and the object is at the world's origin.
    response: a `Response`, its name or CSV. masks: PNG files, white on the object, one for all photographs or one each;
    "auto": found in the photographs, corrected by a PNG after it that is white where there is object, black where there
    is none and grey where it says nothing. spectrum: of all lamps (a name or CSV), if lamps.json has none. intensity:
    of all lamps, instead of that in lamps.json: one number, or one per channel. undistorted: the photographs have no
    lens distortion although their files do not state it. transfer: of 8-bit files; see `Developing`, as developing.
    name: of a capture in memory. out: folder to write to, whole or not at all, in the memory of one photograph: `force`
    replaces it; then the answer says what was written.

    `InputError` if the numbers or names of photographs, lamps and masks differ, sizes differ from the camera's, the
    EXIF of the files contradict each other, only some of the photographs are undistorted, the lamps are behind the
    object, or `out` exists without `force`.
    """
    if transfer is not None:
        developing = replace(developing, transfer=transfer)
    asked = session(
        photographs, lamps, camera, response, masks, spectrum=spectrum, intensity=intensity, undistorted=undistorted,
        developing=developing,
    )  # fmt: skip
    return _in_memory(asked, name) if out is None else write_capture(asked, out, force, progress)


def _in_memory(asked: Session, name: str) -> Capture:
    taken, seen = [], Thumbnails()
    for number, shot in enumerate(asked.shots()):
        if not taken:
            require(float(BYTES_PER_VALUE) * shot.values.size * len(asked.paths), "the photographs")
        seen.add(shot.values, shot.valid)
        own = asked.own_mask(number, shot.valid.shape)
        taken.append(shot.photograph(shot.valid if own is None else shot.valid & own))
    found = asked.found_mask(seen, taken[0].mask.shape)
    if found is not None:
        taken = [replace(photograph, mask=photograph.mask & found) for photograph in taken]
    return Capture(tuple(taken), name, assumptions=asked.assumptions)
