"""Fits that follow the edits: one at a time, the newest state first, states that are out of date left out."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from threading import Condition, Thread

from iris_sysid.errors import IrisError
from iris_sysid.review.history import ReviewState
from iris_sysid.types import Run


@dataclass(frozen=True, eq=False, slots=True)
class FitOutcome:
    """The run of one version of a review, or the problem that there is none; ``seconds`` it took."""

    version: int
    run: Run | None
    problem: str = ""
    seconds: float = 0.0


class FitQueue:
    """Fits states of a review in a thread.

    Attributes
    ----------
    latest
        The newest outcome; None before the first.
    before
        The newest run of an earlier version than that of ``latest``.
    opened
        The first run of all.
    """

    def __init__(self, compute: Callable[[ReviewState], Run | None]) -> None:
        self.latest: FitOutcome | None = None
        self.before: FitOutcome | None = None
        self.opened: FitOutcome | None = None
        self._compute = compute
        self._wanted: tuple[int, ReviewState] | None = None
        self._changed = Condition()
        self._closed = False
        self._worker = Thread(target=self._work, name="fits", daemon=True)
        self._worker.start()

    def ask(self, version: int, state: ReviewState) -> None:
        """Have the ``state`` of that ``version`` fitted next."""
        with self._changed:
            self._wanted = (version, state)
            self._changed.notify_all()

    def outcome(self, version: int, timeout_s: float) -> FitOutcome | None:
        """The outcome of that version or of a later one; None where it takes longer than ``timeout_s``."""
        with self._changed:
            self._changed.wait_for(lambda: self._is_done(version), timeout_s)
            return self.latest if self._is_done(version) else None

    def close(self) -> None:
        """End the thread after the fit that it is at."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _is_done(self, version: int) -> bool:
        return self.latest is not None and self.latest.version >= version

    def _work(self) -> None:
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._wanted is not None)
                if self._closed or self._wanted is None:
                    return
                version, state = self._wanted
                self._wanted = None
            outcome = self._fitted(version, state)
            with self._changed:
                if self.latest is not None and self.latest.run is not None:
                    self.before = self.latest
                self.latest = outcome
                self.opened = self.opened or (outcome if outcome.run is not None else None)
                self._changed.notify_all()

    def _fitted(self, version: int, state: ReviewState) -> FitOutcome:
        start = time.perf_counter()
        try:
            run = self._compute(state)
        except IrisError as error:
            return FitOutcome(version, None, str(error), time.perf_counter() - start)
        except Exception as error:  # a fit must not end the thread that fits: the page shows what happened
            problem = f"unexpected {type(error).__name__}: {error}"
            return FitOutcome(version, None, problem, time.perf_counter() - start)
        return FitOutcome(version, run, "", time.perf_counter() - start)
