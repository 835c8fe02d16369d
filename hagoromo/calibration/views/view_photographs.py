"""Photographs of many views: which they are, what their files state, their grey pictures and masks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from hagoromo.calibration.camera.board import as_shown
from hagoromo.calibration.lamps.lamp_photographs import LampPhotographs
from hagoromo.calibration.views.reconstruct import LEAST_VIEWS
from hagoromo.errors import InputError
from hagoromo.files.checks import existing_file
from hagoromo.files.content import content
from hagoromo.files.picture import by_name
from hagoromo.photograph.object_mask import AUTO, Thumbnails, object_mask
from hagoromo.photograph.pixels import read_mask
from hagoromo.photograph.session import Masks, check_readable
from hagoromo.photograph.session_exif import SessionExif, session_exif

MASK_NAMES = ("{stem}.png", "{name}.png", "{stem}_mask.png", "{stem}.mask.png")  # in a folder of masks
DISPLAY = 2.2  # exponent of the numbers of pictures, for the search of the object alone


@dataclass(frozen=True, eq=False)
class ViewPhotographs:
    """paths: name → file, without those given twice. twins: name of one that is left out → that it is a copy of.
    masks: name → its mask, or empty. auto: whether the object is found in each. contents: name → digest of its file.
    """

    paths: Mapping[str, Path]
    twins: Mapping[str, str]
    masks: Mapping[str, Path]
    auto: bool
    exif: SessionExif
    contents: Mapping[str, str]

    @property
    def names(self) -> list[str]:
        """Their names, in the order that they were given in."""
        return list(self.paths)

    def picture(self, name: str) -> NDArray:
        """The stored pixels of a photograph, or its light."""
        return LampPhotographs([self.paths[name]], None, False)[self.paths[name].name]

    def size(self) -> tuple[int, int]:
        """(width, height) of the first [px]."""
        height, width = self.picture(self.names[0]).shape[:2]
        return width, height

    def mask(self, name: str, picture: NDArray) -> NDArray[np.bool_] | None:
        """Where a photograph shows the object, by its mask, by itself or by its transparency; None: not known."""
        shape = picture.shape[0], picture.shape[1]
        if name in self.masks:
            mask = read_mask(self.masks[name], shape)
        elif self.auto:
            mask = _found(name, picture)
        elif picture.ndim == 3 and picture.shape[2] == 4:
            mask = picture[..., 3] == np.iinfo(picture.dtype).max
        else:
            return None
        if not mask.any():
            raise InputError(f"the mask of {name} is black everywhere: make it white on the object")
        return mask

    def grey(
        self, name: str, size: tuple[int, int], largest: int
    ) -> tuple[NDArray[np.uint8], NDArray[np.bool_] | None]:
        """The grey picture and mask of a photograph of `size` (width, height), of `largest` px a side at most."""
        import cv2

        picture = self.picture(name)
        if picture.shape[1::-1] != size:
            raise InputError(
                f"{self.names[0]} is {size[0]} × {size[1]} px and {name} {picture.shape[1]} × {picture.shape[0]}: give "
                "photographs of one size by one camera, none of them turned or cropped"
            )
        mask = self.mask(name, picture)
        shown = as_shown(
            np.nan_to_num(picture, nan=float(np.nanmax(picture))) if picture.dtype.kind == "f" else picture
        )
        single = shown if shown.ndim == 2 else shown[..., 0] if shown.shape[2] < 3 else None
        grey = np.asarray(cv2.cvtColor(shown[..., :3], cv2.COLOR_RGB2GRAY)) if single is None else single
        share = min(largest / max(size), 1.0)
        if share < 1.0:
            smaller = max(round(size[0] * share), 1), max(round(size[1] * share), 1)
            grey = np.asarray(cv2.resize(grey, smaller, interpolation=cv2.INTER_AREA))
            if mask is not None:
                mask = np.asarray(cv2.resize(mask.astype(np.uint8), smaller, interpolation=cv2.INTER_NEAREST)) > 0
        return np.ascontiguousarray(grey, np.uint8), mask


def view_photographs(
    photographs: Sequence[str | Path], masks: Masks = (), seconds: Sequence[float] = (), iso: float | None = None
) -> ViewPhotographs:
    """The photographs at these paths, checked by their names and what they state.

    masks: a folder of them, one each in the order of the photographs, or "auto". `InputError` for fewer than three,
    files of other formats, of several cameras or focal lengths, and masks that are missing.
    """
    paths = by_name([Path(path) for path in photographs])
    for path in paths.values():
        check_readable(path)
    contents = {name: content(path) for name, path in paths.items()}
    first = {digest: name for name, digest in reversed(contents.items())}
    twins = {name: first[digest] for name, digest in contents.items() if first[digest] != name}
    given = _masks_of(paths, masks)
    kept = {name: path for name, path in paths.items() if name not in twins}
    if len(kept) < LEAST_VIEWS:
        copies = f", {len(twins)} of them copies" if twins else ""
        raise InputError(
            f"{len(paths)} photographs are given{copies}: views need {LEAST_VIEWS} at least, taken 5 to 15° apart all "
            "around the object"
        )
    times = list(seconds)
    if len(times) == len(paths) and twins:
        times = [time for time, name in zip(times, paths, strict=True) if name in kept]
    exif = session_exif(list(kept.values()), times, iso)
    auto = str(masks if isinstance(masks, (str, Path)) else next(iter(masks), "")) == AUTO
    return ViewPhotographs(kept, twins, {k: given[k] for k in kept if k in given}, auto, exif, contents)


def _masks_of(paths: Mapping[str, Path], masks: Masks) -> dict[str, Path]:
    """Name of a photograph → its mask; none where they are to be found, or none is given."""
    given = [Path(masks)] if isinstance(masks, (str, Path)) else [Path(mask) for mask in masks]
    if not given or str(given[0]) == AUTO:
        if len(given) > 1:
            raise InputError("masks of many views are found (--mask auto) or given: a correction is of one view alone")
        return {}
    if len(given) == 1 and given[0].is_dir():
        found = {}
        for name, path in paths.items():
            places = [given[0] / form.format(stem=path.stem, name=path.name) for form in MASK_NAMES]
            mask = next((place for place in places if place.is_file()), None)
            if mask is None:
                raise InputError(f"{given[0]} has no mask of {name}: add {places[0].name}, white on the object")
            found[name] = mask
        return found
    if len(given) != len(paths):
        raise InputError(f"{len(given)} masks for {len(paths)} photographs: give their folder, one each, or auto")
    return dict(zip(paths, map(existing_file, given), strict=True))


def _found(name: str, picture: NDArray) -> NDArray[np.bool_]:
    """The object in one photograph; `InputError` that names it where none stands out."""
    colour = picture if picture.ndim == 3 else picture[..., None]
    whole = picture.dtype.kind == "u"
    light = (colour[..., :3] / np.iinfo(picture.dtype).max) ** DISPLAY if whole else np.nan_to_num(colour)
    seen = Thumbnails()
    seen.add(np.asarray(light, np.float32), np.ones(picture.shape[:2], np.bool_))
    try:
        return object_mask(seen, (picture.shape[0], picture.shape[1])).mask
    except InputError as error:
        raise InputError(f"{name}: {error}") from error
