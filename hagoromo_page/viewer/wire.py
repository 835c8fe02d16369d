"""Wire: the web socket of a viewer, of whose messages viser hears only those that are right.

What is wrong with a message is a line in the log and nothing else. A browser that sends more than is heeded waits: its
messages are taken from the socket no faster than the viewer does what they ask for.
"""

from __future__ import annotations

import asyncio
import logging
from collections.abc import Callable
from contextvars import ContextVar
from typing import Any

from hagoromo.errors import InputError

LOG = logging.getLogger(f"hagoromo.{__name__}")
MOST_WAITING = 64  # things of one viewer that wait to be done
MOST_LINES = 20  # on one viewer's messages
PAUSE_S = 0.05  # after a message that was wrong, and while things wait
Check = Callable[[Any], bytes]  # a frame → the frame that viser is given; `InputError` of a wrong one


class Wire:
    """A socket of websockets, as viser uses it. number: of the viewer, in the log. put, done: things to do."""

    def __init__(self, socket: Any, number: int, check: Check) -> None:
        self._socket, self._number, self._check = socket, number, check
        self.put = self.done = self._wrong = 0  # `put` by the thread of the sockets, `done` by that of the pictures

    async def recv(self) -> bytes:
        """The next message that is right."""
        while True:
            await asyncio.sleep(0.0)  # the tasks that viser made of the last message put what they ask for
            while self.put - self.done >= MOST_WAITING:
                await asyncio.sleep(PAUSE_S)
            frame = await self._socket.recv()
            try:
                return self._check(frame)
            except InputError as error:
                self._say(error)
            await asyncio.sleep(PAUSE_S)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._socket, name)

    def _say(self, error: InputError) -> None:
        self._wrong += 1
        if self._wrong <= MOST_LINES:
            LOG.warning("viewer %d: not heeded: %s", self._number, error)
        if self._wrong == MOST_LINES:
            LOG.warning("viewer %d: further messages of this kind are not listed", self._number)


PRESENT: ContextVar[Wire | None] = ContextVar("wire", default=None)  # whose message is being handled
