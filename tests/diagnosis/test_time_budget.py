"""A diagnosis that is stopped, by its time or by the user, returns the best answer so far."""

import time
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.time_budget import OutOfTime, TimeBudget
from iris_sysid.registry import MODELS
from tests.diagnosis.test_hold_out import NOISE, THREE_EFFECTS, dragged, table


@pytest.fixture(scope="module")
def clip():
    return table(dragged())


def test_time_that_is_over_at_once_gives_the_fit_without_effects_and_says_so(clip):
    began = time.process_time()
    found = diagnose(clip, "pendulum", effects=THREE_EFFECTS, seconds=0.01)
    assert time.process_time() - began < 10.0  # the base fit and the errors over blocks, on a slow machine
    (note,) = [note for note in found.notes if note.kind == "stopped"]
    assert note.text == "the time allowed (0.01 s) was over; this is the best answer so far"
    assert found.added == ()
    assert found.base.usable
    assert found.components.parts[0].kind == "force-of-velocity"
    assert found.after.heldout == found.before.heldout > 3 * NOISE


@pytest.mark.parametrize("step", ["screening", "refitting"])
def test_interrupt_after_the_base_fit_gives_the_best_answer_so_far(step, clip):
    interrupted = []

    def stop(text: str) -> None:
        if text.startswith(step) and not interrupted:
            interrupted.append(text)
            raise KeyboardInterrupt

    found = diagnose(clip, "pendulum", effects=THREE_EFFECTS, progress=stop)
    (note,) = [note for note in found.notes if note.kind == "stopped"]
    assert note.text == "the search was interrupted; this is the best answer so far"
    assert found.base.usable
    assert np.isfinite(found.after.heldout)
    assert found.findings


def test_search_that_is_not_stopped_has_no_such_note(clip):
    found = diagnose(clip, "pendulum", effects=THREE_EFFECTS, seconds=600.0)
    assert [effect.name for effect in found.added] == ["quadratic-drag"]
    assert [note for note in found.notes if note.kind == "stopped"] == []


def test_interrupt_while_the_base_is_fitted_is_the_users():
    def rhs(t, state, params):
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        diagnose(table(dragged()), replace(MODELS["pendulum"], rhs=rhs), effects=THREE_EFFECTS)


def test_budget_stops_at_the_share_that_is_allowed_and_not_after_its_end():
    said = []
    budget = TimeBudget(0.02, said.append)
    budget.report("before any share is allowed")
    budget.allow(0.0)
    with pytest.raises(OutOfTime):
        budget.report("too late")
    budget.allow(1000.0)
    budget.report("in time")
    budget.allow(0.0)
    budget.end()
    budget.report("the report")
    assert said == ["before any share is allowed", "in time", "the report"]


def test_budget_without_a_limit_never_stops():
    budget = TimeBudget(None, lambda text: None)
    budget.allow(0.0)
    budget.report("whenever")
