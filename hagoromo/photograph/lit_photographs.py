"""Capture of photographs: one view under one lamp each, with their camera, response and masks → Capture."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_camera
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.exr import read_header
from hagoromo.files.memory import require
from hagoromo.files.picture import by_name, read_picture
from hagoromo.files.record import decode, read_json
from hagoromo.light.lamp import Lamp
from hagoromo.light.spectrum import Spectrum
from hagoromo.photograph.capture import BYTES_PER_VALUE, Capture
from hagoromo.photograph.lamps_file import LampsRecord
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import SUFFIXES, default_channels, read_mask, read_pixels
from hagoromo.photograph.transforms import ImageSettings, lamp_from_record

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
# focal length over the picture's longer side where no camera is given: nearly an orthographic view
ORTHOGRAPHIC_FOCAL = 20.0
UP_AND_BACK = np.diag([1.0, -1.0, -1.0, 1.0])  # world axes x right, y up, z to the camera → the camera's


def capture(
    photographs: Sequence[str | Path],
    lamps: str | Path | Sequence[Lamp],
    camera: Camera | str | Path | None = None,
    response: Response | str | Path | None = None,
    masks: str | Path | Sequence[str | Path] = (),
    *,
    spectrum: Spectrum | str | Path | None = None,
    intensity: float | Sequence[float] | None = None,
    undistorted: bool = False,
    transfer: Literal["linear", "srgb"] | None = None,
    name: str = "",
) -> Capture:
    """The capture of photographs that one camera took from one place, with one lamp on in each.

    photographs: EXR files of `develop`, or linear PNG or TIFF. lamps: lamps.json, or `Lamp`s. A photograph is assigned
    the lamp with the name of its file (without suffix); if the names do not match, lamps are assigned in order. camera:
    a `Camera` or its file; world axes are then the camera's (x right, y down, z forward). Without it the view is
    assumed orthographic (x right, y up, z to the camera). response: a `Response`, its name or CSV. masks: PNG files,
    white on the object, one for all photographs or one each. spectrum: of all lamps (a name or CSV), if lamps.json has
    none. intensity: of all lamps, instead of that in lamps.json: one number, or one per channel. undistorted: the
    photographs have no lens distortion although their files do not state it. transfer: of 8-bit files.

    `InputError` if the numbers of photographs, lamps and masks differ, sizes differ from the camera's, only some of the
    photographs are undistorted, or the lamps are behind the object.
    """
    paths = by_name([Path(path) for path in photographs])
    if not paths:
        raise InputError("no photograph is given: give one per lamp")
    lit = [_as_stated(lamp, spectrum, intensity) for lamp in _matched(_lamps(lamps), list(paths.values()))]
    if response is not None and not isinstance(response, Response):
        response = Response.load(response)
    channels = response.channels if response else default_channels(3)
    shapes = [masks] if isinstance(masks, (str, Path)) else list(masks)
    if len(shapes) not in (0, 1, len(paths)):
        raise InputError(f"{len(shapes)} masks for {len(paths)} photographs: give one for all, or one each")
    view = None
    shots = []
    for number, (label, path) in enumerate(paths.items()):
        _check_readable(path, transfer)
        frame = ImageSettings(transfer=transfer or "linear")
        pixels = read_pixels(path, frame, channels, "bilinear", label)
        height, width = pixels.values.shape[:2]
        if view is None:
            require(float(BYTES_PER_VALUE) * pixels.values.size * len(paths), "the photographs")
            view = replace(_view(camera, width, height, _undistorted(paths, undistorted)), response=response)
            _check_lamps(lit, view)
        if (width, height) != (view.width, view.height):
            raise InputError(f"{path} is {width} × {height} px and its camera {view.width} × {view.height}: resize it")
        valid = pixels.valid
        if shapes:
            valid = valid & read_mask(Path(shapes[number if len(shapes) > 1 else 0]), (height, width))
        seen_by = replace(view, sensor=pixels.sensor)
        one = Photograph(pixels.values, pixels.variance, valid, seen_by, (lit[number],), path.stem, pixels.native)
        shots.append(one)
    return Capture(tuple(shots), name)


def load_lamps(path: str | Path) -> tuple[Lamp, ...]:
    """The lamps in a lamps.json of `hagoromo calibrate lamps`; `InputError` for a file that lists none."""
    record = read_json(path)
    listed = decode({"lamps": record} if isinstance(record, list) else record, LampsRecord, str(path)).lamps
    if not listed:
        raise InputError(f"{path} lists no lamps: give the lamps.json of `hagoromo calibrate lamps`")
    return tuple(lamp_from_record(lamp, Path(path).parent, f"{path} lamp {i}") for i, lamp in enumerate(listed))


def _lamps(lamps: str | Path | Sequence[Lamp]) -> tuple[Lamp, ...]:
    return load_lamps(lamps) if isinstance(lamps, (str, Path)) else tuple(lamps)


def _matched(lamps: tuple[Lamp, ...], paths: Sequence[Path]) -> list[Lamp]:
    """The lamp of each photograph: by name where all names match, else in order."""
    if len(lamps) != len(paths):
        raise InputError(f"{len(paths)} photographs and {len(lamps)} lamps: give one photograph per lamp")
    by_stem = {Path(lamp.name).stem: lamp for lamp in lamps}
    if set(by_stem) == {path.stem for path in paths} and len(by_stem) == len(paths):
        return [by_stem[path.stem] for path in paths]
    return list(lamps)


def _as_stated(lamp: Lamp, spectrum: Spectrum | str | Path | None, intensity: float | Sequence[float] | None) -> Lamp:
    if spectrum is not None:
        lamp = replace(lamp, spectrum=Spectrum.load(str(spectrum) if isinstance(spectrum, Path) else spectrum))
    return lamp if intensity is None else replace(lamp, intensity=np.squeeze(np.asarray(intensity, np.float64)))


def _check_readable(path: Path, transfer: str | None) -> None:
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path} is not an image of a known format: give one of {', '.join(SUFFIXES)}")
    if suffix in PICTURES and transfer is None and read_picture(path).dtype == np.uint8:
        raise InputError(
            f"{path} has 8 bits, which are rarely linear: develop it first, or state transfer (--transfer)"
        )


def _undistorted(paths: dict[str, Path], stated: bool) -> bool:
    """Whether the photographs have no lens distortion: `stated`, or written in the EXR files by `develop`."""
    exr = {name: path for name, path in paths.items() if path.suffix.lower() == ".exr"}
    marked = [name for name, path in exr.items() if "undistorted" in read_header(path)]
    if marked and len(marked) < len(paths) and not stated:
        other = next(name for name in paths if name not in marked)
        raise InputError(
            f"{marked[0]} is undistorted and {other} is not: develop all with undistort (--undistort), or none"
        )
    return stated or bool(marked)


def _view(camera: Camera | str | Path | None, width: int, height: int, undistorted: bool) -> Camera:
    """The camera of all photographs, a pinhole if they are undistorted."""
    if camera is None:
        focal = ORTHOGRAPHIC_FOCAL * max(width, height)
        orthographic = Camera(width, height, (focal, focal), (width / 2, height / 2), name="orthographic")
        return orthographic.with_pose(UP_AND_BACK)
    lens = camera if isinstance(camera, Camera) else read_camera(camera)
    return replace(lens, distortion=(0.0,) * len(lens.distortion)) if undistorted else lens


def _check_lamps(lamps: Sequence[Lamp], camera: Camera) -> None:
    """Raise `InputError` if every lamp is far and none lights the side that the camera sees."""
    forward = camera.world_to_camera[2, :3]
    if all(lamp.to_lamp is not None and lamp.to_lamp @ forward >= 0.0 for lamp in lamps):
        raise InputError(
            "every lamp is behind the object as seen from this camera: give camera (--camera) if, and only if, it was "
            "given to `hagoromo calibrate lamps`"
        )
