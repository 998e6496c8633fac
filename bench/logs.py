"""Where the log goes: beside the data it is about, and into the user's own folder when there is no run yet."""

from __future__ import annotations

import contextlib
import logging
import os
import sys
import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

__all__ = ["LOG_FILE", "log_into", "record_bug"]

#: Name of the log, in a run folder and elsewhere.
LOG_FILE: Final = "evs-bench.log"
_FORMAT: Final = "%(asctime)s %(levelname)s %(name)s: %(message)s"
_logger: Final = logging.getLogger("evs_bench")
_logger.addHandler(logging.NullHandler())
#: Where an error that :func:`log_into` has written says so, among its own attributes.
_WRITTEN_TO: Final = "evs_bench_log"


class _Log(logging.FileHandler):
    """A log that a disk may refuse: what is being done matters more, and has its own way to tell of the disk."""

    def emit(self, record: logging.LogRecord) -> None:
        """Write a line, if the file can be opened."""
        with contextlib.suppress(OSError):
            super().emit(record)

    def handleError(self, record: logging.LogRecord) -> None:  # noqa: N802 - its name in logging
        """Do without the line, where the disk does not take it; a bug of ours is shown."""
        if not isinstance(sys.exc_info()[1], OSError):
            super().handleError(record)

    def close(self) -> None:
        """Close the file, whatever of it the disk has taken."""
        with contextlib.suppress(OSError):
            super().close()


@contextlib.contextmanager
def log_into(file: Path) -> Iterator[None]:
    """Append everything that is logged meanwhile to `file`."""
    handler = _Log(file, encoding="utf-8", delay=True)
    handler.setFormatter(logging.Formatter(_FORMAT))
    _logger.addHandler(handler)
    _logger.setLevel(logging.INFO)
    try:
        yield
    except Exception as error:
        _logger.exception("ended by an error")
        vars(error)[_WRITTEN_TO] = file
        raise
    finally:
        _logger.removeHandler(handler)
        handler.close()


def record_bug(error: BaseException) -> Path:
    """Return the log that has the traceback of `error`; if none has, write it to the user's own."""
    written = vars(error).get(_WRITTEN_TO)
    if isinstance(written, Path) and written.exists():
        return written
    file = _own_log()
    handler = logging.FileHandler(file, encoding="utf-8")
    handler.setFormatter(logging.Formatter(_FORMAT))
    _logger.addHandler(handler)
    _logger.error("ended by an error", exc_info=error)
    _logger.removeHandler(handler)
    handler.close()
    return file


def _own_log() -> Path:
    for base in (os.environ.get("XDG_STATE_HOME"), str(Path("~/.local/state").expanduser()), tempfile.gettempdir()):
        if base:
            folder = Path(base) / "evs-bench"
            with contextlib.suppress(OSError):
                folder.mkdir(parents=True, exist_ok=True)
                if os.access(folder, os.W_OK):
                    return folder / LOG_FILE
    return Path(LOG_FILE)
