"""Who is to be told that numba compiles: a first use stands still for up to a minute, later ones do not."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager

NOTICED_S = 1.0  # of compiling: less is not worth a word
_told: list[Callable[[], None]] = []


@contextmanager
def when_compiling(tell: Callable[[], None]) -> Iterator[None]:
    """Call ``tell`` once when compiling has taken longer than a moment while the block runs."""
    _told.append(tell)
    try:
        yield
    finally:
        if tell in _told:
            _told.remove(tell)


class CompileTime:
    """Sum of the time of compiling, s; tells those who wait when it is long, and no more often."""

    def __init__(self) -> None:
        self.total_s = 0.0

    def add(self, duration_s: float) -> None:
        """Count another ``duration_s``, s."""
        self.total_s += duration_s
        if self.total_s > NOTICED_S:
            while _told:
                _told.pop()()
