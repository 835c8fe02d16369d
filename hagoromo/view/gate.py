"""Gate: viser's server, behind a token in its address and bounds on what may come in.

Viser itself lets anybody in who reaches its port. Its HTTP requests and the handshakes of its web sockets go through
one function, which is wrapped here: without the token, or the cookie that the token was changed for, both are refused.
"""

from __future__ import annotations

import hmac
import http
import io
import secrets
import socket
from collections.abc import Awaitable, Callable, Iterator
from contextlib import contextmanager, redirect_stdout
from http.cookies import CookieError, SimpleCookie
from typing import Any
from urllib.parse import parse_qs, urlsplit

from hagoromo.errors import InputError

TOKEN_BYTES = 24
MOST_VIEWERS = 8
LARGEST_MESSAGE = 1 << 20  # bytes that a browser may send at once
PRIVATE = (("Cache-Control", "no-store"), ("Referrer-Policy", "no-referrer"), ("X-Content-Type-Options", "nosniff"))
REFUSAL = "open the address that hagoromo view printed: it has a token\n"
Answer = Callable[[Any, Any], Any]


class Gate:
    """Who may come in: those with the token, MOST_VIEWERS at a time."""

    def __init__(self, most: int = MOST_VIEWERS) -> None:
        self.token, self.most, self.inside, self.stands = secrets.token_urlsafe(TOKEN_BYTES), most, 0, False

    def guarded(self, answer: Answer) -> Answer:
        """Viser's answer to a request; a refusal, or the cookie, in its place."""

        def answered(connection: Any, request: Any) -> Any:
            asked = urlsplit(request.path)
            name = f"hagoromo-{connection.local_address[1]}"
            if self._is_token(parse_qs(asked.query).get("token", [""])[0]):
                cookie = f"{name}={self.token}; Path=/; HttpOnly; SameSite=Strict"
                return _response(http.HTTPStatus.FOUND, "", ("Location", "/"), ("Set-Cookie", cookie))
            if not self._is_token(_cookie(request.headers.get("Cookie", ""), name)):
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

        return answered

    def counted(self, handle: Callable[[Any], Awaitable[None]]) -> Callable[[Any], Awaitable[None]]:
        """The handler of a web socket, which is counted while it is open."""

        async def handled(connection: Any) -> None:
            self.inside += 1
            try:
                await handle(connection)
            finally:
                self.inside -= 1

        return handled

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), self.token.encode())


def gated_server(host: str, port: int, gate: Gate) -> Any:
    """Viser's server behind a gate; `InputError` for an address that cannot be listened on, or a missing viser."""
    try:
        import viser
        from viser import _messages
    except ImportError:
        raise InputError("the viewer needs viser, which is not installed: pip install 'hagoromo[view]'") from None
    _check_free(host, port)
    with _through(gate), redirect_stdout(io.StringIO()):  # viser prints its address, without the token
        server = viser.ViserServer(host, port, label="Hagoromo", verbose=False)
    if not gate.stands:
        server.stop()
        raise RuntimeError(f"viser {viser.__version__} does not listen by websockets.asyncio.server.serve")
    for share in (_messages.ShareUrlRequest, _messages.ShareUrlDisconnect):  # would publish it through a relay
        server._websock_server.unregister_handler(share)
    return server


@contextmanager
def _through(gate: Gate) -> Iterator[None]:
    """Servers of web sockets that are made in this block stand behind `gate`."""
    from websockets.asyncio import server as sockets

    plain = sockets.serve

    def serve(handler: Any, *place: Any, **options: Any) -> Any:
        gate.stands = True
        guarded = gate.guarded(options.pop("process_request"))
        return plain(
            gate.counted(handler), *place, **options | {"process_request": guarded, "max_size": LARGEST_MESSAGE}
        )

    sockets.serve = serve
    try:
        yield
    finally:
        sockets.serve = plain


def _check_free(host: str, port: int) -> None:
    """`InputError` unless `port` of `host` can be listened on: viser would try others without end."""
    if not 0 <= port <= 65535:
        raise InputError(f"port is {port}: give 0 (a free one) to 65535")
    try:
        family, kind, protocol, _, place = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as trial:
            trial.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            trial.bind(place)
    except (OSError, UnicodeError) as error:
        raise InputError(f"cannot listen on {host}, port {port}: {error}: give another --host or --port") from None


def _cookie(header: str, name: str) -> str:
    try:
        morsel = SimpleCookie(header).get(name)
    except CookieError:
        return ""
    return "" if morsel is None else morsel.value


def _response(status: http.HTTPStatus, text: str, *headers: tuple[str, str]) -> Any:
    from websockets import Headers
    from websockets.http11 import Response

    body = text.encode()
    kind = ("Content-Type", "text/plain; charset=utf-8"), ("Content-Length", str(len(body)))
    return Response(status.value, status.phrase, Headers([*headers, *kind, *PRIVATE]), body)
