"""A web hook: an HTTP POST of a small JSON document."""

from __future__ import annotations

import base64
import http.client
import json
import urllib.error
import urllib.request
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Final
from urllib.parse import SplitResult, unquote, urlsplit

from bench.notices.way import NotSent, not_sent

if TYPE_CHECKING:
    import ssl

    from bench.notices.notice import Notice

__all__ = ["Webhook", "url_problem"]

_LOCAL: Final = ("localhost", "127.0.0.1", "::1")
#: Answers after which the same request may go through later.
_LATER: Final = (408, 425, 429)


def url_problem(url: str, *, token: bool) -> str | None:
    """Return why no notice can be posted to `url`, None if it can; the address itself is not in it."""
    try:
        parts = urlsplit(url)
        known = parts.scheme in ("http", "https") and bool(parts.hostname)
        _ = parts.port
    except ValueError:
        known = False
    if not known or not url.isascii() or not url.isprintable() or " " in url:
        return "this is no address of the web, expected https://HOST/PATH"
    if (token or parts.password is not None) and parts.scheme == "http" and parts.hostname not in _LOCAL:
        return "a token or a password is not sent in the clear: the address must begin with https://"
    return None


class _NoRedirect(urllib.request.HTTPRedirectHandler):
    """A POST that is sent elsewhere would arrive without its document, and the token with a stranger."""

    def redirect_request(self, *_: Any, **__: Any) -> None:
        """Follow none."""


@dataclass(frozen=True, slots=True)
class Webhook:
    """An address that notices are posted to.

    Parameters
    ----------
    url
        The address, which :func:`url_problem` has nothing against. A name and password in it are sent as such.
    token
        Sent as ``Authorization: Bearer``; None for none.
    context
        What a secure connection trusts.
    """

    url: str = field(repr=False)
    token: str | None = field(repr=False)
    context: ssl.SSLContext = field(repr=False)

    @property
    def name(self) -> str:
        """Scheme and host alone: chat services keep their secret in the path."""
        parts = urlsplit(self.url)
        return f"webhook {parts.scheme}://{_host(parts)}"

    def send(self, notice: Notice, timeout_s: float) -> None:
        """Post a notice; any answer of 2xx is good."""
        handlers = (_NoRedirect(), urllib.request.HTTPSHandler(context=self.context))
        try:
            opener = urllib.request.build_opener(*handlers)
            with opener.open(self._request(notice), timeout=timeout_s):
                pass
        except urllib.error.HTTPError as error:
            error.close()
            raise _refused(error.code) from None
        except urllib.error.URLError as error:
            reason = error.reason
            raise (
                not_sent(reason, timeout_s)
                if isinstance(reason, OSError)
                else NotSent("cannot be reached", again=True)
            ) from None
        except http.client.HTTPException as error:
            raise NotSent(f"the answer is no HTTP ({type(error).__name__})", again=True) from None
        except OSError as error:
            raise not_sent(error, timeout_s) from None

    def _request(self, notice: Notice) -> urllib.request.Request:
        parts = urlsplit(self.url)
        headers = {"Content-Type": "application/json; charset=utf-8", "User-Agent": "evs-bench"}
        if parts.username is not None:
            pair = f"{unquote(parts.username)}:{unquote(parts.password or '')}"
            headers["Authorization"] = f"Basic {base64.b64encode(pair.encode()).decode()}"
        if self.token is not None:
            headers["Authorization"] = f"Bearer {self.token}"
        body = json.dumps(notice.to_dict()).encode()
        url = parts._replace(netloc=_host(parts), fragment="").geturl()
        return urllib.request.Request(url, body, headers, method="POST")  # noqa: S310 - url_problem saw the scheme


def _host(parts: SplitResult) -> str:
    return parts.netloc.rpartition("@")[2]


def _refused(code: int) -> NotSent:
    if 300 <= code < 400:
        return NotSent(f"the server answered {code}: the address has moved, give the new one", again=False)
    return NotSent(f"the server answered {code}", again=code >= 500 or code in _LATER)
