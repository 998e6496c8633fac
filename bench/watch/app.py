"""The page as a web application: the page itself, the state of the run, and word of each change."""

from __future__ import annotations

import asyncio
import json
from datetime import UTC, datetime
from functools import cache
from importlib.resources import files
from typing import TYPE_CHECKING, Final, Protocol

if TYPE_CHECKING:
    from collections.abc import AsyncIterator, Callable

    from starlette.requests import Request
    from starlette.responses import Response
    from starlette.types import ASGIApp

    from bench.watch.access import Access
    from bench.watch.watcher import Snapshot

__all__ = ["Source", "changes", "watch_app"]

_LOOK_S: Final = 0.25
_ALIVE_S: Final = 10.0  #: so often something is sent, that neither side takes the other for gone
_STATIC: Final = {
    "/watch.css": "text/css",
    "/watch.js": "text/javascript",
    "/plots.js": "text/javascript",
    "/icon.svg": "image/svg+xml",
}


class Source(Protocol):
    """What has the latest state of the run: :class:`bench.watch.watcher.Watcher`."""

    @property
    def snapshot(self) -> Snapshot:
        """The state of the run as it was last seen."""
        ...


def watch_app(source: Source, access: Access, closing: Callable[[], bool] = lambda: False) -> ASGIApp:
    """Return the application that shows the run of `source`.

    Parameters
    ----------
    access
        Who may look.
    closing
        Whether the server is about to end: connections that wait for changes are ended then.
    """
    from starlette.applications import Starlette
    from starlette.responses import Response, StreamingResponse
    from starlette.routing import Route

    from bench.watch.access import Guard

    async def page(_request: Request) -> Response:
        run = json.loads(source.snapshot.body)["run"]
        return Response(_page(run["title"]), media_type="text/html")

    async def state(request: Request) -> Response:
        snapshot = source.snapshot
        tag = f'"{snapshot.version}"'
        if request.headers.get("if-none-match") == tag:
            return Response(status_code=304, headers={"ETag": tag})
        headers = {
            "ETag": tag,
            "X-State-Version": snapshot.version,
            "X-Server-Time": _now(),
            "Vary": "Accept-Encoding",
        }
        if "gzip" not in request.headers.get("accept-encoding", ""):
            return Response(snapshot.body, media_type="application/json", headers=headers)
        headers["Content-Encoding"] = "gzip"
        return Response(snapshot.packed, media_type="application/json", headers=headers)

    async def events(_request: Request) -> Response:
        return StreamingResponse(changes(source, closing), media_type="text/event-stream")

    async def static(request: Request) -> Response:
        name = request.url.path
        return Response(_template(name[1:]), media_type=_STATIC[name])

    routes = [
        Route("/", page, methods=["GET"]),
        Route("/state.json", state, methods=["GET"]),
        Route("/events", events, methods=["GET"]),
        *(Route(name, static, methods=["GET"]) for name in _STATIC),
    ]
    return Guard(Starlette(routes=routes), access)


async def changes(source: Source, closing: Callable[[], bool]) -> AsyncIterator[str]:
    """Yield an event for the present state, and one for each change, until the server ends.

    An event holds the version of the state and the time here; the state itself is fetched by whoever wants it.
    """
    yield "retry: 2000\n\n"
    told, silent_s = "", _ALIVE_S
    while not closing():
        version = source.snapshot.version
        if version != told or silent_s >= _ALIVE_S:
            told, silent_s = version, 0.0
            yield f"data: {json.dumps({'version': version, 'now': _now()})}\n\n"
        await asyncio.sleep(_LOOK_S)
        silent_s += _LOOK_S


def _now() -> str:
    return datetime.now(UTC).isoformat(timespec="milliseconds")


@cache
def _template(name: str) -> str:
    return files("bench.watch").joinpath("templates", name).read_text(encoding="utf-8")


def _page(title: str) -> str:
    """Return the page, still empty: what it shows it asks for itself."""
    from jinja2 import Environment, StrictUndefined

    environment = Environment(autoescape=True, undefined=StrictUndefined)
    return environment.from_string(_template("watch.html")).render(title=title)
