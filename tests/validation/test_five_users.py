"""What a command said is judged by both axes of its verdict."""

import subprocess

import pytest

from validation.five_users import STEPS, Said, Step, first_line, judgement

STEP = Step("student", "fit table.csv", "0.5 m", {"length": (0.5, 0.01)})


def said(length: float, word: str = "good", *, complete: bool = True) -> Said:
    verdict = {"word": word, "equation": {"complete": complete}}
    return Said(0, "", {"parameters": {"length": {"value": length}}, "verdict": verdict})


@pytest.mark.parametrize(
    ("answer", "word"),
    [
        (said(0.505), "right"),
        (said(0.505, complete=False), "right"),
        (said(0.52), "WRONG"),
        (said(0.52, complete=False), "doubt"),
        (said(0.52, "doubtful"), "doubt"),
        (Said(0, "", {"parameters": {"length": {"value": 0.52}}, "verdict": None}), "doubt"),
        (Said(0, "", None), "WRONG"),
        (Said(1, "give --fps", None), "question"),
        (Said(1, "unexpected failure", None), "stopped"),
    ],
)
def test_number_is_wrong_only_where_the_verdict_finds_nothing_amiss(answer, word):
    assert judgement(STEP, answer) == word


def test_step_without_a_truth_has_no_right_answer():
    assert judgement(Step("student", "fit table.csv", "no pendulum"), said(0.5)) == "WRONG"
    assert judgement(Step("student", "fit table.csv", "a pendulum", anything=True), said(0.5)) == "answer"


@pytest.mark.parametrize(
    ("lines", "first"),
    [
        ("80 % of the residual is noise.\nusable: length good to 1 %\nequation complete", "usable: length good to 1 %"),
        ("doubtful: the clock is unsure", "doubtful: the clock is unsure"),
        ("two bodies\nwritten", "two bodies"),
        ("", "said on stderr"),
    ],
)
def test_verdict_is_what_was_said_also_after_the_sentences_of_a_diagnosis(lines, first):
    assert first_line(subprocess.CompletedProcess([], 0, lines, "said on stderr\n")) == first


def test_every_step_says_what_is_known():
    assert all(step.known for step in STEPS)
