"""A journal that grows is read like one that is read at once, whatever stands in it."""

from __future__ import annotations

import json
import tempfile
from pathlib import Path

from hypothesis import given, settings
from hypothesis import strategies as st

from bench.store.journal import read_journal
from bench.watch.journal_tail import JournalTail

LINES = st.lists(
    st.fixed_dictionaries(
        {"state": st.sampled_from(["planned", "started", "done", "run_finished"]), "t": st.text()},
        optional={"point": st.integers(0, 9), "attempt": st.integers(1, 3), "reason": st.none() | st.text()},
    ),
    max_size=12,
)


@settings(deadline=None)
@given(LINES, st.data())
def test_pieces_give_what_the_whole_gives(lines: list[dict[str, object]], data: st.DataObject) -> None:
    content = "".join(json.dumps(line, ensure_ascii=False) + "\n" for line in lines).encode("utf-8", "surrogatepass")
    cuts = sorted(data.draw(st.lists(st.integers(0, len(content)), max_size=5)))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "journal.jsonl")
        tail = JournalTail(path)
        for stop in [*cuts, len(content)]:
            path.write_bytes(content[:stop]) if not path.exists() else _append(path, content, stop)
            tail.read()
        assert tail.entries == read_journal(path)
        assert not tail.read()


def _append(path: Path, content: bytes, stop: int) -> None:
    with path.open("ab") as file:
        file.write(content[path.stat().st_size : stop])


@settings(deadline=None)
@given(st.binary(max_size=300))
def test_no_content_ends_the_page(content: bytes) -> None:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "journal.jsonl")
        path.write_bytes(content)
        tail = JournalTail(path)
        tail.read()
        assert len(tail.entries) + len(tail.damaged) <= content.count(b"\n")


def test_a_line_is_read_when_it_is_whole(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    tail = JournalTail(path)
    assert not tail.read()
    path.write_bytes(b'{"state": "run_started"}\n{"state": "star')
    assert tail.read()
    assert [entry.state for entry in tail.entries] == ["run_started"]
    with path.open("ab") as file:
        file.write(b'ted", "point": 4}\nnonsense\n')
    assert tail.read()
    assert [(entry.state, entry.point) for entry in tail.entries] == [("run_started", None), ("started", 4)]
    assert tail.damaged == [3]


def test_another_journal_is_read_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "journal.jsonl"
    path.write_bytes(b'{"state": "run_started"}\n{"state": "run_finished"}\n')
    tail = JournalTail(path)
    tail.read()
    (tmp_path / "other").write_bytes(b'{"state": "run_started"}\n{"state": "run_aborted"}\n{"state": "resumed"}\n')
    (tmp_path / "other").replace(path)
    assert tail.read()
    assert [entry.state for entry in tail.entries] == ["run_started", "run_aborted", "resumed"]
    path.unlink()
    assert tail.read()
    assert tail.entries == []
    assert not tail.exists
