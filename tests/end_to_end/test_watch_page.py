"""The page of a run in a real browser, while another process takes the run."""

from __future__ import annotations

import json
import shutil
import signal
import subprocess
import sys
import time
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator
    from pathlib import Path

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
DRIVER = shutil.which("chromedriver")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--window-size=1200,1000",
)

pytestmark = [
    pytest.mark.browser,
    pytest.mark.slow,
    pytest.mark.skipif(BROWSER is None or DRIVER is None, reason="there is no Chromium, or no driver for it"),
]


def until(true: Callable[[], Any], what: str) -> None:
    """Return when `true` is; fail after two minutes."""
    limit = time.monotonic() + 120.0
    while not true():
        assert time.monotonic() < limit, what
        time.sleep(0.1)


@contextmanager
def process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    """Run evs-bench, and end it in the end."""
    code = f"import sys; from bench.commands.{arguments[0]} import command; command.main(sys.argv[2:])"
    with subprocess.Popen([sys.executable, "-c", code, *arguments], stdout=subprocess.PIPE, text=True) as started:
        try:
            yield started
        finally:
            started.send_signal(signal.SIGCONT)
            started.kill()


@pytest.fixture
def browser(tmp_path: Path) -> Iterator[Any]:
    """Return a browser that starts with an empty profile, and notes each request."""
    webdriver = pytest.importorskip("selenium.webdriver")
    options = webdriver.ChromeOptions()
    options.binary_location = BROWSER
    for flag in (*FLAGS, f"--user-data-dir={tmp_path / 'profile'}"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL", "performance": "ALL"})
    driver = webdriver.Chrome(options=options, service=webdriver.ChromeService(DRIVER))
    try:
        yield driver
    finally:
        driver.quit()


def shown(browser: Any) -> dict[str, Any]:
    """Return what the page shows, without the times that go on by themselves."""
    return dict(
        browser.execute_script("""
            const all = (selector, value) => [...document.querySelectorAll(selector)].map(value);
            return {
                title: document.getElementById("title").textContent,
                badge: document.getElementById("badge").textContent,
                tiles: all("#tiles button", (tile) => tile.className),
                plots: all("#families svg[role=img]", (plot) => plot.querySelectorAll("[data-point]").length),
                rates: document.querySelectorAll("#rates [data-point]").length,
                log: document.getElementById("log").textContent,
                version: document.body.dataset.version,
            };
        """)
    )


def requests_of(browser: Any) -> set[str]:
    """Return every address that the page asked for."""
    messages = [json.loads(line["message"])["message"] for line in browser.get_log("performance")]
    return {m["params"]["request"]["url"] for m in messages if m["method"] == "Network.requestWillBeSent"}


def done_in(run: Path) -> int:
    """Return how many points of a run are done."""
    journal = run / "journal.jsonl"
    return journal.read_text().count('"state": "done"') if journal.exists() else 0


def test_a_sweep_is_seen_while_it_is_taken(browser: Any, tmp_path: Path) -> None:
    run = tmp_path / "run"
    with process("run", "quick_look", "--out", str(run)) as taking:
        until(lambda: done_in(run) >= 12, "the run does not go on")
        taking.send_signal(signal.SIGSTOP)  # it holds still, and holds its lock
        done = done_in(run)
        with process("watch", str(run), "--port", "0", "--no-browser") as server:
            assert server.stdout is not None
            address = server.stdout.readline().strip()
            browser.get(address)
            until(lambda: sum(shown(browser)["plots"]) == done, "not all points are in the plot")
            before = shown(browser)
            assert before["badge"] == "Measuring"
            assert before["tiles"].count("tile done") == done
            assert len(before["tiles"]) == 64
            browser.refresh()
            until(lambda: shown(browser)["version"] == before["version"], "the state is another after a reload")
            until(lambda: shown(browser) == before, "the page is another after a reload")
            taking.send_signal(signal.SIGCONT)
            until(lambda: shown(browser)["badge"] == "Finished", "the end is not seen")
            until(lambda: shown(browser)["rates"] == 8, "not all rates are in the plot")
            until(lambda: sum(shown(browser)["plots"]) == 60, "not all points are in the plots")
            after = shown(browser)
            assert after["tiles"] == ["tile done"] * 64
            assert after["plots"] == [30, 30]
            assert [line for line in browser.get_log("browser") if line["level"] == "SEVERE"] == []
            asked = requests_of(browser)
            assert f"{address}state.json" in asked
            own = ("chrome:", "chrome-untrusted:", "about:", "data:")  # of the browser itself
            assert [url for url in asked if not url.startswith((address, *own))] == []
            tell_of_a_point(browser)


def tell_of_a_point(browser: Any) -> None:
    """A square that is pointed at says what was measured there."""
    actions = pytest.importorskip("selenium.webdriver").ActionChains(browser)
    actions.move_to_element(browser.find_element("css selector", '#tiles [data-point="29"]')).perform()
    tip = browser.execute_script("return [...document.querySelectorAll('#tip p')].map((line) => line.textContent)")
    assert tip[:2] == ["point 29, done", "on, 100 lux, log contrast 0.451"]
    assert tip[2].startswith("ON response ")
