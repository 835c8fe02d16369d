"""Browser: viewers by viser, each with a camera of its own, before one desk.

Viser calls from its threads. Each call only reads what was asked for and puts it into a queue, which the thread that
traces rays takes from between two pictures: all else is done by one thread, in the order of the calls. A fault in what
one viewer asked for is a line in the log, and the others go on.
"""

from __future__ import annotations

import io
import logging
import math
import queue
import warnings
from collections.abc import Callable
from contextlib import redirect_stdout
from typing import Any

import numpy as np
from numpy.typing import NDArray

from hagoromo.camera.camera import Camera
from hagoromo.camera.pose import inverse_pose, pose_of
from hagoromo.errors import InputError
from hagoromo.files.names import reason
from hagoromo_page.viewer.gate import Gate, gated_server
from hagoromo_page.viewer.own_panel import OwnPanel
from hagoromo_page.viewer.panel import Panel
from hagoromo_page.viewer.picture_desk import PictureDesk, PictureWatcher
from hagoromo_page.viewer.watcher import Desk, Watcher
from hagoromo_page.viewer.wire import PRESENT

LOG = logging.getLogger(f"hagoromo.{__name__}")
WAIT_S = 0.5  # for something to do; Ctrl-C is heard within
LEFT = "Queued a .* on a closed connection"  # how viser warns of what is sent to a viewer that has left
JPEG_QUALITY = 90  # of pictures that a better one follows; the last is lossless
NOTICE_S = 8.0  # for which a notice stays
SURROUND = 24  # display value beside a picture of another shape than the window
LONGEST_WINDOW = 8.0  # of a window's sides, the longer over the shorter: a picture is not padded to more


class Browser:
    """The viewers of a desk. address: what to open, with the token."""

    def __init__(self, desk: Desk | PictureDesk, host: str, port: int) -> None:
        """Listen on `port` of `host` (0: any free one); `InputError` where that cannot be."""
        gate = Gate()
        self.desk, self.server = desk, gated_server(host, port, gate)
        self.events: queue.SimpleQueue[Callable[[], None]] = queue.SimpleQueue()
        self.watchers: dict[int, tuple[OwnPanel, Watcher | PictureWatcher]] = {}
        self.address = gate.admission.address(host, self.server.get_port())
        self._place_cameras()
        self.server.gui.configure_theme(dark_mode=True, show_logo=False, show_share_button=False)
        self.server.gui.main_panel.dock_right()
        self.panel = Panel(self.server, desk, self._queued)
        self.server.scene.on_click()(self._queued(self._clicked, lambda event: (event.client_id, event.screen_pos)))
        self.server.on_client_connect(self._queued(self._joins))
        self.server.on_client_disconnect(self._queued(self._leaves))

    def run(self) -> None:
        """Serve until an interrupt."""
        busy = False
        while True:
            busy = self.step(0.0 if busy else WAIT_S)

    def step(self, seconds: float = 0.0) -> bool:
        """Do what viewers asked for, waiting up to `seconds` for it, and send each a picture; whether any was due.

        A viewer may leave while something is sent to it, which is no fault: viser's warning of that is not passed on.
        """
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", LEFT, UserWarning)
            self._heed(seconds)
            return self._show()

    def stop(self) -> None:
        """End the server and let go of the viewers."""
        self.watchers.clear()
        with redirect_stdout(io.StringIO()):
            self.server.stop()

    def _queued(self, act: Callable[..., None], read: Callable[..., tuple[Any, ...] | None] | None = None) -> Any:
        """A callback of viser that puts `act` into the queue, in the order of the calls.

        read: gives what `act` is called with, from what viser calls with and at that time: widgets change meanwhile.
        None: there is nothing to do.
        """

        async def queued(*what: Any) -> None:
            given, wire = what if read is None else read(*what), PRESENT.get()
            if given is None:
                return
            if wire is not None:
                wire.put += 1

            def done() -> None:
                try:
                    act(*given)
                finally:
                    if wire is not None:
                        wire.done += 1

            self.events.put(done)

        return queued

    def _heed(self, seconds: float) -> None:
        """Do all that viewers have asked for by now; wait for the first up to `seconds`."""
        for number in range(self.events.qsize() or 1):  # what comes meanwhile waits for the next picture
            try:
                act = self.events.get(seconds > 0.0 and number == 0, seconds or None)
            except queue.Empty:
                return
            try:
                act()
            except InputError as error:
                self.panel.say(f"not done: {error}")
            except Exception as error:
                _log_fault(error)

    def _show(self) -> bool:
        """Send each viewer its next picture; whether there was any."""
        any_shown = False
        for own, watcher in list(self.watchers.values()):
            try:
                any_shown = self._show_one(own.client, watcher) or any_shown
            except InputError as error:
                own.client.add_notification("Hagoromo", str(error), auto_close_seconds=NOTICE_S)
            except Exception as error:
                _log_fault(error)
        return any_shown

    def _show_one(self, client: Any, watcher: Watcher | PictureWatcher) -> bool:
        """Send a viewer its next picture; whether there was one."""
        shown = watcher.next()
        if shown is None:
            return False
        picture = in_window(shown.picture, client.camera.aspect)
        kind: Any = "png" if shown.last else "jpeg"
        client.scene.set_background_image(picture, format=kind, jpeg_quality=JPEG_QUALITY)
        client.flush()
        return True

    def _joins(self, client: Any) -> None:
        watcher = self.desk.watcher()
        own = OwnPanel(client, watcher, self.panel)
        self.watchers[client.client_id] = own, watcher
        own.jump(self.desk.camera)
        client.camera.on_update(self._queued(self._moved))

    def _leaves(self, client: Any) -> None:
        self.watchers.pop(client.client_id, None)

    def _moved(self, camera: Any) -> None:
        if camera.client.client_id not in self.watchers:
            return
        own, watcher = self.watchers[camera.client.client_id]
        watcher.fit(camera.image_width, camera.image_height)
        own.moved(pose_from_viser(camera.wxyz, camera.position))
        fov = field_of_view(self.desk.camera, camera.aspect)
        if abs(fov - camera.fov) > 1e-4:
            camera.fov = fov

    def _clicked(self, client_id: int, place: tuple[float, float]) -> None:
        if client_id in self.watchers:
            self.watchers[client_id][0].clicked(*place)

    def _place_cameras(self) -> None:
        """Cameras of new viewers stand where that of the desk does, and turn about what it sees."""
        first, camera, target = self.server.initial_camera, self.desk.camera, self.desk.target
        away = float(np.linalg.norm(target - camera.position))
        first.position, first.look_at = camera.position, target
        first.up, first.fov = -camera.world_to_camera[1, :3], field_of_view(camera, camera.width / camera.height)
        first.near, first.far = 1e-3 * away, 1e3 * away


def pose_from_viser(wxyz: NDArray[np.float64], position: NDArray[np.float64]) -> NDArray[np.float64]:
    """World-to-camera pose (4, 4) of a unit quaternion camera → world and a place, both in OpenCV's axes."""
    w, x, y, z = np.asarray(wxyz, np.float64) / np.linalg.norm(wxyz)
    rotation = np.array([
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)],
        [2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)],
        [2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)],
    ])  # fmt: skip
    return inverse_pose(pose_of(rotation, np.asarray(position, np.float64)))


def field_of_view(camera: Camera, aspect: float) -> float:
    """Vertical field of view [rad] of a window, width over height `aspect`, in which the whole picture stands."""
    height = max(camera.height, camera.width / max(aspect, 1e-3))
    return 2.0 * math.atan(0.5 * height / camera.focal[1])


def in_window(picture: NDArray[np.uint8], aspect: float) -> NDArray[np.uint8]:
    """The picture in the middle of one of the window's shape, width over height `aspect`; 1:8 to 8:1 at most."""
    height, width = picture.shape[:2]
    aspect = min(max(aspect, 1.0 / LONGEST_WINDOW), LONGEST_WINDOW)
    aside = max(round(height * aspect) - width, 0) // 2
    above = max(round(width / aspect) - height, 0) // 2
    return np.pad(picture, ((above, above), (aside, aside), (0, 0)), constant_values=SURROUND)


def _log_fault(error: Exception) -> None:
    """One line on what no viewer should be able to cause; where it arose, with --verbose."""
    LOG.error("a fault of the viewer, which goes on: %s: %s", type(error).__name__, reason(error))
    LOG.debug("it arose here", exc_info=error)
