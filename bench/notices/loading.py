"""From a file of notices to ways that can be used; every secret is looked up before a run begins."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Final

from bench.notices.command import Command
from bench.notices.mail import Mail
from bench.notices.schema import CommandEntry, MailEntry, NoticesFile, WebhookEntry
from bench.notices.way import tls_context
from bench.notices.webhook import Webhook, url_problem
from protocols.errors import InputError, Problem
from protocols.files import parse_model, read_text
from protocols.yaml_strict import read_yaml

if TYPE_CHECKING:
    import ssl

    from bench.notices.notice import Kind
    from bench.notices.way import Way
    from protocols.yaml_strict import Node

__all__ = ["NOTIFY_VARIABLE", "Notices", "Subscription", "load_notices"]

#: Environment variable that names a file of notices.
NOTIFY_VARIABLE: Final = "EVS_BENCH_NOTIFY"


@dataclass(frozen=True, slots=True)
class Subscription:
    """A way, and what goes by it."""

    way: Way
    on: tuple[Kind, ...]
    timeout_s: float
    no_progress_s: float | None = None  #: None where that is not told


@dataclass(frozen=True, slots=True)
class Notices:
    """What a file of notices says."""

    subscriptions: tuple[Subscription, ...]
    no_progress_factor: float


def load_notices(file: Path | None = None) -> Notices | None:
    """Return what `file` says, or the file that ``EVS_BENCH_NOTIFY`` names; None if there is neither.

    Raises
    ------
    InputError
        With everything that is wrong in it: also an environment variable that is not set, a file that cannot be
        read, an address that is none. No secret is in a message.
    """
    named = os.environ.get(NOTIFY_VARIABLE)
    if file is None and not named:
        return None
    path = file or Path(str(named))
    text, source = read_text(path), str(path)
    content = parse_model(text, NoticesFile, source)
    return _Loading(content, read_yaml(text, source), source, path.parent).notices()


class _Missing(Exception):
    """Something that an entry needs is not there; it has been noted."""


class _Loading:
    """One file on its way to ways; collects what is wrong."""

    def __init__(self, content: NoticesFile, document: Node, source: str, folder: Path) -> None:
        self._content = content
        self._document = document
        self._source = source
        self._folder = folder
        self._problems: list[Problem] = []

    def notices(self) -> Notices:
        found = []
        for number, entry in enumerate(self._content.notices):
            try:
                way = self._way(number, entry)
            except _Missing:
                continue
            found.append(Subscription(way, entry.on, entry.timeout_s, entry.no_progress_s))
        if self._problems:
            raise InputError(*self._problems)
        return Notices(tuple(found), self._content.no_progress_factor)

    def _way(self, number: int, entry: WebhookEntry | MailEntry | CommandEntry) -> Way:
        if isinstance(entry, WebhookEntry):
            return self._webhook(number, entry)
        return self._mail(number, entry) if isinstance(entry, MailEntry) else self._command(entry)

    def _webhook(self, number: int, entry: WebhookEntry) -> Webhook:
        token = self._secret(number, "token_env", entry.token_env, "token_file", entry.token_file)
        url = entry.url or self._secret(number, "url_env", entry.url_env, "url_file", entry.url_file)
        problem = url_problem(url or "", token=token is not None)
        if problem:
            key = next(key for key in ("url", "url_env", "url_file") if getattr(entry, key) is not None)
            raise self._missing(number, key, problem)
        return Webhook(str(url), token, self._trusted(number, entry.ca_file))

    def _mail(self, number: int, entry: MailEntry) -> Mail:
        password = self._secret(number, "password_env", entry.password_env, "password_file", entry.password_file)
        login = None if entry.user is None or password is None else (entry.user, password)
        context = self._trusted(number, entry.ca_file)
        return Mail(entry.to, entry.sender, entry.server, entry.port_used, entry.security, login, context)

    def _command(self, entry: CommandEntry) -> Command:
        program = entry.arguments[0]
        if "/" in program:  # a path, and not a name to be looked for in PATH
            program = str(self._folder.absolute() / program)
        return Command((program, *entry.arguments[1:]))

    def _secret(self, number: int, env_key: str, variable: str | None, file_key: str, file: str | None) -> str | None:
        """Return a secret from where the entry says that it is; None if it names no place."""
        if variable is not None:
            value = os.environ.get(variable, "")
            return value.strip() or self._fail(number, env_key, f"the environment has no variable {variable}")
        if file is None:
            return None
        try:
            value = (self._folder / file).read_text(encoding="utf-8").strip()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or "it is not UTF-8 text"
            return self._fail(number, file_key, f"{self._folder / file} cannot be read: {reason}")
        usable = value and value.isprintable()
        return value if usable else self._fail(number, file_key, f"{self._folder / file} is not one line of text")

    def _trusted(self, number: int, ca_file: str | None) -> ssl.SSLContext:
        try:
            return tls_context(None if ca_file is None else str(self._folder / ca_file))
        except OSError as error:
            reason = error.strerror or "it holds no certificate"
            raise self._missing(number, "ca_file", f"cannot be used: {reason}") from None

    def _fail(self, number: int, key: str, message: str) -> str:
        raise self._missing(number, key, message)

    def _missing(self, number: int, key: str, message: str) -> _Missing:
        node = self._document.children["notices"].children[number].children[key]
        self._problems.append(Problem(f"notices[{number}].{key}: {message}", self._source, node.line, node.column))
        return _Missing()
