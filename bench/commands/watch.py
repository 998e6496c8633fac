"""`evs-bench watch`: a run in the browser while it is taken."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import click

from bench.commands.common import say

__all__ = ["command"]


@click.command(name="watch")
@click.argument("run", type=click.Path(path_type=Path))
@click.option(
    "--port", type=click.IntRange(0, 65535), default=8765, show_default=True, metavar="N",
    help="Port of the page; 0 for any free one.",
)  # fmt: skip
@click.option(
    "--host", default="127.0.0.1", show_default=True, metavar="ADDRESS",
    help="Where to listen: 127.0.0.1 for this computer only, 0.0.0.0 for others too, who then need a token.",
)  # fmt: skip
@click.option("--token", metavar="TOKEN", help="What visitors have to know; made up where others can reach the page.")
@click.option("--no-browser", is_flag=True, help="Do not open the page; only print its address.")
def command(run: Path, port: int, host: str, token: str | None, no_browser: bool) -> None:
    """Show the run in the folder RUN in a browser, while it is taken or later, until Ctrl-C.

    The folder is only read: the run goes on as if nobody looked, and the page can be opened in the middle of it,
    closed, and opened again.

    Example:  evs-bench watch my_run

    For others in the laboratory:  evs-bench watch my_run --host 0.0.0.0 --no-browser
    """
    from bench.watch.serving import serve

    def ready(address: str) -> None:
        click.echo(address)
        say(f"this page shows {run} until Ctrl-C")
        if not no_browser and _has_screen():
            import webbrowser

            webbrowser.open(address)

    serve(run, host, port, token, ready)
    say("no longer shown; the run itself is not concerned")


def _has_screen() -> bool:
    """Return whether a browser would open a window; without one it would take over the terminal."""
    if sys.platform != "linux":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))
