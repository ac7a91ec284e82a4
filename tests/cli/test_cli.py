"""The commands at work: results in files and on stdout, progress on stderr, the same bytes again."""

import json
import os
import shlex
import subprocess
import sys

import av
import cv2
import pandas as pd
import pytest
import typer

from iris_sysid.cli import app
from iris_sysid.io.csv_read import read_track, read_trajectory
from iris_sysid.io.files import sha256_of
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import DOCUMENTS, DiagnosisDocument, OriginDocument
from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA, TRACKERS
from iris_sysid.synthetic import read_truth
from iris_sysid.synthetic.scene import SCENES
from tests._documents import read_fit
from tests.conftest import listing

COMMANDS = typer.main.get_command(app).commands


def strict(text: str) -> object:
    """Parse JSON that holds neither NaN nor Infinity."""

    def refuse(constant):
        raise AssertionError(f"{constant} is not JSON")

    return json.loads(text, parse_constant=refuse)


def example_of(name: str) -> str:
    """The line after ``Example:`` in a command's help."""
    lines = COMMANDS[name].help.splitlines()
    return next(line for at, line in enumerate(lines) if lines[at - 1].strip() == "Example:").strip()


def process(*arguments: object, encoding: str = "utf-8", **more) -> subprocess.CompletedProcess:
    """Run a command in a separate process."""
    command = [sys.executable, "-c", "from iris_sysid.cli import main; main()", *map(str, arguments)]
    return subprocess.run(command, capture_output=True, text=True, encoding=encoding, check=False, **more)


# --------------------------------------------------------------------------- help


@pytest.mark.parametrize("name", COMMANDS)
def test_help_has_an_example_that_parses(name):
    program, command, *arguments = shlex.split(example_of(name))
    assert (program, command) == ("iris-sysid", name)
    COMMANDS[name].make_context(name, arguments).close()


@pytest.mark.parametrize("name", COMMANDS)
def test_help_shows_the_example_on_one_line(name, cli):
    outcome = cli(name, "--help")
    assert outcome.status == 0
    assert example_of(name) in outcome.out
    assert outcome.err == ""


def test_help_names_every_command_and_how_to_debug(cli):
    out = cli("--help").out
    assert all(f"  {name} " in out for name in COMMANDS)
    assert "--debug" in out


# --------------------------------------------------------------------------- list and schema


def test_list_names_everything_that_is_registered(cli):
    outcome = cli("list")
    assert outcome.status == 0
    rows = [line.split()[:2] for line in outcome.out.splitlines()]
    for registry in (PHENOMENA, MODELS, EFFECTS, TRACKERS, SCENES):
        assert [name for kind, name in rows if kind == registry.kind] == list(registry)


def test_list_as_json_says_the_same(cli):
    rows = strict(cli("list", "--json").out)
    assert {"kind", "name", "summary"} == set(rows[0])
    assert len(rows) == len(cli("list").out.splitlines())


@pytest.mark.parametrize("name", DOCUMENTS)
def test_schema_is_json(name, cli):
    outcome = cli("schema", name)
    assert outcome.status == 0
    assert strict(outcome.out)["$schema"].startswith("https://json-schema.org/")
    assert name in COMMANDS["schema"].params[0].help


# --------------------------------------------------------------------------- run


@pytest.fixture(scope="module")
def ran(pendulum_clip, tmp_path_factory):
    """The folder of one run, and the process that made it."""
    folder = tmp_path_factory.mktemp("run") / "deep" / "out"
    options = ["--phenomenon", "pendulum", "--set", "ball_radius=33.5+-0.5mm", "--roi", "0,0,160,90"]
    return folder, process("run", pendulum_clip, *options, "-o", folder, "--json")


def test_run_prints_json_alone_on_stdout_and_the_rest_on_stderr(ran):
    folder, done = ran
    assert done.returncode == 0, done.stderr
    assert strict(done.stdout) == strict((folder / "fit.json").read_text("utf-8"))
    assert done.stderr.splitlines()[-1] == f"report: {folder / 'report.html'}"


def test_run_writes_a_complete_folder(ran):
    folder, _ = ran
    assert set(listing(folder)) == {
        "clip.txt",
        "fit.json",
        "fit.png",
        "report.html",
        "track.csv",
        "track.csv.origin.json",
        "track.png",
        "trajectory.csv",
        "trajectory.csv.origin.json",
    }
    assert all(cv2.imread(str(folder / name)) is not None for name in ("fit.png", "track.png"))


def test_run_writes_files_that_read_back(ran, pendulum_clip):
    folder, _ = ran
    fit = read_fit(folder / "fit.json")
    assert fit.parameters["length"].value == pytest.approx(
        read_truth(pendulum_clip).parameters["length"].value, rel=0.01
    )
    assert fit.parameters["ball_radius"].unit == "m"
    assert fit.parameters["ball_radius"].value == pytest.approx(0.0335)
    assert read_track(folder / "track.csv")[0].t_s.size == 90
    trajectory = read_trajectory(folder / "trajectory.csv")
    assert trajectory.quantities[0].column == "theta_rad"
    assert {"hand", "motion"} <= {segment.label for segment in trajectory.segments}


def test_run_leaves_an_origin_in_every_document(ran, pendulum_clip):
    folder, _ = ran
    origins = [read_fit(folder / "fit.json").origin]
    for name in ("track.csv", "trajectory.csv"):
        document = read_document(folder / f"{name}.origin.json", OriginDocument)
        assert document.table_sha256 == sha256_of(folder / name)
        origins.append(document.origin)
    for origin in origins:
        assert origin["source"] == pendulum_clip.name
        assert origin["sha256"] == sha256_of(pendulum_clip)
        assert origin["versions"]["iris-sysid"]
        assert origin["roi"] == [0, 0, 160, 90]
        assert origin["options"]["settings"] == {"ball_radius": {"value": 0.0335, "stderr": 0.0005, "unit": "m"}}
    assert pendulum_clip.parent.name not in (folder / "report.html").read_text("utf-8")


def test_run_again_writes_the_same_bytes(ran, pendulum_clip, tmp_path, cli):
    folder, _ = ran
    options = ["--phenomenon", "pendulum", "--set", "ball_radius=33.5+-0.5mm", "--roi", "0,0,160,90"]
    assert cli("run", pendulum_clip, *options, "-o", tmp_path / "again").status == 0
    again, first = listing(tmp_path / "again"), listing(folder)
    assert (tmp_path / "again" / again.pop("clip.txt").decode().strip()).samefile(pendulum_clip)
    assert (folder / first.pop("clip.txt").decode().strip()).samefile(pendulum_clip)
    assert again == first


def test_run_prints_a_table_when_not_asked_for_json(pendulum_clip, tmp_path, cli):
    outcome = cli("run", pendulum_clip, "--phenomenon", "pendulum", "-o", tmp_path / "out")
    assert outcome.status == 0
    number, equation, first, *_ = outcome.out.splitlines()
    assert number.startswith("usable: length good to ")
    assert equation.startswith("equation complete: it explains ")
    assert first.startswith("length ")
    assert outcome.err.splitlines()[-2:] == [
        f"report: {tmp_path / 'out' / 'report.html'}",
        f"next: iris-sysid diagnose {tmp_path / 'out'} -o {tmp_path / 'out' / 'diagnosis'}",
    ]


def test_run_replaces_only_when_forced(pendulum_clip, tmp_path, cli):
    command = ["run", pendulum_clip, "--phenomenon", "pendulum", "-o", tmp_path]
    (tmp_path / "fit.json").write_text("mine")
    assert cli(*command).status == 1
    assert cli(*command, "--force").status == 0
    assert read_fit(tmp_path / "fit.json").status == "ok"


def test_run_with_a_scale_bar_measures_in_metres(pendulum_clip, tmp_path, cli):
    scale = read_truth(pendulum_clip).pixels_per_metre
    bar = ["--scale-bar", f"10,10,{10 + scale:.2f},10=1m"]
    assert cli("run", pendulum_clip, "--phenomenon", "pendulum", *bar, "-o", tmp_path / "out").status == 0
    radius = read_fit(tmp_path / "out" / "fit.json").geometry["arc_radius"]
    assert (radius.unit, radius.value) == ("m", pytest.approx(0.5, rel=0.03))


# --------------------------------------------------------------------------- track


def test_track_writes_a_table_and_an_overlay(pendulum_clip, tmp_path, cli):
    outcome = cli("track", pendulum_clip, "-o", tmp_path / "track.csv", "--overlay", tmp_path / "over.mp4", "--json")
    assert outcome.status == 0
    (body,) = strict(outcome.out)
    assert body["frames"] == 90
    assert outcome.err == ""
    (track,) = read_track(tmp_path / "track.csv")
    assert track.n_valid == body["tracked"]
    assert track.origin["sha256"] == sha256_of(pendulum_clip)
    assert track.origin["options"]["tracker"] == "auto"
    with av.open(str(tmp_path / "over.mp4")) as container:
        times = [float(frame.pts * frame.time_base) for frame in container.decode(video=0)]
    assert times == pytest.approx(track.t_s.tolist(), abs=2e-5)


def test_track_again_writes_the_same_bytes(pendulum_clip, tmp_path, cli):
    for name in ("one", "two"):
        outcome = cli("track", pendulum_clip, "-o", tmp_path / name / "t.csv", "--overlay", tmp_path / name / "o.mp4")
        assert outcome.status == 0
    assert listing(tmp_path / "one") == listing(tmp_path / "two")


def test_track_follows_a_body_until_it_leaves_and_leaves_gaps_after(leaving_clip, tmp_path, cli):
    assert cli("track", leaving_clip, "-o", tmp_path / "t.csv").status == 0
    table = pd.read_csv(tmp_path / "t.csv")
    assert len(table) == 60
    assert table.x_px.notna().sum() == pytest.approx(17, abs=4)
    assert table.x_px[25:].isna().all()


def test_track_of_two_equal_movers_follows_one_or_both_as_asked(two_movers_clip, tmp_path, cli):
    assert cli("track", two_movers_clip, "--bodies", 1, "-o", tmp_path / "one.csv").status == 0
    (only,) = read_track(tmp_path / "one.csv")
    assert only.n_valid == 60
    assert abs(only.xy_px[:, 1] - only.xy_px[0, 1]).max() < 2
    assert cli("track", two_movers_clip, "--bodies", 2, "-o", tmp_path / "two.csv").status == 0
    heights = sorted(track.xy_px[:, 1].mean() for track in read_track(tmp_path / "two.csv"))
    assert heights == pytest.approx([28, 68], abs=0.1)
    assert cli("track", two_movers_clip, "--roi", "0,48,128,48", "-o", tmp_path / "low.csv").status == 0
    assert read_track(tmp_path / "low.csv")[0].xy_px[:, 1].mean() == pytest.approx(68, abs=0.1)


def test_track_keeps_what_can_be_read_when_asked(pendulum_clip, tmp_path, cli):
    folder = tmp_path / "pictures"
    folder.mkdir()
    with av.open(str(pendulum_clip)) as container:
        for number, frame in enumerate(container.decode(video=0)):
            cv2.imwrite(str(folder / f"{number:03d}.png"), frame.to_ndarray(format="bgr24"))
    (folder / "050.png").write_bytes((folder / "050.png").read_bytes()[:200])
    command = ["track", folder, "--fps", 30, "-o", tmp_path / "t.csv"]
    refused = cli(*command)
    assert refused.status == 1
    assert "050.png" in refused.err
    kept = cli(*command, "--keep-partial")
    assert kept.status == 0
    assert "warning: " in kept.err
    assert read_track(tmp_path / "t.csv")[0].t_s.size == 50


# --------------------------------------------------------------------------- smooth, fit, diagnose


def test_smooth_adds_velocities_and_bridges_gaps(angles, tmp_path, cli):
    outcome = cli("smooth", angles, "-o", tmp_path / "s.csv")
    assert outcome.status == 0
    assert outcome.out == ""
    assert outcome.err.startswith("theta: process noise ")
    table = pd.read_csv(tmp_path / "s.csv")
    velocity = next(name for name in table if name.startswith("d_"))
    assert table[velocity].notna().all()
    assert table.theta_rad.isna().sum() == 5
    assert read_trajectory(tmp_path / "s.csv").origin["sha256"] == sha256_of(angles)


def test_smooth_again_writes_the_same_bytes(angles, tmp_path, cli):
    for name in ("one", "two"):
        cli("smooth", angles, "-o", tmp_path / name / "s.csv")
    assert listing(tmp_path / "one") == listing(tmp_path / "two")


FIT = ["--model", "pendulum", "--set", "gravity=9.81+-0.01"]


def test_fit_writes_and_prints_the_same_json(angles, tmp_path, cli):
    outcome = cli("fit", angles, *FIT, "-o", tmp_path / "fit.json", "--plot", tmp_path / "fit.png", "--json")
    assert outcome.status == 0
    assert outcome.err == ""
    assert strict(outcome.out) == strict((tmp_path / "fit.json").read_text("utf-8"))
    assert cv2.imread(str(tmp_path / "fit.png")) is not None
    fit = read_fit(tmp_path / "fit.json")
    assert fit.parameters["length"].value == pytest.approx(1.0, abs=0.01)
    assert fit.parameters["gravity"].unit == "m/s^2"
    assert fit.parameters["gravity"].measurement_type == "direct"


def test_fit_leaves_its_origin(angles, tmp_path, cli):
    cli("fit", angles, *FIT, "--start-at", "length=0.7", "-o", tmp_path / "fit.json")
    origin = read_fit(tmp_path / "fit.json").origin
    assert origin["source"] == angles.name
    assert origin["sha256"] == sha256_of(angles)
    assert origin["options"]["model"] == "pendulum"
    assert origin["options"]["set"] == ["gravity=9.81+-0.01"]
    assert origin["options"]["start_at"] == ["length=0.7"]
    assert origin["versions"]["lmfit"]


def test_fit_again_writes_the_same_bytes(angles, tmp_path, cli):
    for name in ("one", "two"):
        cli("fit", angles, *FIT, "-o", tmp_path / name / "fit.json", "--plot", tmp_path / name / "fit.png")
    assert listing(tmp_path / "one") == listing(tmp_path / "two")
    assert len(listing(tmp_path / "one")) == 2


def test_fit_frees_gravity_when_the_length_is_given(angles, tmp_path, cli):
    cli("fit", angles, "--model", "pendulum", "--set", "length=100cm", "--free", "gravity", "-o", tmp_path / "f.json")
    fit = read_fit(tmp_path / "f.json")
    assert fit.parameters["gravity"].value == pytest.approx(9.81, abs=0.1)
    assert "gravity" in fit.free


def test_failed_fit_is_a_document_with_the_remedy_and_exit_1(angles, tmp_path, cli):
    short = tmp_path / "short.csv"
    short.write_text("\n".join(angles.read_text().splitlines()[:5]) + "\n")
    command = ["fit", short, "--model", "pendulum", "-o", tmp_path / "fit.json", "--plot", tmp_path / "fit.png"]
    outcome = cli(*command, "--json")
    assert outcome.status == 1
    assert outcome.err.startswith("iris-sysid: the fit failed (too-short): ")
    assert len(outcome.err.splitlines()) == 1
    fit = read_fit(tmp_path / "fit.json")
    assert fit.status == "too-short"
    assert fit.parameters["length"].value is None
    assert strict(outcome.out)["status"] == "too-short"


def test_diagnose_writes_a_complete_folder(angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "--model", "pendulum", "-o", tmp_path / "out", "--json")
    assert outcome.status == 0, outcome.err
    folder = tmp_path / "out"
    pictures = {"residual.png", "state.png", "plan.png"}  # no picture of the parts: the residual is noise
    assert set(listing(folder)) == {"diagnosis.json", "plan.json", "report.html", *pictures}
    assert strict(outcome.out) == strict((folder / "diagnosis.json").read_text("utf-8"))
    assert outcome.err.splitlines()[-1] == f"report: {folder / 'report.html'}"
    document = read_document(folder / "diagnosis.json", DiagnosisDocument)
    assert document.added == []
    assert document.origin["sha256"] == sha256_of(angles)
    assert document.origin["options"]["holdout"] == 0.3


@pytest.mark.parametrize(
    ("sensor", "tested", "missing"), [("encoder", "zero-drift", "camera-tilt"), ("camera", "camera-tilt", "zero-drift")]
)
def test_diagnose_offers_the_effects_of_the_sensor_that_is_stated(sensor, tested, missing, angles, tmp_path, cli):
    outcome = cli("diagnose", angles, "--model", "pendulum", "--sensor", sensor, "-o", tmp_path / "out")
    assert outcome.status == 0, outcome.err
    document = read_document(tmp_path / "out" / "diagnosis.json", DiagnosisDocument)
    effects = {limit.effect for limit in document.ruled_out}
    assert tested in effects
    assert missing not in effects
    assert document.origin["options"]["sensor"] == sensor


def test_diagnose_again_writes_the_same_bytes_and_prints_its_sentence(angles, tmp_path, cli):
    for name in ("one", "two"):
        outcome = cli("diagnose", angles, "--model", "pendulum", "-o", tmp_path / name)
    document = read_document(tmp_path / "two" / "diagnosis.json", DiagnosisDocument)
    *sentences, number, equation = outcome.out.splitlines()
    assert " ".join(sentences).startswith(document.sentence)
    assert (number[:8], equation[:18]) == ("usable: ", "equation complete:")
    assert listing(tmp_path / "one") == listing(tmp_path / "two")


# --------------------------------------------------------------------------- render, demo


def test_render_writes_a_clip_with_its_truth_the_same_again(tmp_path, cli):
    options = ["--size", "64x48", "--seconds", 0.2, "--effect", "quadratic-drag=0.1", "--set", "theta_0=-30deg"]
    for name in ("one", "two"):
        outcome = cli("render", "--phenomenon", "pendulum", *options, "-o", tmp_path / name / "clip.mp4")
        assert (outcome.status, outcome.out) == (0, "")
    assert listing(tmp_path / "one") == listing(tmp_path / "two")
    assert set(listing(tmp_path / "one")) == {"clip.mp4", "clip.truth.json", "clip.truth.csv", "clip.hidden.json"}
    truth = read_truth(tmp_path / "one" / "clip.mp4")
    assert truth.effects == {"quadratic-drag": 0.1}
    assert truth.parameters["theta_0"].value == pytest.approx(-0.5235988)


# --------------------------------------------------------------------------- failures


def test_stated_failure_is_one_line_and_exit_1(tmp_path):
    done = process("run", tmp_path / "no.mp4", "--phenomenon", "pendulum", "-o", tmp_path / "out")
    assert done.returncode == 1
    assert done.stdout == ""
    assert done.stderr == f"iris-sysid: there is no file {tmp_path / 'no.mp4'}\n"


def test_wrong_usage_is_exit_2(cli):
    outcome = cli("run", "clip.mp4", "--speed", 9)
    assert outcome.status == 2
    assert "No such option: --speed" in outcome.err
    assert cli().status == 2


def test_debug_shows_the_traceback(tmp_path):
    done = process("run", tmp_path / "no.mp4", "--phenomenon", "pendulum", "-o", tmp_path / "out", "--debug")
    assert done.returncode == 1
    assert "Traceback (most recent call last)" in done.stderr
    assert "VideoError: there is no file" in done.stderr


def test_path_that_the_system_refuses_is_named_with_its_reason(cli, tmp_path):
    outcome = cli("gt", "a" * 3000, "-o", tmp_path / "gt")
    assert outcome.status == 1
    assert outcome.err.startswith("iris-sysid: File name too long: aaa")
    assert "unexpected" not in outcome.err


def test_unexpected_failure_is_one_line_unless_debugged(monkeypatch, cli):
    def fail(name):
        raise RuntimeError("first\nsecond \x1b[31m")

    monkeypatch.setattr("iris_sysid.io.json_documents.schema", fail)
    outcome = cli("schema", "fit")
    assert outcome.status == 1
    said = outcome.err.replace(f" in {__file__}, line {fail.__code__.co_firstlineno + 1}", "")
    assert said == r"iris-sysid: unexpected RuntimeError: first\nsecond \x1b[31m; --debug shows where" + "\n"
    with pytest.raises(RuntimeError, match="first"):
        cli("schema", "fit", "--debug")


def test_result_can_be_printed_where_the_terminal_lacks_its_letters(angles, tmp_path):
    table = tmp_path / "振り子.csv"
    table.write_bytes(angles.read_bytes())
    environment = {**os.environ, "PYTHONIOENCODING": "latin-1"}
    arguments = ["fit", table, "--model", "pendulum", "-o", tmp_path / "fit.json", "--json"]
    done = process(*arguments, env=environment, encoding="latin-1")
    assert done.returncode == 0, done.stderr
    assert strict(done.stdout)["origin"]["source"] == "???.csv"
    assert read_fit(tmp_path / "fit.json").origin["source"] == "振り子.csv"
