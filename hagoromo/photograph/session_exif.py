"""EXIF of a session: what the files of photographs of one view state, and whether they agree.

A session has one camera, one lens setting and one aperture; exposure time and ISO may differ, as values are per second
at ISO 100.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from hagoromo.errors import InputError
from hagoromo.files.exif import Exif, read_exif
from hagoromo.files.exr import read_header

SAME = 5e-3  # largest relative difference of equal settings, which files round
ONE_SETTING = (("focal_mm", "a focal length of {:g} mm"), ("f_number", "the aperture f/{:g}"))

UNSTATED = {"exposure_s": 1.0, "iso": 100.0}  # what is computed with where nobody states it


@dataclass(frozen=True)
class SessionExif:
    """exif: of each file. seconds, iso: of each photograph; UNSTATED where nobody states them. stated, states_iso:
    whether exposure times and ISO are stated.

    focal_px: of developed EXR files, whose header has it.
    """

    exif: tuple[Exif, ...]
    seconds: tuple[float, ...]
    iso: tuple[float, ...]
    stated: bool
    focal_px: float | None = None
    states_iso: bool = False

    def without_unstated(self, frame: dict[str, Any]) -> dict[str, Any]:
        """An entry of transforms.json without the exposure time and the ISO that nobody stated."""
        stated = {"exposure_s": self.stated, "iso": self.states_iso}
        return {key: v for key, v in frame.items() if stated.get(key, True) or v != UNSTATED[key]}

    def focal_of(self, width: int) -> float | None:
        """Focal length [px] of pictures of `width` px; None where the files do not state it.

        `InputError` where the EXIF of a file contradicts itself about it.
        """
        known = next((one for one in self.exif if one.focal_px(width) is not None), None)
        if known is None:
            return self.focal_px
        if known.sensor_conflict:
            raise InputError(
                f"the EXIF of {known.camera or 'the photographs'} contradicts itself: {known.sensor_conflict}: give "
                "camera (--camera), a file or orthographic"
            )
        return known.focal_px(width)


def session_exif(paths: Sequence[Path], seconds: Sequence[float] = (), iso: float | None = None) -> SessionExif:
    """The EXIF of the files at `paths`; seconds, iso: as stated by the user, over what the files state.

    `InputError` where they are of different cameras, focal lengths or apertures, or only some state an exposure time.
    """
    if len(seconds) not in (0, 1, len(paths)):
        raise InputError(f"{len(seconds)} exposures for {len(paths)} photographs: give one for all, or one each")
    developed = [path.suffix.lower() == ".exr" for path in paths]
    exif = [Exif() if exr else read_exif(path) for path, exr in zip(paths, developed, strict=True)]
    _check_one_camera(paths, exif)
    stated = list(seconds) * (len(paths) if len(seconds) == 1 else 1) or [one.exposure_s for one in exif]
    stated = [1.0 if exr else time for time, exr in zip(stated, developed, strict=True)]
    for path, one in zip(paths, exif, strict=True):
        if one.exposure_conflict and not seconds:
            raise InputError(
                f"the EXIF of {path.name} contradicts itself: {one.exposure_conflict}: state exposures (--exposures)"
            )
    lacking = [path.name for path, time in zip(paths, stated, strict=True) if time is None]
    known = [
        path.name for path, time, exr in zip(paths, stated, developed, strict=True) if time is not None and not exr
    ]
    if lacking and known:
        raise InputError(
            f"{known[0]} states its exposure time and {lacking[0]} does not: state exposures (--exposures) for all"
        )
    return SessionExif(
        tuple(exif),
        tuple(time or 1.0 for time in stated),
        tuple(100.0 if exr else iso or one.iso or 100.0 for one, exr in zip(exif, developed, strict=True)),
        bool(known),
        _focal_of_developed(paths, developed),
        iso is not None or any(one.iso is not None for one in exif),
    )


def _check_one_camera(paths: Sequence[Path], exif: Sequence[Exif]) -> None:
    named = [(path.name, one) for path, one in zip(paths, exif, strict=True)]
    cameras = [(name, one.camera) for name, one in named if one.camera]
    for name, camera in cameras[1:]:
        if camera != cameras[0][1]:
            raise InputError(
                f"{cameras[0][0]} was taken by {cameras[0][1]} and {name} by {camera}: give photographs of one camera"
            )
    for key, words in ONE_SETTING:
        known = [(name, figure) for name, one in named if (figure := getattr(one, key)) is not None]
        for name, figure in known[1:]:
            if abs(figure / known[0][1] - 1.0) > SAME:
                raise InputError(
                    f"{known[0][0]} has {words.format(known[0][1])} and {name} {words.format(figure)}, by their EXIF: "
                    "photographs of one view have one setting of the lens, leave the others out"
                )


def _focal_of_developed(paths: Sequence[Path], developed: Sequence[bool]) -> float | None:
    """Focal length [px] in the header of the first EXR that has one."""
    for path, exr in zip(paths, developed, strict=True):
        focal = read_header(path).get("focal_px") if exr else None
        if focal is not None:
            try:
                return float(focal) if float(focal) > 0.0 else None
            except ValueError:
                raise InputError(f"{path} states a focal length of {focal!r:.30} px: develop it again") from None
    return None
