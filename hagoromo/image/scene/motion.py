"""Motion: the tables of a scene file → those of one frame of a film, at its time.

What moves is in the table [motion]: keyframes of the camera, of lamps and their spectra, of boxes and of surfaces.
Besides, camera and lamps may turn about the vertical axis through the middle of the matter (`turned`).
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.pose import inverse_pose, pose_of
from hagoromo.errors import InputError
from hagoromo.files.record import decode, read_toml
from hagoromo.image.scene.motion_record import MOST_RATE, BoxKey, CameraKey, LampKey, MotionRecord, SurfaceKey
from hagoromo.image.scene.scene import Scene
from hagoromo.image.scene.scene_file import SceneRecord
from hagoromo.image.scene.scene_lights import turned_tables
from hagoromo.light.spectrum import Spectrum

Tables: TypeAlias = Mapping[str, Any]


Key = TypeVar("Key", CameraKey, LampKey, BoxKey, SurfaceKey)


class Motion:
    """The keyframes of the tables of a scene, checked. seconds: length of the film. rate: frames a second.

    key_times: of all keyframes [s]. shutter: when it opens and closes, from the time of a picture [s]; None: pictures
    are of one instant.
    """

    def __init__(self, tables: Tables, folder: Path, where: str) -> None:
        """The file lies in `folder`; `where` names it in messages. `InputError` for keyframes of what is not there."""
        self.tables, self.folder, self.where = tables, folder, where
        decode(tables, SceneRecord, where)
        record = decode(tables.get("motion", {}), MotionRecord, f"{where} [motion]")
        self.between, self.rate = record.between, record.frames_per_second
        self.shutter: tuple[float, float] | None = None
        if record.shutter_close is not None and record.shutter_close != record.shutter_open:
            self.shutter = record.shutter_open, record.shutter_close
            if not record.shutter_open < record.shutter_close:
                raise InputError(f"{where} [motion]: shutter_close is before shutter_open: give a later time")
        self.camera = [
            decode(key, CameraKey, f"{where} [motion] camera {k + 1}") for k, key in enumerate(record.camera)
        ]
        self.lamps = self._of_things(record.lamp, LampKey, "lamp")
        self.boxes = self._of_things(record.box, BoxKey, "box")
        self.surfaces = self._of_things(record.surface, SurfaceKey, "surface")
        things = (self.lamps, self.boxes, self.surfaces)
        keys = [*self.camera, *(key for of in things for each in of.values() for key in each)]
        self.key_times = sorted({key.time for key in keys})
        self.seconds = record.seconds or max(self.key_times, default=0.0)
        if keys and not self.seconds > 0.0:
            raise InputError(f"{where} [motion]: all keyframes are of time 0: give later ones, or seconds")
        if not 1.0 <= self.rate <= MOST_RATE:
            raise InputError(f"{where} [motion]: frames_per_second is {self.rate:g}: give 1 to {MOST_RATE:g}")

    def at(self, time: float) -> dict[str, Any]:
        """The tables of the scene at a time [s], without [motion]."""
        tables = {key: value for key, value in self.tables.items() if key != "motion"}
        if self.camera:
            tables["camera"] = self._camera_at(time)
        for what, keyed, names in (
            ("lamp", self.lamps, ("position", "to_lamp", "intensity", "spectrum")),
            ("box", self.boxes, ("position", "rotation_deg")),
            ("surface", self.surfaces, ("position", "rotation_deg")),
        ):
            if keyed:
                things = list(tables[what])
                for number, keys in keyed.items():
                    moved = {name: self._value(keys, name, time) for name in names}
                    things[number] = things[number] | {
                        name: value for name, value in moved.items() if value is not None
                    }
                tables[what] = things
        return tables

    def times(self, count: int) -> NDArray[np.float64]:
        """The middles of `count` parts of the time that the shutter is open, from that of a picture [s]."""
        first, last = self.shutter or (0.0, 0.0)
        return first + (np.arange(count) + 0.5) / count * (last - first)

    def _of_things(self, records: Sequence[Any], kind: type[Key], what: str) -> dict[int, list[Key]]:
        """Keyframes of lamps, boxes or surfaces, by the number of the thing."""
        names = [thing.get("name") for thing in self.tables.get(what, ())]
        found: dict[int, list[Key]] = {}
        for k, record in enumerate(records):
            where = f"{self.where} [motion] {what} {k + 1}"
            key = decode(record, kind, where)
            thing = getattr(key, what)
            places = [i for i, name in enumerate(names) if thing in (i, name)]
            if len(places) != 1:
                known = ", ".join(map(str, (name or i for i, name in enumerate(names))))
                raise InputError(f"{where}: {len(places)} are called {thing!r}: the scene has {known or 'none'}")
            found.setdefault(places[0], []).append(key)
        return found

    def _camera_at(self, time: float) -> dict[str, Any]:
        moved = ((name, self._value(self.camera, name, time)) for name in ("eye", "target", "up"))
        camera = dict(self.tables["camera"]) | {name: value for name, value in moved if value is not None}
        if camera.pop("world_to_camera", None) is not None and not camera.keys() >= {"eye", "target"}:
            raise InputError(f"{self.where} [motion]: the camera has no eye and target: give both in its keyframes")
        return camera

    def _value(self, keys: Sequence[Any], name: str, time: float) -> Any:
        """A quantity at a time, between its keyframes; None where no keyframe has it."""
        stated = sorted(((key.time, getattr(key, name)) for key in keys if getattr(key, name) is not None), key=_time)
        if not stated:
            return None
        times = np.array([when for when, _ in stated])
        if (np.diff(times) <= 0.0).any():
            raise InputError(f"{self.where} [motion]: two keyframes of {name} are of one time: leave one out")
        if name == "spectrum":
            return _mixture([value for _, value in stated], self._shares(times, time), self.folder)
        values = self._shares(times, time) @ np.array([value for _, value in stated], np.float64)
        return values.tolist()

    def _shares(self, times: NDArray[np.float64], time: float) -> NDArray[np.float64]:
        """Of each keyframe at a time, which sum to 1: of the one before and the one after."""
        shares = np.zeros(len(times))
        after = int(np.searchsorted(times, time, side="right"))
        if after in (0, len(times)):
            shares[min(after, len(times) - 1)] = 1.0
            return shares
        part = (time - times[after - 1]) / (times[after] - times[after - 1])
        part = part * part * (3.0 - 2.0 * part) if self.between == "smooth" else part
        shares[after - 1], shares[after] = 1.0 - part, part
        return shares


def read_motion(path: str | Path) -> Motion:
    """The motion of a scene file; `InputError` for keyframes that are wrong, wherever they stand."""
    path = Path(path)
    motion = Motion(read_toml(path), path.parent, str(path))
    motion.at(0.0)
    motion.at(0.5 * motion.seconds)  # between keyframes, where spectra are mixed
    return motion


def turned(tables: Tables, scene: Scene, angle: float, camera: bool, lamps: bool) -> dict[str, Any]:
    """The tables with the camera, the lights, or both turned by `angle` [rad] about the vertical axis, counterclockwise
    from above. The axis stands in the middle of the bounds of the boxes, or of the surfaces where there is no box.
    scene: that of the tables.
    """
    corners = scene.matter_corners()
    middle = 0.5 * (corners.min(axis=0) + corners.max(axis=0))
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    changed = dict(tables)
    if camera:
        pose = scene.camera.world_to_camera @ inverse_pose(pose_of(turn, middle - turn @ middle))
        kept = {key: value for key, value in tables["camera"].items() if key not in ("eye", "target", "up")}
        changed["camera"] = kept | {"world_to_camera": pose.ravel().tolist()}
    if lamps:
        changed |= turned_tables(tables, scene, turn, middle)
    return changed


def _time(pair: tuple[float, Any]) -> float:
    return pair[0]


def _mixture(sources: Sequence[Any], shares: NDArray[np.float64], folder: Path) -> Any:
    """The spectrum between those of two keyframes; a keyframe's own source where it is reached."""
    parts = [(source, float(share)) for source, share in zip(sources, shares, strict=True) if share > 0.0]
    if len(parts) == 1:
        return parts[0][0]
    spectra = [Spectrum.load(source, folder).scaled(share) for source, share in parts]
    knots = np.unique(np.concatenate([one.wavelengths for one in spectra]))
    return Spectrum(knots, sum(one.at(knots) for one in spectra)).record()
