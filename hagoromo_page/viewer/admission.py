"""Admission: who may come in. The address that is printed holds a token; whoever opens it gets a cookie for it."""

from __future__ import annotations

import hmac
import secrets
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qs, urlsplit

TOKEN_BYTES = 24
PRIVATE = (("Cache-Control", "no-store"), ("Referrer-Policy", "no-referrer"), ("X-Content-Type-Options", "nosniff"))


class Admission:
    """A token, new with every start. Each port has a cookie of its own, as cookies do not know ports."""

    def __init__(self) -> None:
        self.token = secrets.token_urlsafe(TOKEN_BYTES)

    def by_token(self, target: str) -> bool:
        """Whether the address that is asked for holds the token; ValueError for one that is none."""
        return self._is_token(parse_qs(urlsplit(target).query).get("token", [""])[0])

    def by_cookie(self, header: str, port: int) -> bool:
        """Whether the cookies of a request, as its header has them, hold the token."""
        try:
            morsel = SimpleCookie(header).get(_name(port))
        except CookieError:
            return False
        return morsel is not None and self._is_token(morsel.value)

    def cookie(self, port: int) -> str:
        """The cookie, as a header sets it."""
        return f"{_name(port)}={self.token}; Path=/; HttpOnly; SameSite=Strict"

    def address(self, host: str, port: int) -> str:
        """What to open, with the token."""
        return f"http://{f'[{host}]' if ':' in host else host}:{port}/?token={self.token}"

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), self.token.encode())


def _name(port: int) -> str:
    return f"hagoromo-{port}"
