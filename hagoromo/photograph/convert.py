"""Convert: cameras from the file format of one program to that of another, or with their images to a capture."""

from __future__ import annotations

from pathlib import Path

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import Format, read_views, write_views
from hagoromo.errors import InputError
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.gather import gather, size_of_images
from hagoromo.photograph.lamp_files import LP, load_lamps, write_lp


def convert(
    cameras: str | Path,
    out: str | Path,
    to: Format | None = None,
    images: str | Path | None = None,
    force: bool = False,
) -> dict[str, Camera] | Capture:
    """Write the cameras in the file (or folder) `cameras` to `out`; returns the views, image file → camera.

    An `out` that ends in .lp gets the far lamps of lamps.json; there are no views then.

    to: format (None: by the suffix of `out`). images: folder of the images; a capture is then written and returned
    instead. `InputError` for an unknown format, and if both `to` and `images` are given.
    """
    if Path(out).suffix.lower() == LP:
        write_lp(out, load_lamps(cameras), force)
        return {}
    if images is None:
        views = read_views(cameras)
        write_views(out, views, to, force)
        return views
    if to is not None:
        raise InputError(
            f"to (--to) {to} and images (--images) contradict each other: with images the result is a capture"
        )
    capture = gather(read_views(cameras, size_of_images(images)), images)
    capture.save(out, force)
    return capture
