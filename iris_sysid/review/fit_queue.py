"""Fits that follow the edits: a quick one of a long clip first, then that of all frames; the newest state first.

Nothing is fitted before an outcome is requested: what a page shows first need not share the processor with it.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import Enum
from threading import Condition, Thread

from iris_sysid.errors import IrisError
from iris_sysid.review.fit_process import AbandonedError
from iris_sysid.review.history import ReviewState
from iris_sysid.types import Run


@dataclass(frozen=True, eq=False, slots=True)
class FitOutcome:
    """The run of one version of a review, or the problem that there is none; ``seconds`` it took.

    ``every`` is above 1 for a preview: it used one frame in ``every``, and the fit of all frames follows.
    """

    version: int
    run: Run | None
    problem: str = ""
    seconds: float = 0.0
    every: int = 1


Fitting = Callable[[ReviewState, Callable[[], bool]], Run | None]  # the latter: whether to abandon it
Previewing = Callable[[ReviewState], tuple[Run | None, int] | None]


class FitStage(Enum):
    """What a thread fits."""

    PREVIEW = "previews"
    WHOLE = "fits"


class FitQueue:
    """Fits states of a review in two threads: its preview, then all frames; the newest state first.

    Attributes
    ----------
    latest
        The newest outcome; None before the first.
    before
        The newest run of an earlier version than that of ``latest``.
    opened
        The first run of all frames.
    """

    def __init__(self, compute: Fitting, preview: Previewing) -> None:
        self.latest: FitOutcome | None = None
        self.before: FitOutcome | None = None
        self.opened: FitOutcome | None = None
        self._compute, self._preview = compute, preview
        self._wanted: dict[FitStage, list[tuple[int, ReviewState]]] = {stage: [] for stage in FitStage}
        self._changed = Condition()
        self._first = self._newest = 0
        self._closed = self._begun = False

    def ask(self, version: int, state: ReviewState) -> None:
        """Have the ``state`` of that ``version`` fitted next."""
        with self._changed:
            self._first, self._newest = self._first or version, version
            self._want(FitStage.PREVIEW, version, state)

    def outcome(self, version: int, timeout_s: float, *, whole: bool = False) -> FitOutcome | None:
        """The outcome of that version or of a later one; None where it takes longer than ``timeout_s``.

        ``whole`` waits for the fit of all frames where there is a preview.
        """
        with self._changed:
            if not self._begun:
                self._begun = True
                for stage in FitStage:
                    Thread(target=self._work, args=(stage,), name=stage.value, daemon=True).start()
            self._changed.wait_for(lambda: self._is_done(version, whole), timeout_s)
            return self.latest if self._is_done(version, whole) else None

    def close(self) -> None:
        """End the threads after the fits that they are at; one that can be abandoned is."""
        with self._changed:
            self._closed = True
            self._changed.notify_all()

    def _is_done(self, version: int, whole: bool) -> bool:
        latest = self.latest
        return latest is not None and latest.version >= version and not (whole and latest.every > 1)

    def _is_old(self, version: int) -> bool:
        """Whether nobody waits for the fit of all frames of that version; the first is what later ones are beside."""
        return self._closed or (version < self._newest and self.opened is not None)

    def _want(self, stage: FitStage, version: int, state: ReviewState) -> None:
        """Have that fitted next; of those that wait only the first of all is kept: later ones are shown beside it."""
        self._wanted[stage] = [*(one for one in self._wanted[stage] if one[0] == self._first), (version, state)]
        self._changed.notify_all()

    def _work(self, stage: FitStage) -> None:
        fit = self._previewed if stage is FitStage.PREVIEW else self._fitted
        while True:
            with self._changed:
                self._changed.wait_for(lambda: self._closed or self._wanted[stage])
                if self._closed:
                    return
                version, state = self._wanted[stage].pop(0)
            outcome = fit(version, state)
            with self._changed:
                if outcome is not None:
                    self._take(outcome)
                if stage is FitStage.PREVIEW:
                    self._want(FitStage.WHOLE, version, state)

    def _take(self, outcome: FitOutcome) -> None:
        """Publish an outcome, unless it is out of date: of an older version, or a preview of what is fitted already."""
        latest = self.latest
        if outcome.every == 1 and outcome.run is not None:
            self.opened = self.opened or outcome
        if latest is not None and (outcome.version, -outcome.every) < (latest.version, -latest.every):
            if outcome.run is not None and outcome.every == 1 and outcome.version < latest.version:
                self.before = outcome
            return
        if latest is not None and latest.run is not None and latest.version < outcome.version:
            self.before = latest
        self.latest = outcome
        self._changed.notify_all()

    def _previewed(self, version: int, state: ReviewState) -> FitOutcome | None:
        """The quick fit; None where the clip is short, or where only the fit of all frames says what is wrong."""
        start = time.perf_counter()
        try:
            found = self._preview(state)
        except Exception:  # the whole fit meets the same problem, and says it
            return None
        if found is None:
            return None
        run, every = found
        return FitOutcome(version, run, "", time.perf_counter() - start, every)

    def _fitted(self, version: int, state: ReviewState) -> FitOutcome | None:
        """The fit of all frames; None where it was abandoned."""
        start = time.perf_counter()
        try:
            run = self._compute(state, lambda: self._is_old(version))
        except AbandonedError:
            return None
        except IrisError as error:
            return FitOutcome(version, None, str(error), time.perf_counter() - start)
        except Exception as error:  # a fit must not end the thread that fits: the page shows what happened
            problem = f"unexpected {type(error).__name__}: {error}"
            return FitOutcome(version, None, problem, time.perf_counter() - start)
        return FitOutcome(version, run, "", time.perf_counter() - start)
