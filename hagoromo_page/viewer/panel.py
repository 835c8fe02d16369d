"""Panel: the controls of a desk as widgets and gizmos of viser, which all viewers see and move."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.errors import InputError
from hagoromo_page.viewer.controls import Choice, Colour, Control, Slider, VectorControl
from hagoromo_page.viewer.picture_desk import PictureDesk
from hagoromo_page.viewer.probe import plain
from hagoromo_page.viewer.watcher import Desk

PAUSE_S = 1.0  # edits of one control that are this far apart are two
GIZMO_SHARE = 0.15  # size of a gizmo, of the height that the camera sees at the middle of the matter


class Panel:
    """The controls of `desk` at a viser server."""

    def __init__(self, server: Any, desk: Desk | PictureDesk, queued: Callable[..., Any]) -> None:
        """`queued`: makes a callback of viser of a function that this thread is to call; see `Browser._queued`."""
        self.server, self.desk, self.queued = server, desk, queued
        self.first: Any = desk.state
        self.controls: dict[str, Control] = {}
        self.widgets: dict[str, Any] = {}
        self.gizmos: dict[str, Any] = {}
        self.folders: list[Any] = []
        self.edited_at = 0.0
        self._shape: tuple[tuple[str, str], ...] = ()  # names and folders of the widgets
        gui = server.gui
        self.message = gui.add_markdown(desk.hint)
        acts = {"undo": self.undo, "redo": self.redo} | ({"add a lamp": self.add_lamp} if desk.has_scene else {})
        gui.add_button_group("", tuple(acts)).on_click(queued(lambda name: acts[name](), value_set))
        self.refresh()

    def say(self, text: str) -> None:
        """Show a line above the controls."""
        self.message.content = plain(text)

    def edit(self, name: str, value: Any, dragged: bool = False) -> None:
        """A viewer set a control; edits of one drag are one, however long the hand rests between them."""
        control = self.controls.get(name)
        if control is None or _same(control.get(self.desk.state), value):
            return
        if not dragged and time.monotonic() - self.edited_at > PAUSE_S:
            self.desk.history.close()
        self.edited_at = time.monotonic()
        self._try(lambda state: control.put(state, value), name)

    def undo(self) -> None:
        """Take the last edit back."""
        edit = self.desk.undo()
        self.say("there is nothing to take back" if edit is None else f"taken back: {edit}")
        self.refresh()

    def redo(self) -> None:
        """Make it again."""
        edit = self.desk.redo()
        self.say("there is nothing to make again" if edit is None else f"made again: {edit}")
        self.refresh()

    def add_lamp(self) -> None:
        """A far lamp from behind the camera, as strong as the first light is at the middle of the scene."""
        assert isinstance(self.desk, Desk)
        scene = self.desk.scene
        strength = self.desk.strength_of_first_light()
        lamp = {"name": f"lamp {len(scene.lamps) + 1}", "intensity": strength}
        to_lamp = scene.camera.position - self.desk.middle
        self._try(lambda state: state.with_lamp(lamp | {"to_lamp": to_lamp.tolist()}), "add a lamp")

    def remove_lamp(self, number: int) -> None:
        """Remove a lamp."""
        self._try(lambda state: state.without_lamp(number), "remove a lamp")

    def refresh(self, but: str = "") -> None:
        """Show the desk's state; `but`: a control that a hand holds."""
        found = self.desk.controls(self.first)
        shape = tuple((one.name, one.folder) for one in found)
        self.controls = {one.name: one for one in found}
        if shape != self._shape:
            self._build(found)
            return
        for name, widget in self.widgets.items():
            if name != but:
                self._set(widget, self.controls[name].get(self.desk.state))
                self._place_gizmo(name)

    def _try(self, change: Callable[[Any], Any], name: str) -> None:
        """Make an edit, or say why it cannot be made."""
        try:
            self.desk.edit(change(self.desk.state), name)
        except InputError as error:
            self.say(f"not done: {error}")
            self.refresh()
            return
        self.say(self.desk.hint)
        self.refresh(but=name)

    def _build(self, found: list[Control]) -> None:
        """All widgets anew."""
        for old in (*self.folders, *self.gizmos.values()):
            old.remove()
        self.folders, self.widgets, self.gizmos = [], {}, {}
        for folder in dict.fromkeys(one.folder for one in found):
            with self.server.gui.add_folder(folder, expand_by_default=folder == "Picture") as made:
                for control in (one for one in found if one.folder == folder):
                    self.widgets[control.name] = self._widget(control)
                if self.desk.has_scene and folder.startswith("Lamp "):
                    number = int(folder.split()[1]) - 1
                    self._button("remove it", lambda number=number: self.remove_lamp(number))
            self.folders.append(made)
        for control in found:
            if isinstance(control.kind, VectorControl):
                self._add_gizmo(control)
        self._shape = tuple((one.name, one.folder) for one in found)

    def _widget(self, control: Control) -> Any:
        gui, kind, value = self.server.gui, control.kind, control.get(self.desk.state)
        if isinstance(kind, Slider):
            shown = min(max(value, kind.least), kind.most)
            widget = gui.add_slider(control.label, kind.least, kind.most, kind.step, shown)
        elif isinstance(kind, Choice):
            names = kind.names if value in kind.names else (value, *kind.names)
            widget = gui.add_dropdown(control.label, names, initial_value=value)
        elif isinstance(kind, Colour):
            widget = gui.add_rgb(control.label, value)
        else:
            widget = gui.add_vector3(control.label, value, step=1e-4)
        widget.on_update(self.queued(lambda value: self.edit(control.name, value), value_set))
        return widget

    def _set(self, widget: Any, value: Any) -> None:
        if not _same(widget.value, value):
            widget.value = value

    def _button(self, label: str, act: Callable[[], None]) -> None:
        self.server.gui.add_button(label).on_click(self.queued(lambda _: act()))

    def _add_gizmo(self, control: Control) -> None:
        """A thing to drag for a place, with its name; a far lamp stands on a ball around the middle of the scene."""
        camera = self.desk.camera
        away = float(np.linalg.norm(camera.position - self.desk.middle)) * camera.height / camera.focal[1]
        name = f"/lamps/{len(self.gizmos)}"
        gizmo = self.server.scene.add_transform_controls(name, scale=GIZMO_SHARE * away, disable_rotations=True)
        self.server.scene.add_label(f"{name}/name", control.folder.partition(" ")[2])
        self.gizmos[control.name] = gizmo
        self._place_gizmo(control.name)
        dragged = lambda event: (control.name, np.array(event.target.position), event.phase)  # noqa: E731
        gizmo.on_update(self.queued(self._dragged, dragged))

    def _place_gizmo(self, name: str) -> None:
        if name not in self.gizmos:
            return
        control = self.controls[name]
        assert isinstance(control.kind, VectorControl)
        place = np.asarray(control.get(self.desk.state), np.float64)
        if control.kind.away is not None:
            place = self.desk.middle + place / np.linalg.norm(place) * control.kind.away
        if not _same(self.gizmos[name].position, place):
            self.gizmos[name].position = place

    def _dragged(self, name: str, place: NDArray[np.float64], phase: str) -> None:
        """A viewer drags a lamp to a place."""
        if name not in self.gizmos:
            return
        control = self.controls[name]
        assert isinstance(control.kind, VectorControl)
        if control.kind.away is not None:
            place = (place - self.desk.middle) / control.kind.away
        if phase == "start":
            self.desk.history.close()
        self.edit(name, tuple(place.tolist()), dragged=True)
        if name in self.widgets:
            self._set(self.widgets[name], self.controls[name].get(self.desk.state))
        if phase == "end":
            self.desk.history.close()
            self._place_gizmo(name)


def value_set(event: Any) -> tuple[Any] | None:
    """What a hand set a widget to; None where the viewer itself set it."""
    return None if event.client_id is None else (event.target.value,)


def _same(one: Any, other: Any) -> bool:
    """Whether two values of a control are alike, but for rounding."""
    if isinstance(one, str) or isinstance(other, str):
        return one == other
    return bool(np.allclose(np.asarray(one, np.float64), np.asarray(other, np.float64), rtol=1e-9, atol=1e-12))
