"""A run that is followed while another process writes it, over a real connection."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
import threading
import urllib.request
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

from bench.store.errors import RunError
from bench.watch.access import access_for
from bench.watch.app import watch_app
from bench.watch.counting import count_point
from bench.watch.watcher import Watcher

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

    Until = Callable[[Callable[[], Any]], Any]

#: Takes the lines of a journal on stdin, writes each when it is asked for, and brings the file that a line names.
WRITER = """
import fcntl, shutil, sys
source, run = sys.argv[1:]
with open(run + "/journal.jsonl", "ab", buffering=0) as journal:
    fcntl.flock(journal, fcntl.LOCK_EX)
    for line in sys.stdin:
        name, _, text = line.partition(" ")
        if name != "-":
            shutil.copy(source + "/" + name, run + "/" + name)
        journal.write(text.encode())
        print("written", flush=True)
"""


class Writer:
    """Another process that writes a run, line by line."""

    def __init__(self, source: Path, run: Path) -> None:
        shutil.copytree(source, run, ignore=shutil.ignore_patterns("*.h5", "journal.jsonl"))
        (run / "journal.jsonl").touch()
        self._process = subprocess.Popen(
            [sys.executable, "-c", WRITER, str(source), str(run)],
            stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True,
        )  # fmt: skip

    def write(self, line: dict[str, Any]) -> None:
        """Write one line, and return when it stands in the file."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._process.stdin.write(f"{line.get('file') or '-'} {json.dumps(line)}\n")
        self._process.stdin.flush()
        assert self._process.stdout.readline() == "written\n"

    def kill(self) -> None:
        """End it as a crash would."""
        self._process.kill()
        self._process.communicate()


@pytest.fixture
def writer(finished_run: Path, tmp_path: Path) -> Iterator[Writer]:
    made = Writer(finished_run, tmp_path / "growing")
    yield made
    made.kill()


@contextmanager
def served(folder: Path) -> Iterator[str]:
    """Serve a run on a free port of this computer, and yield the address."""
    import uvicorn

    from bench.watch.serving import _listening

    watcher = Watcher(folder)
    with _listening("127.0.0.1", 0) as listener:
        app = watch_app(watcher, access_for("127.0.0.1", None), lambda: server.should_exit)
        server = uvicorn.Server(uvicorn.Config(app, lifespan="off", log_config=None, ws="none", http="h11"))
        thread = threading.Thread(target=server.run, kwargs={"sockets": [listener]})
        watcher.start()
        thread.start()
        try:
            yield f"http://127.0.0.1:{listener.getsockname()[1]}"
        finally:
            server.should_exit = True
            thread.join(30)
            watcher.close()
            assert not thread.is_alive()


def test_the_page_follows_a_run(
    writer: Writer,
    finished_run: Path,
    tmp_path: Path,
    journal_of: Callable[[Path], list[dict[str, Any]]],
    until: Until,
) -> None:
    lines = journal_of(finished_run)
    begun = next(i for i, line in enumerate(lines) if line["state"] == "done") + 1
    for line in lines[:begun]:
        writer.write(line)
    with served(tmp_path / "growing") as address:
        until(lambda: fetched(address)["progress"]["shown"] == 1)
        state = fetched(address)
        assert (state["progress"]["total"], state["progress"]["done"]) == (10, 1)
        assert state["state"]["name"] == "measuring"
        with urllib.request.urlopen(f"{address}/events", timeout=60) as answer:  # noqa: S310
            assert answer.headers["content-type"].startswith("text/event-stream")
            told = (json.loads(line[6:])["version"] for line in answer if line.startswith(b"data: "))
            first = next(told)
            for line in lines[begun:]:
                writer.write(line)
            assert next(version for version in told if version != first)
        until(lambda: fetched(address)["progress"]["shown"] == 10)
        until(lambda: fetched(address)["state"]["name"] == "finished")
        assert fetched(address)["progress"]["done"] == 10


def fetched(address: str) -> dict[str, Any]:
    """Return the state of the run that is served at `address`."""
    with urllib.request.urlopen(f"{address}/state.json", timeout=60) as answer:  # noqa: S310
        found: dict[str, Any] = json.load(answer)
    return found


def test_a_writer_that_dies_is_missed(
    writer: Writer, finished_run: Path, tmp_path: Path, journal_of: Callable[[Path], list[dict[str, Any]]]
) -> None:
    for line in journal_of(finished_run)[:12]:
        writer.write(line)
    watcher = Watcher(tmp_path / "growing")
    assert json.loads(watcher.snapshot.body)["state"]["name"] == "measuring"
    writer.kill()
    watcher.look()
    assert json.loads(watcher.snapshot.body)["state"]["name"] == "dead"


def test_a_folder_that_goes_away_is_told_and_what_was_seen_stays(run: Path) -> None:
    watcher = Watcher(run)
    before = json.loads(watcher.snapshot.body)
    run.rename(run.with_name("elsewhere"))
    watcher.look()
    gone = json.loads(watcher.snapshot.body)
    assert "not there any more" in gone["problems"][0]
    assert gone["progress"]["total"] == before["progress"]["total"] == 10
    run.with_name("elsewhere").rename(run)
    watcher.look()
    assert json.loads(watcher.snapshot.body)["problems"] == []


def test_another_run_under_the_same_name_is_followed_from_its_beginning(run: Path) -> None:
    watcher = Watcher(run)
    header = (run / "run.yaml").read_text()
    shutil.rmtree(run)
    (run / "points").mkdir(parents=True)
    (run / "run.yaml").write_text(header.replace("\nid: ", "\nid: other-"))
    (run / "journal.jsonl").write_text('{"state": "run_started"}\n{"state": "planned", "point": 0}\n')
    watcher.look()
    state = json.loads(watcher.snapshot.body)
    assert state["run"]["id"].startswith("other-")
    assert state["progress"]["total"] == 1


def test_each_file_is_counted_once(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    counted: list[int] = []

    def counting(folder: Path, done: Any, roi: Any) -> Any:
        counted.append(done.point)
        return count_point(folder, done, roi)

    monkeypatch.setattr("bench.watch.counter.count_point", counting)
    watcher = Watcher(run)
    while watcher.count_one():
        watcher.look()
    with (run / "journal.jsonl").open("a") as journal:
        journal.write('{"state": "resumed"}\n')
    watcher.look()
    assert not watcher.count_one()
    assert sorted(counted) == list(range(10))


def test_looking_leaves_no_trace_in_the_folder(run: Path) -> None:
    def listing() -> dict[str, tuple[int, int]]:
        return {str(p): (p.stat().st_size, p.stat().st_mtime_ns) for p in sorted(run.rglob("*"))}

    before = listing()
    watcher = Watcher(run)
    while watcher.count_one():
        watcher.look()
    assert listing() == before


@pytest.mark.parametrize("damage", [b"", b"format: [", b"format: evs-bench-run/9\n", b"\xff\xfe"])
def test_a_header_that_cannot_be_read_is_one_line(damage: bytes, tmp_path: Path) -> None:
    (tmp_path / "run.yaml").write_bytes(damage)
    with pytest.raises(RunError) as caught:
        Watcher(tmp_path)
    assert len(str(caught.value).splitlines()) == 1
    assert str(tmp_path / "run.yaml") in str(caught.value)
