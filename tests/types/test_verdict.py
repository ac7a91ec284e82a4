"""One verdict in the same words on every result, and in the files."""

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import MODELS, Doubt, Estimate, Trajectory, Verdict, diagnose, diagnosis_sentence, fit
from iris_sysid.io.json_documents import write_fit
from iris_sysid.types import Completeness, worst_verdict
from iris_sysid.types._verdict import explained_percent, times_text
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
    assert (verdict.word, verdict.reasons, verdict.complete) == ("good", (), True)
    assert verdict.equation.explained == pytest.approx(1.0, abs=1e-4)
    assert list(verdict.accuracy) == ["length"]
    assert verdict.text.startswith("usable: length good to 0.0")


def test_verdict_gives_no_relative_error_of_a_value_that_is_nominally_zero():
    pivot = {"pivot_along": Estimate(0.05, 1e-3, "1", "fitted")}
    result = fit(swing(), PENDULUM, free=["pivot_along"], fixed=pivot)
    assert "pivot_along" in result.free
    assert list(result.verdict.accuracy) == ["length"]


def test_verdict_takes_the_doubts_of_the_track():
    result = fit(swing(doubts=[JUMPS]), PENDULUM)
    assert result.status == "ok"
    assert (result.verdict.word, result.verdict.reasons, result.verdict.complete) == ("doubtful", (JUMPS,), True)


def test_verdict_on_a_fit_without_estimates_is_failed():
    verdict = fit(swing(4), PENDULUM).verdict
    assert (verdict.word, verdict.equation) == ("failed", None)
    assert [doubt.kind for doubt in verdict.reasons] == ["too-few-samples"]


def test_number_of_an_incomplete_equation_is_usable_and_the_equation_says_what_to_do():
    verdict = fit(swing(strange=0.002), PENDULUM).verdict
    assert (verdict.word, verdict.complete) == ("good", False)
    assert verdict.equation.residual_over_noise > 2
    assert verdict.equation_reasons[-1].kind == "residual-above-noise"
    assert "diagnose" in verdict.equation_reasons[-1].remedy
    assert verdict.number_reasons == ()
    assert ". equation incomplete: it explains 9" in verdict.text
    assert " % of the motion; the residual is " in verdict.text


def test_verdict_on_a_motion_that_the_equation_hardly_explains_is_doubtful():
    verdict = fit(swing(strange=0.05), PENDULUM).verdict
    assert (verdict.word, verdict.complete) == ("doubtful", False)
    assert verdict.equation.explained < 0.9
    assert "little-explained" in [doubt.kind for doubt in verdict.number_reasons]


@pytest.mark.parametrize(
    ("strange", "error", "remedy"),
    [(0.002, 0.25, "Diagnose"), (0.0, 0.25, None), (0.0, 0.6, "record more"), (0.002, 0.6, "Diagnose")],
)
def test_value_with_a_large_error_is_doubtful(strange, error, remedy):
    result = fit(swing(strange=strange), PENDULUM)
    length = replace(result.estimates["length"], stderr=error * result.estimates["length"].value)
    verdict = replace(result, estimates={**result.estimates, "length": length}).verdict
    if remedy is None:
        assert (verdict.word, verdict.number_reasons) == ("good", ())
    else:
        (doubt,) = verdict.number_reasons
        assert (verdict.word, doubt.kind) == ("doubtful", "imprecise")
        assert remedy in doubt.remedy
        assert f"length is good to {100 * error:.0f} % only" in verdict.text


def test_diagnosis_doubts_the_size_that_further_effects_may_move_far():
    found = diagnose(swing(), PENDULUM, effects=[])
    length = found.final.estimates["length"]
    wide = replace(found, sizes={"length": replace(length, stderr=0.6 * length.value)})
    assert (found.verdict.word, wide.verdict.word) == ("good", "doubtful")
    assert [doubt.kind for doubt in wide.verdict.number_reasons] == ["imprecise"]


def test_phenomenon_of_another_name_is_doubtful_and_its_equation_incomplete():
    another = Doubt("phenomenon", "it swings", "take a pendulum")
    verdict = fit(swing(doubts=[another]), PENDULUM).verdict
    assert (verdict.word, verdict.complete) == ("doubtful", False)


@pytest.mark.parametrize(
    ("share", "text"),
    [(0.994, "99.4 %"), (0.99997, "99.997 %"), (0.881, "88 %"), (1.0, "over 99.9999 %"), (-2.0, "0 %"), (0.0, "0 %")],
)
def test_share_of_the_motion_keeps_the_digits_of_what_lacks(share, text):
    assert explained_percent(share) == text


@pytest.mark.parametrize(
    ("ratio", "text"),
    [(1.42, "1.4 times"), (2.0, "2.0 times"), (0.5, "0.5 times"), (213.2, "210 times"), (4e6, "4000000 times")],
)
def test_ratio_is_written_out_with_two_digits(ratio, text):
    assert times_text(ratio) == text


def test_verdict_on_what_the_data_do_not_determine_is_doubtful():
    verdict = fit(swing(), PENDULUM, free=["gravity"]).verdict
    assert verdict.word == "doubtful"
    assert "undetermined" in [doubt.kind for doubt in verdict.reasons]


def test_diagnosis_speaks_the_same_words():
    doubted = diagnose(swing(doubts=[JUMPS]), PENDULUM, effects=[])
    assert (doubted.verdict.word, doubted.verdict.reasons, doubted.verdict.complete) == ("doubtful", (JUMPS,), True)
    incomplete = replace(doubted, noise_floor=doubted.after.fitted / 5)
    assert (incomplete.verdict.word, incomplete.verdict.complete) == ("doubtful", False)
    assert [doubt.kind for doubt in incomplete.verdict.reasons] == ["jumps", "incomplete"]


def test_noise_that_is_correlated_is_no_incomplete_equation():
    """It is larger than its scatter from sample to sample; where it has a form, or cannot be split, it may be more."""
    noisy = diagnose(swing(), PENDULUM, effects=[])
    larger = replace(noisy, noise_floor=noisy.after.fitted / 2.5)
    assert larger.verdict.complete
    assert diagnosis_sentence(larger).startswith("The residual is noise: nothing is missing")
    assert not replace(larger, components=None).verdict.complete
    assert not replace(noisy, noise_floor=noisy.after.fitted / 3.5).verdict.complete


def test_diagnosis_says_once_that_a_residual_remains():
    remains = diagnose(swing(strange=0.002), PENDULUM, effects=[])
    assert "residual-above-noise" in [doubt.kind for doubt in remains.final.verdict.reasons]
    assert [doubt.kind for doubt in remains.verdict.reasons] == ["incomplete"]
    assert remains.verdict.good


@pytest.mark.parametrize(("words", "worst"), [([], "good"), (["good", "failed", "doubtful"], "failed")])
def test_worst_verdict_of_several_results(words, worst):
    assert worst_verdict(Verdict(word, (JUMPS,)) for word in words) == Verdict(worst, (JUMPS,) if words else ())


def test_worst_verdict_takes_the_worst_of_each_axis():
    first = Verdict("good", (), Completeness(0.99, True, 1.1), {"length": 0.01})
    second = Verdict("doubtful", (), Completeness(0.97, False, 3.0, "it wanders"), {"length": 0.02, "mass": 0.1})
    worst = worst_verdict([first, second])
    assert worst.equation == Completeness(0.97, False, 3.0, "it wanders")
    assert worst.accuracy == {"length": 0.02, "mass": 0.1}


def test_fit_json_holds_the_verdict_and_the_codes_of_the_problems(tmp_path):
    clip = swing(doubts=[JUMPS], strange=0.05)
    result = fit(clip, PENDULUM)
    document = read_fit(write_fit(result, clip, tmp_path / "fit.json"))
    assert document.verdict.verdict() == result.verdict
    assert [(entry.reason, entry.remedy) for entry in document.problems] == [
        (problem.reason, problem.remedy) for problem in result.problems
    ]
