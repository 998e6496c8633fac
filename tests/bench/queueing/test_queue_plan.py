"""From a queue file to its runs: what it may say, repetitions and references, and the timetable."""

from __future__ import annotations

from datetime import datetime
from typing import TYPE_CHECKING

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bench.queueing import check_queue, load_queue
from bench.queueing.checking import timetable, timetable_rows
from bench.queueing.schema import QueueFile
from protocols.errors import InputError
from protocols.files import parse_model

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path


def names(path: Path) -> list[tuple[str, int | None]]:
    return [(run.folder, run.seed) for run in load_queue(path).runs]


def test_repetitions_have_folders_and_seeds_of_their_own(write_queue: Callable[..., Path]) -> None:
    path = write_queue(
        "protocol: bright.yaml, repeat: 2",
        "protocol: dark.yaml, seed: 40, repeat: 2",
        "protocol: quick_look, name: q",
    )
    assert names(path) == [
        ("001-bright", None), ("002-bright", 2), ("003-dark", 40), ("004-dark", 41), ("005-q", None),
    ]  # fmt: skip


def test_references_come_first_last_and_after_so_many_runs(write_queue: Callable[..., Path]) -> None:
    path = write_queue("protocol: bright.yaml, repeat: 4", more="reference: {protocol: dark.yaml, every: 2}\n")
    assert names(path) == [
        ("001-reference", None), ("002-bright", None), ("003-bright", 2),
        ("004-reference", 2), ("005-bright", 3), ("006-bright", 4),
        ("007-reference", 3),
    ]  # fmt: skip


def test_references_come_after_so_much_planned_time(write_queue: Callable[..., Path]) -> None:
    more = "reference: {protocol: dark.yaml, every_minutes: 0.3, name: ref}\n"
    path = write_queue("protocol: bright.yaml, repeat: 6", "protocol: quick_look", more=more)
    queue = load_queue(path)
    (bright_s,) = {run.duration_s for run in queue.runs if run.name == "bright"}
    fit = int(18 / bright_s)
    assert 1 < fit < 6
    found = [run.name for run in queue.runs]
    assert found[: fit + 2] == ["ref", *["bright"] * fit, "ref"]
    assert found[-3:] == ["ref", "quick_look", "ref"]  # longer than that, and not cut


def test_a_warm_up_comes_before_the_first_repetition_and_before_its_reference(
    write_queue: Callable[..., Path],
) -> None:
    entry = "protocol: bright.yaml, repeat: 3, warm_up: {minutes: 10}"
    runs = load_queue(write_queue(entry)).runs
    assert [run.warm_up is not None for run in runs] == [True, False, False]
    runs = load_queue(write_queue(entry, more="reference: {protocol: dark.yaml, every: 2}\n")).runs
    assert [run.warm_up is not None for run in runs] == [True, False, False, False, False, False]


def test_the_timetable_takes_warm_ups_at_their_longest(write_queue: Callable[..., Path]) -> None:
    queue = load_queue(
        write_queue(
            "protocol: dark.yaml, warm_up: {until_degc_per_minute: 0.1, at_most_minutes: 30}",
            "protocol: dark.yaml, warm_up: {seconds: 90}",
        )
    )
    begin = datetime(2026, 11, 20, 23, 40).astimezone()
    planned = timetable(queue, begin)
    dark_s = queue.runs[0].duration_s
    assert (planned[0].end - begin).total_seconds() == pytest.approx(1800 + dark_s)
    assert (planned[1].end - planned[1].begin).total_seconds() == pytest.approx(90 + dark_s)
    assert planned[1].begin == planned[0].end
    rows = timetable_rows(planned)
    assert rows[0][6:] == ("23:40", "Sat 00:10", "warm-up, 30 min at most")
    assert [p.run.number for p in timetable(queue, begin, frozenset({1}))] == [2]


def problems(path: Path) -> str:
    with pytest.raises(InputError) as caught:
        check_queue(load_queue(path), None)
    return str(caught.value).replace(f"{path.parent}/", "")


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ("protocol: brigt.yaml", ":4:16: there is no protocol"),
        ("protocol: quick_lok", "did you mean 'quick_look'?"),
        ("protocol: bright.yaml, station: none.yaml", ":4:38: there is no station"),
        ("protocol: bright.yaml, repeat: 0", ":4:37: entries[0].repeat: 0 is out of range, must be at least 1"),
        ("protocol: bright.yaml, repeats: 2", "unknown key, did you mean 'repeat'?"),
        ("protocol: bright.yaml, on_failure: go", "'go' is not one of next, stop"),
        ("protocol: bright.yaml, name: a/b", "must be letters, digits"),
        ("protocol: bright.yaml, warm_up: {}", "give one of seconds, minutes and until_degc_per_minute"),
        ("protocol: bright.yaml, warm_up: {minutes: 1, seconds: 5}", "give one of seconds, minutes"),
        ("protocol: bright.yaml, warm_up: {until_degc_per_minute: 1}", "and at_most_minutes go together"),
        ("protocol: bright.yaml, warm_up: {minutes: 1, at_most_minutes: 2}", "go together"),
    ],
)
def test_what_is_wrong_is_said_with_its_place(write_queue: Callable[..., Path], entry: str, said: str) -> None:
    text = problems(write_queue(entry))
    assert said in text
    assert text.startswith("queue.yaml:4:")


def test_a_reference_says_how_often(write_queue: Callable[..., Path]) -> None:
    for more in ("", ", every: 2, every_minutes: 3"):
        path = write_queue("protocol: bright.yaml", more=f"reference: {{protocol: dark.yaml{more}}}\n")
        assert "queue.yaml:3:12: reference: give one of every (runs) and every_minutes" in problems(path)


def test_what_is_wrong_in_a_protocol_is_said_with_its_own_place(
    folder: Path, write_queue: Callable[..., Path]
) -> None:
    (folder / "dark.yaml").write_text((folder / "dark.yaml").read_text().replace("title", "titel"))
    text = problems(write_queue("protocol: bright.yaml", "protocol: dark.yaml"))
    assert text.startswith("dark.yaml:2:1: titel: unknown key")


def test_all_that_cannot_be_taken_is_said_at_once(folder: Path, write_queue: Callable[..., Path]) -> None:
    for name in ("bright", "dark"):
        path = folder / f"{name}.yaml"
        path.write_text(path.read_text().replace("illuminance_lux: [1", "illuminance_lux: [1e5, 1"))
    text = problems(write_queue("protocol: bright.yaml, repeat: 2", "protocol: dark.yaml"))
    assert "runs 1, 2 (bright.yaml on simulated): light" in text
    assert "run 3 (dark.yaml on simulated): light" in text


def test_steps_of_a_person_are_refused_where_there_is_none(folder: Path, write_queue: Callable[..., Path]) -> None:
    path = folder / "dark.yaml"
    path.write_text(path.read_text() + "    operator: {before: Put the cap on.}\n")
    assert "run 1 (dark.yaml on simulated): somebody has to do something" in problems(
        write_queue("protocol: dark.yaml")
    )
    assert check_queue(load_queue(write_queue("protocol: dark.yaml")), lambda _: None) is not None


def test_too_many_runs_are_refused(write_queue: Callable[..., Path]) -> None:
    path = write_queue(*["protocol: dark.yaml, repeat: 1000"] * 3)
    assert "3000 runs in one queue, at most 2000 are allowed" in problems(path)


@given(st.text(max_size=200) | st.from_regex(r"(format|entries|reference|warm_up): [\[\]{}a-z0-9, :\n-]{0,80}"))
@settings(max_examples=150, deadline=None)
def test_any_text_is_read_or_refused_in_our_words(text: str) -> None:
    try:
        parse_model(text, QueueFile, "any.yaml")
    except InputError as error:
        assert error.problems  # noqa: PT017 - most texts are refused, some are not
