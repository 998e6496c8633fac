"""A web server, a mail server and a certificate of this machine's own, for what sends notices."""

from __future__ import annotations

import base64
import json
import socketserver
import ssl
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import TYPE_CHECKING, Any

import pytest

from bench.notices import Notice

if TYPE_CHECKING:
    from pathlib import Path

LIMIT_S = 60.0


@pytest.fixture(autouse=True)
def no_proxy(monkeypatch: pytest.MonkeyPatch) -> None:
    """Reach this machine without a proxy, and start without a file of notices."""
    monkeypatch.setenv("no_proxy", "*")
    monkeypatch.delenv("EVS_BENCH_NOTIFY", raising=False)


@pytest.fixture
def notice() -> Notice:
    """Return a notice that says a little of everything."""
    return Notice(
        "failure", "quick look", "camera: read the events: unplugged\nsee to it", station="lab", run="runs/x",
        points_done=3, points=64, label="on, 100 lux", t="2026-11-20T03:00:00Z", host="bench1",
    )  # fmt: skip


@pytest.fixture
def until() -> Callable[[Callable[[], bool]], None]:
    """Return a function that waits until something is true, at most a minute."""

    def wait(true: Callable[[], bool]) -> None:
        deadline_s = time.monotonic() + LIMIT_S
        while not true():
            assert time.monotonic() < deadline_s, "it did not become true"
            time.sleep(0.01)

    return wait


@dataclass
class WebServer:
    """A web server: what it was sent, and what it answers."""

    url: str = ""
    answers: list[int] = field(default_factory=list)  #: codes of the next answers; then 200
    received: list[tuple[str, dict[str, str], dict[str, Any]]] = field(default_factory=list)
    hang: threading.Event = field(default_factory=threading.Event)  #: set: answers nothing until it is cleared


@pytest.fixture
def web() -> Iterator[WebServer]:
    """Return a web server on this machine."""
    state = WebServer()

    class Handler(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            body = self.rfile.read(int(self.headers["Content-Length"]))
            while state.hang.is_set():
                time.sleep(0.01)
            state.received.append((self.path, dict(self.headers), json.loads(body)))
            code = state.answers.pop(0) if state.answers else 200
            self.send_response(code)
            if 300 <= code < 400:
                self.send_header("Location", state.url + "/elsewhere")
            self.send_header("Content-Length", "0")
            self.end_headers()

        def log_message(self, *_: Any) -> None:
            pass

        def handle(self) -> None:
            try:
                super().handle()
            except OSError:  # a client that did not wait for the answer
                self.close_connection = True

    with ThreadingHTTPServer(("127.0.0.1", 0), Handler) as server:
        server.daemon_threads = True
        state.url = f"http://127.0.0.1:{server.server_address[1]}"
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        yield state
        state.hang.clear()
        server.shutdown()


@pytest.fixture(scope="session")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return the certificate of 127.0.0.1 and its key."""
    folder = tmp_path_factory.mktemp("certificate")
    files = folder / "cert.pem", folder / "key.pem"
    subprocess.run(
        ["openssl", "req", "-x509", "-newkey", "rsa:2048", "-nodes", "-days", "2", "-subj", "/CN=localhost",
         "-addext", "subjectAltName=DNS:localhost,IP:127.0.0.1", "-out", str(files[0]), "-keyout", str(files[1])],
        check=True, capture_output=True, timeout=120,
    )  # fmt: skip
    return files


@dataclass
class MailServer:
    """A mail server: what it was sent, and whom it takes."""

    port: int = 0
    login: tuple[str, str] | None = None
    refuse_recipients: tuple[str, ...] = ()
    commands: list[str] = field(default_factory=list)
    letters: list[str] = field(default_factory=list)
    was_secure: list[bool] = field(default_factory=list)


class _SmtpSession(socketserver.StreamRequestHandler):
    """As much of SMTP as a client of the bench speaks."""

    server: _SmtpServer

    def handle(self) -> None:
        state, self.secure = self.server.state, self.server.tls_at_once
        self.say("220 mail")
        while line := self.rfile.readline().decode().rstrip("\r\n"):
            word = line.split(" ")[0].upper()
            state.commands.append(word)
            if word == "QUIT":
                self.say("221 bye")
                return
            getattr(self, f"on_{word.lower()}", self.on_other)(line)

    def finish(self) -> None:
        super().finish()
        self.connection.close()  # one that was made secure is not the one that the server closes

    def say(self, *lines: str) -> None:
        self.wfile.write("".join(f"{line}\r\n" for line in lines).encode())

    def on_ehlo(self, _line: str) -> None:
        self.say("250-mail", *(() if self.secure else ("250-STARTTLS",)), "250 AUTH PLAIN")

    def on_starttls(self, _line: str) -> None:
        self.say("220 go on")
        assert self.server.tls is not None
        self.connection = self.server.tls.wrap_socket(self.connection, server_side=True)
        self.rfile, self.wfile = self.connection.makefile("rb"), self.connection.makefile("wb", 0)
        self.secure = True

    def on_auth(self, line: str) -> None:
        _, user, password = base64.b64decode(line.split(" ")[2]).decode().split("\0")
        good = (user, password) == self.server.state.login
        self.say("235 welcome" if good else f"535 {password} is not the password of {user}")

    def on_rcpt(self, line: str) -> None:
        refused = any(address in line for address in self.server.state.refuse_recipients)
        self.say("550 nobody here" if refused else "250 ok")

    def on_data(self, _line: str) -> None:
        self.say("354 write")
        lines = []
        while (line := self.rfile.readline().decode().rstrip("\r\n")) != ".":
            lines.append(line)
        self.server.state.letters.append("\n".join(lines))
        self.server.state.was_secure.append(self.secure)
        self.say("250 sent")

    def on_other(self, _line: str) -> None:
        self.say("250 ok")


class _SmtpServer(socketserver.ThreadingTCPServer):
    daemon_threads = True

    def __init__(self, state: MailServer, tls: ssl.SSLContext | None, tls_at_once: bool) -> None:
        self.state, self.tls, self.tls_at_once = state, tls, tls_at_once
        super().__init__(("127.0.0.1", 0), _SmtpSession)

    def get_request(self) -> tuple[Any, Any]:
        connection, address = super().get_request()
        if self.tls_at_once:
            assert self.tls is not None
            connection = self.tls.wrap_socket(connection, server_side=True)
        return connection, address

    def handle_error(self, request: Any, client_address: Any) -> None:
        pass  # a client that goes away, or does not like the certificate


MailServerMaker = Callable[..., MailServer]


@pytest.fixture
def mail_server(certificate: tuple[Path, Path]) -> Iterator[MailServerMaker]:
    """Return a maker of mail servers on this machine; `tls_at_once` for one that is secure from the beginning."""
    running: list[_SmtpServer] = []

    def make(*, tls_at_once: bool = False, **options: Any) -> MailServer:
        state = MailServer(**options)
        tls = ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER)
        tls.load_cert_chain(*certificate)
        server = _SmtpServer(state, tls, tls_at_once)
        state.port = server.server_address[1]
        threading.Thread(target=server.serve_forever, kwargs={"poll_interval": 0.01}, daemon=True).start()
        running.append(server)
        return state

    yield make
    for server in running:
        server.shutdown()
        server.server_close()
