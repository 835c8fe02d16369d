"""Capture folder from photographs of any number: each is developed, written and forgotten before the next is read.

A photograph takes half floats (EXR), a validity channel where pixels are clipped, and a model of its variance in
transforms.json, so 24 megapixels need some 100 MB on disk and memory for one.
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.nerfstudio import record_from_camera
from hagoromo.camera.response import Response
from hagoromo.files.exr import write_exr
from hagoromo.files.memory import require
from hagoromo.files.png import write_png
from hagoromo.files.record import write_json, written_by
from hagoromo.files.whole import whole_folder
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.capture import TRANSFORMS, shared_keys, write_response
from hagoromo.photograph.object_mask import Thumbnails
from hagoromo.photograph.pixels import ALPHA, NATIVE, default_channels, write_pixels
from hagoromo.photograph.session import Session
from hagoromo.photograph.shot import Shot
from hagoromo.photograph.transforms import record_from_lamp, record_from_sensor
from hagoromo.photograph.variance_model import VarianceModel
from hagoromo.progress import Progress, silent

IMAGES, MASKS, OBJECT_MASK = "images", "masks", "masks/object.png"
BYTES_PER_VALUE = 24.0  # memory of one value of the photograph that is being developed, with all copies
LARGEST_HALF = 6e4
WIDEST_GAP = 180.0  # [°] between neighbouring lamps around the line of sight; beyond it they are all on one side
ON_AXIS = 0.15  # sine of the angle from the line of sight below which a lamp is on no side
SIDES = ("right", "upper right", "top", "upper left", "left", "lower left", "bottom", "lower right")


@dataclass(frozen=True)
class Captured:
    """What `capture` wrote to a folder. lamps: name of each photograph → that of its lamp. assumptions: what is taken
    for given, and from where. remarks: what a person should look at.
    """

    folder: Path
    lamps: dict[str, str]
    assumptions: dict[str, str]
    remarks: tuple[str, ...]


def write_capture(asked: Session, out: str | Path, force: bool = False, progress: Progress = silent) -> Captured:
    """Write the photographs of a session to the capture folder `out`, whole or not at all.

    The object's mask is masks/object.png, for all photographs: it may be corrected by hand afterwards. `InputError` as
    `capture` raises it, and if `out` exists without `force`.
    """
    lamps: dict[str, int] = {}
    with whole_folder(out, force) as home:
        for name in (IMAGES, MASKS):
            (home / name).mkdir()
        frames, seen, shape, masked = [], Thumbnails(), (0, 0), 0
        for number, shot in enumerate(asked.shots()):
            progress(number / len(asked.paths), shot.name)
            if not frames:
                shape = shot.valid.shape
                require(BYTES_PER_VALUE * shot.values.size, str(shot.path))
            if asked.auto_mask:
                seen.add(shot.values, shot.valid)
            own = asked.own_mask(number, shape) if len(asked.masks) > 1 else None
            frames.append(write_frame(shot, own, number, home, lamps))
            masked += own is not None
        found = asked.found_mask(seen, shape) if asked.auto_mask else None
        if found is None and len(asked.masks) <= 1:
            found = asked.own_mask(0, shape)
        if found is not None:
            write_png(home / OBJECT_MASK, found.astype(np.uint8) * 255)
        elif not masked:
            (home / MASKS).rmdir()
        for picture, pixels in asked.pictures.items():
            write_png(home / picture, pixels)
        shared = {} if found is None else {"mask_path": OBJECT_MASK}
        frames = [asked.exif.without_unstated(frame) for frame in frames]
        write_frames(home, frames, lamps, {**shared, "assumptions": asked.assumptions}, asked.response)
    remarks = (*asked.remarks, *lamp_remarks(asked.lamps, asked.view))
    named = {
        path.stem: lamp.name or "without a name" for path, lamp in zip(asked.paths.values(), asked.lamps, strict=True)
    }
    return Captured(Path(out), named, dict(asked.assumptions), remarks)


def write_frame(
    shot: Shot, own: NDArray[np.bool_] | None, number: int, home: Path, lamps: dict[str, int]
) -> dict[str, Any]:
    """Write the image of a photograph, and its own mask; returns its frame. lamps: JSON text → index, so far."""
    stem = home / IMAGES / f"{number:04d}"
    model = shot.variance if isinstance(shot.variance, VarianceModel) else None
    if model is None or not np.abs(shot.values).max(initial=0.0) < LARGEST_HALF:
        image = write_pixels(shot.photograph(shot.valid), stem)
        kept: dict[str, Any] = {}
        if not shot.valid.all():
            own = shot.valid if own is None else shot.valid & own
    else:
        image = stem.with_suffix(".exr")
        count = shot.values.shape[2]
        response = shot.camera.response
        names = response.channels if response and len(response.channels) == count else default_channels(count)
        channels = {name: shot.values[..., k] for k, name in enumerate(names)}
        if not shot.valid.all():
            channels[ALPHA] = shot.valid.astype(np.float32)
        if shot.native is not None:
            channels |= {NATIVE + name: shot.native[..., k].astype(np.float16) for k, name in enumerate(names)}
        text = {"colourSpace": "camera, linear, the white level of one exposure as 1"}
        write_exr(image, channels, text, half=True)
        kept = {"exposure_s": shot.scale[0], "iso": shot.scale[1], "variance_model": model.record()}
    if own is not None:
        kept["mask_path"] = f"{MASKS}/{number:04d}.png"
        write_png(home / kept["mask_path"], own.astype(np.uint8) * 255)
    if shot.camera.sensor:
        kept["sensor"] = record_from_sensor(shot.camera.sensor)
    return {
        "file_path": image.relative_to(home).as_posix(),
        "name": shot.name,
        **record_from_camera(shot.camera),
        "lamps": [lamps.setdefault(json.dumps(record_from_lamp(lamp)), len(lamps)) for lamp in shot.lamps],
        **kept,
    }


def write_frames(
    home: Path,
    frames: Sequence[Mapping[str, Any]],
    lamps: Mapping[str, int],
    further: Mapping[str, Any],
    response: Response | None,
) -> None:
    """Write transforms.json.

    lamps: JSON text → index, as `write_frame` gathers them. further: keys of the whole file.
    """
    shared = shared_keys(frames)
    if response is not None:
        shared["sensor"] = {**shared.get("sensor", {}), "response": write_response(response, home)}
    shared |= further
    own = [{k: v for k, v in frame.items() if k not in shared or shared[k] != v} for frame in frames]
    top = {"hagoromo": written_by(), **shared}
    write_json(home / TRANSFORMS, {**top, "lamps": [json.loads(lamp) for lamp in lamps], "frames": own})


def lamp_remarks(lamps: Sequence[Lamp], camera: Camera | None) -> tuple[str, ...]:
    """One line if three far lamps or more all stand on one side of the line of sight."""
    far = [np.asarray(lamp.to_lamp) for lamp in lamps if lamp.to_lamp is not None]
    if camera is None or len(far) < max(len(lamps), 3):
        return ()
    across, down = (camera.world_to_camera[row, :3] for row in (0, 1))
    place = np.array([[to @ across, -(to @ down)] for to in far])
    place = place[np.hypot(*place.T) > ON_AXIS]
    if len(place) < max(3, 0.6 * len(far)):
        return ()
    around = np.sort(np.degrees(np.arctan2(place[:, 1], place[:, 0])))
    gaps = np.diff([*around, around[0] + 360.0])
    widest = int(np.argmax(gaps))
    if gaps[widest] <= WIDEST_GAP:
        return ()
    middle = around[widest] + 0.5 * gaps[widest]
    side = SIDES[round(middle / 45.0) % 8]
    return (
        f"all {len(far)} lamps are on one side: none lights the object from the {side} of the picture, over "
        f"{gaps[widest]:.0f}°, and what faces there is not measured: add a lamp there",
    )
