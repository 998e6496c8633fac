"""Telling somebody how a run goes: by a web hook, by mail, or by a command of the user's own.

A notice never touches the run: it is sent from a thread of its own, with a time-out, and what goes wrong with it is
one line in the log.
"""

from __future__ import annotations

from bench.notices.loading import NOTIFY_VARIABLE, Notices, Subscription, load_notices
from bench.notices.notice import KINDS, Kind, Notice
from bench.notices.notifier import Notifier, notifying
from bench.notices.watching import NoticeProgress, RunFacts, facts_of, with_notices

__all__ = [
    "KINDS",
    "NOTIFY_VARIABLE",
    "Kind",
    "Notice",
    "NoticeProgress",
    "Notices",
    "Notifier",
    "RunFacts",
    "Subscription",
    "facts_of",
    "load_notices",
    "notifying",
    "with_notices",
]
