"""The commands of the README on real recordings, against what their sources state, within its uncertainty."""

import json
from dataclasses import dataclass

import numpy as np
import pytest

from iris_sysid.io.csv_write import write_trajectory
from tests._project import recording
from tests._real_data import alexiev_length_68, wooden_bob

COVERAGE = 2.0  # standard errors, of the result and of the stated truth together: 95 %


@dataclass(frozen=True, slots=True)
class Stated:
    """What a source states of one parameter, with the standard error that its statement allows, and why that."""

    name: str
    value: float
    stderr: float
    why: str


RECORDINGS = {
    "juangomez_pendulum/pendulum.mp4": (
        "--phenomenon pendulum --scale 640px=1m",
        [Stated("length", 1.7, 0.05 / np.sqrt(3), "stated to one decimal: a uniform error of half of it")],
    ),
    "iris_footage/pendulum.gif": (
        "--phenomenon pendulum --set ball_radius=33.5+-1mm",
        # 2 % of the length more than the tape's 2 mm: the cord has a knot at each end, stretches under three times the
        # ball's weight, and is seen in 36 frames of a preview.
        [Stated("rope_length", 0.50, 0.01, "tape of 2 mm, cord and knots of 2 %")],
    ),
    "iris_footage/Sliding_cone.gif": (
        "--phenomenon sliding-cone --scale-bar 201,408,692,135=0.84m",
        [Stated("angle", np.radians(29.0), np.radians(0.5 / np.sqrt(3)), "read from the picture to a degree")],
    ),
    "phystrack/Projectile_Motion__30Deg_2_726mps.MP4": (
        "--phenomenon projectile --fps 240 --scale gravity=9.79 --mark launch=5,103",
        [
            Stated("launch_speed", 2.726, 0.0005, "by an electronic gate, three decimals"),
            Stated("launch_angle", np.radians(30.0), np.radians(0.5 / np.sqrt(3)), "set to a degree"),
        ],
    ),
    "phystrack/Projectile_Motion__60Deg_2_699mps.MP4": (
        "--phenomenon projectile --fps 240 --scale gravity=9.79 --mark launch=5,103",
        [
            Stated("launch_speed", 2.699, 0.0005, "by an electronic gate, three decimals"),
            Stated("launch_angle", np.radians(60.0), np.radians(0.5 / np.sqrt(3)), "set to a degree"),
        ],
    ),
}
TABLES = {
    "wooden_bob": (wooden_bob, Stated("length", 0.3340, 0.002, "cord to a ball of 38 mm: its centre is known to 2 mm")),
    "alexiev_length_68": (alexiev_length_68, Stated("length", 0.68, 0.005 / np.sqrt(3), "stated to a centimetre")),
}


def assert_agrees(document, stated):
    entry = {**document["geometry"], **document["parameters"]}[stated.name]
    allowed = COVERAGE * np.hypot(stated.stderr, entry["stderr"])
    assert abs(entry["value"] - stated.value) < allowed, (stated, entry["value"], entry["stderr"])


@pytest.mark.slow
@pytest.mark.parametrize("name", RECORDINGS)
def test_run_of_a_recording_agrees_with_what_its_source_states(name, cli, tmp_path):
    options, truths = RECORDINGS[name]
    outcome = cli("run", recording(name), *options.split(), "-o", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    document = json.loads((tmp_path / "out" / "fit.json").read_text("utf-8"))
    for stated in truths:
        assert_agrees(document, stated)


@pytest.mark.slow
@pytest.mark.parametrize("name", TABLES)
def test_fit_of_a_recorded_table_agrees_with_what_its_source_states(name, cli, tmp_path):
    read, stated = TABLES[name]
    write_trajectory(read(), tmp_path / "angles.csv")
    outcome = cli("fit", tmp_path / "angles.csv", "--model", "pendulum", "-o", tmp_path / "fit.json")
    assert outcome.status == 0, outcome.err
    assert_agrees(json.loads((tmp_path / "fit.json").read_text("utf-8")), stated)
