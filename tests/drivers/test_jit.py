"""Compiled code is kept by a hash of all kernel files, because numba's own cache looks at one file only."""

from __future__ import annotations

import ast
import os
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("bench", "drivers", "protocols", "sim_backend")

HELPER = "from drivers.jit import njit\n\n\n@njit(cache=True)\ndef helper(x):\n    return x + {added}\n"
CALLER = (
    "from drivers.helper_kernels import helper\n"
    "from drivers.jit import njit\n\n\n"
    "@njit(cache=True)\ndef caller(x):\n    return helper(x) * 10\n"
)


def run(folder: Path) -> int:
    """Call the kernel of the small project in `folder`, in a process of its own."""
    environment = {**os.environ, "EVS_BENCH_CACHE": str(folder / "cache"), "PYTHONPATH": str(folder)}
    code = "from drivers.caller_kernels import caller; print(caller(1))"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=folder, env=environment, capture_output=True, text=True, check=True
    )
    return int(done.stdout)


def test_a_changed_helper_in_another_file_changes_the_result(tmp_path: Path) -> None:
    package = tmp_path / "drivers"
    package.mkdir()
    (package / "__init__.py").touch()
    shutil.copy(ROOT / "drivers" / "jit.py", package)
    (package / "caller_kernels.py").write_text(CALLER)
    helper = package / "helper_kernels.py"
    helper.write_text(HELPER.format(added=1))
    assert run(tmp_path) == 20
    assert run(tmp_path) == 20
    helper.write_text(HELPER.format(added=5))
    assert run(tmp_path) == 60
    folders = list((tmp_path / "cache" / "evs-bench" / "kernels").iterdir())
    assert len(folders) == 2


def test_only_kernel_files_import_the_compiler() -> None:
    for file in (f for p in PACKAGES for f in (ROOT / p).rglob("*.py")):
        if file.name.endswith("kernels.py") or file == ROOT / "drivers" / "jit.py":
            continue
        imported = {
            name
            for node in ast.walk(ast.parse(file.read_text()))
            for name in (
                [node.module or ""] if isinstance(node, ast.ImportFrom)
                else [alias.name for alias in node.names] if isinstance(node, ast.Import)
                else []
            )
        }  # fmt: skip
        assert not imported & {"numba", "drivers.jit"}, f"{file}: only files named *kernels.py may be compiled"


def test_no_kernel_gives_up_exact_arithmetic() -> None:
    for file in (ROOT / "sim_backend").rglob("*kernels.py"):
        assert "fastmath" not in file.read_text(), file
