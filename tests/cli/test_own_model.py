"""A model of the user's own, named as FILE.py:NAME: found, fitted, diagnosed, or refused with the reason."""

import json

import numpy as np
import pandas as pd
import pytest

from iris_sysid.errors import DataError, UnknownNameError
from iris_sysid.registry import MODELS

MINE = '''
"""A body that coasts, slowed by its bearing."""

from iris_sysid import OdeModel, Parameter, Quantity


def rhs(t, state, params):
    s, v = state
    return v, -params[0] * v


def guess(trajectory):
    return {"drag": 0.5, "s_0": float(trajectory.position[0, 0]), "v_0": 1.0}


coasting = OdeModel(
    name="coasting",
    summary="a body that coasts",
    equation=r"s'' = {-b s'",
    source="mine",
    states=(Quantity("s", "m", "s"), Quantity("v", "m/s", "v")),
    parameters=(Parameter("drag", "1/s", "b", lower=0.0),),
    observed=(Quantity("s", "m", "s"),),
    rhs=rhs,
    guess=guess,
)
number = 3
'''


@pytest.fixture
def mine(tmp_path):
    path = tmp_path / "my_models.py"
    path.write_text(MINE)
    return path


def way(seed: int) -> pd.DataFrame:
    t_s = np.arange(0.0, 3.0, 0.02)
    s_m = 1.5 * (1 - np.exp(-0.8 * t_s)) / 0.8 + 1e-3 * np.random.default_rng(seed).standard_normal(t_s.size)
    return pd.DataFrame({"t_s": t_s, "s_m": s_m})


def test_model_of_the_bank_is_found_by_its_name():
    assert MODELS.named("pendulum") is MODELS["pendulum"]


def test_own_model_is_fitted_and_diagnosed_over_two_clips_even_if_its_equation_is_no_latex(mine, tmp_path, cli):
    for seed in (1, 2):
        way(seed).to_csv(tmp_path / f"{seed}.csv", index=False)
    outcome = cli(
        "diagnose", tmp_path / "1.csv", tmp_path / "2.csv", "--model", f"{mine}:coasting", "-o", tmp_path / "out"
    )
    assert outcome.status == 0
    document = json.loads((tmp_path / "out" / "diagnosis.json").read_text())
    assert document["added"] == []
    for fit in (document["base"], document["further_clips"][0]["base"]):
        drag = fit["parameters"]["drag"]
        assert abs(drag["value"] - 0.8) < 4 * drag["stderr"]
    assert "Clips" in (tmp_path / "out" / "report.html").read_text()
    outcome = cli("plan", tmp_path / "out", tmp_path / "1.csv")
    assert outcome.status == 0, outcome.err
    assert outcome.out.startswith("One answer is left: ranked by precision")
    assert "error of drag" in outcome.out


def test_own_model_is_fitted_by_the_name_that_help_promises(mine, tmp_path, cli):
    way(1).to_csv(tmp_path / "1.csv", index=False)
    assert cli("fit", tmp_path / "1.csv", "--model", f"{mine}:coasting", "-o", tmp_path / "fit.json").status == 0
    drag = json.loads((tmp_path / "fit.json").read_text())["parameters"]["drag"]
    assert abs(drag["value"] - 0.8) < 4 * drag["stderr"]


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("none.py:coasting", "there is no file .*none.py"),
        ("my_models.py:swing", "'swing' is not there in .*; items of type OdeModel in it: coasting"),
        ("my_models.py:number", "'number' is of type int in .*; items of type OdeModel in it: coasting"),
        ("broken.py:coasting", "broken.py fails with ZeroDivisionError"),
        ("leaves.py:coasting", "leaves.py calls sys.exit"),
    ],
)
def test_own_model_that_cannot_be_used_is_refused_with_the_reason(mine, tmp_path, name, message):
    (tmp_path / "broken.py").write_text("1 / 0\n")
    (tmp_path / "leaves.py").write_text("import sys\nsys.exit(0)\n")
    with pytest.raises(DataError, match=message):
        MODELS.named(str(tmp_path / name))


def test_unknown_name_lists_the_bank():
    with pytest.raises(UnknownNameError, match="pendulum"):
        MODELS.named("swing")
