"""Serving the page until Ctrl-C."""

from __future__ import annotations

import errno
import os
import socket
import threading
import time
from typing import TYPE_CHECKING, Final

from bench.watch.access import access_for
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable
    from pathlib import Path

__all__ = ["serve"]

_CALM: Final = 10  #: added to the nice value: the run, on the same computer as a rule, comes first


def serve(folder: Path, host: str, port: int, token: str | None, ready: Callable[[str], None]) -> None:
    """Show the run in `folder` until Ctrl-C.

    Parameters
    ----------
    folder
        The run folder; it is only read.
    host, port
        Where to listen; 0 for any free port.
    token
        What a visitor has to know; None for nothing on this computer, and for one that is made up elsewhere.
    ready
        Called with the address once the page can be opened.

    Raises
    ------
    InputError
        If there is no run, the page cannot listen there, or what it needs is not installed.
    """
    _require_extra()
    import uvicorn

    from bench.watch.app import watch_app
    from bench.watch.watcher import Watcher

    access = access_for(host, token)
    watcher = Watcher(folder)
    with _listening(host, port) as listener:
        config = uvicorn.Config(
            watch_app(watcher, access, lambda: server.should_exit),
            loop="asyncio",
            http="h11",
            ws="none",
            lifespan="off",
            log_config=None,
            log_level="error",
            access_log=False,
            server_header=False,
            proxy_headers=False,
            limit_concurrency=200,
            timeout_graceful_shutdown=2,
        )
        server = uvicorn.Server(config)
        _be_calm()
        watcher.start()
        address = _address(host, listener.getsockname()[1], access.token)
        told = threading.Thread(target=_tell, args=(server, ready, address), daemon=True)
        told.start()
        try:
            server.run(sockets=[listener])
        except KeyboardInterrupt:
            pass  # that is how it is ended
        finally:
            watcher.close()


def _require_extra() -> None:
    """Raise :class:`InputError` if the packages of the page are not installed."""
    from importlib.util import find_spec

    missing = [name for name in ("starlette", "uvicorn") if find_spec(name) is None]
    if missing:
        raise InputError(f"the page of a run needs {' and '.join(missing)}: pip install 'evs-bench[web]'")


def _listening(host: str, port: int) -> socket.socket:
    """Return a socket that listens on `host`."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(
            host, port, type=socket.SOCK_STREAM, flags=socket.AI_PASSIVE
        )[0]
        listener = socket.socket(family, kind, protocol)
    except OSError as error:
        raise InputError(f"--host {host}: {error.strerror or error}") from None
    try:
        if os.name == "posix":  # elsewhere it would let two pages share a port
            listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        listener.bind(address)
        listener.listen()
    except OSError as error:
        listener.close()
        hint = "; --port 0 takes any free one" if error.errno == errno.EADDRINUSE else ""
        raise InputError(f"cannot listen on {host}, port {port}: {error.strerror or error}{hint}") from None
    return listener


def _be_calm() -> None:
    if hasattr(os, "nice"):
        os.nice(_CALM)


def _address(host: str, port: int, token: str | None) -> str:
    """Return the address to open; of a page on all networks, under the name of this computer."""
    name = socket.gethostname() if host in ("0.0.0.0", "::") else host  # noqa: S104 - only compared
    shown = f"[{name}]" if ":" in name else name
    return f"http://{shown}:{port}/" + (f"?token={token}" if token else "")


def _tell(server: object, ready: Callable[[str], None], address: str) -> None:
    while not getattr(server, "started", False):
        if getattr(server, "should_exit", False):
            return
        time.sleep(0.02)
    ready(address)
