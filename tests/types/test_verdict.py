"""One verdict in the same words on every result, and in the files."""

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import MODELS, Doubt, Trajectory, Verdict, diagnose, fit
from iris_sysid.io.json_documents import write_fit
from iris_sysid.types import worst_verdict
from tests._documents import read_fit

PENDULUM = MODELS["pendulum"]
JUMPS = Doubt("jumps", "the track leaps 3 times", "mark the body with --mark")


def swing(n=200, doubts=(), strange=0.0):
    t_s = np.arange(n) / 60
    theta = 0.1 * np.cos(np.sqrt(9.81 / 0.5) * t_s) + strange * np.sin(11 * t_s) * t_s
    theta = theta + 1e-4 * np.random.default_rng(3).standard_normal(n)
    return Trajectory(
        t_s, PENDULUM.observed, theta[:, None], np.full((n, 1), 1e-4), np.ones(n, bool), doubts=tuple(doubts)
    )


def test_verdict_on_a_clean_fit_is_good():
    verdict = fit(swing(), PENDULUM).verdict
    assert (verdict.word, verdict.reasons) == ("good", ())


def test_verdict_takes_the_doubts_of_the_track():
    result = fit(swing(doubts=[JUMPS]), PENDULUM)
    assert result.status == "ok"
    assert result.verdict == Verdict("doubtful", (JUMPS,))


def test_verdict_on_a_fit_without_estimates_is_failed():
    verdict = fit(swing(4), PENDULUM).verdict
    assert verdict.word == "failed"
    assert [doubt.kind for doubt in verdict.reasons] == ["too-few-samples"]


def test_verdict_on_a_motion_of_another_equation_is_misfit_with_the_remedy():
    verdict = fit(swing(strange=0.05), PENDULUM).verdict
    assert verdict.word == "misfit"
    assert verdict.reasons[-1].kind == "residual-above-noise"
    assert "diagnose" in verdict.reasons[-1].remedy


def test_verdict_on_what_the_data_do_not_determine_is_doubtful():
    verdict = fit(swing(), PENDULUM, free=["gravity"]).verdict
    assert verdict.word == "doubtful"
    assert "undetermined" in [doubt.kind for doubt in verdict.reasons]


def test_diagnosis_speaks_the_same_words():
    doubted = diagnose(swing(doubts=[JUMPS]), PENDULUM, effects=[])
    assert doubted.verdict == Verdict("doubtful", (JUMPS,))
    incomplete = replace(doubted, noise_floor=doubted.after.fitted / 5)
    assert incomplete.verdict.word == "misfit"
    assert [doubt.kind for doubt in incomplete.verdict.reasons] == ["jumps", "incomplete"]


def test_diagnosis_says_once_that_a_residual_remains():
    remains = diagnose(swing(strange=0.05), PENDULUM, effects=[])
    assert "residual-above-noise" in [doubt.kind for doubt in remains.final.verdict.reasons]
    assert [doubt.kind for doubt in remains.verdict.reasons] == ["incomplete"]


@pytest.mark.parametrize(("words", "worst"), [([], "good"), (["good", "failed", "misfit"], "failed")])
def test_worst_verdict_of_several_results(words, worst):
    assert worst_verdict(Verdict(word, (JUMPS,)) for word in words) == Verdict(worst, (JUMPS,) if words else ())


def test_fit_json_holds_the_verdict_and_the_codes_of_the_problems(tmp_path):
    clip = swing(doubts=[JUMPS], strange=0.05)
    result = fit(clip, PENDULUM)
    document = read_fit(write_fit(result, clip, tmp_path / "fit.json"))
    assert document.verdict.verdict() == result.verdict
    assert [(entry.reason, entry.remedy) for entry in document.problems] == [
        (problem.reason, problem.remedy) for problem in result.problems
    ]
