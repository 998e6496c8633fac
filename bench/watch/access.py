"""Who may look: everybody on this computer, or whoever has the token.

A page that listens on this computer only answers to its own names, so that no page of the internet can ask it under
another one (DNS rebinding). One that other computers can reach wants a token.
"""

from __future__ import annotations

import hmac
import ipaddress
import re
import secrets
from dataclasses import dataclass, field
from http.cookies import CookieError, SimpleCookie
from typing import TYPE_CHECKING, Final
from urllib.parse import parse_qs

from protocols.errors import InputError

if TYPE_CHECKING:
    from starlette.types import ASGIApp, Message, Receive, Scope, Send

__all__ = ["Access", "Guard", "access_for", "is_loopback"]

_TOKEN: Final = re.compile(r"[A-Za-z0-9_~.-]{8,200}")
_LOCAL_NAMES: Final = frozenset({"localhost", "127.0.0.1", "[::1]"})
_HEADERS: Final = (
    (
        b"content-security-policy",
        b"default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src 'self'; "
        b"base-uri 'none'; form-action 'none'; frame-ancestors 'none'",
    ),
    (b"x-content-type-options", b"nosniff"),
    (b"referrer-policy", b"no-referrer"),
    (b"cross-origin-opener-policy", b"same-origin"),
    (b"cross-origin-resource-policy", b"same-origin"),
    (b"cache-control", b"no-store"),
)


@dataclass(frozen=True, slots=True)
class Access:
    """Who may look."""

    names: frozenset[str] | None  #: host names that are answered to; None for all
    token: str | None = field(repr=False)  #: None where none is wanted


def is_loopback(host: str) -> bool:
    """Return whether only this computer reaches a page that listens on `host`."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host.lower() == "localhost"


def access_for(host: str, token: str | None) -> Access:
    """Return who may look at a page that listens on `host`.

    Parameters
    ----------
    token
        The token that is wanted; None makes one up where other computers reach the page.

    Raises
    ------
    InputError
        If the token is too short to be one, or cannot stand in an address.
    """
    if token is not None and not _TOKEN.fullmatch(token):
        raise InputError("--token: expected 8 to 200 letters, digits or any of - _ . ~")
    if not is_loopback(host):
        return Access(None, token or secrets.token_urlsafe(18))
    return Access(_LOCAL_NAMES | {_bracketed(host.lower())}, token)


def _bracketed(host: str) -> str:
    return f"[{host}]" if ":" in host else host


class Guard:
    """Lets a request through to the page, or answers it itself; adds the headers that keep a browser careful.

    Parameters
    ----------
    app
        The page.
    access
        Who may look.
    """

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self._app = app
        self._access = access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer one request."""
        if scope["type"] != "http":
            return

        async def send_carefully(message: Message) -> None:
            if message["type"] == "http.response.start":
                headers = [(k, v) for k, v in message.get("headers", []) if k.lower() != b"cache-control"]
                message = {**message, "headers": [*headers, *_HEADERS]}
            await send(message)

        answer = self._refusal(scope) or self._entrance(scope)
        await (answer or self._app)(scope, receive, send_carefully)

    def _refusal(self, scope: Scope) -> ASGIApp | None:
        """Return the answer to a request that is not let through, None if it is."""
        from starlette.responses import PlainTextResponse

        host = _header(scope, b"host")
        if self._access.names is not None and _name(host) not in self._access.names:
            return PlainTextResponse("This page answers to the name localhost only.\n", 421)
        if self._access.token is None or self._has_token(scope) or self._brings_token(scope):
            return None
        text = "This page needs its token: open the whole address that evs-bench watch printed.\n"
        return PlainTextResponse(text, 401)

    def _entrance(self, scope: Scope) -> ASGIApp | None:
        """Return the way in for a first visit: the token goes into a cookie, and out of the address."""
        from starlette.responses import RedirectResponse

        if self._access.token is None or scope["path"] != "/" or not self._brings_token(scope):
            return None
        answer = RedirectResponse("/", 303)
        answer.set_cookie(_cookie(scope), self._access.token, httponly=True, samesite="strict", path="/")
        return answer

    def _has_token(self, scope: Scope) -> bool:
        try:
            cookie = SimpleCookie(_header(scope, b"cookie")).get(_cookie(scope))
        except CookieError:
            return False
        return cookie is not None and self._is_token(cookie.value)

    def _brings_token(self, scope: Scope) -> bool:
        query = parse_qs(scope.get("query_string", b"").decode("latin-1"))
        return self._is_token(query.get("token", [""])[0])

    def _is_token(self, text: str) -> bool:
        return hmac.compare_digest(text.encode(), (self._access.token or "").encode()) and bool(text)


def _header(scope: Scope, name: bytes) -> str:
    values = [value for key, value in scope["headers"] if key.lower() == name]
    return bytes(values[0]).decode("latin-1") if values else ""


def _name(host: str) -> str:
    """Return the name in a Host header, without its port."""
    return re.sub(r":\d*$", "", host.strip().lower())


def _cookie(scope: Scope) -> str:
    """Return the name of the cookie: cookies know no ports, and several runs may be watched."""
    return f"evs_bench_watch_{(scope.get('server') or ('', 0))[1]}"
