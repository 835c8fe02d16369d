"""Server: the window's page, its pictures and its messages by HTTP, on this machine alone, to who has the token.

Plain HTTP of the standard library: what is drawn over photographs is drawn by the page itself, and nothing is pushed.
"""

from __future__ import annotations

import json
import logging
import threading
from collections.abc import Callable
from functools import cached_property
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from importlib.resources import files
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs, unquote, urlsplit

from hagoromo.errors import InputError
from hagoromo.files.checks import inside, read_bytes
from hagoromo.files.names import printable, reason
from hagoromo.files.record import json_value
from hagoromo_page.lab.folder import LAB
from hagoromo_page.lab.laboratory import Exists, Laboratory
from hagoromo_page.lab.messages import LARGEST_BODY
from hagoromo_page.viewer.admission import PRIVATE, Admission
from hagoromo_page.viewer.gate import check_free

LOG = logging.getLogger(f"hagoromo.{__name__}")
LOOPBACK = "127.0.0.1"
HERE = (LOOPBACK, "localhost")  # names of this machine that a request may be sent to: a page elsewhere has another
MOST_AT_ONCE = 16  # requests that are answered at a time
TIMEOUT_S = 30.0  # in which a request must be sent
REFUSAL = "open the address that hagoromo lab printed: it has a token\n"
OWN = "default-src 'self'; img-src 'self' data: blob:; style-src 'self' 'unsafe-inline'; frame-ancestors 'none'; base-uri 'none'; form-action 'none'"  # noqa: E501
FOREIGN = "sandbox allow-scripts"  # of results: their scripts run without this page's origin and its cookie
PAGES = {"/": ("lab.html", "text/html"), "/lab.css": ("lab.css", "text/css"), "/lab.js": ("lab.js", "text/javascript")}
KINDS = {".html": "text/html", ".png": "image/png", ".jpg": "image/jpeg", ".json": "text/plain", ".txt": "text/plain"}


class LabServer(ThreadingHTTPServer):
    """The window of a laboratory at a port of this machine. address: what to open, with the token."""

    daemon_threads = True

    def __init__(self, laboratory: Laboratory, port: int = 0) -> None:
        """Listen; `InputError` where that cannot be."""
        check_free(LOOPBACK, port)
        self.laboratory, self.admission = laboratory, Admission()
        self.free = threading.BoundedSemaphore(MOST_AT_ONCE)
        super().__init__((LOOPBACK, port), Request)
        self.address = self.admission.address(LOOPBACK, self.server_port)

    def stop(self) -> None:
        """End what runs, and listen no more."""
        self.laboratory.stop()
        self.server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """A connection that breaks off is no fault."""
        LOG.debug("a request broke off", exc_info=True)


class Request(BaseHTTPRequestHandler):
    """One request."""

    server: LabServer  # pyrefly: ignore[bad-override-mutable-attribute]
    timeout = TIMEOUT_S
    server_version, sys_version = "Hagoromo", ""

    @cached_property
    def query(self) -> dict[str, str]:
        """Values of the address."""
        return {key: values[0] for key, values in parse_qs(urlsplit(self.path).query, max_num_fields=10).items()}

    def do_GET(self) -> None:
        """A page, the state, a picture or a result."""
        self._answered(self._get)

    def do_POST(self) -> None:
        """A message."""
        self._answered(self._post)

    def _answered(self, answer: Callable[[], None]) -> None:
        with self.server.free:
            try:
                if self._comes_in():
                    answer()
            except Exists as error:
                self._json(HTTPStatus.CONFLICT, {"replaces": error.names})
            except (InputError, OSError, ValueError) as error:
                self._json(HTTPStatus.BAD_REQUEST, {"error": printable(error)})
            except Exception as error:
                LOG.error("a fault of the window, which goes on: %s: %s", type(error).__name__, reason(error))
                LOG.debug("it arose here", exc_info=True)
                self._json(HTTPStatus.INTERNAL_SERVER_ERROR, {"error": f"a fault of the program: {reason(error)}"})

    def _comes_in(self) -> bool:
        """Whether the request has the cookie and is for this machine; the refusal, or the cookie, in its place."""
        admission, port = self.server.admission, self.server.server_port
        if urlsplit(f"//{self.headers.get('Host', '')}").hostname not in HERE:
            self._send(HTTPStatus.FORBIDDEN, b"for another machine\n", "text/plain")
        elif self.command == "GET" and admission.by_token(self.path):
            more = ("Location", "/"), ("Set-Cookie", admission.cookie(port))
            self._send(HTTPStatus.FOUND, b"", "text/plain", *more)
        elif not admission.by_cookie(self.headers.get("Cookie", ""), port):
            self._send(HTTPStatus.FORBIDDEN, REFUSAL.encode(), "text/plain")
        elif self.command == "POST" and urlsplit(self.headers.get("Origin", "")).netloc != self.headers.get("Host"):
            self._send(HTTPStatus.FORBIDDEN, b"from another page\n", "text/plain")
        else:
            return True
        return False

    def _get(self) -> None:
        path, laboratory = urlsplit(self.path).path, self.server.laboratory
        if path in PAGES:
            name, kind = PAGES[path]
            page = (files("hagoromo_page.lab") / "page" / name).read_bytes()
            return self._send(HTTPStatus.OK, page, kind, ("Content-Security-Policy", OWN))
        if path == "/job":
            return self._json(HTTPStatus.OK, laboratory.progress())
        if path == "/state":
            return self._json(HTTPStatus.OK, laboratory.state())
        folder, pictures = laboratory.folder(), laboratory.pictures
        if path == "/photograph":
            data = pictures.photograph(folder, self.query.get("name", ""), self.query.get("size", ""))
            return self._send(HTTPStatus.OK, data, "image/jpeg")
        if path == "/brightest":
            return self._send(HTTPStatus.OK, pictures.brightest(folder), "image/jpeg")
        if path == "/overlay":
            return self._send(HTTPStatus.OK, pictures.overlay(folder), "image/png")
        if path == "/layer":
            return self._send(HTTPStatus.OK, pictures.layer(folder, self.query.get("name", "")), "image/png")
        if path.startswith("/result/"):
            return self._result(folder.home, unquote(path.removeprefix("/result/")))
        return self._send(HTTPStatus.NOT_FOUND, b"nothing is there\n", "text/plain")

    def _result(self, home: Path, name: str) -> None:
        """A file that a command wrote; its scripts run apart from this page."""
        path = inside(home / LAB, name.removeprefix(f"{LAB}/"))
        kind = KINDS.get(path.suffix.lower(), "application/octet-stream")
        self._send(HTTPStatus.OK, read_bytes(path), kind, ("Content-Security-Policy", FOREIGN))

    def _post(self) -> None:
        if urlsplit(self.path).path != "/do":
            return self._send(HTTPStatus.NOT_FOUND, b"nothing is there\n", "text/plain")
        stated = self.headers.get("Content-Length", "")
        if not stated.isdecimal() or len(stated) > 12:
            return self._send(HTTPStatus.LENGTH_REQUIRED, b"state the length of the message\n", "text/plain")
        if int(stated) > LARGEST_BODY:
            said = f"a message has {LARGEST_BODY} bytes at most\n".encode()
            return self._send(HTTPStatus.REQUEST_ENTITY_TOO_LARGE, said, "text/plain")
        self.server.laboratory.do(json_value(self.rfile.read(int(stated)), "the message"))
        return self._json(HTTPStatus.OK, self.server.laboratory.state())

    def _json(self, status: HTTPStatus, data: Any) -> None:
        text = json.dumps(data, ensure_ascii=True, allow_nan=False).encode()
        self._send(status, text, "application/json")

    def _send(self, status: HTTPStatus, body: bytes, kind: str, *more: tuple[str, str]) -> None:
        self.close_connection = True
        self.send_response(status)
        typed = f"{kind}; charset=utf-8" if kind.startswith(("text/", "application/json")) else kind
        for name, value in (("Content-Type", typed), ("Content-Length", str(len(body))), *PRIVATE, *more):
            self.send_header(name, value)
        self.end_headers()
        self.wfile.write(body)

    def log_message(self, format: str, *args: Any) -> None:
        """Requests are listed with --verbose alone, without the token."""
        LOG.debug("%s %s", self.command, urlsplit(self.path).path)
