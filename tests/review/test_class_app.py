"""The page of a class is served with a review of each group, to its own page only."""

import os
import re
import subprocess
import sys

import numpy as np
import pytest
from starlette.testclient import TestClient

from iris_sysid.classroom.groups import Group, GroupRequest, Source
from iris_sysid.classroom.measure import measure_groups
from iris_sysid.io.csv_read import read_track
from iris_sysid.registry import PHENOMENA
from iris_sysid.review.class_app import ClassReviews, class_app
from iris_sysid.review.opening import open_result
from tests._browser import browser_is_there, started_browser
from tests.review._screen import Screen
from tests.review.conftest import HOST, OFF_PX, TOKEN, WRONG


@pytest.fixture
def reviews(project):
    opened = ClassReviews({"group1": lambda: open_result(project / "out")})
    yield opened
    opened.close()


@pytest.fixture
def client(reviews):
    app = class_app(lambda token: f'<a href="review/group1/?token={token}">group1</a>', reviews, TOKEN, [HOST])
    return TestClient(app, base_url=f"http://{HOST}", headers={"x-review-token": TOKEN})


def test_page_leads_to_the_review_of_a_group(client):
    (link,) = re.findall('href="([^"]+)"', client.get("/").text)
    page = client.get(f"/{link}", headers={"x-review-token": ""})
    assert page.status_code == 200
    assert "Review of pendulum.mp4" in page.text
    assert client.get("/review/group1/api/clip").json()["name"] == "pendulum.mp4"
    assert client.get("/review/group1/frame/3.jpg").content[:2] == b"\xff\xd8"
    assert client.get("/review/group1/static/review.js").status_code == 200


def test_an_edit_reaches_the_group_and_its_log(client, project):
    version = client.get("/review/group1/api/state").json()["version"]
    edit = {"kind": "delete", "body": "1", "first": 10, "last": 12}
    answer = client.post("/review/group1/api/edit", json={"version": version, "edit": edit})
    assert answer.status_code == 200, answer.text
    assert "delete" in (project / "out" / "review.jsonl").read_text("utf-8")


@pytest.mark.parametrize("path", ["/review/group2/", "/review/..%2Fout/api/clip", "/review/", "/out/track.csv"])
def test_nothing_else_is_served(client, path):
    assert client.get(path).status_code == 404


@pytest.mark.parametrize("path", ["/", "/review/group1/", "/review/group1/api/state"])
def test_wrong_token_opens_nothing(client, reviews, path):
    assert client.get(path, headers={"x-review-token": "wrong"}).status_code == 403
    assert reviews._sessions == {}


def test_group_whose_clip_is_gone_says_so(client, project):
    (project / "pendulum.mp4").unlink()
    answer = client.get("/review/group1/api/clip")
    assert (answer.status_code, "--clip" in answer.json()["error"]) == (400, True)


def test_track_that_was_corrected_and_saved_is_measured(project):
    """A class takes the corrected track instead of tracking again, once."""
    group = Group(Source("pendulum", project / "pendulum.mp4"), GroupRequest(PHENOMENA["pendulum"]))
    (first,), now = measure_groups([group], project / "class")
    assert now == 1
    folder = project / "class" / "groups" / "pendulum"
    session = open_result(folder, project / "pendulum.mp4")
    try:
        x, y = session.state.tracks[0].xy_px[60]
        client = TestClient(class_app(str, ClassReviews({"g": lambda: session}), TOKEN, [HOST]), f"http://{HOST}")
        client.headers["x-review-token"] = TOKEN
        place = {"kind": "place", "body": "1", "frame": 60, "x": x + OFF_PX, "y": y, "zoom": 2.0, "pointer": "mouse"}
        version = client.post("/review/g/api/edit", json={"version": session.version, "edit": place}).json()["version"]
        assert client.post("/review/g/api/save", json={"version": version}).status_code == 200
    finally:
        session.close()
    (second,), now = measure_groups([group], project / "class")
    assert now == 1
    assert second.parameters["length"].value != first.parameters["length"].value
    assert np.flatnonzero(read_track(folder / "track.csv")[0].edited).tolist() == [60]
    (third,), now = measure_groups([group], project / "class")
    assert (now, third) == (0, second)


@pytest.mark.slow
def test_a_group_of_a_served_class_is_opened_in_a_browser(wrong_project, tmp_path):
    browser_is_there()
    project, _ = wrong_project
    (project / "clips").mkdir()
    (project / "pendulum.mp4").rename(project / "clips" / "group1.mp4")
    command = [sys.executable, "-m", "iris_sysid", "class", project / "clips", "--phenomenon", "pendulum", "--serve"]
    process = subprocess.Popen(
        [*map(str, command), "-o", str(tmp_path / "class")],
        stderr=subprocess.PIPE,
        stdout=subprocess.DEVNULL,
        text=True,
        env={**os.environ, "BROWSER": "true"},  # a command that opens nothing
    )
    try:
        said = ""
        while "http://" not in said:
            line = process.stderr.readline()
            assert line, said
            said += line
        address = re.search(r"http://127\.0\.0\.1:\d+/\?token=\S+", said)[0]
        with started_browser(tmp_path / "profile", "--window-size=1400,1000") as driver:
            driver.get(address)
            driver.find_element("link text", "group1").click()
            screen = Screen(driver, None)
            screen.until(lambda: screen.text("fit-status").startswith("fitted"))
            screen.go_to(WRONG[0])
            assert screen.errors() == []
    finally:
        process.terminate()
        process.communicate(timeout=30)
