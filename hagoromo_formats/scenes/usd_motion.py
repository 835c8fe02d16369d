"""Motion of USD, time samples of transforms, and ours, keyframes of [motion], both ways; and the shutter of cameras.

Here a thing is shifted and turned; USD moves it by any matrix. What it has besides at rest, its scale and shear, stays
with it. Times of USD are counted in time codes, ours in seconds from the beginning of the film.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.pose import opencv_from_opengl, turned_about_axes
from hagoromo.errors import InputError
from hagoromo.image.scene.motion_record import MOST_KEYS, MOST_RATE, RATE

Matrix = NDArray[np.float64]
Table = dict[str, Any]
RIGID = 1e-4  # departure of a turn from one


class Placed(NamedTuple):
    """A thing that moves: own: (4, 4) to its frame from what is stored; places: its frame at each time, rigid."""

    own: Matrix
    times: Sequence[float]
    places: Matrix

    def keys(self, **named: Any) -> list[Table]:
        """Keyframes of it, without those that change nothing of the one before and the one after; times in codes."""
        position, degrees = self.places[:, :3, 3], _degrees(self.places[:, :3, :3])
        both = np.concatenate([position, degrees], axis=1)
        same = np.abs(np.diff(both, axis=0)).max(axis=1) == 0.0
        kept = [k for k in range(len(both)) if not (0 < k < len(both) - 1 and same[k - 1] and same[k])]
        return [
            {**named, "time": self.times[k], "position": position[k].tolist(), "rotation_deg": degrees[k].tolist()}
            for k in kept
        ]


def placed(places: Matrix, times: Sequence[float]) -> Placed | None:
    """Of the (n, 4, 4) places of a thing, the first of which is its own; None where it changes otherwise than by shifts
    and turns.
    """
    ways = places @ np.linalg.inv(places[0])
    turns = ways[:, :3, :3]
    if np.abs(turns @ turns.transpose(0, 2, 1) - np.eye(3)).max() > RIGID or (np.linalg.det(turns) < 0.0).any():
        return None
    left, _, right = np.linalg.svd(places[0][:3, :3])
    frame = np.eye(4)
    frame[:3, :3] = left @ right if np.linalg.det(left @ right) > 0.0 else np.eye(3)
    frame[:3, 3] = places[0][:3, 3]
    return Placed(np.linalg.inv(frame) @ places[0], times, ways @ frame)


def camera_keys(places: Matrix, times: Sequence[float]) -> list[Table]:
    """Keyframes of a camera whose (n, 4, 4) places have the axes of OpenGL."""
    made = []
    for time, place in zip(times, places, strict=True):
        place = place.copy()
        place[:3, :3] /= np.linalg.norm(place[:3, :3], axis=0)
        pose = opencv_from_opengl(place)
        eye, down, ahead = (pose[:3, k] for k in (3, 1, 2))
        made.append({"time": time, "eye": eye.tolist(), "target": (eye + ahead).tolist(), "up": (-down).tolist()})
    return made


def motion_table(clock: Mapping[str, float], keys: Mapping[str, list[Table]], shutter: Sequence[float]) -> Table:
    """The table [motion]. clock: see `UsdParts`. shutter: opening and closing [codes].

    `InputError` for more keyframes than a scene has.
    """
    if any(len(of) > MOST_KEYS for of in keys.values()):
        raise InputError(f"it has more than {MOST_KEYS} time samples: leave some out")
    every = [key["time"] for of in keys.values() for key in of]
    rate, first = clock["per_second"], min([clock.get("first", every[0]), *every])
    last = max([clock.get("last", every[0]), *every])
    timed = {what: [{**key, "time": (key["time"] - first) / rate} for key in of] for what, of in keys.items() if of}
    opened, closed = (each / rate for each in shutter)
    return {
        **({"seconds": (last - first) / rate} if last > first else {}),
        "frames_per_second": min(max(clock["frames"] or RATE, 1.0), MOST_RATE),
        "between": "linear",
        **({"shutter_open": opened, "shutter_close": closed} if closed > opened else {}),
        **timed,
    }


def _degrees(turns: Matrix) -> Matrix:
    """(n, 3) turns about x, then y, then z [°] of rotations, each of the two that are one next to the one before."""
    # R = Rz Ry Rx, whose last row is (−sin y, cos y sin x, cos y cos x)
    y = np.arcsin(np.clip(-turns[:, 2, 0], -1.0, 1.0))
    x, z = np.arctan2(turns[:, 2, 1], turns[:, 2, 2]), np.arctan2(turns[:, 1, 0], turns[:, 0, 0])
    made, before = [], np.zeros(3)
    for one in np.degrees(np.stack([x, y, z], axis=1)):
        both = [one, np.array([one[0] + 180.0, 180.0 - one[1], one[2] + 180.0])]
        near = [each + 360.0 * np.round((before - each) / 360.0) for each in both]
        before = min(near, key=lambda each: float(np.abs(each - before).sum()))
        made.append(before)
    return np.array(made)


def rest(record: Mapping[str, Any]) -> Matrix:
    """(4, 4) of position and rotation_deg of a thing of a scene file."""
    pose = np.eye(4)
    pose[:3, :3] = turned_about_axes(record.get("rotation_deg") or (0.0, 0.0, 0.0))
    pose[:3, 3] = record.get("position") or (0.0, 0.0, 0.0)
    return pose
