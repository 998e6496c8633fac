"""What all tests share: where the fixtures are, and the rule that nothing is skipped in silence."""

from __future__ import annotations

import os
from pathlib import Path

import pytest
from hypothesis import settings

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")  # as the command does, before numpy is loaded

# How long an example takes depends on what else the machine does: that is no reason to fail.
settings.register_profile("any_machine", deadline=None)
settings.load_profile("any_machine")

_ALLOWED = Path(__file__).parent / "allowed_skips.txt"
_skipped: list[str] = []


@pytest.fixture(scope="session")
def data_folder() -> Path:
    """Return the folder of fixtures, each with its source and licence."""
    return Path(__file__).parent / "data"


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Remember each test that was skipped."""
    if report.skipped and not hasattr(report, "wasxfail"):
        _skipped.append(report.nodeid)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Remember each file that was skipped as a whole."""
    if report.skipped:
        _skipped.append(report.nodeid)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Where skips are not allowed, a test that was skipped and is not on the list fails the run."""
    if os.environ.get("EVS_BENCH_STRICT_SKIPS") != "1":
        return
    allowed = {line.split("#")[0].strip() for line in _ALLOWED.read_text().splitlines()}
    unexpected = [node for node in _skipped if node not in allowed]
    if unexpected:
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
        reporter = session.config.pluginmanager.getplugin("terminalreporter")
        if reporter is not None:
            reporter.write_line("skipped, and not in tests/allowed_skips.txt: " + ", ".join(unexpected), red=True)
