"""Who may look at a page."""

from __future__ import annotations

import asyncio
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import pytest

from bench.watch.access import access_for, is_loopback
from bench.watch.app import watch_app
from bench.watch.watcher import Snapshot
from protocols.errors import InputError

if TYPE_CHECKING:
    from bench.watch.access import Access

TOKEN = "a-token-of-some-length"  # noqa: S105


class Still:
    """A run that does not change, with a title that wants to be markup."""

    snapshot = Snapshot("v1", b'{"run": {"title": "</title><script>alert(1)</script>"}}', b"")


@dataclass
class Answer:
    """What came back."""

    status_code: int
    headers: dict[str, str]
    text: str


class Visitor:
    """Asks the application as a server does, with any path and header one likes; keeps its cookie."""

    def __init__(self, access: Access) -> None:
        self._app = watch_app(Still(), access)
        self._cookie = ""

    def get(self, path: str, headers: dict[str, str] | None = None) -> Answer:
        return self.request("GET", path, headers)

    def request(self, method: str, path: str, headers: dict[str, str] | None = None) -> Answer:
        path, _, query = path.partition("?")
        sent = {"Host": "localhost", "Cookie": self._cookie, **(headers or {})}
        scope = {
            "type": "http", "method": method, "path": path, "raw_path": path.encode(), "query_string": query.encode(),
            "headers": [(k.lower().encode(), v.encode("latin-1")) for k, v in sent.items()], "root_path": "",
            "scheme": "http", "http_version": "1.1", "server": ("127.0.0.1", 8765), "client": ("127.0.0.1", 5000),
        }  # fmt: skip
        messages: list[Any] = []

        async def receive() -> dict[str, Any]:
            return {"type": "http.request", "body": b"", "more_body": False}

        async def send(message: Any) -> None:
            messages.append(message)

        asyncio.run(self._app(scope, receive, send))  # type: ignore[arg-type] # any awaitable will do
        got = {k.decode().lower(): v.decode() for k, v in messages[0]["headers"]}
        self._cookie = got.get("set-cookie", self._cookie).partition(";")[0]
        body = b"".join(message.get("body", b"") for message in messages[1:])
        return Answer(messages[0]["status"], got, body.decode())


@pytest.mark.parametrize("host", ["127.0.0.1", "127.0.0.2", "::1", "localhost"])
def test_this_computer_alone_needs_no_token(host: str) -> None:
    assert is_loopback(host)
    assert access_for(host, None).token is None


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "lab-pc"])  # noqa: S104
def test_others_need_a_token_that_is_hard_to_guess(host: str) -> None:
    token = access_for(host, None).token
    assert token is not None
    assert len(token) >= 20
    assert token != access_for(host, None).token


@pytest.mark.parametrize("token", ["", "short", "with space in it", "a/b/c/d/e/f", "x" * 300])
def test_a_token_that_is_none_is_refused(token: str) -> None:
    with pytest.raises(InputError, match="--token: expected 8 to 200"):
        access_for("127.0.0.1", token)


@pytest.mark.parametrize("host", ["evil.example", "evil.example:8765", "127.0.0.1.evil.example", ""])
def test_a_page_of_this_computer_answers_to_no_other_name(host: str) -> None:
    for path in ("/", "/state.json", "/events", "/watch.js"):
        answer = Visitor(access_for("127.0.0.1", None)).get(path, headers={"Host": host})
        assert answer.status_code == 421
        assert "script" not in answer.text


@pytest.mark.parametrize("host", ["127.0.0.1:8765", "localhost", "LOCALHOST:1", "[::1]:8765"])
def test_it_answers_to_its_own_names(host: str) -> None:
    assert Visitor(access_for("127.0.0.1", None)).get("/", headers={"Host": host}).status_code == 200


def test_without_the_token_nothing_is_shown() -> None:
    for query in ("", "?token=", "?token=wrong-token", f"?token={TOKEN}x", "?token=%C3%A9%C3%A9"):
        for path in ("/", "/state.json", "/events", "/watch.js"):
            answer = Visitor(access_for("0.0.0.0", TOKEN)).get(path + query)  # noqa: S104
            assert answer.status_code == 401
            assert "needs its token" in answer.text
            assert "set-cookie" not in answer.headers
            assert TOKEN not in answer.text


def test_the_token_goes_into_a_cookie_and_out_of_the_address() -> None:
    guest = Visitor(access_for("0.0.0.0", TOKEN))  # noqa: S104
    answer = guest.get(f"/?token={TOKEN}")
    assert (answer.status_code, answer.headers["location"]) == (303, "/")
    cookie = answer.headers["set-cookie"].lower()
    assert "httponly" in cookie
    assert "samesite=strict" in cookie
    assert guest.get("/").status_code == 200
    assert guest.get("/state.json").status_code == 200
    assert Visitor(access_for("0.0.0.0", TOKEN)).get("/state.json").status_code == 401  # noqa: S104


def test_a_program_may_bring_the_token_each_time() -> None:
    answer = Visitor(access_for("0.0.0.0", TOKEN)).get(f"/state.json?token={TOKEN}")  # noqa: S104
    assert answer.status_code == 200


@pytest.mark.parametrize("cookie", ["evs_bench_watch_8765=wrong", "=;;=", 'evs_bench_watch_8765="\x01', "a" * 5000])
def test_a_strange_cookie_is_no_token(cookie: str) -> None:
    answer = Visitor(access_for("0.0.0.0", TOKEN)).get("/", headers={"Cookie": cookie})  # noqa: S104
    assert answer.status_code == 401


@pytest.mark.parametrize(
    "path", ["/", "/state.json", "/watch.js", "/watch.css", "/plots.js", "/icon.svg", "/nothing"]
)
def test_every_answer_keeps_the_browser_careful(path: str) -> None:
    headers = Visitor(access_for("127.0.0.1", None)).get(path).headers
    assert headers["x-content-type-options"] == "nosniff"
    assert headers["cache-control"] == "no-store"
    policy = headers["content-security-policy"]
    assert "default-src 'none'" in policy
    assert "script-src 'self'" in policy
    assert "unsafe" not in policy


@pytest.mark.parametrize(
    "path",
    [
        "/../pyproject.toml",
        "/%2e%2e/%2e%2e/etc/passwd",
        "/watch.js/../../app.py",
        "/templates/watch.html",
        "//etc/passwd",
    ],
)
def test_no_path_leads_to_a_file(path: str) -> None:
    assert Visitor(access_for("127.0.0.1", None)).get(path).status_code == 404


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "PATCH"])
def test_nothing_can_be_written(method: str) -> None:
    assert Visitor(access_for("127.0.0.1", None)).request(method, "/state.json").status_code == 405


def test_text_of_files_is_no_markup() -> None:
    page = Visitor(access_for("127.0.0.1", None)).get("/").text
    assert "<script>alert" not in page
    assert "&lt;/title&gt;&lt;script&gt;alert(1)" in page
    assert "://" not in page  # nothing is loaded from elsewhere


def test_an_unchanged_state_is_not_sent_again() -> None:
    guest = Visitor(access_for("127.0.0.1", None))
    tag = guest.get("/state.json", headers={"Accept-Encoding": ""}).headers["etag"]
    assert guest.get("/state.json", headers={"If-None-Match": tag}).status_code == 304
