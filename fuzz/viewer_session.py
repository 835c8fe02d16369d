"""The messages of a browser to the viewer: a good session, and its spoiling.

A session is a list in MessagePack: tables are messages, bytes and texts are frames as they are. Widgets stand there by
their labels, in place of the identifiers that a server gives them anew.
"""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from fuzz import mutators
from fuzz.trees import VALUES, changed

Random = np.random.Generator
Message = dict[str, Any]
IDENTIFIER = 36  # characters, of a widget
ADMISSIBLE = "<any widget>"  # the kind of a message that sets a widget to a value that it may have
FRAMES = ("", "{}", "text", "\x00" * 300, b"", b"\x91" * 20_000, b"\xc1", b"\x00" * (1 << 21))


def scene_session(path: Path) -> None:
    """Everything that a hand does with a scene: look, set each kind of widget, drag a lamp, click."""
    path.write_bytes(msgspec.msgpack.encode([camera_message(0.0), *hand_messages()]))


def image_session(path: Path) -> None:
    """What a hand does with an image."""
    sets = [set_message("exposure [stops]", -1.0), set_message("layer", "opacity"), set_message("", "undo")]
    path.write_bytes(msgspec.msgpack.encode([camera_message(0.0), *sets, click_message(0.3, 0.6)]))


def camera_message(turn: float, **changes: Any) -> Message:
    """A camera 1 m from the middle, `turn` [rad] about the z axis."""
    x, y = math.sin(turn), -math.cos(turn)
    half = 0.5 * turn
    c, s, r = math.cos(half), math.sin(half), math.sqrt(0.5)
    return {
        "type": "ViewerCameraMessage", "wxyz": [r * c, -r * c, -r * s, r * s], "position": [x, y, 0.0], "fov": 0.6,
        "near": 0.001, "far": 1000.0, "image_height": 60, "image_width": 80, "look_at": [0.0, 0.0, 0.0],
        "up_direction": [0.0, 0.0, 1.0],
    } | changes  # fmt: skip


def hand_messages() -> list[Message]:
    """What a hand does beside looking."""
    gizmo = {"name": "/lamps/0", "owner": ""}
    moved = {"wxyz": [1.0, 0.0, 0.0, 0.0], "position": [0.4, -1.5, 0.9]}
    return [
        set_message("exposure [stops]", 1.5),
        set_message("layer", "normals"),
        set_message("layer", "picture"),
        set_message("α body [1/sr]", 0.1),
        set_message("body colour", [200, 100, 50]),
        set_message("place [m]", [0.5, -1.9, 1.0]),
        set_message("eye [m]", [0.1, -1.0, 0.1]),
        set_message("look from there", True),
        set_message("", "undo"),
        {"type": "TransformControlsDragStartMessage", **gizmo},
        {"type": "TransformControlsUpdateMessage", **gizmo, **moved},
        {"type": "TransformControlsDragEndMessage", **gizmo},
        click_message(0.5, 0.5),
    ]


def set_message(label: str, value: Any) -> Message:
    """A widget is set."""
    return {"type": "GuiUpdateMessage", "uuid": placeholder(label), "updates": {"value": value}}


def click_message(x: float, y: float) -> Message:
    """A click into the picture."""
    return {
        "type": "ScenePointerMessage", "event_type": "click", "ray_origin": [0.0, -1.0, 0.0],
        "ray_direction": [0.0, 1.0, 0.0], "screen_pos": [[x, y]], "modifier": None,
    }  # fmt: skip


def placeholder(label: str) -> str:
    """Stands for the identifier of the first widget of that label, as many bytes long."""
    return f"<{label}>" + "." * (IDENTIFIER - len(f"<{label}>".encode()))


def spoil(files: dict[str, bytes], random: Random) -> None:
    """One to three things wrong: in a message, of another kind, in the bytes of a frame, or between messages."""
    (name,) = files
    frames: list[Any] = msgspec.msgpack.decode(files[name])
    for _ in range(int(random.choice((1, 1, 2, 3)))):
        at, chance = int(random.integers(len(frames))), random.random()
        if chance < 0.55 and isinstance(frames[at], dict):
            frames[at] = changed(frames[at], random)
        elif chance < 0.65:
            frames.insert(at, any_message(random))
        elif chance < 0.75:
            frames.insert(at, far_message(random))
        elif chance < 0.8:
            frames.insert(at, {"type": ADMISSIBLE, "seed": int(random.integers(2**32))})
        elif chance < 0.9:
            data = frames[at] if isinstance(frames[at], bytes) else encoded(frames[at])
            frames[at] = mutators._one_of(mutators.BYTES, random)(data, random)
        elif chance < 0.95:
            frames[at] = FRAMES[int(random.integers(len(FRAMES)))]
        else:
            frames[at : at + 1] = [frames[int(random.integers(len(frames)))]] * int(random.choice((0, 2, 40)))
        frames = frames or [b""]
    files[name] = msgspec.msgpack.encode(plain(frames))


def any_message(random: Random) -> Message:
    """A message of any kind that viser has, its fields filled with whatever there is."""
    from viser import _messages

    kinds = _messages.Message.get_subclasses()
    kind: Any = kinds[int(random.integers(len(kinds)))]
    names = [field.name for field in dataclasses.fields(kind)]
    known: Message = {"uuid": placeholder("exposure [stops]"), "name": "/lamps/0", "owner": "", "modifier": None}
    return {"type": kind.__name__} | {
        name: known.get(name, VALUES[int(random.integers(len(VALUES)))]) for name in names
    }


def far_message(random: Random) -> Message:
    """A message that is right, at the ends of what it may be."""
    numbers = (0.0, 1e-300, 1e-6, 0.15, -1.0, 1e6, -1e12, 1e12)
    place = [numbers[int(k)] for k in random.integers(len(numbers), size=3)]
    turn = random.normal(size=4) * random.integers(0, 2, size=4) + [1e-9, 0.0, 0.0, 0.0]
    turn = (turn / np.linalg.norm(turn)).tolist()
    window = [int(side) for side in random.choice((1, 2, 7, 640, 16384), size=2)]
    if random.random() < 0.6:
        more = {"wxyz": turn, "position": place, "image_height": window[0], "image_width": window[1]}
        return camera_message(0.0, fov=float(random.choice((1e-6, 0.5, 3.14))), **more)
    if random.random() < 0.5:
        moved = {"name": "/lamps/0", "owner": "", "wxyz": turn, "position": place}
        return {"type": "TransformControlsUpdateMessage", **moved}
    return click_message(*(float(one) for one in random.choice((-16.0, 0.0, 0.5, 1.0, 16.0), size=2)))


def plain(value: Any) -> Any:
    """The same without whole numbers that MessagePack has not."""
    if isinstance(value, dict):
        return {key: plain(one) for key, one in value.items()}
    if isinstance(value, list):
        return [plain(one) for one in value]
    return float(value) if isinstance(value, int) and not -(2**63) <= value < 2**64 else value


def encoded(frame: Any) -> bytes:
    """A message as a frame."""
    return frame if isinstance(frame, bytes) else msgspec.msgpack.encode(plain(frame))
