"""Every command and every Python block in README and docs does what it says.

Blocks fenced as ``sh`` are run line by line, in one temporary folder for each document; blocks fenced as ``python``
are run in the same folder, and blocks that begin with ``# file: NAME``, Python or not, are written into it. Lines
that set up a machine (make, pip, git, an environment) are left to the CI script, which runs them from a fresh clone.
"""

from __future__ import annotations

import os
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
DOCUMENTS = sorted([ROOT / "README.md", ROOT / "CONTRIBUTING.md", *(ROOT / "docs").rglob("*.md")])
FENCE = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
NAMED = re.compile(r"# file: (\S+)\n")
SET_UP = re.compile(r"^(git clone|cd |make |python3? -m (venv|pip)|\.venv/bin/pip|pip install|source |\. )")


def blocks(document: Path) -> list[tuple[str, str]]:
    """Return language and text of each fenced block that can be run or written."""
    found = FENCE.findall(document.read_text())
    return [(lang, text) for lang, text in found if lang in {"sh", "python"} or NAMED.match(text)]


def run_line(line: str, folder: Path) -> None:
    """Run one line of a shell block as a user would, with this environment's own evs-bench."""
    tools = str(Path(sys.executable).parent)
    environment = {**os.environ, "PATH": tools + os.pathsep + os.environ["PATH"], "NO_COLOR": "1"}
    done = subprocess.run(
        shlex.split(line, comments=True), cwd=folder, env=environment, capture_output=True, text=True, timeout=500,
        stdin=subprocess.DEVNULL,
    )  # fmt: skip
    assert done.returncode == 0, f"{line}\n{done.stdout}\n{done.stderr}"


@pytest.mark.slow
@pytest.mark.parametrize("document", [d for d in DOCUMENTS if blocks(d)], ids=lambda d: str(d.relative_to(ROOT)))
def test_every_block_runs(document: Path, tmp_path: Path) -> None:
    for language, text in blocks(document):
        if named := NAMED.match(text):
            (tmp_path / named[1]).write_text(text)
            continue
        if language == "python":
            script = tmp_path / "block.py"
            script.write_text(text)
            run_line(f"{shlex.quote(sys.executable)} -W error {script}", tmp_path)
            continue
        for line in filter(str.strip, text.splitlines()):
            if not line.startswith("#") and not SET_UP.match(line):
                run_line(line, tmp_path)
