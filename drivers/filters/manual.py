"""ND filters that a person changes."""

from __future__ import annotations

import math
import sys
from typing import TYPE_CHECKING, Final

from drivers.errors import WrongState
from drivers.interfaces import Filter, FilterWheel
from protocols.errors import InputError

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping

__all__ = ["ManualFilter"]

_ADVICE: Final = "run it in a terminal with somebody at it, or use a wheel with a motor"


class ManualFilter(FilterWheel):
    """A filter holder without a motor: the operator is asked to put a filter in, and confirms.

    Which filter is in is what the operator confirmed last; nothing can read it back. On :meth:`connect` the first
    filter is asked for, so that it is known from then on.

    Parameters
    ----------
    filters
        Nominal optical density of each filter, by name.
    ask
        Shows a request to the operator, and returns when it was confirmed; an `EOFError` says that it never will be.
        None to ask in the terminal.
    name
        What the operator calls it.

    Raises
    ------
    InputError
        There is no filter, or an optical density is negative.
    """

    def __init__(
        self, filters: Mapping[str, float], *, ask: Callable[[str], None] | None = None, name: str = "filter"
    ) -> None:
        super().__init__(name)
        if not filters:
            raise InputError(f"{name}: has no filters; expected one or more")
        for label, nd_od in filters.items():
            if not 0.0 <= nd_od < math.inf:
                raise InputError(f"{name}: filter {label} has optical density {nd_od}; expected 0 or more")
        self.filters = tuple(Filter(label, float(nd_od)) for label, nd_od in filters.items())
        self._ask = ask or self._ask_in_terminal
        self._selected: Filter | None = None

    def identity(self) -> dict[str, str]:
        """Return maker, model, serial number and firmware version."""
        self.require_connected("identify itself")
        model = f"{len(self.filters)} filters changed by hand"
        return {"maker": "the operator", "model": model, "serial": "none", "firmware": "none"}

    def selected(self) -> str:
        """Return the name of the filter that the operator confirmed last.

        Raises
        ------
        WrongState
            Nobody confirmed any, or the last request was not confirmed.
        """
        self.require_connected("read the position")
        if self._selected is None:
            raise WrongState(self.name, "read the position", "no filter was confirmed", "select one, and confirm it")
        return self._selected.name

    def _connect(self) -> None:
        self._put_in(self.filters[0])

    def _close(self) -> None:
        """There is nothing to let go of."""

    def _safe_state(self) -> None:
        """No filter is safer than another."""

    def _select(self, name: str) -> None:
        wanted = next(f for f in self.filters if f.name == name)
        if wanted != self._selected:
            self._put_in(wanted)

    def _put_in(self, wanted: Filter) -> None:
        self._selected = None  # until it is confirmed, nobody knows
        asked = f"put filter {wanted.name} (OD {wanted.nd_od:g}) into the light path"
        try:
            self._ask(f"{self.name}: {asked}")
        except EOFError:
            raise WrongState(self.name, asked, "the terminal was closed before it was confirmed", _ADVICE) from None
        self._selected = wanted

    def _ask_in_terminal(self, request: str) -> None:
        """Ask in the terminal, and wait for Enter.

        Raises
        ------
        WrongState
            There is nobody to ask.
        """
        if sys.stdin is None or not sys.stdin.isatty():
            asked = request.removeprefix(f"{self.name}: ")
            raise WrongState(self.name, asked, "nobody can be asked: the input is no terminal", _ADVICE)
        input(f"{request}, then press Enter: ")
