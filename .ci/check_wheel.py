"""Build the wheel, look into it, install it into an empty environment, and use it outside the checkout."""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
import venv
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = {"bench", "drivers", "protocols", "sim_backend"}
NEEDED = {"py.typed", "quick_look.yaml", "simulated.yaml", "paper.yaml", "study.html"}


def build(folder: Path) -> Path:
    """Build the wheel from a copy of what git knows, so that nothing untracked slips in."""
    source = folder / "source"
    source.mkdir()
    files = subprocess.run(
        ["git", "ls-files", "-z", "--cached", "--others", "--exclude-standard"],
        cwd=ROOT, check=True, capture_output=True, text=True,
    ).stdout.split("\0")  # fmt: skip
    for name in filter(None, files):
        if (ROOT / name).is_file():
            target = source / name
            target.parent.mkdir(parents=True, exist_ok=True)
            target.write_bytes((ROOT / name).read_bytes())
    subprocess.run(
        [sys.executable, "-m", "build", "--wheel", "--outdir", folder, source], check=True, capture_output=True
    )
    (wheel,) = folder.glob("*.whl")
    return wheel


def look_into(wheel: Path) -> None:
    """Fail unless the wheel holds the four packages, their data, and nothing else."""
    names = [Path(n) for n in zipfile.ZipFile(wheel).namelist()]
    tops = {n.parts[0] for n in names if not n.parts[0].endswith(".dist-info")}
    if tops != PACKAGES:
        sys.exit(f"the wheel holds {sorted(tops)}, expected {sorted(PACKAGES)}")
    missing = NEEDED - {n.name for n in names}
    if missing:
        sys.exit(f"the wheel lacks {sorted(missing)}")


def use(wheel: Path, folder: Path) -> None:
    """Install the wheel into an empty environment, and run the quick protocol from an empty folder."""
    environment = folder / "venv"
    venv.create(environment, with_pip=True)
    tools = environment / ("Scripts" if sys.platform == "win32" else "bin")
    pip = [tools / "python", "-m", "pip", "--disable-pip-version-check", "install", "--quiet", "--no-compile"]
    subprocess.run([*pip, "-c", ROOT / "requirements.lock", wheel], check=True)
    elsewhere = folder / "elsewhere"
    elsewhere.mkdir()
    command = [tools / "evs-bench", "run", "quick_look", "--out", "run", "--json"]
    done = subprocess.run(command, cwd=elsewhere, check=True, capture_output=True, text=True)
    points = json.loads(done.stdout)["points_done"]
    if points < 60:
        sys.exit(f"the installed wheel took {points} points of quick_look, expected 60 or more")


def main() -> None:
    """Do it all in a temporary folder."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        wheel = build(folder)
        look_into(wheel)
        use(wheel, folder)
        print(f"wheel: {wheel.name} holds {', '.join(sorted(PACKAGES))}, installs and runs elsewhere")


if __name__ == "__main__":
    main()
