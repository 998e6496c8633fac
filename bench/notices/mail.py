"""Mail by SMTP, as a rule over a secure connection."""

from __future__ import annotations

import smtplib
from dataclasses import dataclass, field
from email.message import EmailMessage
from email.utils import formatdate, make_msgid
from typing import TYPE_CHECKING, Literal

from bench.notices.way import NotSent, not_sent

if TYPE_CHECKING:
    import ssl

    from bench.notices.notice import Notice

__all__ = ["Mail"]


@dataclass(frozen=True, slots=True)
class Mail:
    """A mail server, and who gets the notices."""

    to: tuple[str, ...]
    sender: str
    server: str
    port: int
    security: Literal["starttls", "ssl", "none"]
    login: tuple[str, str] | None = field(repr=False)  #: user and password
    context: ssl.SSLContext = field(repr=False)  #: what a secure connection trusts

    @property
    def name(self) -> str:
        """The addresses and the server."""
        return f"mail to {', '.join(self.to)} by {self.server}:{self.port}"

    def send(self, notice: Notice, timeout_s: float) -> None:
        """Send a notice to all addresses."""
        try:
            with self._connected(timeout_s) as server:
                if self.security == "starttls":
                    server.starttls(context=self.context)
                if self.login is not None:
                    server.login(*self.login)
                refused = server.send_message(self._letter(notice), self.sender, self.to)
        except smtplib.SMTPException as error:
            raise _not_mailed(error) from None
        except OSError as error:
            raise not_sent(error, timeout_s) from None
        if refused:
            raise NotSent(f"the server takes no mail to {', '.join(refused)}", again=False)

    def _connected(self, timeout_s: float) -> smtplib.SMTP:
        if self.security == "ssl":
            return smtplib.SMTP_SSL(self.server, self.port, timeout=timeout_s, context=self.context)
        return smtplib.SMTP(self.server, self.port, timeout=timeout_s)

    def _letter(self, notice: Notice) -> EmailMessage:
        letter = EmailMessage()
        letter["Subject"] = notice.subject
        letter["From"] = self.sender
        letter["To"] = ", ".join(self.to)
        letter["Date"] = formatdate(localtime=True)
        letter["Message-ID"] = make_msgid(domain=self.sender.rpartition("@")[2])
        letter["Auto-Submitted"] = "auto-generated"  # so that nobody's holiday notice answers it
        letter.set_content("\n".join(notice.lines()) + "\n")
        return letter


def _not_mailed(error: smtplib.SMTPException) -> NotSent:
    """Return what a mail server said; of a login only that it was refused."""
    if isinstance(error, smtplib.SMTPAuthenticationError):
        return NotSent(f"the server refused user or password ({error.smtp_code})", again=error.smtp_code < 500)
    if isinstance(error, smtplib.SMTPRecipientsRefused):
        later = all(code < 500 for code, _ in error.recipients.values())
        return NotSent(f"the server takes no mail to {', '.join(error.recipients)}", again=later)
    if isinstance(error, smtplib.SMTPResponseException):
        return NotSent(f"the server answered {error.smtp_code}", again=error.smtp_code < 500)
    if isinstance(error, smtplib.SMTPNotSupportedError):
        return NotSent("the server lacks what is asked of it (STARTTLS, or a login)", again=False)
    return NotSent("the server ended the connection", again=True)
