"""The three ways of a notice, on servers and programs of this machine."""

from __future__ import annotations

import base64
import json
import socket
import sys
import time
from email import message_from_string
from typing import TYPE_CHECKING, Any

import pytest

from bench.notices.command import Command
from bench.notices.mail import Mail
from bench.notices.way import NotSent, tls_context
from bench.notices.webhook import Webhook, url_problem

if TYPE_CHECKING:
    import ssl
    from collections.abc import Callable
    from pathlib import Path

    from bench.notices import Notice

TIMEOUT_S = 20.0
SECRET = "s3cr3t-pass"  # noqa: S105 - made up
TOKEN = "t0ken"  # noqa: S105


def hook(url: str, token: str | None = None) -> Webhook:
    return Webhook(url, token, tls_context(None))


def failure(way: Any, notice: Notice, timeout_s: float = TIMEOUT_S) -> NotSent:
    with pytest.raises(NotSent) as caught:
        way.send(notice, timeout_s)
    assert SECRET not in str(caught.value)
    assert "\n" not in str(caught.value)
    return caught.value


def test_a_webhook_gets_a_json_document_and_the_token(web: Any, notice: Notice) -> None:
    hook(f"{web.url}/hook?key={SECRET}", TOKEN).send(notice, TIMEOUT_S)
    ((path, headers, body),) = web.received
    assert path == f"/hook?key={SECRET}"
    assert headers["Authorization"] == f"Bearer {TOKEN}"
    assert headers["Content-Type"].startswith("application/json")
    assert body["format"] == "evs-bench-notice/1"
    assert (body["kind"], body["points_done"], body["points"]) == ("failure", 3, 64)
    assert body["text"] == "EVS bench: quick look failed: camera: read the events: unplugged see to it"


def test_credentials_in_an_address_are_sent_as_such_and_named_nowhere(web: Any, notice: Notice) -> None:
    way = hook(f"http://lab:{SECRET}@127.0.0.1:{web.url.rpartition(':')[2]}/services/{SECRET}?k={SECRET}")
    way.send(notice, TIMEOUT_S)
    assert web.received[0][1]["Authorization"] == f"Basic {base64.b64encode(f'lab:{SECRET}'.encode()).decode()}"
    assert "@" not in web.received[0][1]["Host"]
    assert way.name == f"webhook {web.url}"
    assert SECRET not in repr(way)


@pytest.mark.parametrize(("code", "again"), [(500, True), (503, True), (429, True), (404, False), (401, False)])
def test_what_a_server_answers_decides_whether_it_is_tried_again(
    web: Any, notice: Notice, code: int, again: bool
) -> None:
    web.answers = [code]
    error = failure(hook(f"{web.url}/{SECRET}"), notice)
    assert (str(error), error.again) == (f"the server answered {code}", again)


def test_no_redirection_is_followed(web: Any, notice: Notice) -> None:
    web.answers = [302]
    error = failure(hook(web.url, TOKEN), notice)
    assert "has moved" in str(error)
    assert not error.again
    assert len(web.received) == 1


def test_a_server_that_hangs_is_left(web: Any, notice: Notice) -> None:
    web.hang.set()
    error = failure(hook(f"{web.url}/{SECRET}"), notice, 0.2)
    assert (str(error), error.again) == ("no answer in 0.2 s", True)


def test_a_port_without_a_server_is_said(notice: Notice) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    error = failure(hook(f"http://127.0.0.1:{port}/{SECRET}"), notice)
    assert (str(error), error.again) == ("Connection refused", True)


def test_an_answer_that_is_no_http_is_said(notice: Notice, mail_server: Any) -> None:
    error = failure(hook(f"http://127.0.0.1:{mail_server().port}/"), notice)
    assert "no HTTP" in str(error)


@pytest.mark.parametrize(
    ("url", "token", "part"),
    [
        ("ftp://host/x", False, "no address of the web"),
        (f"https:/{SECRET}", False, "no address of the web"),
        (f"https://host:port/{SECRET}", False, "no address of the web"),
        (f"https://ho st/{SECRET}", False, "no address of the web"),
        ("http://chat.example/x", True, "in the clear"),
        (f"http://a:{SECRET}@chat.example/x", False, "in the clear"),
    ],
)
def test_bad_addresses_are_refused_without_being_repeated(url: str, token: bool, part: str) -> None:
    problem = url_problem(url, token=token)
    assert problem is not None
    assert part in problem
    assert SECRET not in problem


def test_good_addresses_are_not_refused() -> None:
    assert url_problem("https://chat.example:8443/x?y=1", token=True) is None
    assert url_problem("http://localhost:8080/x", token=True) is None


def mail(server: Any, context: ssl.SSLContext, **options: Any) -> Mail:
    settings = {"to": ("a@lab.example", "b@lab.example"), "sender": "bench@lab.example", "server": "127.0.0.1",
                "security": "starttls", "login": ("bench", SECRET)}  # fmt: skip
    return Mail(port=server.port, context=context, **{**settings, **options})


@pytest.fixture(name="trusted")
def trusting_context(certificate: tuple[Path, Path]) -> ssl.SSLContext:
    return tls_context(str(certificate[0]))


def test_a_mail_goes_over_starttls_after_a_login(mail_server: Any, trusted: ssl.SSLContext, notice: Notice) -> None:
    server = mail_server(login=("bench", SECRET))
    mail(server, trusted).send(notice, TIMEOUT_S)
    assert server.was_secure == [True]
    assert server.commands.index("STARTTLS") < server.commands.index("AUTH")
    letter = message_from_string(server.letters[0])
    assert letter["Subject"] == "EVS bench: quick look failed"
    assert letter["To"] == "a@lab.example, b@lab.example"
    assert "3 of 64" in letter.get_payload()
    assert "runs/x" in letter.get_payload()


def test_a_mail_goes_over_a_connection_that_is_secure_at_once(
    mail_server: Any, trusted: ssl.SSLContext, notice: Notice
) -> None:
    server = mail_server(tls_at_once=True, login=("bench", SECRET))
    mail(server, trusted, security="ssl").send(notice, TIMEOUT_S)
    assert server.was_secure == [True]


def test_a_mail_goes_in_the_clear_where_that_is_asked_for(
    mail_server: Any, trusted: ssl.SSLContext, notice: Notice
) -> None:
    server = mail_server()
    mail(server, trusted, security="none", login=None).send(notice, TIMEOUT_S)
    assert server.was_secure == [False]


def test_a_wrong_password_is_not_repeated_even_if_the_server_does(
    mail_server: Any, trusted: ssl.SSLContext, notice: Notice
) -> None:
    server = mail_server(login=("bench", "another"))
    error = failure(mail(server, trusted), notice)
    assert str(error) == "the server refused user or password (535)"
    assert not error.again


def test_a_certificate_that_nobody_vouches_for_is_refused(mail_server: Any, notice: Notice) -> None:
    server = mail_server(login=("bench", SECRET))
    error = failure(mail(server, tls_context(None)), notice)
    assert "not trusted" in str(error)
    assert "AUTH" not in server.commands


@pytest.mark.parametrize("refused", [("a@lab.example",), ("a@lab.example", "b@lab.example")])
def test_addresses_that_a_server_refuses_are_named(
    mail_server: Any, trusted: ssl.SSLContext, notice: Notice, refused: tuple[str, ...]
) -> None:
    server = mail_server(login=("bench", SECRET), refuse_recipients=refused)
    error = failure(mail(server, trusted), notice)
    assert str(error) == f"the server takes no mail to {', '.join(refused)}"


SCRIPT = """\
import json, os, sys
facts = {key: value for key, value in os.environ.items() if key.startswith("EVS_BENCH_")}
json.dump([sys.argv[2:], facts, json.load(sys.stdin)], open(sys.argv[1], "w"))
"""


def test_a_program_gets_the_facts_and_no_shell_reads_its_arguments(tmp_path: Path, notice: Notice) -> None:
    out = tmp_path / "out.json"
    way = Command((sys.executable, "-c", SCRIPT, str(out), "$HOME; exit 3", SECRET))
    way.send(notice, TIMEOUT_S)
    arguments, facts, document = json.loads(out.read_text())
    assert arguments == ["$HOME; exit 3", SECRET]
    assert document == notice.to_dict()
    assert facts["EVS_BENCH_KIND"] == "failure"
    assert facts["EVS_BENCH_POINTS_DONE"] == "3"
    assert facts["EVS_BENCH_TEST"] == "false"
    assert SECRET not in way.name


def test_a_program_that_fails_or_is_not_there_is_said(notice: Notice, tmp_path: Path) -> None:
    assert str(failure(Command((sys.executable, "-c", "raise SystemExit(3)")), notice)) == "ended with exit code 3"
    missing = failure(Command((str(tmp_path / "missing"),)), notice)
    assert (str(missing), missing.again) == ("cannot be started: No such file or directory", False)


def test_a_program_that_hangs_is_ended_with_what_it_started(
    tmp_path: Path, notice: Notice, until: Callable[[Callable[[], bool]], None]
) -> None:
    beat = tmp_path / "beat"
    child = f"import time\nwhile True: open({str(beat)!r}, 'a').write('x'); time.sleep(0.02)"
    script = f"import subprocess, sys, time; subprocess.Popen([sys.executable, '-c', {child!r}]); time.sleep(600)"
    assert "not done in 2 s" in str(failure(Command((sys.executable, "-c", script)), notice, 2.0))
    sizes = [-1, -2]

    def still() -> bool:
        time.sleep(0.3)
        sizes.append(beat.stat().st_size if beat.exists() else 0)
        return sizes[-1] == sizes[-2]

    until(still)


def test_a_notice_holds_nothing_that_an_environment_cannot_carry() -> None:
    from bench.notices import Notice

    odd = Notice("end", "a\0b\nc\ud800", "x" * 5000, host="h")
    facts = odd.environment()
    assert all("\0" not in v and "\n" not in v and len(v) <= 1000 and v.encode() for v in facts.values())
