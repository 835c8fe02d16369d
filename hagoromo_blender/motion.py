"""Motion blur: where objects, boxes and the camera are while the shutter is open, as keyframes of a scene.toml."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import bpy
import numpy as np
from mathutils import Matrix

INSTANTS = 5  # at which places are asked for; between them they change in a straight line
RIGID = 1e-4  # departure of a turn from one
STILL = 1e-7
BEGINS = {"START": 0.0, "CENTER": -0.5, "END": -1.0}  # of the shutter, in its lengths from the frame
CAMERA = ("", ())
Key = tuple[str, tuple[int, ...]]


class OpenShutter:
    """Places of what is shown at instants from the opening of the shutter to its closing; none where it is not open."""

    def __init__(self, depsgraph: bpy.types.Depsgraph, frame_set: Callable[[int, float], None] | None) -> None:
        """frame_set: evaluates the scene at a frame and a part of one; None: all stands still."""
        scene, render = depsgraph.scene, depsgraph.scene.render
        self.places: list[dict[Key, Matrix]] = []
        self.seconds = render.motion_blur_shutter / (render.fps / render.fps_base)
        self.keys: dict[str, list[dict[str, Any]]] = {"camera": [], "surface": [], "box": []}
        if frame_set is None or not render.use_motion_blur or self.seconds <= 0.0:
            return
        middle = scene.frame_current + scene.frame_subframe
        first = middle + BEGINS[render.motion_blur_position] * render.motion_blur_shutter
        for frame in (*np.linspace(first, first + render.motion_blur_shutter, INSTANTS), middle):
            whole = int(np.floor(frame))
            frame_set(whole, float(frame) - whole)
            self.places.append(places_of(depsgraph))
        self.places.pop()  # of the frame itself, in which the scene is left

    @property
    def times(self) -> list[float]:
        """Of the instants [s], from the opening."""
        return [self.seconds * k / (INSTANTS - 1) for k in range(INSTANTS)]

    def of(self, key: Key) -> list[Matrix] | None:
        """The places of an object; None where it stands still, or is not there all the time."""
        found = [places[key] for places in self.places if key in places]
        if len(found) != INSTANTS or np.ptp(np.array(found), axis=0).max() < STILL:
            return None
        return found

    def add(self, what: str, number: int, key: Key, now: Matrix, lost: set[str]) -> Matrix | None:
        """Add the keyframes of a surface or a box, by its number. Gives the frame in which it stands still, at `now`;
        None where it does so in the world, or a line says why not.
        """
        places = self.of(key)
        if places is None:
            return None
        ways = [place @ now.inverted() for place in places]
        if any(not is_rigid(way) for way in ways):
            lost.add(f"{key[0]}: its motion, which is not of shifts and turns alone")
            return None
        place, turn, _ = now.decompose()
        frame = Matrix.LocRotScale(place, turn, None)
        before = None
        for time, way in zip(self.times, ways, strict=True):
            at = way @ frame
            before = at.to_euler("XYZ") if before is None else at.to_euler("XYZ", before)
            turned = np.degrees(before).tolist()
            self.keys[what].append(
                {what: number, "time": time, "position": list(at.translation), "rotation_deg": turned}
            )
        return frame

    def camera(self) -> None:
        """Add the keyframes of the camera."""
        for time, place in zip(self.times, self.of(CAMERA) or (), strict=False):
            eye, turn = place.translation, place.to_3x3().normalized()
            target, up = eye - turn.col[2], turn.col[1]
            self.keys["camera"].append({"time": time, "eye": list(eye), "target": list(target), "up": list(up)})

    def table(self) -> Mapping[str, Any]:
        """The table [motion]; {} where nothing moves."""
        keys = {what: of for what, of in self.keys.items() if of}
        return {"between": "linear", "shutter_close": self.seconds, **keys} if keys else {}


def key_of(each: bpy.types.DepsgraphObjectInstance) -> Key:
    """What an object, or one of its instances, is known by."""
    return each.object.name, tuple(each.persistent_id)


def places_of(depsgraph: bpy.types.Depsgraph) -> dict[Key, Matrix]:
    """Where everything is now."""
    found = {key_of(each): each.matrix_world.copy() for each in depsgraph.object_instances}
    camera = depsgraph.scene.camera
    return found | ({CAMERA: camera.evaluated_get(depsgraph).matrix_world.copy()} if camera else {})


def is_rigid(way: Matrix) -> bool:
    """Whether it shifts and turns alone."""
    turn = np.array(way)[:3, :3]
    return bool(np.abs(turn @ turn.T - np.eye(3)).max() < RIGID and np.linalg.det(turn) > 0.0)
