"""A program of the user's own: facts in its environment, and as JSON on its standard input."""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
from dataclasses import dataclass
from pathlib import PurePath
from typing import TYPE_CHECKING

from bench.notices.way import NotSent

if TYPE_CHECKING:
    from bench.notices.notice import Notice

__all__ = ["Command"]


@dataclass(frozen=True, slots=True)
class Command:
    """A program and its arguments; no shell reads them."""

    arguments: tuple[str, ...]

    @property
    def name(self) -> str:
        """The program; there may be a secret in its arguments."""
        return f"command {PurePath(self.arguments[0]).name}"

    def send(self, notice: Notice, timeout_s: float) -> None:
        """Start the program, give it a notice, and wait; it is ended where it takes too long."""
        try:
            # A session of its own: Ctrl-C is for the bench, and all that it starts can be ended with it.
            process = subprocess.Popen(  # noqa: S603 - that a user's own program is started is what this is for
                self.arguments,
                stdin=subprocess.PIPE,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
                env={**os.environ, **notice.environment()},
                start_new_session=True,
            )
        except OSError as error:
            raise NotSent(f"cannot be started: {error.strerror}", again=False) from None
        with process:
            _finish(process, json.dumps(notice.to_dict()).encode() + b"\n", timeout_s)


def _finish(process: subprocess.Popen[bytes], text: bytes, timeout_s: float) -> None:
    try:
        process.communicate(text, timeout=timeout_s)
    except subprocess.TimeoutExpired:
        _kill(process)
        raise NotSent(f"not done in {timeout_s:g} s, so it was ended", again=False) from None
    if process.returncode:
        raise NotSent(f"ended with exit code {process.returncode}", again=False)


def _kill(process: subprocess.Popen[bytes]) -> None:
    """End the program and what it started."""
    with contextlib.suppress(OSError):
        if hasattr(os, "killpg"):
            os.killpg(process.pid, signal.SIGKILL)
        else:
            process.kill()
