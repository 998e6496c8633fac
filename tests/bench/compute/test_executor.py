"""The executor: what it promises, kept by processes of this machine and by a cluster alike."""

from __future__ import annotations

import logging
import multiprocessing
import os
import pickle
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import pytest
import worker_functions as functions  # type: ignore[import-not-found]

from bench.compute import ComputeError, Executor, ItemFailed, WorkerLost, Workforce
from bench.compute.same_software import require_same_software, software
from bench.compute.work import Failure
from drivers.errors import DataLost, OutOfRange
from protocols import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator

    Opener = Callable[..., Executor]

Task = functions.Task
NUMBERS = range(12)


def _squares(executor: Executor, tasks: list[functions.Task], *, ordered: bool = False) -> list[tuple[int, int]]:
    return list(executor.map(functions.square, tasks, ordered=ordered))


def test_every_item_comes_back_once(open_executor: Opener) -> None:
    found = _squares(open_executor(), [Task(n) for n in NUMBERS])
    assert sorted(found) == [(n, n**2) for n in NUMBERS]


def test_in_the_order_of_finishing_or_of_the_items(open_executor: Opener) -> None:
    executor = open_executor()
    assert list(executor.map(functions.square, [])) == []
    _squares(executor, [Task(0), Task(1)])  # the workers have begun
    tasks = [Task(0, delay_s=1.0), Task(1), Task(2), Task(3)]
    assert [i for i, _ in _squares(executor, tasks)][-1] == 0
    assert _squares(executor, tasks, ordered=True) == [(n, n**2) for n in range(4)]


@pytest.mark.parametrize("ordered", [False, True])
def test_items_are_taken_when_there_is_room(open_executor: Opener, ordered: bool) -> None:
    """However many items there are, no more than one for each worker is under way or waits to be looked at."""
    taken = 0

    def endless() -> Iterator[functions.Task]:
        nonlocal taken
        while True:
            yield Task(taken, delay_s=0.0 if taken else 0.3)
            taken += 1

    results = open_executor().map(functions.square, endless(), ordered=ordered)
    for delivered in range(1, 20):
        next(results)
        assert taken < delivered + 3  # two under way, and one that the generator was about to count


def test_a_lost_worker_loses_nothing(open_executor: Opener, tmp_path: Path) -> None:
    told: list[str] = []
    tasks = [Task(n, str(tmp_path), deaths=int(n in (1, 5))) for n in NUMBERS]
    executor = open_executor(tell=told.append)
    assert sorted(_squares(executor, tasks)) == [(n, n**2) for n in NUMBERS]
    assert all(len(functions.tried(task)) == task.deaths for task in tasks)
    if told:  # the cluster sees to it on its own
        assert len(told) == 2
        assert "number 1" in told[0] + told[1]
        assert "killed by SIGKILL" in told[0]


def test_an_item_that_kills_its_workers_is_named(open_executor: Opener, tmp_path: Path) -> None:
    tasks = [Task(n, str(tmp_path), deaths=99 * (n == 3)) for n in NUMBERS]
    with pytest.raises(WorkerLost, match=r"item 3 \(number 3\): its worker died") as error:
        _squares(open_executor(), tasks)
    assert "\n" not in str(error.value)
    assert 3 <= len(functions.tried(tasks[3])) <= 4


def test_an_exception_comes_back_with_its_item_and_its_own_parts(open_executor: Opener) -> None:
    executor = open_executor()
    with pytest.raises(ItemFailed, match=r"item 2 \(number 2\): lamp: set level to 7 V") as caught:
        _squares(executor, [Task(n, error=n == 2) for n in NUMBERS])
    error = caught.value.error
    assert isinstance(error, OutOfRange)
    assert (caught.value.index, error.highest, error.unit) == (2, 5.0, "V")
    assert "worker_functions.py" in "".join(error.__notes__)
    assert sorted(_squares(executor, [Task(4)])) == [(0, 16)]  # it can be used again


def test_a_result_that_cannot_be_sent_is_an_error_of_its_item(open_executor: Opener) -> None:
    with pytest.raises(ItemFailed, match="item 0"):
        list(open_executor().map(functions.unpicklable, [1]))


def test_a_name_of_the_caller(open_executor: Opener) -> None:
    results = open_executor().map(functions.square, [Task(1, error=True)], name=lambda task: f"point {task.number}")
    with pytest.raises(ItemFailed, match="point 1: lamp"):
        list(results)


def test_each_worker_is_prepared_once(open_executor: Opener) -> None:
    executor = open_executor(functions.prepare)
    found = [who for _, who in executor.map(functions.who, range(10))]
    assert {count for _, count, _ in found} == {1}
    assert len({process for process, _, _ in found}) == 2
    assert all(int(threads) >= 1 for _, _, threads in found)


def test_a_worker_that_cannot_be_prepared_is_an_error(open_executor: Opener) -> None:
    with pytest.raises(ItemFailed, match="no such file") as caught:
        list(open_executor(functions.cannot_prepare).map(functions.who, range(3)))
    assert isinstance(caught.value.error, DataLost)


def test_workers_share_the_processors() -> None:
    with Workforce(workers=2).open() as executor:
        (found,) = {threads for _, (_, _, threads) in executor.map(functions.who, range(4))}
    available = len(os.sched_getaffinity(0))
    assert int(found) == max(1, available // 2)


@pytest.mark.parametrize(("users", "workers"), [(None, "1"), ("3", "3")])
def test_workers_load_the_linear_algebra_with_one_thread(
    monkeypatch: pytest.MonkeyPatch, users: str | None, workers: str
) -> None:
    monkeypatch.delenv("OPENBLAS_NUM_THREADS")
    if users is not None:
        monkeypatch.setenv("OPENBLAS_NUM_THREADS", users)
    with Workforce(workers=2).open() as executor:
        assert {threads for _, threads in executor.map(functions.threads_of_algebra, range(2))} == {workers}
    assert os.environ.get("OPENBLAS_NUM_THREADS") == users


def test_one_worker_is_this_process() -> None:
    with Workforce(setup=functions.prepare).open() as executor:
        assert {who[0] for _, who in executor.map(functions.who, range(3))} == {os.getpid()}
        with pytest.raises(ItemFailed, match="number 2"):
            _squares(executor, [Task(2, error=True)])
    assert Workforce().alone
    assert not Workforce(workers=2).alone
    assert not Workforce(cluster="tcp://scheduler:8786").alone


def test_nobody_to_compute_is_one_line() -> None:
    with pytest.raises(ComputeError, match="0 workers; expected 1 or more"):
        Workforce(workers=0).open()


@pytest.mark.slow
def test_a_cluster_that_is_not_there_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("bench.compute.cluster._ANSWER_S", 0.5)
    for address in ("tcp://127.0.0.1:9", "nonsense://x"):
        with pytest.raises(ComputeError, match=f"cluster {address}: no scheduler answers there") as error:
            Workforce(cluster=address).open()
        assert "\n" not in str(error.value)


@pytest.mark.slow
def test_a_cluster_without_workers_is_one_line(monkeypatch: pytest.MonkeyPatch) -> None:
    from distributed import LocalCluster

    monkeypatch.setattr("bench.compute.cluster._WORKERS_S", 0.3)
    with (
        LocalCluster(n_workers=0, dashboard_address=":0", silence_logs=logging.CRITICAL) as cluster,
        pytest.raises(ComputeError, match="has no workers; start some with: dask worker") as error,
    ):
        Workforce(cluster=cluster.scheduler_address).open()
    assert "\n" not in str(error.value)


def test_other_software_is_refused() -> None:
    require_same_software(software())
    with pytest.raises(ComputeError, match=r"has other software: numpy .*, not 0\.1"):
        require_same_software({**software(), "numpy": "0.1"})


def test_work_that_is_given_up_leaves_no_process() -> None:
    before = set(multiprocessing.active_children())
    with Workforce(workers=2).open() as executor:
        results = executor.map(functions.square, [Task(0), Task(1, delay_s=600.0)])
        assert next(results) == (0, 0)
        assert len(set(multiprocessing.active_children()) - before) == 2
    assert set(multiprocessing.active_children()) <= before


def test_an_exception_without_a_way_through_a_pickle_is_told_by_its_text() -> None:
    class Odd(Exception):
        pass

    failure = Failure.of(Odd("something odd"))
    assert pickle.dumps(failure)
    error = failure.error()
    assert (type(error), str(error)) == (RuntimeError, "Odd: something odd")
    error = Failure.of(InputError("one", "two")).error()
    assert isinstance(error, InputError)
    assert len(error.problems) == 2


SCRIPT = """\
import sys
sys.path.insert(0, sys.argv[1])
import worker_functions
from bench.compute import Workforce

if __name__ == "__main__":
    with Workforce(workers=2).open() as executor:
        list(executor.map(worker_functions.note_and_wait, [sys.argv[2]] * 2))
"""


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGKILL])
def test_ctrl_c_and_a_kill_leave_no_process_behind(number: signal.Signals, tmp_path: Path) -> None:
    """Ctrl-C reaches all processes of a terminal at once; a kill reaches only the first."""
    script, folder = tmp_path / "script.py", tmp_path / "pids"
    script.write_text(SCRIPT)
    folder.mkdir()
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    command = [sys.executable, str(script), str(Path(__file__).parent), str(folder)]
    with subprocess.Popen(command, env=environment, stderr=subprocess.PIPE, start_new_session=True) as child:
        _until(lambda: len(list(folder.iterdir())) == 2)
        workers = [int(file.name) for file in folder.iterdir()]
        if number == signal.SIGINT:
            os.killpg(child.pid, number)
        else:
            child.send_signal(number)
        said = child.stderr.read().decode() if child.stderr else ""
    assert said.count("Traceback") == (number == signal.SIGINT)  # of the script itself; workers say nothing
    _until(lambda: not any(_is_there(pid) for pid in workers))


def test_a_script_without_its_guard_is_told(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT.replace('if __name__ == "__main__":', "if True:"))
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(p or "." for p in sys.path)}
    command = [sys.executable, str(script), str(Path(__file__).parent), str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert "needs the line if __name__ == '__main__'" in done.stderr


def _until(true: Callable[[], bool], seconds: float = 60.0) -> None:
    deadline = time.monotonic() + seconds
    while not true():
        assert time.monotonic() < deadline
        time.sleep(0.02)


def _is_there(pid: int) -> bool:
    """Return whether the process is alive; one that only waits to be cleared away is not."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
