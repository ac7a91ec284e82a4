"""A class of rendered clips: five planted faults are named and no other.

That others of a class are rarely named is what test_outliers.py tests, over hundreds of classes.
"""

import pytest

from iris_sysid import read_trajectory
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import GroupDocument
from tests.classroom._rendered import FAULTS, render_class

CLIPS = 18
SAID = {
    "group-03": "wrong scale: all its lengths are 1.6",
    "group-05": "no value: the body falls straight down: this is no pendulum",
    "group-07": "camera tilted: it rests",
    "group-10": "another gravity than the others: it was fitted with 1.62 m/s²",
    "group-12": "a 60 fps file of a 240 fps recording: all its times are",
}


@pytest.mark.slow
def test_five_planted_faults_among_eighteen_clips_are_named_and_no_other(tmp_path, cli):
    render_class(tmp_path / "clips", CLIPS)
    known = ("--phenomenon", "pendulum", "--known", "length=0.5")
    arguments = ("class", tmp_path / "clips", *known, "-o", tmp_path / "out")
    done = cli(*arguments, "--workers", 2)
    assert done.status == 0, done.err
    page = (tmp_path / "out" / "class.html").read_text("utf-8")
    assert f"Look at these {len(FAULTS)} groups" in page
    listed = page[page.index('<ul class="named">') : page.index("</ul>")]
    for name, text in SAID.items():
        assert name in listed
        assert text in listed
    assert "agrees with what is known" in done.out
    document = read_document(tmp_path / "out" / "groups" / "group-01" / "group.json", GroupDocument)
    assert document.usable
    assert read_trajectory(tmp_path / "out" / "groups" / "group-01" / "trajectory.csv").n > 100
    assert f"{CLIPS} groups, 0 measured now" in cli(*arguments).err
