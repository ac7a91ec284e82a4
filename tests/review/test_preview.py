"""The quick fit of a long clip, and the two stages of a fit."""

import threading
import time

import numpy as np
import pytest

from iris_sysid.review.fit_process import AbandonedError
from iris_sysid.review.fit_queue import FitQueue
from iris_sysid.review.preview import MAX_FRAMES, thinned
from iris_sysid.types import Track

FPS = 30.0


def swing(frames, rate_hz):
    """A body that swings for so many frames."""
    t_s = np.arange(frames) / FPS
    xy_px = np.column_stack([300 + 100 * np.sin(2 * np.pi * rate_hz * t_s), np.full(frames, 200.0)])
    return Track(t_s, xy_px, np.full((frames, 2), 0.1), np.ones(frames, bool), np.arange(frames))


def test_short_track_is_fitted_as_it_is():
    track = swing(MAX_FRAMES, 1.0)
    assert thinned([track]) == ([track], 1)


@pytest.mark.parametrize("rate_hz", [0.02, 0.5, 1.5])
def test_thinned_track_keeps_eight_samples_a_period_and_is_short(rate_hz):
    track = swing(54_000, rate_hz)
    (some,), every = thinned([track])
    assert some.t_s.size <= MAX_FRAMES
    assert every > 1
    assert np.array_equal(some.xy_px, track.xy_px[some.frame])
    assert 1 / (rate_hz * np.median(np.diff(some.t_s))) >= 7.5


def test_of_a_fast_motion_frames_in_the_middle_are_taken():
    (some,), every = thinned([swing(54_000, 6.0)])
    assert (every, some.t_s.size) == (1, MAX_FRAMES)
    assert some.frame[0] > 20_000


def test_gaps_and_a_body_that_was_never_found_are_no_trouble():
    track = swing(10_000, 0.5)
    lost = Track(track.t_s, np.full((10_000, 2), np.nan), track.sigma_px, np.zeros(10_000, bool), track.frame)
    (some, _), every = thinned([track, lost])
    assert (every, some.t_s.size) == (1, MAX_FRAMES)


def test_preview_is_shown_until_all_frames_are_fitted():
    release = threading.Event()

    def whole(state, is_old):
        release.wait(20)
        return f"all of {state}"

    queue = FitQueue(whole, lambda state: (f"some of {state}", 18))
    queue.ask(1, "one")
    first = queue.outcome(1, 20)
    assert (first.run, first.every) == ("some of one", 18)
    assert queue.outcome(1, 0.05, whole=True) is None
    release.set()
    last = queue.outcome(1, 20, whole=True)
    assert (last.run, last.every, queue.before) == ("all of one", 1, None)
    queue.close()


def test_fit_that_an_edit_has_made_old_is_what_was_before():
    started, release = threading.Event(), threading.Event()

    def whole(state, is_old):
        started.set()
        release.wait(20)
        return f"all of {state}"

    queue = FitQueue(whole, lambda state: (f"some of {state}", 18))
    queue.ask(1, "one")
    queue.outcome(1, 20)
    assert started.wait(20)
    queue.ask(2, "two")
    assert queue.outcome(2, 20).run == "some of two"  # while all frames of the first state are being fitted
    release.set()
    last = queue.outcome(2, 20, whole=True)
    assert (last.run, queue.before.run) == ("all of two", "all of one")
    queue.close()


def test_problem_is_that_of_the_fit_of_all_frames():
    def fails(*state):
        raise RuntimeError("no fit")

    queue = FitQueue(fails, fails)
    queue.ask(1, "one")
    outcome = queue.outcome(1, 20)
    assert (outcome.run, outcome.every) == (None, 1)
    assert "no fit" in outcome.problem
    queue.close()


def test_nothing_is_fitted_before_an_outcome_is_asked_for():
    asked = []
    queue = FitQueue(lambda state, is_old: asked.append(state), lambda state: None)
    queue.ask(1, "one")
    time.sleep(0.1)
    assert asked == []
    assert queue.outcome(1, 20).version == 1
    assert asked == ["one"]
    queue.close()


def test_first_state_is_fitted_even_if_an_edit_comes_before_its_outcome_is_asked_for():
    queue = FitQueue(lambda state, is_old: f"all of {state}", lambda state: None)
    for version, state in enumerate(("one", "two", "three"), start=1):
        queue.ask(version, state)
    assert queue.outcome(3, 20, whole=True).run == "all of three"
    assert (queue.opened.run, queue.before.run) == ("all of one", "all of one")
    queue.close()


def test_fit_of_all_frames_is_abandoned_for_a_newer_state_but_not_the_first():
    began = []

    def whole(state, is_old):
        began.append(state)
        stop = time.monotonic() + (0.3 if state == "one" else 20)
        while time.monotonic() < stop and state != "three":
            if is_old():
                raise AbandonedError
            time.sleep(0.01)
        return f"all of {state}"

    queue = FitQueue(whole, lambda state: (f"some of {state}", 18))
    for version, state in enumerate(("one", "two", "three"), start=1):
        queue.ask(version, state)
        queue.outcome(version, 20)
        while state not in began:
            time.sleep(0.01)
    last = queue.outcome(3, 20, whole=True)
    assert (last.run, queue.opened.run, queue.before.run) == ("all of three", "all of one", "some of two")
    queue.close()
