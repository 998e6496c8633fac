"""`evs-bench notify-test`: one of each notice, and what became of it."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bench.commands.common import json_option, print_json, print_table, say

if TYPE_CHECKING:
    from bench.notices import Kind, Notices, Subscription

__all__ = ["command"]


@click.command(name="notify-test")
@click.argument("file", required=False, type=click.Path(path_type=Path, dir_okay=False))
@json_option
def command(file: Path | None, as_json: bool) -> int:
    """Send one notice of each kind by each way in FILE, and say what happened.

    FILE is what `--notify` takes; without it the file that the environment variable EVS_BENCH_NOTIFY names. Each
    notice says that it is a test, and is tried once. The exit code is 1 if one did not leave.

    Example:  evs-bench notify-test notices.yaml
    """
    from bench.notices import NOTIFY_VARIABLE, load_notices

    notices = load_notices(file)
    if notices is None:
        raise click.UsageError(f"name a FILE of notices, or set {NOTIFY_VARIABLE}")
    outcomes = _try_all(notices)
    if as_json:
        print_json({"format": "evs-bench-notify-test/1", "notices": outcomes})
    else:
        rows = [(o["way"], o["kind"], _outcome_text(o)) for o in outcomes]
        print_table(("way", "notice", "what happened"), rows)
    lost = sum(not o["sent"] for o in outcomes)
    if lost:
        say(f"{lost} of {len(outcomes)} notices did not leave")
    return 1 if lost else 0


def _try_all(notices: Notices) -> list[dict[str, Any]]:
    return [_outcome(one, kind) for one in notices.subscriptions for kind in dict.fromkeys(one.on)]


def _outcome(subscription: Subscription, kind: Kind) -> dict[str, Any]:
    """Send one notice, and return what happened."""
    from bench.notices import Notice
    from bench.notices.way import NotSent

    begin_s, reason = time.monotonic(), None
    notice = Notice(kind, "a trial of the notices", "nothing happened, this is a test", test=True)
    say(f"{subscription.way.name}: {kind} ...")
    try:
        subscription.way.send(notice, subscription.timeout_s)
    except NotSent as error:
        reason = str(error)
    took_s = time.monotonic() - begin_s
    return {"way": subscription.way.name, "kind": kind, "sent": reason is None, "reason": reason, "took_s": took_s}


def _outcome_text(outcome: dict[str, Any]) -> str:
    return f"sent in {outcome['took_s']:.1f} s" if outcome["sent"] else f"NOT SENT: {outcome['reason']}"
