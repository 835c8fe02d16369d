"""`hagoromo convert`: cameras of one program's file → another's, or with their images → a capture."""

from __future__ import annotations

from pathlib import Path

from hagoromo.camera.formats.camera_file import Format, read_views, write_views
from hagoromo.errors import InputError
from hagoromo.photograph.capture import save_capture
from hagoromo.photograph.gather import gather, size_of_images


def convert(cameras: Path, out: Path, to: Format | None, images: Path | None, force: bool) -> str:
    """Write the cameras, or a capture where `images` are given, to `out`; what it is, in words."""
    if images is None:
        views = read_views(cameras)
        write_views(out, views, to, force)
        return f"{len(views)} {'camera' if len(views) == 1 else 'cameras'}"
    if to is not None:
        raise InputError(f"--to {to} and --images contradict each other: with images the result is a capture")
    views = read_views(cameras, size_of_images(images))
    capture = gather(views, images)
    save_capture(capture, out, force)
    return f"a capture of {len(capture.photographs)} photographs"
