"""What the ways of sending a notice have in common, and how they say what went wrong without telling a secret."""

from __future__ import annotations

import socket
import ssl
from typing import TYPE_CHECKING, Protocol

if TYPE_CHECKING:
    from bench.notices.notice import Notice

__all__ = ["NotSent", "Way", "not_sent", "tls_context"]


class NotSent(Exception):
    """A notice could not be sent.

    Parameters
    ----------
    reason
        Why, on one line and without a secret.
    again
        Whether it may go through later.
    """

    def __init__(self, reason: str, *, again: bool) -> None:
        super().__init__(reason)
        self.again = again


class Way(Protocol):
    """A way of sending notices."""

    @property
    def name(self) -> str:
        """What logs and operators call it; there is no secret in it."""
        ...

    def send(self, notice: Notice, timeout_s: float) -> None:
        """Send a notice; raises :class:`NotSent`."""
        ...


def not_sent(error: OSError, timeout_s: float) -> NotSent:
    """Return what an error of the network says; never its whole text, in which there may be an address."""
    if isinstance(error, TimeoutError):
        return NotSent(f"no answer in {timeout_s:g} s", again=True)
    if isinstance(error, ssl.SSLCertVerificationError):
        return NotSent(f"the certificate of the server is not trusted: {error.verify_message}", again=False)
    if isinstance(error, ssl.SSLError):
        return NotSent(f"no secure connection ({error.reason or type(error).__name__})", again=True)
    if isinstance(error, socket.gaierror):
        return NotSent(f"the server is not found: {error.strerror}", again=True)
    return NotSent(error.strerror or type(error).__name__, again=True)


def tls_context(ca_file: str | None) -> ssl.SSLContext:
    """Return what a secure connection trusts: the certificates of the system, or those of a file.

    Raises
    ------
    OSError
        If the file cannot be read, or holds no certificate.
    """
    return ssl.create_default_context(cafile=ca_file)
