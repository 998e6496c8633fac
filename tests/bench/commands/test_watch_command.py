"""The command that shows a run: what it says, and how it ends."""

from __future__ import annotations

import importlib.util
import signal
import socket
import subprocess
import sys
import urllib.request
from typing import TYPE_CHECKING, Any

import pytest

from bench.commands.watch import command
from protocols.errors import InputError

if TYPE_CHECKING:
    from pathlib import Path

HEADER = """\
format: evs-bench-run/1
id: a-run
title: A run
sensor: {name: S, width: 10, height: 10}
roi: {x: 0, y: 0, width: 2, height: 2}
"""


@pytest.fixture
def run(tmp_path: Path) -> Path:
    (tmp_path / "run/points").mkdir(parents=True)
    (tmp_path / "run/run.yaml").write_text(HEADER)
    (tmp_path / "run/journal.jsonl").write_text('{"state": "run_started"}\n{"state": "planned", "point": 0}\n')
    return tmp_path / "run"


def refusal(*arguments: str) -> str:
    """Return the line with which the command is refused."""
    with pytest.raises(InputError) as caught:
        command.main([*arguments, "--no-browser"], standalone_mode=False)
    lines = [str(problem) for problem in caught.value.problems]
    assert len(lines) == 1
    return lines[0]


def test_a_folder_without_a_run_is_one_line(tmp_path: Path) -> None:
    assert refusal(str(tmp_path)) == f"{tmp_path}: this is no run, it has no run.yaml"
    assert refusal(str(tmp_path / "no")) == f"{tmp_path / 'no'}: there is no such run folder"


def test_what_is_to_be_installed_is_one_line(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    found = importlib.util.find_spec

    def without(name: str, *more: Any) -> Any:
        return None if name == "uvicorn" else found(name, *more)

    monkeypatch.setattr(importlib.util, "find_spec", without)
    assert refusal(str(run)) == "the page of a run needs uvicorn: pip install 'evs-bench[web]'"


def test_a_port_that_is_taken_is_one_line(run: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        line = refusal(str(run), "--port", str(port))
    assert line.startswith(f"cannot listen on 127.0.0.1, port {port}: ")
    assert line.endswith("--port 0 takes any free one")


def test_a_host_that_is_none_is_one_line(run: Path) -> None:
    assert refusal(str(run), "--host", "300.1.1.1").startswith("--host 300.1.1.1: ")


def start(run: Path, *options: str) -> subprocess.Popen[str]:
    code = "import sys; from bench.commands.watch import command; command.main(sys.argv[1:])"
    return subprocess.Popen(
        [sys.executable, "-c", code, str(run), "--port", "0", "--no-browser", *options],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def test_ctrl_c_ends_it_cleanly_even_while_somebody_looks(run: Path) -> None:
    with start(run) as server:
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        assert address.startswith("http://127.0.0.1:")
        with urllib.request.urlopen(f"{address}events", timeout=30) as events:  # noqa: S310
            assert events.readline() == b"retry: 2000\n"
            server.send_signal(signal.SIGINT)
            _, errors = server.communicate(timeout=60)
    assert server.returncode == 0
    assert errors == f"this page shows {run} until Ctrl-C\nno longer shown; the run itself is not concerned\n"


def test_where_others_reach_it_the_address_holds_a_token(run: Path) -> None:
    with start(run, "--host", "0.0.0.0") as server:  # noqa: S104
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        server.send_signal(signal.SIGINT)
        server.communicate(timeout=60)
    assert "/?token=" in address
    assert "0.0.0.0" not in address  # noqa: S104
