"""In CI nothing is skipped in silence: neither a test nor a whole file."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest

CONFTEST = Path(__file__).parent / "conftest.py"


FINE = "def test_fine(): pass\n"
ONE = "import pytest\ndef test_fine(): pass\n@pytest.mark.skip\ndef test_one(): pass\n"
WHOLE_FILE = "import pytest\npytest.importorskip('no_such_module')\ndef test_fine(): pass\n"


@pytest.mark.parametrize(
    ("text", "strict", "workers", "code"),
    [
        (FINE, "1", "0", 0),
        (ONE, "0", "0", 0),
        (ONE, "1", "0", 1),
        (ONE, "1", "1", 1),
        (WHOLE_FILE, "1", "0", 1),
        (WHOLE_FILE, "1", "1", 1),
    ],
)
def test_a_skip_that_is_not_allowed_fails_the_run(
    text: str, strict: str, workers: str, code: int, tmp_path: Path
) -> None:
    (tmp_path / "conftest.py").write_text(CONFTEST.read_text())
    (tmp_path / "allowed_skips.txt").touch()
    (tmp_path / "test_it.py").write_text(text)
    (tmp_path / "test_other.py").write_text("def test_other(): pass\n")
    environment = {**os.environ, "EVS_BENCH_STRICT_SKIPS": strict}
    options = ["-q", "-n", workers, "-p", "no:hypothesispytest", "--rootdir", str(tmp_path)]
    command = [sys.executable, "-m", "pytest", *options, str(tmp_path)]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, cwd=tmp_path)
    assert done.returncode == code, done.stdout + done.stderr
