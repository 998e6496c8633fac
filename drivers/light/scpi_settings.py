"""Setting something of a function generator, and looking whether it came to be."""

from __future__ import annotations

from typing import TYPE_CHECKING

from drivers.errors import UnexpectedAnswer
from drivers.light.scpi_talk import number_of

if TYPE_CHECKING:
    from drivers.light.scpi_dialects import Dialect, Setting
    from drivers.light.scpi_talk import ScpiTalk

__all__ = ["Settings"]


class Settings:
    """The settings of a generator.

    Parameters
    ----------
    talk
        The link to it.
    dialect
        How it says things.
    name
        What the operator calls it.
    """

    def __init__(self, talk: ScpiTalk, dialect: Dialect, name: str) -> None:
        self._talk = talk
        self._dialect = dialect
        self._name = name

    def put(self, setting: Setting) -> float:
        """Set something, read it back, and return it as it is; a word is 0."""
        if setting.command:
            self._talk.tell(setting.command)
        answer = self.ask(setting)
        if self.differs(setting, answer):
            raise self.unexpected(setting, answer)
        return number_of(self._name, setting.question, answer) if isinstance(setting.expected, float) else 0.0

    def see_to(self, setting: Setting) -> None:
        """Set something if it is otherwise: nothing that is right is touched."""
        answer = self._answer(setting)
        if answer is None and setting.optional:
            return
        if answer is None or self.differs(setting, answer):
            self.put(setting)

    def ask(self, setting: Setting) -> str:
        """Return what something is set to."""
        answer = self._talk.ask(setting.question)
        value = self._dialect.value(setting, answer)
        if value is None:
            raise UnexpectedAnswer(self._name, setting.question, repr(answer), "is the dialect right? try again")
        return value

    def differs(self, setting: Setting, answer: str) -> bool:
        """Return whether an answer is not the one that is expected."""
        if isinstance(setting.expected, tuple):
            return answer.upper() not in setting.expected
        try:
            return not abs(float(answer) - setting.expected) <= setting.tolerance
        except ValueError:
            return True

    def unexpected(self, setting: Setting, answer: str) -> UnexpectedAnswer:
        """Return the error that something is not what was asked for."""
        asked = f"set {setting.what} ({setting.command})" if setting.command else f"ask for the {setting.what}"
        return UnexpectedAnswer(
            self._name, asked, f"it is {answer!r} {setting.unit}".rstrip(), "can the generator do this? try again"
        )

    def _answer(self, setting: Setting) -> str | None:
        return self._dialect.value(setting, self._talk.ask(setting.question))
