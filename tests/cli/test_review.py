"""The command ``review``, and ``run`` without a phenomenon: what they say before any page is opened."""

import os
import signal
import subprocess
import sys

import pytest

from iris_sysid.registry import PHENOMENA


def test_run_without_phenomenon_lists_them_and_points_to_the_page(cli, pendulum_clip, tmp_path, nothing_written):
    nothing_written()
    outcome = cli("run", pendulum_clip, "-o", tmp_path / "out")
    assert outcome.status == 2
    assert all(f"  {name} " in outcome.err for name in PHENOMENA)
    assert f"next: iris-sysid review {pendulum_clip} -o {tmp_path / 'out'}" in outcome.err
    assert outcome.out == ""


def test_run_without_phenomenon_of_no_clip_says_that_first(cli, text_clip, tmp_path):
    outcome = cli("run", text_clip, "-o", tmp_path / "out")
    assert outcome.status == 1
    assert "it is a text file" in outcome.err


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("none.mp4",), "there is no file none.mp4"),
        (("{text}",), "it is a text file"),
        (("{clip}", "--phenomenon", "pendulums"), "did you mean 'pendulum'"),
        (("{clip}", "--scale", "five"), "five"),
        (("{clip}", "--set", "gravty=9.8", "--phenomenon", "pendulum"), "gravty"),
    ],
)
def test_review_that_cannot_begin_says_why_and_writes_nothing(
    arguments, said, cli, pendulum_clip, text_clip, tmp_path, nothing_written
):
    nothing_written()
    filled = [text.format(clip=pendulum_clip, text=text_clip) for text in arguments]
    outcome = cli("review", *filled, "-o", tmp_path / "out", "--no-browser")
    assert outcome.status == 1
    assert said in outcome.err


def test_options_of_a_review_that_exists_are_refused(cli, pendulum_clip, tmp_path):
    (tmp_path / "track.csv").write_text("t_s,x_px,y_px\n0,1,1\n1,2,2\n")
    outcome = cli("review", tmp_path, "--phenomenon", "pendulum", "--no-browser")
    assert outcome.status == 1
    assert "is recorded in" in outcome.err


def test_table_without_a_clip_asks_for_it(cli, tmp_path):
    (tmp_path / "track.csv").write_text("t_s,x_px,y_px\n0,1,1\n1,2,2\n")
    outcome = cli("review", tmp_path, "--no-browser")
    assert outcome.status == 1
    assert "--clip" in outcome.err


def _heeds_ctrl_c():
    """A program that a shell starts in the background ignores Ctrl-C, and so do those that it starts."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)


@pytest.mark.skipif(os.name == "nt", reason="Ctrl-C is sent as a signal")
def test_interrupted_review_says_where_the_log_is_and_how_to_go_on(pendulum_clip, tmp_path):
    folder = tmp_path / "out"
    command = [sys.executable, "-m", "iris_sysid", "review", str(pendulum_clip), "-o", str(folder), "--no-browser"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, preexec_fn=_heeds_ctrl_c)
    first = process.stderr.readline()
    assert "http://127.0.0.1:" in first
    assert process.stderr.readline() == f"log: {folder / 'review.jsonl'}; Ctrl-C ends it, nothing is lost\n"
    process.send_signal(signal.SIGINT)
    _, rest = process.communicate(timeout=60)
    assert process.returncode == 0, rest
    assert rest.splitlines()[-1] == f"next: iris-sysid review {folder}"
    assert "Traceback" not in rest
    assert (folder / "review.jsonl").is_file()
