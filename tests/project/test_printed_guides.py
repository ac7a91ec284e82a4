"""The guide for plug-ins runs as printed, block by block, in a folder with the files that it names."""

import re
import shlex
import shutil

import numpy as np
import pandas as pd
import pytest

from iris_sysid import render_clip
from tests._drawn import noisy
from tests._motions import pendulum_angle
from tests._project import ROOT
from tests.conftest import discs, write_video

BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
OWN_FILE = re.compile(r"# (my_\w+\.py)\n")
STEP_S = 0.02
SCATTER = 1e-3  # of what is measured: rad and m


@pytest.fixture(scope="module")
def named(tmp_path_factory):
    """The folder of the files that the guide names."""
    folder, random = tmp_path_factory.mktemp("named"), np.random.default_rng(1)
    t_s = np.arange(0.0, 6.0, STEP_S)
    theta = pendulum_angle(t_s, 0.4, 0.4, 0.12) + SCATTER * random.standard_normal(t_s.size)
    pd.DataFrame({"t_s": t_s, "theta_rad": theta}).to_csv(folder / "swing.csv", index=False)
    s = 0.1 + 1.5 / 0.8 * (1 - np.exp(-0.8 * t_s)) + SCATTER * random.standard_normal(t_s.size)
    pd.DataFrame({"t_s": t_s, "s_m": s}).to_csv(folder / "cart.csv", index=False)
    render_clip("pendulum", folder / "clip.mp4", size=(320, 180), fps=60.0, duration_s=3.0, seed=3)
    across = 10 + 100 * (1 - np.exp(-0.8 * np.arange(60) / 30))
    write_video(folder / "rail.mp4", noisy([discs((x, 48.0)) for x in across], 3.0))
    return folder


@pytest.mark.slow
def test_every_block_runs_as_printed(named, cli, tmp_path, monkeypatch):
    text = (ROOT / "docs" / "guide" / "plugins.md").read_text("utf-8")
    own, ran = {}, 0
    for number, (language, block) in enumerate(BLOCK.findall(text)):
        if language not in ("", "python"):  # what is printed, or part of a project
            continue
        folder = tmp_path / str(number)
        shutil.copytree(named, folder)
        monkeypatch.chdir(folder)
        file = OWN_FILE.match(block)
        if file:
            own[file[1]] = block
        for name, content in own.items():
            (folder / name).write_text(content, "utf-8")
        if language:
            exec(compile(block, "plugins.md", "exec"), {"__name__": "__main__", "__file__": str(folder / "block.py")})
        for line in [] if language else block.splitlines():
            program, *arguments = shlex.split(line)
            assert program == "iris-sysid"
            outcome = cli(*arguments)
            assert outcome.status == 0, f"{line}\n{outcome.err}"
        ran += 1
    assert ran >= 4
