"""What the tests of the review share: a clip with its run, copied for each test, and a page's way to the server."""

import shutil
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
from starlette.testclient import TestClient

from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_track
from iris_sysid.pipeline import one_clip
from iris_sysid.review.app import review_app
from iris_sysid.review.opening import open_result
from iris_sysid.review.session import Session
from iris_sysid.synthetic import render_clip

TOKEN = "token-of-the-test"
HOST = "127.0.0.1:8080"
WRONG = (60, 75, 90)  # frames in which the track is put beside the body
OFF_PX = 9.0


@dataclass
class Page:
    """What the page does: it sends the token, its origin and the version that it shows."""

    client: TestClient
    version: int = 0

    def get(self, path, **more):
        return self.client.get(path, **more)

    def post(self, path, **content):
        return self.client.post(path, json={"version": self.version, **content}, headers={"origin": f"http://{HOST}"})

    def edit(self, kind, **values):
        answer = self.post("/api/edit", edit={"kind": kind, **values})
        assert answer.status_code == 200, answer.text
        self.version = answer.json()["version"]
        return answer.json()

    def step(self, what):
        answer = self.post(f"/api/{what}")
        assert answer.status_code == 200, answer.text
        self.version = answer.json()["version"]
        return answer.json()

    def state(self):
        state = self.get("/api/state").json()
        self.version = state["version"]
        return state

    def fit(self):
        answer = self.get(f"/api/fit?version={self.version}")
        assert answer.status_code == 200, answer.text
        return answer.json()


@pytest.fixture(scope="session")
def swing(made) -> Path:
    """A folder with two seconds of a pendulum of 0.5 m at 60 frames a second, and its run in ``out``."""
    folder = made / "review"
    render_clip("pendulum", folder / "pendulum.mp4", size=(320, 180), fps=60.0, duration_s=2.0, seed=1)
    one_clip.save(one_clip.run(folder / "pendulum.mp4", "pendulum"), folder / "out")
    return folder


@pytest.fixture
def project(swing, tmp_path) -> Path:
    """A copy of the folder that a test may change."""
    return Path(shutil.copytree(swing, tmp_path / "project"))


@pytest.fixture
def wrong_project(project) -> tuple[Path, np.ndarray]:
    """A run whose track is beside the body in three frames, and where the body is there, px."""
    path = project / "out" / "track.csv"
    (track,) = read_track(path)
    xy = track.xy_px.copy()
    right = xy[list(WRONG)].copy()
    xy[list(WRONG)] += (OFF_PX, 0.0)
    write_track([replace(track, xy_px=xy)], path, overwrite=True)
    return project, right


@pytest.fixture
def opened():
    """Open the folder of a project; closed after the test."""
    sessions: list[Session] = []

    def opening(folder: Path) -> Session:
        sessions.append(open_result(folder))
        return sessions[-1]

    yield opening
    for session in sessions:
        session.close()


@pytest.fixture
def session(project, opened) -> Session:
    return opened(project / "out")


@pytest.fixture
def page(session) -> Page:
    page = page_of(session)
    page.state()
    return page


def page_of(session: Session) -> Page:
    """A page of a session, of which it knows the token."""
    app = review_app(session, TOKEN, [HOST])
    headers = {"x-review-token": TOKEN}
    return Page(TestClient(app, base_url=f"http://{HOST}", headers=headers, raise_server_exceptions=False))
