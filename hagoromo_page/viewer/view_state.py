"""View state: what a viewer shows, as the tables of a scene file and how the picture of the scene is developed.

Every edit makes a new state; `History` keeps the earlier ones. As the scene is always made of the tables that would be
written, a picture in the viewer is that of the file.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

MOST_UNDONE = 200  # edits that can be taken back
POSE_KEYS = ("eye", "target", "up", "world_to_camera")
RE_EXPOSED = ("intensity", "spectrum", "name")  # keys of a lamp that need no new march
Steps = tuple[str | int, ...]  # the place of a value in tables: keys, and numbers in lists
State = TypeVar("State")


@dataclass(frozen=True)
class ViewTransform:
    """How the weights of a picture become one for people.

    stops: exposure, in stops above that of the first picture. white: what is shown as white: "first lamp", or the name
    of an illuminant. tone: of TONES, the curve of bright values, or a view of OpenColorIO, see `tones`. layer: of
    LAYERS, what the picture shows. ocio: configuration of the views; "": ACES.
    """

    stops: float = 0.0
    white: str = "first lamp"
    tone: str = "clipped"
    layer: str = "picture"
    ocio: str = ""


TONES = ("clipped", "shoulder")


@dataclass(frozen=True, eq=False)
class ViewState:
    """tables: those of a scene file. development: how its picture is shown. Both are never changed in place."""

    tables: Mapping[str, Any]
    development: ViewTransform = field(default_factory=ViewTransform)

    def at(self, *steps: str | int) -> Any:
        """The value at a place in the tables; None where there is none."""
        value: Any = self.tables
        for step in steps:
            try:
                value = value[step]
            except (KeyError, IndexError, TypeError):
                return None
        return value

    def with_value(self, steps: Steps, value: Any) -> ViewState:
        """The state with another value at a place; a value of None removes the key."""
        return replace(self, tables=_changed(self.tables, steps, value))

    def developed(self, **changes: Any) -> ViewState:
        """The state with another development."""
        return replace(self, development=replace(self.development, **changes))

    def with_pose(self, world_to_camera: NDArray[np.float64]) -> ViewState:
        """The state with the camera at another (4, 4) pose."""
        camera = {key: value for key, value in self.tables["camera"].items() if key not in POSE_KEYS}
        return self.with_value(("camera",), camera | {"world_to_camera": np.ravel(world_to_camera).tolist()})

    def with_lamp(self, lamp: Mapping[str, Any]) -> ViewState:
        """The state with one more lamp."""
        return self.with_value(("lamp",), [*self.lamps, dict(lamp)])

    def without_lamp(self, number: int) -> ViewState:
        """The state without lamp `number`, which makes no scene where it was its only light."""
        return self.with_value(("lamp",), [*self.lamps[:number], *self.lamps[number + 1 :]])

    @property
    def lamps(self) -> Sequence[Mapping[str, Any]]:
        """The tables of its lamps: none of a scene under other lights."""
        return self.tables.get("lamp", ())

    def marched(self) -> str:
        """Equal for two states whose pictures have the same weights, up to a factor for each lamp that is not 0.

        It holds all tables but the camera's pose and response, and strength and spectrum of the lamps.
        """
        camera = {key: value for key, value in self.tables["camera"].items() if key not in (*POSE_KEYS, "response")}
        lamps = [{key: value for key, value in lamp.items() if key not in RE_EXPOSED} for lamp in self.lamps]
        return json.dumps({**self.tables, "camera": camera, "lamp": lamps}, sort_keys=True, default=list)


def _changed(tables: Any, steps: Sequence[str | int], value: Any) -> Any:
    """Copies of the tables along `steps`, with another value at their end; everything else is shared."""
    if not steps:
        return value
    first, *rest = steps
    if isinstance(first, int):
        entries = list(tables)
        entries[first] = _changed(entries[first], rest, value)
        return entries
    table = dict(tables or {})
    changed = _changed(table.get(first), rest, value)
    if changed is None:
        table.pop(first, None)
    else:
        table[first] = changed
    return table


class History(Generic[State]):
    """The states of a viewer: the present one, those before it and those that were taken back.

    >>> history = History(ViewState({"camera": {}, "lamp": [{"intensity": 1.0}]}))
    >>> for strength in (2.0, 3.0):  # one drag of a slider is one edit
    ...     history.put(history.now.with_value(("lamp", 0, "intensity"), strength), "strength of lamp 0")
    >>> history.undo(), history.now.at("lamp", 0, "intensity")
    ('strength of lamp 0', 1.0)
    """

    def __init__(self, first: State) -> None:
        self.now = first
        self._before: list[tuple[str, State]] = []
        self._after: list[tuple[str, State]] = []
        self._open = False  # whether the next edit of the same name joins the last one

    def put(self, state: State, edit: str) -> None:
        """Make `state` the present one, by an edit of this name; edits of one name after each other are one."""
        if not (self._open and self._before and self._before[-1][0] == edit):
            self._before = [*self._before[-MOST_UNDONE + 1 :], (edit, self.now)]
        self.now, self._after, self._open = state, [], True

    def close(self) -> None:
        """The next edit is one of its own, whatever its name: the hand has let go."""
        self._open = False

    def undo(self) -> str | None:
        """Take the last edit back; its name, None where there is none."""
        return self._step(self._before, self._after)

    def redo(self) -> str | None:
        """Make the edit again that was taken back last; its name, None where there is none."""
        return self._step(self._after, self._before)

    def _step(self, away: list[tuple[str, State]], towards: list[tuple[str, State]]) -> str | None:
        if not away:
            return None
        edit, state = away.pop()
        towards.append((edit, self.now))
        self.now, self._open = state, False
        return edit

    def __iter__(self) -> Iterator[str]:
        """The names of the edits that can be taken back, the oldest first."""
        return (edit for edit, _ in self._before)
