"""Pictures of the window: photographs made small, what is mask and what is painted, and the maps of a measurement."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable, Hashable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.lamps.lamp_photographs import LampPhotographs
from hagoromo.errors import InputError
from hagoromo.files.png import png_bytes, read_png
from hagoromo.light.colour import srgb_encode
from hagoromo_page.lab.corrections import GREY, painted
from hagoromo_page.lab.folder import MASK, Folder
from hagoromo_page.lab.steps import CAPTURE, MEASURED
from hagoromo_page.viewer.plates import shrunk, three_channels

SIDES = {"small": 240, "large": 1600}  # [px] of the longer side
QUALITY = 88
KEPT_BYTES = 1 << 28  # of pictures in memory
WHITE_PERCENT = 99.5  # of the samples are shown up to white, of linear light
LIFTED_PERCENT, LIFTED_TO = 90.0, 0.7  # so many pixels of the brightest picture are darker than this, of white
OUTSIDE, OBJECT, BACKGROUND = (24, 60, 110, 80), (46, 160, 67, 90), (200, 40, 40, 90)  # R, G, B, A
OUTLINE = (255, 140, 0, 255)
FOUND_MASK = f"{CAPTURE}/masks/object.png"


class Pictures:
    """Encoded pictures, kept in memory while their files stay as they are; one is made at a time."""

    def __init__(self) -> None:
        self._kept: OrderedDict[Hashable, Any] = OrderedDict()
        self._making = threading.RLock()  # a map is made of the measurement, which is kept, too

    def photograph(self, folder: Folder, name: str, size: str) -> bytes:
        """JPEG of a photograph, of a size of SIDES; `InputError` for another name or size, or a damaged file."""
        if name not in {*folder.photographs, *folder.ball_photographs, folder.chart} - {""} or size not in SIDES:
            raise InputError(f"{name!r} is no photograph of this folder: reload the page")
        return self._photograph(folder.file(name))[1][size]

    def brightest(self, folder: Folder) -> bytes:
        """JPEG of the brightest of all photographs at each pixel, lifted out of the dark: where the balls end."""
        paths = [folder.file(name) for name in folder.ball_photographs or folder.photographs]
        return self._once(("brightest", *map(_stamp, paths)), lambda: self._brightest(paths))

    def _brightest(self, paths: list[Path]) -> bytes:
        import cv2

        most = None
        for path in paths:
            data = np.frombuffer(self._photograph(path)[1]["large"], np.uint8)
            picture = np.asarray(cv2.imdecode(data, cv2.IMREAD_COLOR))[..., ::-1]
            if most is not None and most.shape != picture.shape:
                raise InputError(f"{path.name} has another size than the photographs before it")
            most = picture if most is None else np.maximum(most, picture)
        assert most is not None
        lifted = LIFTED_TO * np.sqrt(most / max(float(np.percentile(most, LIFTED_PERCENT)), 1.0))
        return _jpeg((255.0 * np.minimum(lifted, 1.0)).astype(np.uint8))

    def shape(self, folder: Folder, name: str = "") -> tuple[int, int]:
        """(height, width) [px] of a photograph; of the first without a name."""
        return self._photograph(folder.file(name or folder.photographs[0]))[0]

    def overlay(self, folder: Folder) -> bytes:
        """PNG, mostly transparent: what is not the object is dark blue, its outline orange; painted object green,
        painted background red.
        """
        shape = self.shape(folder)
        files = [folder.home / name for name in (FOUND_MASK, MASK)]
        return self._once(("overlay", *map(_stamp, files)), partial(_overlay, folder, shape))

    def layers(self, folder: Folder) -> list[str]:
        """Names of the maps of the measurement; none without one."""
        return list(self._plate(folder).layers) if (folder.home / MEASURED / "materials.json").is_file() else []

    def maps_size(self, folder: Folder) -> tuple[int, int] | None:
        """(width, height) of the maps: of the part of the photographs that the object is in."""
        return self._plate(folder).size if self.layers(folder) else None

    def layer(self, folder: Folder, name: str) -> bytes:
        """PNG of a map of the measurement; `InputError` for one that it does not have."""
        if name not in self.layers(folder):
            raise InputError(f"the measurement has no map {name!r}: reload the page")
        key = ("layer", name, _stamp(folder.home / MEASURED))
        return self._once(key, lambda: png_bytes(_layer(self._plate(folder), name)))

    def _photograph(self, path: Path) -> tuple[tuple[int, int], dict[str, bytes]]:
        return self._once(("photograph", _stamp(path)), lambda: _small(path))

    def _plate(self, folder: Folder) -> Any:
        return self._once(("plate", _stamp(folder.home / MEASURED)), lambda: _maps(folder.home / MEASURED))

    def _once(self, key: Hashable, make: Callable[[], Any]) -> Any:
        """What is kept under a key; made where nothing is. A browser asks for many at a time: memory is that of one."""
        with self._making:
            if key in self._kept:
                self._kept.move_to_end(key)
                return self._kept[key]
            made = self._kept[key] = make()
            while len(self._kept) > 1 and sum(map(_weight, self._kept.values())) > KEPT_BYTES:
                self._kept.popitem(last=False)
            return made


def _stamp(path: Path) -> Hashable:
    """What changes where a file does."""
    try:
        status = path.stat()
    except OSError:
        return str(path), 0, 0
    return str(path), status.st_size, status.st_mtime_ns


def _weight(made: Any) -> int:
    """Bytes of what is kept; of the maps of a measurement a share of what they may have."""
    if isinstance(made, bytes):
        return len(made)
    return sum(map(len, made[1].values())) if isinstance(made, tuple) else KEPT_BYTES // 2


def _small(path: Path) -> tuple[tuple[int, int], dict[str, bytes]]:
    """Shape, and JPEG of each of SIDES."""
    pixels = LampPhotographs([path], None, False)[path.name]
    shape = pixels.shape[0], pixels.shape[1]
    shown = {}
    for name, side in sorted(SIDES.items(), key=lambda item: -item[1]):
        pixels = shrunk(np.nan_to_num(pixels, nan=1.0), _size(pixels.shape, side))
        shown[name] = _jpeg(_display(pixels))
    return shape, shown


def _size(shape: tuple[int, ...], side: int) -> tuple[int, int]:
    """(width, height) of a picture whose longer side is `side` at most."""
    scale = min(side / max(shape[:2]), 1.0)
    return max(round(shape[1] * scale), 1), max(round(shape[0] * scale), 1)


def _display(pixels: NDArray[Any]) -> NDArray[np.uint8]:
    """Stored numbers as they are, light as sRGB; (height, width, 3)."""
    colour = three_channels(pixels if pixels.ndim == 3 else pixels[..., None])
    if colour.dtype == np.uint8:
        return colour
    if colour.dtype == np.uint16:
        colour = colour / 65535.0
    white = max(float(np.percentile(colour, WHITE_PERCENT)), 1e-12)
    return srgb_encode(np.clip(colour / white, 0.0, 1.0))


def _jpeg(picture: NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".jpg", np.ascontiguousarray(picture[..., ::-1]), [cv2.IMWRITE_JPEG_QUALITY, QUALITY])
    if not done:
        raise InputError("a picture could not be encoded: is the memory full?")
    return data.tobytes()


def _overlay(folder: Folder, shape: tuple[int, int]) -> bytes:
    import cv2

    size = _size(shape, SIDES["large"])
    layer = np.zeros((size[1], size[0], 4), np.uint8)
    found = folder.home / FOUND_MASK
    if found.is_file():
        mask = read_png(found)
        if mask.shape[:2] == shape:
            inside = _reduced(mask if mask.ndim == 2 else mask[..., 0], size) > 127
            layer[~inside] = OUTSIDE
            lines, _ = cv2.findContours(inside.astype(np.uint8), cv2.RETR_LIST, cv2.CHAIN_APPROX_NONE)
            cv2.drawContours(layer, lines, -1, OUTLINE, max(round(max(size) / 800), 1))
    if (folder.home / MASK).is_file():
        hand = _reduced(painted(folder, shape), size)
        layer[hand == GREY["object"]] = OBJECT
        layer[hand == GREY["background"]] = BACKGROUND
    return _rgba_png(layer)


def _reduced(mask: NDArray[Any], size: tuple[int, int]) -> NDArray[Any]:
    import cv2

    return np.asarray(cv2.resize(mask, size, interpolation=cv2.INTER_NEAREST))


def _rgba_png(layer: NDArray[np.uint8]) -> bytes:
    import cv2

    done, data = cv2.imencode(".png", np.ascontiguousarray(layer[..., (2, 1, 0, 3)]))
    if not done:
        raise InputError("a picture could not be encoded: is the memory full?")
    return data.tobytes()


def _maps(home: Path) -> Any:
    """The plate of a measurement, made small."""
    from hagoromo.measurement.measurement import Measurement
    from hagoromo_page.publication.publish import page_source
    from hagoromo_page.viewer.maps_plate import MapsPlate

    measurement = Measurement.load(home)
    plate = MapsPlate(page_source(measurement, None, home.name).maps, measurement)
    whole = slice(0, plate.size[1]), slice(0, plate.size[0])
    return plate.part(*whole, _size((plate.size[1], plate.size[0]), SIDES["large"]))


def _layer(plate: Any, name: str) -> NDArray[np.uint8]:
    from hagoromo.image.picture.image import auto_exposure
    from hagoromo_page.viewer.development import toned
    from hagoromo_page.viewer.plates import PlateLight
    from hagoromo_page.viewer.view_state import ViewTransform

    development = ViewTransform(tone="shoulder")
    linear = plate.linear(name, PlateLight(), development)
    if linear is None:
        return plate.coded(name)
    return toned(linear, development, auto_exposure(linear, plate.cover))
