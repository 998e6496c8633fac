"""Two processes on one run, and two on one device: the second is refused in one line, the first goes on."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

sys.path.insert(0, str(Path(__file__).parent))

from failing_disk import is_as, short_protocol  # type: ignore[import-not-found]
from night_devices import Telling  # type: ignore[import-not-found]

from bench.cli import run as command
from bench.run import resume, run_protocol
from bench.run.stop import StopFlag
from bench.station import load_station
from drivers.errors import ConnectionFailed
from drivers.transport.link import Link
from drivers.transport.ports import BytePort, SerialPort, UsbTmcPort

#: Holds a port of a kind until its standard input ends.
_HOLDER = """\
import sys
from drivers.transport.ports import SerialPort, UsbTmcPort
port = SerialPort(sys.argv[2], 9600) if sys.argv[1] == "serial" else UsbTmcPort(sys.argv[2])
port.open()
print("open", flush=True)
sys.stdin.read()
"""


class _Others:
    """What other processes do at some moment of a run."""

    def __init__(self, *asked: list[str]) -> None:
        self._asked = asked
        self.ended: list[tuple[int, str]] = []

    def __call__(self) -> None:
        for arguments in self._asked:
            done = subprocess.run(
                [sys.executable, "-m", "bench", *arguments],
                capture_output=True,
                text=True,
                check=False,
                env={**os.environ, "PYTHONPATH": os.pathsep.join(path or "." for path in sys.path)},
            )
            self.ended.append((done.returncode, done.stderr.strip()))


@pytest.fixture
def whole(tmp_path: Path) -> Path:
    """Return the undisturbed run."""
    run_protocol(short_protocol(), load_station("simulated"), tmp_path / "whole")
    return tmp_path / "whole"


def test_a_run_under_way_is_not_gone_on_with_and_not_begun_again(whole: Path, tmp_path: Path) -> None:
    folder, protocol, queue = tmp_path / "run", tmp_path / "short.yaml", tmp_path / "queue.yaml"
    protocol.write_text(short_protocol().text)
    queue.write_text(f"format: evs-bench-queue/1\ntitle: two\nentries:\n  - protocol: {protocol}\n")
    others = _Others(
        ["resume", str(folder)],
        ["run", str(protocol), "--out", str(folder)],
        ["queue", str(queue), "--out", str(folder)],
    )
    run_protocol(short_protocol(), load_station("simulated"), folder, progress=Telling(1, others))
    assert others.ended[0] == (1, f"evs-bench: {folder}: another process is writing this run")
    assert others.ended[1][0] == others.ended[2][0] == 1
    assert f"{folder}: exists already" in others.ended[1][1]
    assert str(folder) in others.ended[2][1]
    assert "Traceback" not in str(others.ended)
    is_as(folder, whole)


def test_of_two_that_go_on_with_a_run_one_does(whole: Path, tmp_path: Path) -> None:
    folder, stop = tmp_path / "run", StopFlag()
    run_protocol(short_protocol(), load_station("simulated"), folder, stop=stop, progress=Telling(0, stop.request))
    others = _Others(["resume", str(folder)])
    resume(folder, progress=Telling(0, others))
    assert others.ended == [(1, f"evs-bench: {folder}: another process is writing this run")]
    is_as(folder, whole)
    assert command(["resume", str(folder)]) == 0  # when the first is over, it is free


def _held(kind: str, path: str, port: BytePort) -> ConnectionFailed:
    """Return what a link says that opens a port which another process has open; it opens when that one is gone."""
    with subprocess.Popen(
        [sys.executable, "-c", _HOLDER, kind, path],
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
        env={**os.environ, "PYTHONPATH": os.pathsep.join(entry or "." for entry in sys.path)},
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "open\n"
        with pytest.raises(ConnectionFailed) as caught:
            Link(port, "wheel").open()
        holder.communicate()
    port.open()
    port.close()
    return caught.value


def test_a_serial_port_is_nobody_elses() -> None:
    main, other = os.openpty()
    try:
        path = os.ttyname(other)
        line = str(_held("serial", path, SerialPort(path, 9600)))
    finally:
        os.close(main)
        os.close(other)
    assert path in line
    assert "wheel" in line
    assert "\n" not in line


def test_a_usbtmc_instrument_is_nobody_elses(tmp_path: Path) -> None:
    path = tmp_path / "usbtmc0"
    path.touch()
    line = str(_held("usbtmc", str(path), UsbTmcPort(str(path))))
    assert "another program is using it" in line
