"""Messages: what a browser may send to the viewer, each kind a record that is checked when it arrives.

Enters: a frame of a web socket, MessagePack. Leaves: the same message, encoded anew from its record. Viser has some
thirty kinds of messages; those that the viewer has no use for are refused, such as uploads of files.
"""

from __future__ import annotations

import math
from collections.abc import Container, Mapping
from functools import lru_cache
from typing import Annotated, Any, Literal

import msgspec
from msgspec import Meta

from hagoromo.camera.pose import FARTHEST
from hagoromo.errors import InputError
from hagoromo.files.record import Record, decode, decode_one, from_to, one_of

LARGEST_WINDOW = 1 << 14  # px along a side: four screens of 4096 px
LARGEST_FRAME = 1 << 16  # bytes that a browser may send at once: a message has some hundreds
OFF_UNIT = 1e-3  # of the length of a quaternion
WHERE = "the message"
Coordinate = Annotated[float, Meta(ge=-FARTHEST, le=FARTHEST)]
Point = tuple[Coordinate, Coordinate, Coordinate]
Unit = Annotated[float, Meta(ge=-2.0, le=2.0)]
Quaternion = tuple[Unit, Unit, Unit, Unit]
Length = Annotated[float, Meta(gt=0.0, le=1e3 * FARTHEST)]
Side = Annotated[int, from_to(1, LARGEST_WINDOW)]
ScreenShare = Annotated[float, Meta(ge=-16.0, le=16.0)]  # 0…1 within the window; a drag may end outside
Identifier = Annotated[str, Meta(max_length=64)]


class ViewerCamera(Record, frozen=True, kw_only=True, tag_field="type", tag="ViewerCameraMessage"):
    """Where a viewer's camera stands, camera → world in OpenCV's axes, and the size of its window [px]."""

    wxyz: Quaternion
    position: Point
    fov: Annotated[float, Meta(gt=0.0, lt=math.pi)]
    near: Length
    far: Length
    image_height: Side
    image_width: Side
    look_at: Point
    up_direction: Point

    def __post_init__(self) -> None:
        _check_turn(self.wxyz)
        if not any(self.up_direction):
            raise ValueError("up_direction must have a length: given zeros")


class Click(Record, frozen=True, kw_only=True, tag_field="type", tag="ScenePointerMessage"):
    """A click into the picture, at shares of the window's width and height."""

    event_type: Literal["click"]
    ray_origin: Point
    ray_direction: Point
    screen_pos: tuple[tuple[ScreenShare, ScreenShare]]
    modifier: Annotated[str, Meta(max_length=64)] | None = None


class Update(Record, frozen=True, kw_only=True):
    """What of a widget was set: its value, and nothing else."""

    value: Any


class WidgetUpdate(Record, frozen=True, kw_only=True, tag_field="type", tag="GuiUpdateMessage"):
    """A widget was set; its value is checked by `value_for`."""

    uuid: Identifier
    updates: Update


class GizmoStart(Record, frozen=True, kw_only=True, tag_field="type", tag="TransformControlsDragStartMessage"):
    """The drag of a gizmo begins."""

    name: Identifier
    owner: Literal[""] = ""


class GizmoMove(Record, frozen=True, kw_only=True, tag_field="type", tag="TransformControlsUpdateMessage"):
    """A gizmo was dragged to a place."""

    name: Identifier
    wxyz: Quaternion
    position: Point
    owner: Literal[""] = ""

    def __post_init__(self) -> None:
        _check_turn(self.wxyz)


class GizmoEnd(Record, frozen=True, kw_only=True, tag_field="type", tag="TransformControlsDragEndMessage"):
    """The drag of a gizmo ends."""

    name: Identifier
    owner: Literal[""] = ""


KINDS: tuple[type[Record], ...] = (ViewerCamera, Click, WidgetUpdate, GizmoStart, GizmoMove, GizmoEnd)


def checked(frame: Any, widgets: Mapping[str, Any], gizmos: Container[str]) -> bytes:
    """The frame of a message that is right, encoded anew; `InputError` with what is wrong in any other one.

    widgets: identifier → viser's handle. gizmos: the names of those that there are.
    """
    message: Any = decode_one(_plain(frame), KINDS, WHERE)
    if isinstance(message, WidgetUpdate):
        widget = widgets.get(message.uuid)
        if widget is None:
            raise InputError(f"{WHERE} sets the widget {message.uuid!r}, which is not there")
        value = value_for(widget, message.updates.value)
        message = WidgetUpdate(uuid=message.uuid, updates=Update(value=value))
    elif isinstance(message, (GizmoStart, GizmoMove, GizmoEnd)) and message.name not in gizmos:
        raise InputError(f"{WHERE} drags {message.name!r}, which is not there")
    return msgspec.msgpack.encode(message)


def value_for(widget: Any, value: Any) -> Any:
    """The value that a widget of viser is to have; `InputError` for one that it cannot have."""
    kind, label = type(widget).__name__.removeprefix("Gui").removesuffix("Handle"), getattr(widget, "label", "")
    limits = (widget.min, widget.max) if kind == "Slider" else tuple(getattr(widget, "options", ()))
    record = _widget_record(kind, limits)
    if record is None:
        raise InputError(f"{WHERE} sets {label!r}, which is not set by a browser")
    made: Any = decode({"value": value}, record, f"{WHERE} sets {label!r}")
    return made.value


@lru_cache(maxsize=256)
def _widget_record(kind: str, limits: tuple[Any, ...]) -> type[Record] | None:
    """What a message says of a widget of a kind. limits: of its numbers, or the texts to choose from."""
    channel = Annotated[int, from_to(0, 255)]
    types: dict[str, Any] = {
        "Button": Literal[True],
        "Checkbox": bool,
        "Rgb": tuple[channel, channel, channel],
        "Vector3": Point,
    }
    if kind == "Slider":
        types[kind] = Annotated[float, Meta(ge=limits[0], le=limits[1])]
    elif kind in ("Dropdown", "ButtonGroup"):
        types[kind] = Annotated[str, one_of(*limits)]
    if kind not in types:
        return None
    made: Any = msgspec.defstruct(kind, [("value", types[kind])], bases=(Record,), frozen=True)
    return made


def _plain(frame: Any) -> dict[str, Any]:
    """The table in a frame; `InputError` where it holds none, or anything that JSON has not."""
    if not isinstance(frame, bytes):
        raise InputError("a frame of text: a message is MessagePack")
    try:
        return msgspec.msgpack.decode(frame, type=dict[str, Any], ext_hook=_no_extension)
    except (msgspec.MsgspecError, RecursionError, ValueError, TypeError) as error:
        raise InputError(f"a frame of {len(frame)} bytes is no message: {error}") from None


def _no_extension(code: int, data: memoryview) -> Any:
    raise ValueError(f"it holds an extension of type {code}")


def _check_turn(wxyz: Quaternion) -> None:
    length = math.sqrt(sum(one * one for one in wxyz))
    if not abs(length - 1.0) <= OFF_UNIT:
        raise ValueError(f"wxyz must have length 1: given one of {length:.3g}")
