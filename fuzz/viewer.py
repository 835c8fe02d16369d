"""The viewer, over a real web socket: whatever a session sends, it answers another browser.

It says a line at most for each message, and has no fault of its own.
"""

from __future__ import annotations

import atexit
import contextlib
import functools
import http.client
import logging
import shutil
import tempfile
import time
import zlib
from collections.abc import Callable, Iterator, Sequence
from importlib.metadata import version
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import msgspec
import numpy as np

from fuzz import pictures
from fuzz.viewer_session import ADMISSIBLE, Message, Random, camera_message, encoded, placeholder

PATIENCE_S = 300.0  # for a picture, by the clock: a watchdog
PAUSE_S = 0.005  # between two messages, in which the viewer may do what the first asks for
LAST_WIDTH = 101  # px of a window, by which the end of a session is known
SCENE = """
[camera]
size = [31, 23]
focal = [45.0, 45.0]
eye = [0.0, -1.0, 0.0]
[[lamp]]
name = "key"
position = [0.5, -2.0, 1.0]
intensity = 3.0
[[surface]]
name = "ball"
shape = "sphere"
scale = 0.15
reflectance = {alpha = 0.2, beta = 0.5, gamma = 0.2, n = 1.5, body_colour = 0.8}
"""


class Visitor:
    """A browser's socket: what it learnt of widgets, label → identifiers, and how many pictures came."""

    def __init__(self, address: str) -> None:
        from websockets.sync.client import connect
        from websockets.typing import Origin, Subprotocol

        place = urlsplit(address)
        home = f"{place.hostname}:{place.port}"
        link = http.client.HTTPConnection(home, timeout=PATIENCE_S)
        with contextlib.closing(link):
            link.request("GET", f"/?{place.query}")
            cookie = (link.getresponse().getheader("Set-Cookie") or "").partition(";")[0]
        self.socket: Any = connect(
            f"ws://{home}/", origin=Origin(f"http://{home}"), additional_headers={"Cookie": cookie},
            subprotocols=[Subprotocol(f"viser-v{version('viser')}")], max_size=1 << 28, ping_interval=None,
        )  # fmt: skip
        self.widgets: dict[str, str] = {}
        self.offered: list[Message] = []
        self.pictures, self.gone = 0, False

    def send(self, frame: Any) -> None:
        """A message, or a frame as it is, with the identifiers of widgets that it knows."""
        from websockets.exceptions import ConnectionClosed

        if isinstance(frame, dict) and frame.get("type") == ADMISSIBLE:
            frame = self.admissible(np.random.default_rng(zlib.crc32(repr(frame.get("seed")).encode())))
        if not isinstance(frame, str):
            frame = encoded(frame)
            for label, identifier in self.widgets.items():
                frame = frame.replace(placeholder(label).encode(), identifier.encode())
        with contextlib.suppress(ConnectionClosed):
            self.socket.send(frame)

    def listen(self) -> None:
        """Take what came."""
        from websockets.exceptions import ConnectionClosed

        try:
            while True:
                self._take(self.socket.recv(timeout=0.0))
        except TimeoutError:
            return
        except ConnectionClosed:
            self.gone = True

    def sees(self) -> bool:
        """Whether a picture came, or the socket is gone."""
        self.listen()
        return self.gone or self.pictures > 0

    def _take(self, data: bytes) -> None:
        import zstandard

        size = int.from_bytes(data[8:16], "little")
        held = msgspec.msgpack.decode(zstandard.ZstdDecompressor().decompress(data[16 : 16 + size]))
        for message in held["messages"]:
            kind = message["type"]
            self.pictures += kind == "BackgroundImageMessage" and message["rgb_data"] is not None
            label = message.get("props", {}).get("label")
            if kind.startswith("Gui") and label is not None:
                self.widgets.setdefault(label, message["uuid"])
                self.offered.append(message)

    def admissible(self, random: Random) -> Message:
        """Any widget set to any value that it may have, often one at the end."""
        one = self.offered[int(random.integers(len(self.offered)))]
        kind, props = one["type"].removeprefix("Gui").removesuffix("Message"), one["props"]
        value: Any = True
        if "options" in props:
            value = props["options"][int(random.integers(len(props["options"])))]
        elif kind == "Slider":
            value = float(random.choice((props["min"], props["max"], random.uniform(props["min"], props["max"]))))
        elif kind == "Rgb":
            value = [int(k) for k in random.choice((0, 255, 100), size=3)]
        elif kind == "Vector3":
            value = [float(k) for k in random.choice((0.0, 1e-30, 0.1, -1.0, 1e6, 1e12), size=3)]
        return {"type": "GuiUpdateMessage", "uuid": one["uuid"], "updates": {"value": value}}

    def close(self) -> None:
        """Leave."""
        self.socket.close()


class Served:
    """A viewer of what lies at a path, with a bystander who looks on."""

    def __init__(self, path: Path) -> None:
        from hagoromo_page.viewer.browser import Browser
        from hagoromo_page.viewer.open_desk import open_desk

        self.browser = Browser(open_desk(path), "127.0.0.1", 0)
        self.first = self.browser.desk.state
        self.bystander = Visitor(self.browser.address)
        self.turn = 0.0
        self.check()

    def check(self) -> None:
        """The bystander moves, and gets a picture."""
        while self.browser.step():
            pass
        self.bystander.listen()
        self.turn += 0.05
        before, width = self.bystander.pictures, 60 + round(self.turn / 0.05) % 30
        self.bystander.send(camera_message(self.turn, image_width=width))
        self.until(lambda: self.bystander.pictures > before)

    def attend(self, frames: Sequence[Any]) -> None:
        """Another browser joins, sends the frames and leaves."""
        known = set(self.browser.watchers)
        with contextlib.closing(Visitor(self.browser.address)) as visitor:
            visitor.send(camera_message(0.3))
            self.until(lambda: bool(set(self.browser.watchers) - known))
            self.until(visitor.sees)  # a picture comes after the widgets, of which the frames speak
            self.heard(visitor, known, LAST_WIDTH - 1)
            for frame in frames:
                visitor.send(frame)
                self.browser.step(PAUSE_S)
            self.heard(visitor, known, LAST_WIDTH)
        self.until(lambda: not set(self.browser.watchers) - known)

    def heard(self, visitor: Visitor, known: set[int], width: int) -> None:
        """Serve until all that a visitor sent was heeded, or the visitor is gone; by a window of a width of its own."""
        visitor.send(camera_message(0.3, image_width=width))

        def holds() -> bool:
            visitor.listen()
            new = [self.browser.watchers[one] for one in set(self.browser.watchers) - known]
            return visitor.gone or any(watcher._window[0] == width for _, watcher in new)

        self.until(holds)
        while self.browser.step():
            visitor.listen()

    def reset(self) -> None:
        """Whatever was edited is as at first."""
        desk: Any = self.browser.desk
        desk.edit(self.first, "reset")
        self.browser.panel.refresh()

    def until(self, holds: Callable[[], bool]) -> None:
        """Serve until something holds."""
        end = time.monotonic() + PATIENCE_S
        while not holds():
            if time.monotonic() > end:
                raise RuntimeError("the viewer does not answer")
            self.browser.step(0.005)
            self.bystander.listen()


@functools.cache
def served(name: str) -> Served:
    """One for all sessions of a process, of a small scene or image."""
    folder = Path(tempfile.mkdtemp(prefix="fuzz-viewer-"))
    atexit.register(shutil.rmtree, folder, True)
    if name.endswith(".toml"):
        (folder / name).write_text(SCENE)
    else:
        pictures.rendered(folder / name)
    found = Served(folder / name)
    atexit.register(found.browser.stop)
    return found


class _Kept(logging.Handler):
    """Keeps what is said."""

    def __init__(self, said: list[logging.LogRecord]) -> None:
        super().__init__()
        self.said = said

    def emit(self, record: logging.LogRecord) -> None:
        """Keep it."""
        self.said.append(record)


@contextlib.contextmanager
def lines() -> Iterator[list[logging.LogRecord]]:
    """What the viewer says meanwhile."""
    log, said = logging.getLogger("hagoromo"), list[logging.LogRecord]()
    handler = _Kept(said)
    propagates, log.propagate = log.propagate, False
    log.addHandler(handler)
    try:
        yield said
    finally:
        log.removeHandler(handler)
        log.propagate = propagates


def read_of(name: str) -> Callable[[Path], None]:
    """What sends a session to the viewer of a scene or image; see `sent`."""
    return lambda path: sent(msgspec.msgpack.decode(path.read_bytes()), name)


def sent(frames: Sequence[Any], name: str = "scene.toml") -> None:
    """Send a session; `InputError` with the first line that the viewer said of it, RuntimeError of a fault."""
    from hagoromo.errors import InputError

    with lines() as said:
        viewer = served(name)
        viewer.attend(frames)
        viewer.reset()
        viewer.check()
    faults = [one.getMessage() for one in said if one.levelno >= logging.ERROR]
    if faults:
        raise RuntimeError(f"the viewer has a fault: {faults[0]}")
    if len(said) > len(frames):
        raise RuntimeError(f"{len(said)} lines on {len(frames)} messages")
    if said:
        raise InputError(said[0].getMessage())
