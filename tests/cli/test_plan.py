"""The command ``plan``: what a diagnosis on disk leaves open, ranked, and decided with one more clip."""

import json

import numpy as np
import pytest

from iris_sysid import diagnose, write_diagnosis, write_trajectory
from tests.diagnosis.test_planning import swing

NAMES = ("quadratic-drag", "coulomb-friction")
ASKED = ("--name", NAMES[0], "--name", NAMES[1])


@pytest.fixture(scope="module")
def diagnosed(tmp_path_factory):
    folder = tmp_path_factory.mktemp("plan")
    small = swing(0.15)
    write_trajectory(small, folder / "small.csv")
    write_trajectory(swing(np.radians(75), seed=1), folder / "large.csv")
    write_diagnosis(diagnose(small, "pendulum", effects=NAMES), small, folder / "diagnosis")
    return folder


def test_plan_is_printed_and_written_and_decides(diagnosed, cli, tmp_path):
    made = ("--filmed", diagnosed / "large.csv", "--change", "release75")
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", *ASKED, *made, "-o", tmp_path / "plan")
    assert outcome.status == 0, outcome.err
    assert "tell quadratic-drag and coulomb-friction apart" in outcome.out
    assert "The new clip leaves quadratic-drag:" in outcome.out
    document = json.loads((tmp_path / "plan" / "plan.json").read_text())
    assert document["proposals"][0]["power"] > 0.9
    assert document["decision"]["quadratic-drag"] > 0.99
    assert (tmp_path / "plan" / "plan.png").stat().st_size > 10_000


def test_unknown_change_lists_those_there_are(diagnosed, cli):
    made = ("--filmed", diagnosed / "large.csv", "--change", "release-of-doves")
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", *ASKED, *made)
    assert outcome.status == 1
    assert "release75" in outcome.err


@pytest.mark.parametrize("cost", ["release75", "release75=-1", "=2"])
def test_wrong_cost_is_wrong_usage(diagnosed, cli, cost):
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", *ASKED, "--cost", cost)
    assert outcome.status == 2
    assert "NAME=NUMBER" in outcome.err


def test_limits_before_any_clip_fall_with_the_release_and_the_length(cli, tmp_path):
    outcome = cli("plan", "--phenomenon", "pendulum", "--to", "quadratic-drag=0.05", "--json", "-o", tmp_path / "plan")
    assert outcome.status == 0, outcome.err
    sizes = np.array(json.loads(outcome.out)["sizes"])
    assert np.all(np.diff(sizes, axis=0) < 0)
    assert np.all(np.diff(sizes, axis=1) < 0)
    assert (tmp_path / "plan" / "plan.png").stat().st_size > 10_000


def test_plan_without_clip_or_effect_says_what_to_give(cli):
    outcome = cli("plan")
    assert outcome.status == 2
    assert "--phenomenon and --to" in outcome.err


@pytest.mark.slow
def test_diagnosis_that_leaves_several_names_says_what_to_film(diagnosed, cli, tmp_path):
    outcome = cli("diagnose", diagnosed / "small.csv", "--model", "pendulum", "-o", tmp_path / "diagnosis")
    assert outcome.status == 0, outcome.err
    assert "Next: release at" in outcome.err
    assert "next: iris-sysid plan" in outcome.err
    assert "--name quadratic-drag" in outcome.err


def test_another_body_is_stated_by_its_factors(diagnosed, cli):
    made = ("--filmed", diagnosed / "small.csv", "--change", "mass=2,charge=3")
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", *ASKED, *made)
    assert outcome.status == 2
    assert "mass, radius, length" in outcome.err
