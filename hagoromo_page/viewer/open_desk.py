"""Open desk: whatever can be viewed → the desk that viewers sit at."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.exr import read_exr
from hagoromo.files.record import read_json_table
from hagoromo.files.stores import address
from hagoromo.image.picture.image import read_image
from hagoromo.image.picture.spectral_exr import is_spectral, spectral_of_channels
from hagoromo.measurement.measurement import Measurement
from hagoromo.photograph.capture import load_capture
from hagoromo_page.publication.publish import page_source
from hagoromo_page.viewer.development import tones
from hagoromo_page.viewer.image_plate import ImagePlate, plate_of_spectra
from hagoromo_page.viewer.maps_plate import MapsPlate
from hagoromo_page.viewer.photograph_plate import PhotographPlate
from hagoromo_page.viewer.photographs import photographs_of
from hagoromo_page.viewer.picture_desk import PictureDesk
from hagoromo_page.viewer.plates import Plate
from hagoromo_page.viewer.scene_files import opened
from hagoromo_page.viewer.view_state import TONES
from hagoromo_page.viewer.watcher import Desk

WEIGHTS = "palette"  # of the header of an EXR that `Image.save` wrote


def open_desk(path: Path, against: Path | None = None, ocio: str | None = None) -> Desk | PictureDesk:
    """The desk of a scene, a volume box, a capture, a measurement or an image; `InputError` for anything else.

    against: a capture that the picture of a scene is held against, or a file of cameras. ocio: configuration of
    OpenColorIO whose views are among the tone curves; the picture begins with its first.
    """
    if ocio is not None:
        first = tones(ocio)[len(TONES)]
        desk = open_desk(path, against)
        history: Any = desk.history
        history.now = replace(history.now, development=replace(history.now.development, ocio=ocio, tone=first))
        return desk
    plates = None if address(path) else _plates(path)
    if plates is None:
        return Desk(*opened(path), [] if against is None else photographs_of(against))
    if against is not None:
        raise InputError(f"{path} is no scene: --against holds the picture of a scene against photographs")
    return PictureDesk(path, plates)


def _plates(path: Path) -> dict[str, Callable[[], Plate]] | None:
    """Name → what reads a picture; None where the path is none of pictures."""
    if path.suffix.lower() == ".exr":
        plate = image_plate(path)
        return {path.name: lambda: plate}
    if (path / "transforms.json").is_file():
        return _photographs(path)
    if (path / "materials.json").is_file():
        measurement = Measurement.load(path)
        source = page_source(measurement, None, path.name, closely=True)
        maps: Plate = MapsPlate(source.maps, measurement, source.look)  # pyrefly: ignore[bad-assignment]
        return {path.name: lambda: maps}
    return None


def image_plate(path: Path) -> ImagePlate:
    """The image in an EXR: weights of `render`, or spectra; `InputError` for one with colours alone."""
    channels, header = read_exr(path)
    if WEIGHTS in header:
        return ImagePlate(read_image(path))
    if is_spectral(channels):
        return plate_of_spectra(spectral_of_channels(channels, str(path)))
    raise InputError(
        f"{path} has neither weights nor spectra, only {', '.join(list(channels)[:6])}: give an EXR of `render` or a "
        "spectral one"
    )


def _photographs(folder: Path) -> dict[str, Callable[[], Plate]]:
    """The photographs of a capture, each read when it is looked at; the first one now."""
    frames = read_json_table(inside(folder, "transforms.json")).get("frames", [])
    first = load_capture(folder, slice(0, 1)).photographs[0]

    def reader(number: int) -> Callable[[], Plate]:
        def read() -> Plate:
            one = first if number == 0 else load_capture(folder, slice(number, number + 1)).photographs[0]
            return PhotographPlate(one, one.values, one.variance, one.mask)

        return read

    return {
        f"{number + 1} {Path(str(frame.get('file_path', ''))).stem}": reader(number)
        for number, frame in enumerate(frames)
        if isinstance(frame, dict)
    }
