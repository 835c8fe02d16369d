"""Gather: cameras from another program and the folder of their images → Capture."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Literal

from hagoromo.camera.camera import Camera
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_folder, inside
from hagoromo.files.memory import require
from hagoromo.files.picture import picture_size
from hagoromo.photograph.capture import BYTES_PER_VALUE, Capture
from hagoromo.photograph.photograph import Photograph
from hagoromo.photograph.pixels import SUFFIXES, default_channels, read_pixels
from hagoromo.photograph.transforms import ImageSettings


def gather(views: Mapping[str, Camera], folder: str | Path, transfer: Literal["linear", "srgb"] = "linear") -> Capture:
    """The images in `folder` that `views` name, each with its camera; no lamps; noise of a typical sensor.

    transfer: "srgb" for display-encoded pictures. Missing images are omitted with a warning. `InputError` if all are
    missing, or an image does not have the size of its camera.
    """
    home = existing_folder(folder)
    present = {name: inside(home, name) for name in views if name and inside(home, name).is_file()}
    if not present:
        raise InputError(
            f"{home} contains none of the {len(views)} images of the cameras: give the folder of the images"
        )
    if len(present) < len(views):
        absent = len(views) - len(present)
        warnings.warn(f"{home}: {absent} of {len(views)} images are absent and are left out", stacklevel=2)
    pixels = sum(3.0 * views[name].width * views[name].height for name in present)
    require(BYTES_PER_VALUE * pixels, str(home))
    return Capture(tuple(_photograph(path, views[name], transfer) for name, path in present.items()), home.name, home)


def size_of_images(folder: str | Path) -> tuple[int, int] | None:
    """(width, height) [px] of the first image (by name) in `folder`; None when there is none."""
    images = [
        path for path in sorted(existing_folder(folder).iterdir()) if path.suffix.lower() in (".png", ".jpg", ".jpeg")
    ]
    if not images:
        return None
    height, width = picture_size(images[0])
    return width, height


def _photograph(path: Path, camera: Camera, transfer: str) -> Photograph:
    if path.suffix.lower() not in SUFFIXES:
        raise InputError(f"{path} is not an image of a known format: give one of {', '.join(SUFFIXES)}")
    frame = ImageSettings(exposure_s=1.0, iso=100.0, transfer=transfer)
    pixels = read_pixels(path, frame, default_channels(3), "bilinear", str(path))
    height, width = pixels.values.shape[:2]
    if (height, width) != (camera.height, camera.width):
        raise InputError(f"{path} is {width} × {height} px and its camera {camera.width} × {camera.height}: resize it")
    camera = replace(camera, sensor=pixels.sensor)
    return Photograph(pixels.values, pixels.variance, pixels.valid, camera, (), path.stem, pixels.native)
