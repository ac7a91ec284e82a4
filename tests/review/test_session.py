"""Edits, undo and redo, the log, the fit that follows, tracking anew, and what is saved."""

import json
import os
import shutil
import time
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.errors import DataError, OutputError
from iris_sysid.io.clip_place import write_clip_place
from iris_sysid.io.csv_read import read_track, read_trajectory
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import FitDocument
from iris_sysid.report.film import footage_of_table
from iris_sysid.review.opening import open_clip, open_result
from iris_sysid.review.request import ReviewRequest
from iris_sysid.review.session import marked_all
from iris_sysid.types import TrackMark, TrackOptions
from tests.conftest import listing
from tests.review.conftest import page_of
from tests.review.test_doubtful_frames import swing


def track_of(state, body="1"):
    return next(track for track in state["tracks"] if track["body"] == body)


def wait_for_tracker(session):
    stop = time.monotonic() + 120
    while session.tracking.running:
        assert time.monotonic() < stop, "the tracker did not end"
        time.sleep(0.02)


def test_opened_run_shows_its_track_and_fit(page, project):
    state, fit = page.state(), page.fit()
    (track,) = read_track(project / "out" / "track.csv")
    assert track_of(state)["frame"] == track.frame.tolist()
    assert np.allclose(np.array(track_of(state)["x"], float), track.xy_px[:, 0], atol=0.006, equal_nan=True)
    document = read_document(project / "out" / "fit.json", FitDocument)
    length = next(value for value in fit["values"] if value["name"] == "length")
    assert length["now"].startswith(f"{document.parameters['length'].value:.2f}")
    assert fit["verdict"][0].startswith("usable")


def test_placed_point_moves_there_is_marked_as_edited_and_states_its_error(page, session):
    page.edit("place", body="1", frame=50, x=100.5, y=60.25, zoom=4.0, pointer="mouse")
    (track,) = session.state.tracks
    assert track.xy_px[50].tolist() == [100.5, 60.25]
    assert track.sigma_px[50].tolist() == [1.5 / 4, 1.5 / 4]
    assert np.flatnonzero(track.edited).tolist() == [50]


def test_finger_is_less_exact_than_a_mouse_and_no_zoom_makes_a_click_exact(page, session):
    page.edit("place", body="1", frame=50, x=1.0, y=1.0, zoom=2.0, pointer="touch")
    page.edit("place", body="1", frame=51, x=1.0, y=1.0, zoom=1000.0, pointer="mouse")
    sigma = session.state.tracks[0].sigma_px
    assert sigma[50, 0] == 3.0
    assert sigma[51, 0] == 0.2


def test_fit_follows_an_edit_and_shows_what_was_before(page):
    before = page.fit()
    page.edit("delete", body="1", first=0, last=79)
    for frame in range(80, 110, 4):
        at = track_of(page.state())
        page.edit("place", body="1", frame=frame, x=at["x"][frame] + 4.0, y=at["y"][frame], zoom=50.0)
    now = page.fit()
    assert now["version"] == page.version
    value = {row["name"]: row for row in now["values"]}["length"]
    opened = {row["name"]: row for row in before["values"]}["length"]["now"]
    assert value["opened"] == opened
    assert value["now"] != opened
    assert now["word"] != before["word"] or now["verdict"] != before["verdict"]


def test_undo_and_redo_go_through_everything(page, session):
    start = session.state.tracks
    page.edit("place", body="1", frame=50, x=1.0, y=2.0)
    page.edit("split", body="1", frame=60, name="2")
    page.edit("point", name="pivot", at=[160.0, 10.0])
    for _ in range(3):
        state = page.step("undo")
    assert not state["can_undo"]
    assert np.array_equal(session.state.tracks[0].xy_px, start[0].xy_px, equal_nan=True)
    assert session.state.request.geometry.marks_px == {}
    for _ in range(3):
        state = page.step("redo")
    assert not state["can_redo"]
    assert [track.body for track in session.state.tracks] == ["1", "2"]
    assert session.state.request.geometry.marks_px == {"pivot": (160.0, 10.0)}


def test_edit_after_an_undo_drops_what_was_undone(page):
    page.edit("place", body="1", frame=50, x=1.0, y=2.0)
    page.step("undo")
    state = page.edit("place", body="1", frame=51, x=3.0, y=4.0)
    assert not state["can_redo"]
    assert page.post("/api/redo").status_code == 400


def test_split_swap_and_drop_keep_every_position(page, session):
    start = session.state.tracks[0].xy_px.copy()
    page.edit("split", body="1", frame=60, name="2")
    one, two = session.state.tracks
    assert np.isnan(one.xy_px[60:]).all()
    assert np.isnan(two.xy_px[:60]).all()
    page.edit("swap", body="1", other="2", frame=60)
    one, two = session.state.tracks
    assert np.array_equal(one.xy_px, start, equal_nan=True)
    assert not two.valid.any()
    page.edit("drop", body="2")
    assert [track.body for track in session.state.tracks] == ["1"]


def test_scale_gives_metres_and_its_error_comes_from_the_clicks(page, session):
    state = page.edit("scale", ends=[10.0, 10.0, 10.0, 110.0], length="0.5+-0.001m", zoom=2.0)
    assert "px/m" in state["request"]["scale"]
    calibration = session.state.request.calibration
    assert calibration.scale.value == pytest.approx(200.0)
    assert calibration.scale.stderr == pytest.approx(200.0 * np.hypot(np.sqrt(2) * 0.75 / 100, 0.001 / 0.5))


def test_marks_plumb_line_and_region_are_in_the_request(page, session):
    page.edit("plumb", ends=[160.0, 0.0, 160.5, 170.0])
    page.edit("region", roi=[0, 0, 320, 170])
    page.edit("mark", body="1", frame=5, x=10.0, y=20.0)
    state = page.edit("point", name="pivot", at=[160.0, 10.0])
    assert state["request"]["plumb"] == [160.0, 0.0, 160.5, 170.0]
    assert state["request"]["roi"] == [0, 0, 320, 170]
    assert state["request"]["body_marks"] == [["1", 10.0, 20.0, 5]]
    assert session.state.request.geometry.marks_px == {"pivot": (160.0, 10.0)}


BOARD = [60.0, 40.0, 260.0, 40.0, 260.0, 140.0, 60.0, 140.0]


@pytest.mark.parametrize("size", ["1m x 0.5m", "100cm×50.0+-0.2cm", "10x5 of 100mm", "1.00(1)m x 0.5m"])
def test_corners_of_a_board_set_the_calibration(page, session, size):
    state = page.edit("board", corners=BOARD, size=size, zoom=3.0)
    assert state["request"]["scale_points"] == BOARD
    calibration = session.state.request.calibration
    assert calibration.scale.value == pytest.approx(200.0)
    assert 0 < calibration.scale.stderr < 2.5
    fit = page.fit()
    length = next(value for value in fit["values"] if value["name"] == "length")
    assert length["now"] != length["opened"]
    page.step("undo")
    assert session.state.request.calibration is not calibration


@pytest.mark.parametrize("size", ["1m", "big", "1m x", "0x5 of 25mm", "1kg x 2kg", "1m x 2m x 3m", "8x5 of 0mm"])
def test_size_of_a_board_that_cannot_be_is_refused(page, size):
    answer = page.post("/api/edit", edit={"kind": "board", "corners": BOARD, "size": size})
    assert answer.status_code == 400
    assert answer.json()["error"]


def test_board_survives_tracking_anew_and_opening_again(page, session, opened):
    page.edit("board", corners=BOARD, size="1m x 0.5m")
    session.track()
    wait_for_tracker(session)
    again = opened(session.folder)
    assert again.state.request.calibration.scale.value == pytest.approx(200.0)
    assert again.scale_points == tuple(BOARD)


def test_what_is_no_body_is_taken_out_of_the_track_as_far_as_it_is_followed(page, session):
    track = session.state.tracks[0]
    xy = track.xy_px
    page.edit("delete", body="1", first=70, last=72)  # a gap, where another thing begins
    page.edit("place", body="1", frame=100, x=xy[100, 0], y=xy[100, 1])
    page.edit("ignore", frame=90, x=xy[90, 0] + 2.0, y=xy[90, 1])
    (left,) = session.state.tracks
    assert left.valid[:70].sum() == track.valid[:70].sum()
    assert np.flatnonzero(left.valid[73:]).tolist() == [100 - 73]  # what was placed by hand stays
    assert page.state()["request"]["ignored"] == [[xy[90, 0] + 2.0, xy[90, 1], 90]]
    page.step("undo")
    assert session.state.tracks[0].valid[75:].all()
    assert page.state()["request"]["ignored"] == []


def test_click_beside_every_track_takes_nothing_out(page, session):
    before = session.state.tracks[0]
    page.edit("ignore", frame=90, x=5.0, y=5.0)
    assert session.state.tracks[0] is before


# --------------------------------------------------------------------------- the log


def test_every_edit_is_on_disk_before_the_answer(page, session):
    page.edit("place", body="1", frame=50, x=1.0, y=2.0)
    page.step("undo")
    lines = [json.loads(line) for line in (session.folder / "review.jsonl").read_text().splitlines()]
    assert [line.get("what") for line in lines] == [None, "edit", "save", "edit", "undo"]
    assert lines[3]["edit"]["x"] == 1.0


def test_run_that_is_only_looked_at_counts_as_saved(page, session, opened):
    assert session.saved_version == session.version
    assert opened(session.folder).saved_version == session.version
    page.edit("place", body="1", frame=50, x=1.0, y=2.0)
    assert session.saved_version != session.version


def test_review_that_died_goes_on_where_it_was(page, session, opened):
    page.edit("place", body="1", frame=50, x=1.0, y=2.0)
    page.edit("split", body="1", frame=60, name="2")
    page.step("undo")
    again = opened(session.folder)  # nothing was closed or saved
    assert again.version == session.version
    assert again.history.can_redo
    assert again.state.tracks[0].xy_px[50].tolist() == [1.0, 2.0]
    assert [track.body for track in again.state.tracks] == ["1"]


def test_line_that_was_cut_off_is_left_out_and_the_log_goes_on(page, session, opened):
    page.edit("place", body="1", frame=50, x=1.0, y=2.0)
    log = session.folder / "review.jsonl"
    whole = log.read_bytes()
    log.write_bytes(whole + b'{"version":3,"what":"edit","edi')
    again = opened(session.folder)
    assert again.version == 2
    page_of(again).client.post("/api/undo", json={"version": 2})
    assert log.read_bytes() == whole + b'{"version":3,"what":"undo"}\n'


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("{", "line 4, is damaged"),
        ('{"what":"format"}', "line 4: what was done is 'format'"),
        ('{"what":"edit","edit":{"kind":"tracked","file":"../../../etc/passwd"}}', "line 4: no edit: tracked.file"),
        ('{"what":"edit","edit":{"kind":"tracked","file":"review-track-9.csv"}}', "cannot read"),
        ('{"what":"edit","edit":{"kind":"drop","body":"9"}}', "line 4: there is no body '9'"),
        ('{"what":"undo"}', "line 4: there is nothing to undo"),
        ("[" * 30_000, "line 4, is damaged"),
    ],
)
def test_damaged_log_is_refused_with_the_line(line, said, session):
    log = session.folder / "review.jsonl"
    log.write_text(log.read_text() + line + "\n")
    with pytest.raises(DataError, match=r"(?s).*") as error:
        open_result(session.folder)
    assert said in str(error.value)


def test_second_server_on_one_folder_is_told_at_its_next_edit(page, session, opened):
    other = page_of(opened(session.folder))
    other.state()
    other.edit("place", body="1", frame=50, x=1.0, y=2.0)
    answer = page.post("/api/edit", edit={"kind": "drop", "body": "1"})
    assert answer.status_code == 400
    assert "another review has written" in answer.json()["error"]
    assert session.version == 1


def test_second_page_sees_that_it_is_behind(page, session):
    second = page_of(session)
    second.state()
    page.edit("place", body="1", frame=50, x=1.0, y=2.0)
    answer = second.post("/api/edit", edit={"kind": "drop", "body": "1"})
    assert answer.status_code == 409
    assert answer.json()["version"] == 2
    assert [track.body for track in session.state.tracks] == ["1"]
    assert second.post("/api/save").status_code == 409
    second.state()
    second.edit("delete", body="1", first=3, last=4)


def test_full_disk_leaves_the_state_as_it_was(page, session, monkeypatch):
    def full(descriptor):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(os, "fsync", full)
    answer = page.post("/api/edit", edit={"kind": "drop", "body": "1"})
    assert answer.status_code == 400
    assert "the edit was not made" in answer.json()["error"]
    assert session.version == 1
    assert len(session.state.tracks) == 1


# --------------------------------------------------------------------------- the clip


def test_clip_that_is_replaced_while_open_is_neither_shown_nor_edited(page, session, project):
    clip = project / "pendulum.mp4"
    assert page.get("/frame/3.jpg").status_code == 200
    shutil.copy(clip, project / "other.mp4")
    (project / "other.mp4").replace(clip)
    for answer in (page.get("/frame/3.jpg"), page.post("/api/edit", edit={"kind": "drop", "body": "1"})):
        assert answer.status_code == 410
        assert "was replaced" in answer.json()["error"]
    assert page.post("/api/save").status_code == 410
    assert session.version == 1


def test_clip_that_is_gone_is_reported(page, project):
    (project / "pendulum.mp4").unlink()
    answer = page.get("/frame/3.jpg")
    assert answer.status_code == 410
    assert "can no longer be read" in answer.json()["error"]


def test_another_clip_of_that_name_is_refused_at_opening(project, still_clip):
    shutil.copy(still_clip, project / "pendulum.mp4")
    with pytest.raises(DataError, match="is not the clip that was tracked"):
        open_result(project / "out")


def test_clip_that_was_moved_is_asked_for(project):
    (project / "pendulum.mp4").rename(project.parent / "moved.mp4")
    with pytest.raises(DataError, match="--clip"):
        open_result(project / "out")
    open_result(project / "out", project.parent / "moved.mp4").close()


def test_frames_are_those_of_the_reader(page, session):
    import cv2

    from iris_sysid.video.reader import open_video

    session_frames = {frame.index: frame.luma for frame in open_video(session.clip).frames()}
    for number in (7, 3, 100, 101, 0, 119):
        content = page.get(f"/frame/{number}.jpg").content
        shown = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_GRAYSCALE)
        apart = {k: np.abs(luma.astype(float) - shown).mean() for k, luma in session_frames.items()}
        assert min(apart, key=apart.get) == number


def test_narrow_frame_is_smaller(page):
    assert len(page.get("/frame/3.jpg?width=64").content) < len(page.get("/frame/3.jpg").content)
    assert page.get("/frame/3.jpg?width=../x").status_code == 400
    assert page.get("/frame/99999.jpg").status_code == 400


# --------------------------------------------------------------------------- tracking


def test_clip_without_a_run_is_tracked_and_asks_for_the_phenomenon(project, tmp_path):
    session = open_clip(project / "pendulum.mp4", tmp_path / "new", ReviewRequest())
    page = page_of(session)
    try:
        session.track()
        wait_for_tracker(session)
        state = page.state()
        assert session.tracking.problem == ""
        assert state["version"] == 1
        assert state["request"]["phenomenon"] is None
        assert page.fit()["values"] == []
        assert "pendulum" in page.get("/api/clip").json()["phenomena"]
        page.edit("phenomenon", name="pendulum")
        assert {value["name"] for value in page.fit()["values"]} >= {"length", "damping"}
    finally:
        session.close()


def test_points_by_hand_survive_a_re_track(page, session):
    page.edit("place", body="1", frame=50, x=100.0, y=60.0, zoom=4.0)
    page.edit("delete", body="1", first=70, last=71)
    at = track_of(page.state())
    page.edit("mark", body="1", frame=100, x=at["x"][100], y=at["y"][100])
    assert page.post("/api/track").status_code == 200
    wait_for_tracker(session)
    assert session.tracking.problem == ""
    assert session.version == 5
    (track,) = session.state.tracks
    assert np.flatnonzero(track.edited).tolist() == [50, 70, 71]
    assert track.xy_px[50].tolist() == [100.0, 60.0]
    assert not track.valid[70]
    page.version = 5
    page.step("undo")
    assert np.flatnonzero(session.state.tracks[0].edited).tolist() == [50, 70, 71]


def test_still_clip_says_that_nothing_moves_and_points_can_be_placed(still_clip, tmp_path):
    session = open_clip(still_clip, tmp_path / "still", ReviewRequest())
    page = page_of(session)
    try:
        session.track()
        wait_for_tracker(session)
        assert session.tracking.problem
        page.state()
        state = page.edit("place", body="1", frame=3, x=10.0, y=10.0)
        assert track_of(state)["x"][3] == 10.0
        assert page.post("/api/save").json()["saved"] == ["track.csv"]
    finally:
        session.close()


# --------------------------------------------------------------------------- saving


def test_saved_files_are_those_of_a_run_with_the_edits_in_them(page, session, project):
    before = set(listing(project / "out"))
    page.edit("place", body="1", frame=50, x=100.5, y=60.25, zoom=4.0)
    page.edit("delete", body="1", first=70, last=71)
    answer = page.post("/api/save").json()
    assert set(answer["saved"]) <= before
    assert set(listing(project / "out")) == before
    (track,) = read_track(project / "out" / "track.csv")
    assert np.flatnonzero(track.edited).tolist() == [50, 70, 71]
    assert track.xy_px[50].tolist() == [100.5, 60.25]
    assert track.sigma_px[50].tolist() == [0.375, 0.375]
    assert track.origin["review"] == {"log": "review.jsonl", "placed": 1, "removed": 2, "confirmed": []}
    assert track.origin["options"]["phenomenon"] == "pendulum"
    fit = read_document(project / "out" / "fit.json", FitDocument)
    shown = next(value for value in page.fit()["values"] if value["name"] == "length")
    assert shown["now"].startswith(f"{fit.parameters['length'].value:.2f}")


def test_saved_folder_opens_again_at_the_version_saved(page, session, opened):
    page.edit("place", body="1", frame=50, x=100.5, y=60.25)
    page.post("/api/save")
    again = opened(session.folder)
    assert again.version == again.saved_version == 2


def test_folder_with_results_is_not_begun_anew(session, project):
    with pytest.raises(DataError, match="holds results already"):
        open_clip(project / "pendulum.mp4", session.folder, ReviewRequest())


def test_port_that_is_taken_is_reported():
    from iris_sysid.review.server import listen

    with listen(0) as taken, pytest.raises(OutputError, match="--port"):
        listen(taken.getsockname()[1])


def test_opened_run_keeps_a_copy_of_its_track_that_reads_the_same(session, project, opened):
    copy, table = project / "out" / "review-track-1.csv", project / "out" / "track.csv"
    assert copy.read_bytes() == table.read_bytes()
    (again,) = opened(project / "out").state.tracks
    (track,) = session.state.tracks
    assert np.array_equal(again.xy_px, track.xy_px, equal_nan=True)
    assert again.origin == track.origin


def test_result_that_lies_elsewhere_than_its_clip_is_opened(project, tmp_path, opened):
    folder = tmp_path / "results" / "one"
    shutil.copytree(project / "out", folder)
    write_clip_place(project / "pendulum.mp4", folder, overwrite=True)
    assert opened(folder).clip.samefile(project / "pendulum.mp4")
    assert footage_of_table(folder, read_trajectory(folder / "trajectory.csv")) is not None


def test_body_that_is_marked_alone_has_the_others_marked_where_they_are_followed():
    one, other = swing(body="1"), swing(body="2")
    mark = TrackMark("1", 50.0, 60.0, 80)
    options = marked_all(TrackOptions(bodies=2, marks=(mark,)), (one, other))
    assert options.marks[0] == mark
    (found,) = options.marks[1:]
    row = int(np.flatnonzero(other.frame == 80)[0])
    assert (found.body, found.frame) == ("2", 80)
    assert (found.x_px, found.y_px) == tuple(other.xy_px[row])
    lost = replace(other, valid=other.frame > 100)
    assert marked_all(TrackOptions(bodies=2, marks=(mark,)), (one, lost)).marks[1].frame == 101
    assert marked_all(TrackOptions(bodies=2), (one, other)).marks == ()
    assert marked_all(TrackOptions(bodies=1, marks=(mark,)), (one, other)).marks == (mark,)
