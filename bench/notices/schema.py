"""The schema of a file of notices, format ``evs-bench-notices/1``."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field, StringConstraints, model_validator

from bench.notices.notice import Kind
from protocols.base import FrozenModel, Number, PathProblem, Seconds, problems_at

__all__ = ["CommandEntry", "MailEntry", "NoticesFile", "WebhookEntry"]

Text = Annotated[str, StringConstraints(min_length=1)]
Factor = Annotated[Number, Field(ge=1, le=1000)]
Timeout = Annotated[Number, Field(gt=0, le=120)]
Port = Annotated[int, Field(strict=True, ge=1, le=65535)]


class _Entry(FrozenModel):
    """What all ways have in common."""

    on: Annotated[tuple[Kind, ...], Field(min_length=1)]
    """What is told."""
    no_progress_s: Seconds | None = None
    """Time without progress after which ``no_progress`` is told, s. A long point is given its expected time."""
    timeout_s: Timeout = 10.0
    """Longest wait for an answer, s."""

    @model_validator(mode="after")
    def _limit_where_it_is_used(self) -> _Entry:
        if "no_progress" in self.on and self.no_progress_s is None:
            raise problems_at([(("on",), "no_progress needs no_progress_s, the seconds without progress")])
        if "no_progress" not in self.on and self.no_progress_s is not None:
            raise problems_at([(("no_progress_s",), "no_progress is not in `on`, so this has no effect")])
        return self


def _exclusive(entry: FrozenModel, *names: str) -> list[PathProblem]:
    """Return what is wrong where more than one of some keys is given."""
    given = [name for name in names if getattr(entry, name) is not None]
    return [((given[-1],), f"{given[0]} is given too; give one of the two")] if len(given) > 1 else []


class WebhookEntry(_Entry):
    """An HTTP POST of a small JSON document."""

    kind: Literal["webhook"]
    url: Text | None = None
    """Where to. Who knows the address can write there: keep it out of this file if others read that."""
    url_env: Text | None = None
    """Environment variable that holds the address."""
    url_file: Text | None = None
    """File that holds the address, relative to this one."""
    token_env: Text | None = None
    """Environment variable that holds a token, which is sent as ``Authorization: Bearer``."""
    token_file: Text | None = None
    """File that holds the token, relative to this one."""
    ca_file: Text | None = None
    """Certificates to trust instead of the system's, for a server of the lab's own."""

    @model_validator(mode="after")
    def _one_source_each(self) -> WebhookEntry:
        problems = _exclusive(self, "url", "url_env", "url_file") + _exclusive(self, "token_env", "token_file")
        if self.url is None and self.url_env is None and self.url_file is None:
            problems.append(((), "the address is missing: give url, url_env or url_file"))
        if problems:
            raise problems_at(problems)
        return self


class MailEntry(_Entry):
    """A mail by SMTP."""

    kind: Literal["mail"]
    to: Annotated[tuple[Text, ...], Field(min_length=1)]
    sender: Text
    server: Text
    port: Port | None = None
    """Default is 587 for ``starttls``, 465 for ``ssl`` and 25 for ``none``."""
    security: Literal["starttls", "ssl", "none"] = "starttls"
    user: Text | None = None
    password_env: Text | None = None
    """Environment variable that holds the password."""
    password_file: Text | None = None
    """File that holds the password, relative to this one."""
    ca_file: Text | None = None
    """Certificates to trust instead of the system's, for a server of the lab's own."""

    @model_validator(mode="after")
    def _whole(self) -> MailEntry:
        problems = _exclusive(self, "password_env", "password_file")
        password = self.password_env or self.password_file
        if self.user is not None and password is None:
            problems.append((("user",), "the password is missing: give password_env or password_file"))
        if self.user is None and password is not None:
            problems.append(((), "there is a password and no user"))
        if password is not None and self.security == "none":
            problems.append((("security",), "a password is not sent in the clear: use starttls or ssl"))
        problems += _addresses(("sender",), self.sender)
        for i, address in enumerate(self.to):
            problems += _addresses(("to", i), address)
        if problems:
            raise problems_at(problems)
        return self

    @property
    def port_used(self) -> int:
        """The port of the server."""
        return self.port or {"starttls": 587, "ssl": 465, "none": 25}[self.security]


def _addresses(path: tuple[str | int, ...], address: str) -> list[PathProblem]:
    before, at, after = address.partition("@")
    good = before and at and after and "@" not in after and address.isprintable() and not set(address) & set(" ,;<>")
    return [] if good else [(path, f"{address!r} is not a mail address, as operator@lab.example")]


class CommandEntry(_Entry):
    """A program that is started, without a shell: facts in ``EVS_BENCH_*``, and as JSON on its standard input."""

    kind: Literal["command"]
    arguments: Annotated[tuple[Text, ...], Field(min_length=1)]
    """The program, by name or by path relative to this file, and its arguments."""

    @model_validator(mode="after")
    def _can_be_started(self) -> CommandEntry:
        problems: list[PathProblem] = [
            (("arguments", i), "must not hold a NUL character") for i, a in enumerate(self.arguments) if "\0" in a
        ]
        if problems:
            raise problems_at(problems)
        return self


class NoticesFile(FrozenModel):
    """Who is told what, and how."""

    format: Literal["evs-bench-notices/1"]
    no_progress_factor: Factor = 2.0
    """How many times its expected length a point may take before that counts as no progress."""
    notices: Annotated[
        tuple[Annotated[WebhookEntry | MailEntry | CommandEntry, Field(discriminator="kind")], ...],
        Field(min_length=1),
    ]
