"""Photographed: the camera and the lamps that a measurement was made with, as files in its folder.

camera.json (nerfstudio's keys), response.csv where the response is known, lamps.json: other commands read each of them.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from hagoromo.camera.camera import Camera
from hagoromo.camera.formats.camera_file import read_views, write_views
from hagoromo.camera.response import Response
from hagoromo.errors import InputError
from hagoromo.files.checks import inside
from hagoromo.files.record import decode, read_json, write_json, written_by
from hagoromo.light.lamp import Lamp
from hagoromo.photograph.capture import Capture
from hagoromo.photograph.lamp_files import LampsRecord, load_lamps
from hagoromo.photograph.transforms import record_from_lamp

CAMERA, LAMPS, RESPONSE = "camera.json", "lamps.json", "response.csv"
CAPTURE = "capture"  # setting of lamps.json: the name of the capture


@dataclass(frozen=True, eq=False)
class Photographed:
    """camera: of all photographs, with its response where it is known. lamps: named after photographs of one lamp.

    name: that the capture states, "" for none.
    """

    camera: Camera
    lamps: tuple[Lamp, ...]
    name: str = ""


def photographed(capture: Capture, size: tuple[int, int] | None = None) -> Photographed:
    """The camera and the lamps of `capture`. size: (width, height) [px] of maps that are larger than photographs."""
    camera = capture.photographs[0].camera
    if size is not None and size != (camera.width, camera.height):
        step = 1.0 / round(size[0] / camera.width)
        camera = camera.resampled(size[0], size[1], (step, step))
    lamps: dict[int, Lamp] = {}
    for photograph in capture.photographs:
        for lamp in photograph.lamps:
            lone = len(photograph.lamps) == 1
            lamps.setdefault(id(lamp), replace(lamp, name=photograph.name) if lone or not lamp.name else lamp)
    return Photographed(camera, tuple(lamps.values()), capture.own_name)


def write_photographed(home: Path, found: Photographed) -> None:
    """Write camera.json, lamps.json and, where the response is known, response.csv into the folder `home`."""
    write_views(home / CAMERA, {"photograph": found.camera}, "nerfstudio")
    by = written_by({CAPTURE: found.name or None})
    write_json(home / LAMPS, {"lamps": [record_from_lamp(one) for one in found.lamps], "hagoromo": by})
    if found.camera.response is not None:
        found.camera.response.write_table(home / RESPONSE)


def read_photographed(home: Path) -> Photographed | None:
    """What `write_photographed` wrote into the folder; None where it has no camera.json, as of version 0.2."""
    path = inside(home, CAMERA)
    if not path.is_file():
        return None
    views = read_views(path)
    if len(views) != 1:
        raise InputError(f"{path} has {len(views)} views: a measurement has one")
    camera, response = next(iter(views.values())), inside(home, RESPONSE)
    if response.is_file():
        camera = replace(camera, response=Response.load(response))
    lamps = inside(home, LAMPS)
    if not lamps.is_file():
        return Photographed(camera, ())
    known, record = load_lamps(lamps), read_json(lamps)
    ours = isinstance(record, Mapping) and "lamps" in record  # a list of lamps, or lights of Relight, do as well
    name = decode(record, LampsRecord, str(lamps)).hagoromo.settings.get(CAPTURE, "") if ours else ""
    return Photographed(camera, known, str(name))
