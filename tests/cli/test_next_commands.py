"""Every command that a command prints as the next one works as it is printed, and so do those that it prints."""

import ast
import json
import re
import shlex
import webbrowser
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from iris_sysid import cli as command_line
from iris_sysid import render_checkerboard, render_clip
from iris_sysid.review import server
from tests._drawn import noisy
from tests._motions import on_arc, pendulum_angle
from tests.classroom._tables import write_class
from tests.conftest import discs, write_video
from tests.io.test_osp_tracker import axes, body, coords, project

NEXT = re.compile(r"^next: iris-sysid (.*)$", re.MULTILINE)
# what a user puts in the place of the words that a command cannot know
MEANT = {"NAME": "pendulum", "X1,Y1,X2,Y2=LENGTH": "10,10,110,10=1m"}
# the modules of commands that print a next one; each is the first of a test below
LEAD_ON = {
    *("calibrate", "class_", "diagnose", "discover", "fit", "frame", "gt"),
    *("import_marks", "render", "review", "run", "smooth", "track"),
}


def test_every_command_that_prints_a_next_one_is_tried_here():
    found = set()
    for file in Path(command_line.__file__).parent.glob("*.py"):
        calls = [node.func for node in ast.walk(ast.parse(file.read_text("utf-8"))) if isinstance(node, ast.Call)]
        if any(isinstance(call, ast.Attribute) and call.attr == "suggest" for call in calls):
            found.add(file.stem)
    assert found == LEAD_ON


@pytest.fixture
def unserved(monkeypatch):
    """A review that is opened and interrupted at once."""

    def serve(app, port, ready, close):
        ready("http://127.0.0.1/")
        close()

    monkeypatch.setattr(server, "serve", serve)
    monkeypatch.setattr(webbrowser, "open", lambda address: True)


@pytest.fixture
def follow(cli, unserved):
    """Run a command and then every one that is printed, each once, up to the one named; gives all these lines."""

    def followed(*arguments, clip=None, to="", status=0):
        waiting, ran = [list(map(str, arguments))], []
        while waiting:
            line = waiting.pop(0)
            if line[0] == to:  # that it leads on is another test's
                ran.append(line)
                continue
            outcome = cli(*line)
            assert outcome.status == (0 if ran else status), f"{shlex.join(line)}\n{outcome.err}"
            ran.append(line)
            texts = [shlex.split(text) for text in NEXT.findall(outcome.err)]
            texts = [[str(clip) if word == "CLIP" else MEANT.get(word, word) for word in text] for text in texts]
            waiting += [text for text in texts if text not in ran]
        return ran

    return followed


def commands(ran):
    return [line[0] for line in ran]


@pytest.fixture
def positions(tmp_path):
    """A swing as x and z of another program, whose second half runs by another equation."""
    t_s = np.arange(0.0, 5.0, 0.02)
    theta = pendulum_angle(t_s, 0.5, 0.6)
    theta[t_s > 2.5] = 0.3 * np.cos(5.0 * t_s[t_s > 2.5])
    place = on_arc(theta, 0.6) + 3e-4 * np.random.default_rng(2).standard_normal((t_s.size, 2))
    table = tmp_path / "swing of mine.csv"
    pd.DataFrame({"Zeit": t_s, "quer": place[:, 0], "hoch": place[:, 1]}).to_csv(table, index=False)
    return table


def test_positions_with_columns_of_their_own_lead_to_a_diagnosis_and_beyond(follow, positions, tmp_path):
    columns = ("--columns", "t=Zeit,x[m]=quer,z[m]=hoch")
    ran = follow("fit", positions, "--model", "pendulum", *columns, "--set", "gravity=9.81", "-o", tmp_path / "f.json")
    assert {"fit", "diagnose"} <= set(commands(ran))
    assert all("--columns" in line for line in ran if line[1] == str(positions))


def test_clip_leads_through_run_and_diagnosis_to_the_tables_of_the_run(follow, pendulum_clip, tmp_path):
    ran = follow("run", pendulum_clip, "--phenomenon", "pendulum", "-o", tmp_path / "run")
    assert commands(ran)[:2] == ["run", "diagnose"]
    assert not any("track.csv" in word for line in ran for word in line)


def test_frame_and_track_lead_to_run(follow, pendulum_clip, tmp_path):
    assert "run" in commands(follow("frame", pendulum_clip, "-o", tmp_path / "a" / "frame.png", to="diagnose"))
    assert "run" in commands(follow("track", pendulum_clip, "-o", tmp_path / "b" / "track.csv", to="run"))


def test_options_of_a_clip_are_repeated(follow, pendulum_clip, tmp_path):
    given = ("--fps", "25.0", "--stop", "2.5", "--keep-partial", "--scale", "135px=1m")
    asked = follow("run", pendulum_clip, *given, "-o", tmp_path / "asked", status=2, to="diagnose")
    assert commands(asked)[:4] == ["run", "review", "run", "review"]
    assert "--phenomenon" in asked[2]
    assert all(word in line for line in asked[1:3] for word in given)
    tracked = follow("track", pendulum_clip, *given, "-o", tmp_path / "b" / "track.csv", to="diagnose")
    assert all(word in tracked[1] for word in given)
    framed = follow("frame", pendulum_clip, *given[:2], "-o", tmp_path / "c" / "frame.png", to="diagnose")
    assert all(word in framed[1] for word in given[:2])


def test_review_of_a_clip_that_was_moved_is_opened_again(follow, pendulum_clip, tmp_path):
    assert follow("run", pendulum_clip, "--phenomenon", "pendulum", "-o", tmp_path / "run", to="diagnose")
    moved = tmp_path / "elsewhere" / "moved.mp4"
    moved.parent.mkdir()
    moved.write_bytes(pendulum_clip.read_bytes())
    ran = follow("review", tmp_path / "run", "--clip", moved)
    assert commands(ran) == ["review"]
    assert ran[0][-1] == str(moved)


def test_outlier_of_a_class_leads_to_its_review(follow, pendulum_clip, tmp_path):
    write_class(tmp_path / "class", 4, faults={})
    (tmp_path / "class" / "group9.mp4").write_bytes(pendulum_clip.read_bytes())
    (tmp_path / "class" / "groups.csv").write_text("group,scale\ngroup9,50px=1m\n")  # 135 px are 1 m
    ran = follow("class", tmp_path / "class", "--phenomenon", "pendulum", "-o", tmp_path / "out")
    assert commands(ran)[:2] == ["class", "review"]


@pytest.fixture
def still_clip(tmp_path):
    """A clip in which nothing moves."""
    return write_video(tmp_path / "still.mp4", noisy([np.full((96, 128), 128, np.uint8)] * 20, 2.0))


@pytest.mark.parametrize("command", ["run", "track"])
def test_clip_that_no_tracker_follows_leads_to_a_review(follow, still_clip, tmp_path, command):
    given = ("--phenomenon", "pendulum", "--fps", "25.0", "--scale", "135px=1m")
    ran = follow(command, still_clip, *given, "-o", tmp_path / "out" / "track.csv", status=1)
    assert commands(ran) == [command, "review", "review"]  # the last goes on where the first was left
    assert all(word in ran[1] for word in given)


def test_clip_of_a_class_that_no_tracker_follows_leads_to_its_review(follow, still_clip, tmp_path):
    write_class(tmp_path / "class", 4, faults={})
    still_clip.rename(tmp_path / "class" / "group9.mp4")
    ran = follow("class", tmp_path / "class", "--phenomenon", "pendulum", "-o", tmp_path / "out")
    assert commands(ran)[:2] == ["class", "review"]
    assert "<code>iris-sysid review" in (tmp_path / "out" / "class.html").read_text("utf-8")


def test_clip_of_a_class_that_is_followed_but_not_fitted_leads_to_its_review(follow, tmp_path):
    write_class(tmp_path / "class", 4, faults={})
    fall = [discs((64.0, 8.0 + 200 * (k / 30) ** 2)) for k in range(20)]
    write_video(tmp_path / "class" / "group9.mp4", noisy(fall, 3.0))
    ran = follow("class", tmp_path / "class", "--phenomenon", "pendulum", "-o", tmp_path / "out")
    assert commands(ran)[:2] == ["class", "review"]
    page = (tmp_path / "out" / "class.html").read_text("utf-8")
    assert "<strong>group9</strong>: no value" in page
    assert "groups/group9" in page


def test_marks_of_another_program_lead_to_a_fit(follow, tmp_path):
    noise = 0.3 * np.random.default_rng(4).standard_normal((25, 2))  # px
    places = {k: (10 + 3 * k + x, 20 + 200 * 9.81 * (k / 30) ** 2 + y) for k, (x, y) in enumerate(noise)}
    (tmp_path / "a.trk").write_text(project(where=coords(axes(angle=0.0)), bodies=body("a", places)))
    ran = follow("import", tmp_path / "a.trk", "--fps", "30", "-o", tmp_path / "a.csv", to="diagnose")
    assert commands(ran)[:2] == ["import", "fit"]


def test_table_in_metres_of_a_track_is_fitted(follow, cli, pendulum_clip, tmp_path):
    world = ("--scale", "135px=1m", "--world", tmp_path / "world.csv")
    ran = follow("track", pendulum_clip, *world, "-o", tmp_path / "track.csv", to="fit")
    assert commands(ran)[:2] == ["track", "fit"]
    named = [word if word != "auto" else "pendulum" for word in ran[1]]  # the whole bank is fitted to marks, above
    assert cli(*named).status == 0


def test_render_and_smooth_lead_on(follow, angles, tmp_path):
    rendered = ("--size", "160x90", "--fps", "30", "--seed", "1", "-o", tmp_path / "clip.mp4")
    assert commands(follow("render", "--phenomenon", "pendulum", *rendered, to="diagnose"))[:2] == ["render", "run"]
    assert commands(follow("smooth", angles, "-o", tmp_path / "smoothed.csv", to="fit")) == ["smooth", "fit"]


def test_discovery_leads_to_a_fit_with_what_was_known(follow, angles, tmp_path):
    ran = follow("discover", angles, "--set", "gravity=9.81", "-o", tmp_path / "discovery.json", to="diagnose")
    assert commands(ran)[:3] == ["discover", "fit", "diagnose"]
    assert "gravity=9.81" in ran[1]


def test_throw_without_a_scale_gives_gravity_in_px_and_says_how_to_state_a_scale(cli, tmp_path):
    t_s = np.arange(0, 0.9, 1 / 30)
    images = [discs((10 + 122 * t, 85 - 200 * t + 222 * t * t)) for t in t_s]
    clip = write_video(tmp_path / "throw.mp4", noisy(images, 3.0))
    command = ("run", clip, "--phenomenon", "projectile", "--force", "-o", tmp_path / "run")
    outcome = cli(*command)
    assert outcome.status == 0, outcome.err
    gravity = json.loads((tmp_path / "run" / "fit.json").read_text(encoding="utf-8"))["parameters"]["gravity"]
    assert gravity["value"] == pytest.approx(444, rel=0.01)
    assert gravity["unit"] == "px/s^2"
    assert "lengths are in px; for metres state a scale" in outcome.err
    for line in NEXT.findall(outcome.err):
        assert cli(*shlex.split(line)).status == 0, line
    assert "no scale was stated" in (tmp_path / "run" / "report.html").read_text(encoding="utf-8")
    assert cli(*command, "--scale", "gravity=9.81").status == 0


def test_record_keeps_its_sample_time_and_hold_through_a_diagnosis(follow, angles, tmp_path):
    table = tmp_path / "record.csv"
    theta = pd.read_csv(angles)["theta_rad"].interpolate()
    theta[theta.size // 2 :] = 0.3 * np.cos(5.0 * 0.04 * np.arange(theta.size - theta.size // 2))  # another equation
    pd.DataFrame({"u": np.zeros(theta.size), "angle": theta}).to_csv(table, index=False)
    record = ("--columns", "theta[rad]=angle", "--sample-time", "40ms", "--hold", "zero")
    ran = follow("diagnose", table, "--model", "pendulum", *record, "-o", tmp_path / "diagnosis", to="fit")
    assert "discover" in commands(ran)
    assert all({"zero", "t[40 ms]=row,theta[rad]=angle"} <= set(line) for line in ran[1:])


def test_inputs_that_are_held_are_diagnosed_as_held(cli, angles, tmp_path):
    outcome = cli("fit", angles, "--model", "pendulum", "--hold", "zero", "-o", tmp_path / "fit.json")
    assert outcome.status == 0
    (command,) = [line for line in outcome.err.splitlines() if line.startswith("next:")]
    assert "--hold zero" in command


@pytest.mark.slow
def test_ground_truth_leads_to_the_tables_of_a_benchmark(follow, cli, tmp_path):
    small = ("--size", "320x180", "--fps", "30", "--seconds", "2", "--trials", "1", "--classes", "pendulum")
    assert cli("render", "--dataset", tmp_path / "set", *small).status == 0
    given = ("--trials", "1", "--fps", "30", "-o", tmp_path / "parameters.json")
    ran = follow("gt", tmp_path / "set", *given, to="benchmark")
    assert commands(ran) == ["gt", "benchmark"]
    assert "--trials" in ran[1]
    assert "--fps" in ran[1]
    assert cli(*ran[1], "--study", "none").status == 0  # the studies have tests of their own


@pytest.mark.slow
def test_calibration_leads_to_run(follow, tmp_path):
    board, clip = tmp_path / "board.mp4", tmp_path / "clip.mp4"
    render_checkerboard("pendulum", board, size=(640, 360), seed=1)
    render_clip("pendulum", clip, size=(640, 360), fps=30.0, duration_s=3.0, seed=1)
    output = ("--board", "9x6", "--square", "40mm", "-o", tmp_path / "calibration.json")
    assert commands(follow("calibrate", board, *output, clip=clip))[:2] == ["calibrate", "run"]
