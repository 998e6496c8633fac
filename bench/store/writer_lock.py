"""Whether a process is writing a run: the lock on its journal, looked at and never taken.

To try the lock would mean to hold it for a moment, and a run that is resumed in that moment would be refused. The
kernel lists all locks of this computer; of those on a disk of the network it knows only its own.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Final

__all__ = ["is_written"]

_LOCKS: Final = Path("/proc/locks")
_MOUNTS: Final = Path("/proc/self/mountinfo")
#: File systems on which another computer may hold a lock that this one does not list.
_SHARED: Final = ("nfs", "cifs", "smb", "9p", "fuse", "ceph", "afs", "gfs", "ocfs", "lustre", "vboxsf", "virtiofs")


def is_written(journal: Path) -> bool | None:
    """Return whether a process has the journal of a run locked, as every writer has; None if that cannot be told."""
    try:
        status = journal.stat()
        table = _LOCKS.read_text(encoding="ascii", errors="replace")
    except OSError:
        return None
    holders = _holders(table, status.st_ino)
    device = f"{os.major(status.st_dev):02x}:{os.minor(status.st_dev):02x}"
    if any(on == device for _, on in holders):
        return True
    # Some file systems number their devices in two ways: then the open files of the process say it.
    opened = [_has_open(process, status) for process, _ in holders]
    if True in opened:
        return True
    return None if None in opened or _is_shared(journal) else False


def _holders(table: str, inode: int) -> list[tuple[str, str]]:
    """Return process and device of each exclusive lock of a whole file with this inode.

    A line is ``1: FLOCK  ADVISORY  WRITE 29891 fe:00:2328749 0 EOF``; one that waits has an arrow after its number.
    """
    found = []
    for line in table.splitlines():
        words = line.split()
        if len(words) < 6 or words[1] != "FLOCK" or words[3] != "WRITE":
            continue
        device, _, number = words[5].rpartition(":")
        if number == str(inode):
            found.append((words[4], device))
    return found


def _has_open(process: str, status: os.stat_result) -> bool | None:
    """Return whether a process has this file open; None if it may not be asked."""
    try:
        descriptors = list(Path("/proc", process, "fd").iterdir())
    except FileNotFoundError:
        return False
    except OSError:
        return None
    return any(_is_file(descriptor, status) for descriptor in descriptors)


def _is_file(descriptor: Path, status: os.stat_result) -> bool:
    try:
        return os.path.samestat(descriptor.stat(), status)
    except OSError:
        return False


def _is_shared(journal: Path) -> bool:
    """Return whether the journal lies on a disk that other computers may write too."""
    try:
        mounts = _MOUNTS.read_text(encoding="utf-8", errors="replace").splitlines()
        device = journal.stat().st_dev
    except OSError:
        return True
    number = f"{os.major(device)}:{os.minor(device)}"
    kinds = [line.partition(" - ")[2].split(" ")[0] for line in mounts if line.split(" ")[2:3] == [number]]
    return any(kind.startswith(_SHARED) for kind in kinds)
