"""The command ``iris-sysid discover``: its file, its figure, its refusals."""

import json

import numpy as np
import pandas as pd

from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import DiscoveryDocument


def test_discover_writes_the_equation_its_terms_and_its_name(tmp_path, angles, cli):
    out, plot = tmp_path / "discovery.json", tmp_path / "discovery.png"
    outcome = cli("discover", angles, "-o", out, "--plot", plot)
    assert outcome.status == 0
    assert outcome.err == f"next: iris-sysid fit {angles} --model pendulum -o {tmp_path / 'fit.json'}\n"
    assert "theta'' = - 9.8" in outcome.out
    assert "This is the pendulum with length = " in outcome.out
    document = read_document(out, DiscoveryDocument)
    assert [equation.lhs for equation in document.equations] == ["theta''"]
    assert {term.term for term in document.terms if term.selected} == {"sin(theta)", "theta'"}
    assert abs(document.matched.parameters["length"].value - 9.80665 / 9.81) < 0.01
    assert document.origin["source"] == "angles.csv"
    assert plot.read_bytes().startswith(b"\x89PNG")


def test_discover_prints_strict_json_with_the_keys_others_rely_on(tmp_path, angles, cli):
    outcome = cli("discover", angles, angles, "-o", tmp_path / "discovery.json", "--json")
    document = json.loads(outcome.out)
    assert {"equations", "terms", "matched"} <= document.keys()
    assert {"lhs", "rhs", "latex"} <= document["equations"][0].keys()
    assert {"term", "coefficient", "ci95", "inclusion"} <= document["terms"][0].keys()
    assert {"model", "parameters"} <= document["matched"].keys()
    assert [clip["source"] for clip in document["origin"]["clips"]] == ["angles.csv"] * 2


def test_discover_finds_what_a_named_model_lacks(tmp_path, cli):
    table, out = tmp_path / "draining.csv", tmp_path / "lacking.json"
    t_s = np.arange(400) / 10
    level = 0.3 * np.exp(-0.05 * t_s) + 1e-4 * np.random.default_rng(0).standard_normal(400)
    pd.DataFrame({"t_s": t_s, "h_m": level}).to_csv(table, index=False)
    outcome = cli("discover", table, "--residual-of", "torricelli", "-o", out)
    assert (outcome.status, outcome.err) == (0, "")
    document = read_document(out, DiscoveryDocument)
    assert document.matched is None
    assert document.nearest.model == "torricelli"
    assert "h in h'" in document.nearest.extra
    assert document.origin["options"]["residual_of"] == "torricelli"


def test_discover_refuses_the_residual_of_a_model_of_something_else(tmp_path, angles, cli):
    outcome = cli("discover", angles, "--residual-of", "torricelli", "-o", tmp_path / "lacking.json")
    assert outcome.status == 1
    assert (
        "'torricelli' is not a model of theta that the library can express; there are: angular-oscillator, "
        in outcome.err
    )


def test_discover_states_what_is_wrong_in_one_line(tmp_path, cli):
    table = tmp_path / "still.csv"
    pd.DataFrame({"t_s": [k / 10 for k in range(40)], "theta_rad": 0.2}).to_csv(table, index=False)
    outcome = cli("discover", table, "-o", tmp_path / "discovery.json")
    assert outcome.status == 1
    assert outcome.err == "iris-sysid: theta is 0.2 in all 40 samples: what does not move has no equation to find\n"
    assert not (tmp_path / "discovery.json").exists()


def test_discover_does_not_replace_its_own_table(angles, cli):
    outcome = cli("discover", angles, "-o", angles, "--force")
    assert outcome.status == 1
    assert "it is what is read" in outcome.err
