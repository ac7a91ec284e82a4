"""Several clips, intervals, and the choice of a model from the command line; what fit.json then holds."""

import json

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

from fitters.ode import simulate
from iris_sysid.cli import app
from iris_sysid.registry import MODELS
from tests._documents import read_fit

RUN = CliRunner()
KEYS = {"model", "status", "message", "parameters", "noise", "rms", "n"}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    place, t_s = tmp_path_factory.mktemp("clips"), np.arange(300) / 60
    for k in range(3):
        values = {"length": 0.6, "damping": 0.08, "theta_0": 0.4 + 0.1 * k, "omega_0": 0.1}
        theta = simulate(MODELS["pendulum"], t_s, values).observed[:, 0]
        theta = theta + 2e-3 * np.random.default_rng(k).standard_normal(t_s.size)
        pd.DataFrame({"t_s": t_s, "theta_rad": theta}).to_csv(place / f"clip{k}.csv", index=False)
    return place


def run(folder, *arguments):
    return RUN.invoke(app, ["fit", *[str(folder / a) if a.endswith((".csv", ".json")) else a for a in arguments]])


def test_several_tables_make_one_fit_with_a_section_of_clips(folder):
    tables = [f"clip{k}.csv" for k in range(3)]
    done = run(folder, *tables, "--model", "pendulum", "--shared", "length", "-o", "pooled.json")
    assert done.exit_code == 0, done.output
    assert "shared by 3 clips" in done.output
    document = json.loads((folder / "pooled.json").read_text())
    assert set(document) >= KEYS
    assert document["n"] == 900
    assert [clip["table"] for clip in document["clips"]["clips"]] == tables
    assert document["clips"]["shared"] == ["length"]
    assert document["clips"]["population"]["damping"]["between"]["value"] >= 0
    assert read_fit(folder / "pooled.json").parameters["length"].value == pytest.approx(0.6, rel=2e-3)


def test_measured_gravity_that_is_freed_is_a_prior_and_all_intervals_are_written(folder):
    options = ["--set", "gravity=9.79+-0.01", "--free", "gravity", "--uncertainty", "all"]
    done = run(folder, "clip0.csv", "--model", "pendulum", *options, "-o", "one.json")
    assert done.exit_code == 0, done.output
    document = read_fit(folder / "one.json")
    assert document.parameters["gravity"].stderr == pytest.approx(0.01, rel=1e-3)
    assert set(document.intervals) == {"robust", "profile", "bootstrap"}
    assert document.identifiability.hessian_condition == pytest.approx(document.identifiability.condition, rel=0.05)
    assert len(document.identifiability.gradients) > 1


def test_model_auto_writes_the_ranking(folder):
    done = run(folder, "clip2.csv", "--model", "auto", "-o", "auto.json")
    assert done.exit_code == 0, done.output
    document = read_fit(folder / "auto.json")
    assert document.model == document.selection.chosen == document.selection.ranking[0].model == "pendulum"
    assert {candidate.model for candidate in document.selection.ranking} >= {"linear-pendulum", "angular-oscillator"}
    number, equation, chosen, *_ = done.output.splitlines()
    assert (number[:8], equation[:18]) == ("usable: ", "equation complete:")
    assert chosen.startswith("pendulum (as given): its residual is ")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["clip0.csv", "--model", "pendulum", "--shared", "length"], "are about several clips"),
        (["clip0.csv", "clip1.csv", "--model", "auto"], "are about one table"),
        (["clip0.csv", "--model", "auto", "--set", "gravity=9.8"], "need the name of a model"),
        (["clip0.csv", "--model", "pendulum", "--uncertainty", "jackknife"], "there is no jackknife"),
    ],
)
def test_options_that_make_no_sense_together_are_refused(folder, arguments, message):
    done = run(folder, *arguments, "-o", "none.json")
    assert done.exit_code != 0
    assert message in done.output or message in str(done.exception)
    assert not (folder / "none.json").exists()
