"""A file of notices: what it may say, and what is wrong with it, with its place and without its secrets."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.notices import Notices, load_notices
from bench.notices.command import Command
from bench.notices.mail import Mail
from bench.notices.schema import NoticesFile
from bench.notices.webhook import Webhook
from protocols.errors import InputError
from protocols.files import parse_model

GOOD = """\
format: evs-bench-notices/1
no_progress_factor: 3
notices:
  - kind: webhook
    url_env: LAB_HOOK
    token_file: token
    on: [end, failure, no_progress]
    no_progress_s: 900
  - kind: mail
    to: [operator@lab.example]
    sender: bench@lab.example
    server: mail.lab.example
    user: bench
    password_env: LAB_PASSWORD
    on: [failure]
    timeout_s: 30
  - kind: command
    arguments: [./tell.sh, now]
    on: [end]
"""
HEAD = "format: evs-bench-notices/1\nnotices:\n"
SECRET = "s3cr3t"  # noqa: S105 - made up


@pytest.fixture(name="file")
def good_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("LAB_HOOK", f"https://chat.example/{SECRET}")
    monkeypatch.setenv("LAB_PASSWORD", SECRET)
    (tmp_path / "token").write_text(f"{SECRET}\n")
    (tmp_path / "notices.yaml").write_text(GOOD)
    return tmp_path / "notices.yaml"


def problems(text: str, folder: Path) -> str:
    (folder / "bad.yaml").write_text(text)
    with pytest.raises(InputError) as caught:
        load_notices(folder / "bad.yaml")
    assert SECRET not in str(caught.value)
    return str(caught.value).replace(f"{folder}/", "")


def test_a_file_becomes_ways_with_their_secrets(file: Path) -> None:
    notices = load_notices(file)
    assert notices is not None
    hook, mail, command = notices.subscriptions
    assert hook.way == Webhook(f"https://chat.example/{SECRET}", SECRET, hook.way.context)  # type: ignore[attr-defined]
    assert isinstance(mail.way, Mail)
    assert (mail.way.port, mail.way.login) == (587, ("bench", SECRET))
    assert command.way == Command((str(file.parent / "./tell.sh"), "now"))
    assert (hook.no_progress_s, mail.timeout_s, notices.no_progress_factor) == (900.0, 30.0, 3.0)
    assert SECRET not in repr(notices)


def test_the_environment_names_a_file_where_the_operator_does_not(
    file: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert load_notices() is None
    monkeypatch.setenv("EVS_BENCH_NOTIFY", str(file))
    assert isinstance(load_notices(), Notices)


def test_a_secret_that_is_not_there_is_said_with_its_place(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("LAB_PASSWORD")
    (file.parent / "token").unlink()
    text = problems(GOOD, file.parent)
    assert "bad.yaml:6:17: notices[0].token_file: token cannot be read: No such file or directory" in text
    assert "bad.yaml:14:19: notices[1].password_env: the environment has no variable LAB_PASSWORD" in text


def test_an_address_that_is_none_is_not_repeated(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("LAB_HOOK", f"gopher://{SECRET}")
    assert "bad.yaml:5:14: notices[0].url_env: this is no address of the web" in problems(GOOD, file.parent)


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("kind: fax, on: [end]", ":3:12: notices[0].kind: 'fax' is not one of webhook, mail, command"),
        ("kind: command, arguments: [x], on: [ended]", "'ended' is not one of end, failure"),
        ("kind: command, arguments: [x], on: []", "must have at least 1 item"),
        ("kind: command, arguments: [x]", "key 'on' is missing"),
        ("kind: command, arguments: [x], on: [no_progress]", "no_progress needs no_progress_s"),
        ("kind: command, arguments: [x], on: [end], no_progress_s: 5", "so this has no effect"),
        ("kind: command, arguments: x, on: [end]", "'x' is not a list"),
        ("kind: webhook, on: [end]", "the address is missing: give url, url_env or url_file"),
        ("kind: webhook, url: 'https://a.example', url_env: B, on: [end]", "url is given too"),
        ("kind: webhook, url: 'https://a.example', on: [end], timeout_s: 0", "0 is out of range"),
        ("kind: mail, to: [a], sender: b@c, server: d, on: [end]", "notices[0].to[0]: 'a' is not a mail address"),
        ("kind: mail, to: [a@b], sender: b@c, server: d, user: e, on: [end]", "the password is missing"),
        (
            "kind: mail, to: [a@b], sender: b@c, server: d, user: e, password_env: F, security: none, on: [end]",
            "not sent in the clear",
        ),
        (f"kind: mail, to: [a@b], sender: b@c, server: d, password: {SECRET}, on: [end]", "unknown key"),
        ("kind: webhook, url: 'https://a.example', ca_file: none.pem, on: [end]", "ca_file: cannot be used: No such"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(entry: str, said: str, tmp_path: Path) -> None:
    text = problems(f"{HEAD}  - {{{entry}}}\n", tmp_path)
    assert said in text
    assert text.startswith("bad.yaml:3:")


@given(st.text(max_size=200) | st.from_regex(r"(format|notices|kind|on|url): [\[\]{}a-z0-9, :\n-]{0,80}"))
@settings(max_examples=150, deadline=None)
def test_any_text_is_read_or_refused_in_our_words(text: str) -> None:
    try:
        parse_model(text, NoticesFile, "any.yaml")
    except InputError as error:
        assert error.problems  # noqa: PT017 - most texts are refused, some are not


def test_the_files_in_the_documentation_are_good() -> None:
    document = Path(__file__).resolve().parents[3] / "docs" / "how-to" / "get-notices.md"
    blocks = re.findall(r"^```yaml\n(.*?)^```", document.read_text(), re.MULTILINE | re.DOTALL)
    assert len(blocks) == 4
    for block in blocks:
        assert parse_model(block, NoticesFile, "get-notices.md").notices
