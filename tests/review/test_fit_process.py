"""A fit in a separate process: what it gives, what it raises, and its end."""

import os
import time
from functools import partial
from pathlib import Path

import pytest

from iris_sysid.errors import DataError, FitError
from iris_sysid.io.csv_read import read_track
from iris_sysid.phenomena import pendulum
from iris_sysid.pipeline import one_clip
from iris_sysid.registry import PHENOMENA
from iris_sysid.review import session as of_session
from iris_sysid.review.fit_process import AbandonedError, fitted_apart


def never():
    return False


def refused(video):
    raise DataError("no such column")


def dying(video):
    os._exit(1)


def waiting(video):
    time.sleep(60)


@pytest.fixture(scope="module")
def video(swing):
    return one_clip.open_clip(swing / "pendulum.mp4", one_clip.WHOLE_CLIP)


def test_run_is_the_same_as_in_this_process(swing, video):
    tracks = read_track(swing / "out" / "track.csv")
    request = one_clip.RunRequest(PHENOMENA["pendulum"])
    fit = partial(one_clip.run_tracked, tracks=tracks, request=request, source=video.path)
    apart, here = fitted_apart(fit, video, never), fit(video)
    assert apart.fit.estimates["length"].value == here.fit.estimates["length"].value
    assert apart.video is video


def test_phenomenon_of_a_users_file_is_fitted_there_too(swing, video, tmp_path):
    own = tmp_path / "mine.py"
    own.write_text(Path(pendulum.__file__).read_text("utf-8"), "utf-8")
    mine = PHENOMENA.named(f"{own}:PHENOMENON")
    tracks = read_track(swing / "out" / "track.csv")
    fit = partial(one_clip.run_tracked, tracks=tracks, request=one_clip.RunRequest(mine), source=video.path)
    assert fitted_apart(fit, video, never).fit.usable


def test_error_of_the_fit_is_raised_here(video):
    with pytest.raises(DataError, match="no such column"):
        fitted_apart(refused, video, never)


def test_process_that_dies_is_said(video):
    with pytest.raises(FitError, match="has died"):
        fitted_apart(dying, video, never)


def test_fit_that_is_old_ends_at_once(video):
    start = time.monotonic()
    with pytest.raises(AbandonedError):
        fitted_apart(waiting, video, lambda: time.monotonic() - start > 0.2)
    assert time.monotonic() - start < 30


def test_review_of_a_long_clip_shows_the_fit_of_all_frames(page, monkeypatch):
    inline = page.fit()
    monkeypatch.setattr(of_session, "LONG", 10)
    monkeypatch.setattr(of_session, "MAX_FRAMES", 10)
    page.edit("place", body="1", frame=50, x=100.5, y=60.25, zoom=4.0)
    page.step("undo")
    end = time.monotonic() + 120
    while (answer := page.get(f"/api/fit?version={page.version}&whole").json()).get("pending"):
        assert time.monotonic() < end
    assert not answer["preview"]
    assert [row["now"] for row in answer["values"]] == [row["now"] for row in inline["values"]]
