"""The command ``plan``: what a diagnosis on disk leaves open, ranked, and decided with one more clip."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from fitters.own_model.equation import model_from_equation
from iris_sysid import DataError, Plan, Proposal, SetUpChange, diagnose, fit, write_diagnosis, write_trajectory
from iris_sysid.cli._parsing import with_clip_settings
from iris_sysid.io.json_documents import read_document, write_document
from iris_sysid.io.schemas import PlanDocument
from iris_sysid.report.plan_text import advice, change_of, plan_document
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
    made = ("--filmed", diagnosed / "large.csv", "--change", "release75", "--precise", "length=0.01%")
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", *ASKED, *made, "-o", tmp_path / "plan")
    assert outcome.status == 0, outcome.err
    assert "tell quadratic-drag and coulomb-friction apart" in outcome.out
    assert "The new clip leaves quadratic-drag:" in outcome.out
    document = read_document(tmp_path / "plan" / "plan.json", PlanDocument)
    assert document.proposals[0].power > 0.9
    assert document.decision["quadratic-drag"] > 0.99
    (length,) = document.precision
    assert (length.parameter, length.stderr) == ("length", pytest.approx(5e-5, rel=0.01))
    assert f"(0.01 %): {length.ways[0].clips} more clips like this one" in outcome.out
    assert (tmp_path / "plan" / "plan.png").stat().st_size > 10_000


def test_change_is_read_back_from_a_plan(diagnosed, cli, tmp_path):
    release = SetUpChange("release75", "", start={"theta_0": 1.3, "omega_0": 0.0}, without=("camera-tilt",))
    proposal = Proposal(release, 0.9, {}, {}, 1.0, np.zeros(1), {})
    planned = Plan(dict.fromkeys(NAMES, 0.5), {}, proposal, (proposal,), fit(swing(0.15), "pendulum"))
    file = write_document(plan_document(planned), tmp_path / "plan.json")
    assert change_of(read_document(file, PlanDocument), "release75") == release
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", "--change", f"{file}:long")
    assert outcome.status == 1
    assert "there are: release75" in outcome.err


def test_advice_says_where_no_name_describes_the_clip():
    proposal = Proposal(SetUpChange("long", "film longer"), 0.9, {}, {}, 1.0, np.zeros(1), {})
    good = Plan(dict.fromkeys(NAMES, 0.5), {}, proposal, (proposal,), fit(swing(0.15), "pendulum"))
    assert len(advice(good)) == 1
    said = advice(replace(good, fitted=replace(good.fitted, status="misfit")))
    assert "None of these describes today's clip" in said[-1]


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


@pytest.mark.parametrize("wrong", ["length=0", "length=-1%", "length"])
def test_wrong_precision_is_wrong_usage(diagnosed, cli, wrong):
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", "--precise", wrong)
    assert outcome.status == 2
    assert "NAME=NUMBER" in outcome.err


@pytest.mark.slow
def test_diagnosis_that_leaves_several_names_says_what_to_film(diagnosed, cli, tmp_path):
    outcome = cli("diagnose", diagnosed / "small.csv", "--model", "pendulum", "-o", tmp_path / "diagnosis")
    assert outcome.status == 0, outcome.err
    assert "Next: release at" in outcome.err
    assert "next: iris-sysid plan" in outcome.err
    assert "--name quadratic-drag" in outcome.err
    assert "What to film next" in (tmp_path / "diagnosis" / "report.html").read_text()
    assert (tmp_path / "diagnosis" / "plan.png").stat().st_size > 10_000
    assert read_document(tmp_path / "diagnosis" / "plan.json", PlanDocument).proposals


def test_another_body_is_stated_by_its_factors(diagnosed, cli):
    made = ("--filmed", diagnosed / "small.csv", "--change", "mass=2,charge=3")
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", *ASKED, *made)
    assert outcome.status == 2
    assert "mass, radius, length" in outcome.err


@pytest.mark.slow
def test_equation_of_a_diagnosis_is_planned_for(diagnosed, cli, tmp_path):
    equation = "theta'' = -g/L*sin(theta) - b*theta'"
    small = swing(0.15).with_(origin={"options": {"equation": equation, "bound": ["L=0.1:2"], "set": ["g=9.80665"]}})
    model = model_from_equation(equation, units={"theta": "rad"}, observed=["theta"], bounds={"L": (0.1, 2.0)})
    found = diagnose(small, model, fixed={"g": 9.80665}, effects=NAMES)
    write_diagnosis(found, small, tmp_path / "diagnosis")
    outcome = cli("plan", tmp_path / "diagnosis", diagnosed / "small.csv", *ASKED)
    assert outcome.status == 0, outcome.err
    assert "tell quadratic-drag and coulomb-friction apart" in outcome.out


def test_plan_takes_an_equation_with_its_bounds_and_values(diagnosed, cli, tmp_path):
    given = ("--equation", "theta'' = -g/len*sin(theta) - b*theta'", "--set", "g=9.80665", "--bound", "len=0.1:2")
    outcome = cli("plan", diagnosed / "diagnosis", diagnosed / "small.csv", *ASKED, *given, "--precise", "len=0.1%")
    assert outcome.status == 0, outcome.err
    assert "tell quadratic-drag and coulomb-friction apart" in outcome.out
    assert "len " in outcome.out
    refused = cli("plan", "--phenomenon", "pendulum", "--to", "quadratic-drag", *given)
    assert refused.status == 1
    assert "--equation is about clips" in refused.err


def test_values_of_single_clips_are_told_by_path_and_by_number():
    clips, paths = [swing(0.15), swing(0.15, seed=1)], [Path("light.csv"), Path("heavy.csv")]
    light, heavy = with_clip_settings(clips, paths, ["heavy.csv:mass=0.4", "1:mass=0.1", "2:radius=25mm"], {})
    assert light.known["mass"].value == 0.1
    assert (heavy.known["mass"].value, heavy.known["radius"].value) == (0.4, 0.025)
    with pytest.raises(DataError, match="with one of 1, 2, light"):
        with_clip_settings(clips, paths, ["3:mass=0.4"], {})
