"""Short time-outs for the one question that a fault befalls; everything else may take what a busy computer needs."""

from __future__ import annotations

from contextlib import contextmanager
from typing import TYPE_CHECKING, Final

if TYPE_CHECKING:
    from collections.abc import Iterator

    from drivers.transport.link import Link

PATIENT_S: Final = 20.0  #: where nothing goes wrong, so that a slow computer changes nothing
IMPATIENT_S: Final = 0.05  #: where an answer will not come


@contextmanager
def impatient(link: Link, timeout_s: float = IMPATIENT_S, quiet_s: float = 0.01) -> Iterator[None]:
    """Wait no longer than `timeout_s` for each answer; afterwards as long as before."""
    before = link.timeout_s, link._quiet_s
    link.timeout_s, link._quiet_s = timeout_s, quiet_s
    try:
        yield
    finally:
        link.timeout_s, link._quiet_s = before
