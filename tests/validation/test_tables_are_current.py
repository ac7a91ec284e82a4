"""No table of the docs is older than the code that it measures by more than a week of changes."""

import datetime
import re
import subprocess

import pytest

from tests._project import ROOT
from validation.pages import PAGES

WEEK = datetime.timedelta(days=7)
STATED = re.compile(r"^\*`python -m validation\.(?P<program>\w+).*?(?P<date>\d{4}-\d\d-\d\d)\*$", re.MULTILINE)
PRODUCT = ("iris_sysid", "trackers", "fitters")
MEASURED = {  # what a program measures, where that is less than the whole product
    "calibration": ("iris_sysid/calibration",),
    "plans": ("iris_sysid/diagnosis", "fitters"),
    "world_effects": ("iris_sysid/diagnosis", "fitters"),
    "implanted": ("iris_sysid/diagnosis", "fitters"),
    "blind_independent": ("iris_sysid/diagnosis", "fitters"),
    "subpixel": ("trackers",),
    "identity": ("trackers",),
    "observables": ("trackers", "iris_sysid/trajectory"),
    "real_tracks": ("trackers",),
}


def last_change(*folders: str) -> datetime.date:
    command = ["git", "log", "-1", "--format=%cs", "--", *folders]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    if done.returncode or not done.stdout.strip():
        pytest.skip("the history of the code is not here")
    return datetime.date.fromisoformat(done.stdout.strip())


def tables() -> list[tuple[str, str, str]]:
    return [
        (page.name, found["program"], found["date"])
        for page in sorted(PAGES.glob("*.md"))
        for found in STATED.finditer(page.read_text(encoding="utf-8"))
    ]


def test_pages_state_the_date_of_their_tables():
    assert len(tables()) > 20


@pytest.mark.parametrize(("page", "program", "date"), tables())
def test_table_is_at_most_a_week_older_than_the_code_that_it_measures(page, program, date):
    changed = last_change(*MEASURED.get(program, PRODUCT))
    assert changed - datetime.date.fromisoformat(date) <= WEEK, f"{page}: run python -m validation.{program} again"
