"""Gate: viser's server, behind a token in its address and a check of every message that comes in.

Viser itself lets anybody in who reaches its port. Its HTTP requests and the handshakes of its web sockets go through
one function, which is wrapped here: without the token, or the cookie that the token was changed for, both are refused.
The sockets of those who are let in are wrapped, too: see `Wire`.
"""

from __future__ import annotations

import asyncio
import http
import io
import logging
import socket
from collections import ChainMap
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from typing import Any
from urllib.parse import urlsplit

from hagoromo.errors import InputError
from hagoromo.files.names import reason
from hagoromo_page.viewer.admission import PRIVATE, Admission
from hagoromo_page.viewer.messages import LARGEST_FRAME, checked
from hagoromo_page.viewer.wire import PRESENT, Wire

LOG = logging.getLogger(f"hagoromo.{__name__}")
MOST_VIEWERS = 8
REFUSAL = "open the address that hagoromo view printed: it has a token\n"
Answer = Callable[[Any, Any], Any]


class Gate:
    """Who may come in, those with the token, MOST_VIEWERS at a time; and which of their messages.

    server: of viser, whose widgets may be set; until it is there, no message is heeded.
    """

    def __init__(self, most: int = MOST_VIEWERS) -> None:
        self.admission, self.most, self.inside, self.stands = Admission(), most, 0, False
        self.server: Any = None
        self._came = 0

    def guarded(self, answer: Answer) -> Answer:
        """Viser's answer to a request; a refusal, or the cookie, in its place."""

        def answered(connection: Any, request: Any) -> Any:
            try:
                return self._answer(answer, connection, request)
            except (ValueError, OSError) as error:  # an address that is none, a name that no file has
                LOG.info("a request is not answered: %s", reason(error))
                return _response(http.HTTPStatus.BAD_REQUEST, "bad request\n")

        return answered

    def _answer(self, answer: Answer, connection: Any, request: Any) -> Any:
        port = connection.local_address[1]
        if self.admission.by_token(request.path):
            return _response(http.HTTPStatus.FOUND, "", ("Location", "/"), ("Set-Cookie", self.admission.cookie(port)))
        if not self.admission.by_cookie(request.headers.get("Cookie", ""), port):
            return _response(http.HTTPStatus.FORBIDDEN, REFUSAL)
        if request.headers.get("Upgrade", "").lower() == "websocket":
            if urlsplit(request.headers.get("Origin", "")).netloc != request.headers.get("Host"):
                return _response(http.HTTPStatus.FORBIDDEN, "from another page\n")
            if self.inside >= self.most:
                return _response(http.HTTPStatus.SERVICE_UNAVAILABLE, f"{self.most} viewers are here already\n")
        response = answer(connection, request)
        if response is not None:
            response.headers.update(PRIVATE)
        return response

    def watched(self, handle: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """The handler of a web socket, which is counted while it is open, and whose messages are checked."""

        async def handled(connection: Any) -> None:
            self.inside, self._came = self.inside + 1, self._came + 1
            wire = Wire(connection, self._came, self._checked)
            PRESENT.set(wire)  # the tasks that viser makes for each message inherit it
            try:
                await handle(wire)
            finally:
                self.inside -= 1

        return handled

    def _checked(self, frame: Any) -> bytes:
        """See `checked`; of viser's parts those that hold what a browser may set."""
        if self.server is None:
            raise InputError("the viewer is not ready")
        scopes = [self.server, *self.server.get_clients().values()]
        widgets = ChainMap(*(one.gui._gui_input_handle_from_uuid for one in scopes))
        return checked(frame, widgets, self.server.scene._handle_from_transform_controls_name)


def gated_server(host: str, port: int, gate: Gate) -> Any:
    """Viser's server behind a gate; `InputError` for an address that cannot be listened on, or a missing viser."""
    try:
        import viser
        from viser import _messages
    except ImportError:
        raise InputError("the viewer needs viser, which is not installed: pip install 'hagoromo[view]'") from None
    check_free(host, port)
    with _through(gate), redirect_stdout(io.StringIO()):  # viser prints its address, without the token
        server = viser.ViserServer(host, port, label="Hagoromo", verbose=False)
    if not gate.stands:
        server.stop()
        raise RuntimeError(f"viser {viser.__version__} does not listen by websockets.asyncio.server.serve")
    sockets: Any = server._websock_server
    for share in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):  # would publish it through a relay
        sockets.unregister_handler(share)
    loop = server._event_loop
    loop.set_exception_handler(_log_fault)
    sockets._broadcast_buffer.message_event = Woken(loop)
    sockets.on_client_connect(lambda one: setattr(one._state.message_buffer, "message_event", Woken(loop)))
    gate.server = server
    return server


class Woken(asyncio.Event):
    """Wakes what sends messages, by its own loop alone.

    Viser sets this event in the thread that has a message, too, whose waiters the loop may be changing at that time: an
    exception now and then, in a thread that has done nothing wrong. It is set through the loop in any case.
    """

    def __init__(self, loop: asyncio.AbstractEventLoop) -> None:
        super().__init__()
        self._own = loop

    def set(self) -> None:
        """Set it, if this is the loop's thread."""
        try:
            here = asyncio.get_running_loop()
        except RuntimeError:  # no loop runs in this thread
            return
        if here is self._own:
            super().set()


@contextmanager
def _through(gate: Gate) -> Iterator[None]:
    """Servers of web sockets that are made in this block stand behind `gate`."""
    from websockets.asyncio import server as sockets

    plain = sockets.serve

    def serve(handler: Any, *place: Any, **options: Any) -> Any:
        gate.stands = True
        options |= {"process_request": gate.guarded(options["process_request"]), "logger": _log_of_sockets()}
        return plain(gate.watched(handler), *place, **options | {"max_size": LARGEST_FRAME})

    sockets.serve = serve  # pyrefly: ignore[bad-assignment]
    try:
        yield
    finally:
        sockets.serve = plain


def _log_of_sockets() -> logging.Logger:
    """What websockets says, a line each, without tracebacks; nothing of those who were not let in."""
    log = logging.getLogger(f"{__name__}.sockets")
    log.addFilter(_in_one_line)
    return log


def _in_one_line(record: logging.LogRecord) -> bool:
    error = record.exc_info[1] if record.exc_info else None
    if error is not None:
        record.msg, record.args = f"{record.getMessage()}: {reason(error)}", ()
        record.exc_info = record.exc_text = None
    return record.levelno > logging.INFO and not record.msg.startswith("opening handshake failed")


def _log_fault(loop: Any, what: dict[str, Any]) -> None:
    """A fault in one of viser's tasks, in one line."""
    LOG.error("a fault of the viewer, which goes on: %s", reason(what.get("exception") or what["message"]))


def check_free(host: str, port: int) -> None:
    """`InputError` unless `port` of `host` can be listened on: viser would try others without end."""
    if not 0 <= port <= 65535:
        raise InputError(f"port is {port}: give 0 (a free one) to 65535")
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(place)
    except (OSError, UnicodeError) as error:
        raise InputError(f"cannot listen on {host}, port {port}: {error}: give another port or address") from None


def _response(status: http.HTTPStatus, text: str, *headers: tuple[str, str]) -> Any:
    from websockets import Headers
    from websockets.http11 import Response

    body = text.encode()
    kind = ("Content-Type", "text/plain; charset=utf-8"), ("Content-Length", str(len(body)))
    return Response(status.value, status.phrase, Headers([*headers, *kind, *PRIVATE]), body)
