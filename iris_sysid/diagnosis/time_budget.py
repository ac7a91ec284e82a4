"""A budget of time for a long search: it ends between two steps, with the best answer so far."""

from __future__ import annotations

import time
from collections.abc import Callable

from iris_sysid.types import DiagnosticNote


class OutOfTime(Exception):
    """The time that was allowed is over."""


STOPPED = (OutOfTime, KeyboardInterrupt)


class TimeBudget:
    """Counts the time since it was made; a step that is reported after the time is over raises :class:`OutOfTime`.

    Parameters
    ----------
    seconds
        Allowed in all; None for no limit.
    say
        Called with a line of text at each step.
    """

    def __init__(self, seconds: float | None, say: Callable[[str], None]) -> None:
        self._seconds, self._say = seconds, say
        self._began = time.monotonic()
        self._end = float("inf")

    def allow(self, share: float) -> None:
        """Allow a share of the time, counted from the beginning."""
        self._end = float("inf") if self._seconds is None else self._began + share * self._seconds

    def end(self) -> None:
        """From here on nothing is stopped: what remains is the report."""
        self._end = float("inf")

    def report(self, text: str) -> None:
        """Say what the next step is, unless the time is over."""
        if time.monotonic() > self._end:
            raise OutOfTime
        self._say(text)

    def note(self, why: BaseException) -> DiagnosticNote:
        """Why the search stopped before its end."""
        if isinstance(why, OutOfTime):
            cause = f"the time allowed ({self._seconds:g} s) was over"
        else:
            cause = "the search was interrupted"
        return DiagnosticNote("stopped", f"{cause}; this is the best answer so far")
