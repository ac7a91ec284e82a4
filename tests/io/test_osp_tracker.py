"""Tracker projects: what is read, in whose pixels, and what is refused."""

import math
import os
import zipfile

import cv2
import numpy as np
import pytest

from iris_sysid.errors import CalibrationError, VideoError
from iris_sysid.io.csv_read import read_trajectory
from iris_sysid.io.files import sha256_of
from iris_sysid.io.osp_tracker import marked_tracks, read_osp
from iris_sysid.video.reader import open_video
from tests._project import recording
from tests.conftest import write_video

TRACKER = "org.opensourcephysics.cabrillo.tracker"
CORE = "org.opensourcephysics.media.core"


def prop(name, value, kind="double"):
    return f'<property name="{name}" type="{kind}">{value}</property>'


def held(name, cls, content):
    return f'<property name="{name}" type="object"><object class="{cls}">{content}</object></property>'


def axes(x=131.25, y=207.75, angle=30.0, xscale=400.0, yscale=None):
    yscale = xscale if yscale is None else yscale
    names = ("xorigin", "yorigin", "angle", "xscale", "yscale")
    return "".join(prop(name, value) for name, value in zip(names, (x, y, angle, xscale, yscale), strict=True))


def coords(*frames):
    entries = "".join(held(f"[{k}]", f"{CORE}.ImageCoordSystem$FrameData", frame) for k, frame in enumerate(frames))
    return held("coords", f"{CORE}.ImageCoordSystem", f'<property name="framedata" type="array">{entries}</property>')


def body(name, points, cls="PointMass"):
    entries = "".join(
        held(f"[{k}]", f"{TRACKER}.PointMass$FrameData", prop("x", x) + prop("y", y)) for k, (x, y) in points.items()
    )
    content = prop("name", name, "string") + f'<property name="framedata" type="array">{entries}</property>'
    return held("item", f"{TRACKER}.{cls}", content)


def video(path="videos/clip.mp4", extra=""):
    return held("video", f"{CORE}.Video", prop("path", path, "string") + extra)


def project(*, where=None, bodies="", clip=None, unit="m", control=None, head=""):
    where = coords(axes()) if where is None else where
    clip = video() + prop("startframe", 3, "int") + prop("stepsize", 2, "int") if clip is None else clip
    control = prop("delta_t", 66.0) if control is None else control
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>{head}<object class="{TRACKER}.TrackerPanel">'
        f"{held('videoclip', f'{CORE}.VideoClip', clip)}{held('clipcontrol', f'{CORE}.ClipControl', control)}"
        f"{where}{prop('length_unit', unit, 'string') if unit else ''}"
        f'<property name="tracks" type="collection">{bodies}</property></object>'
    )


@pytest.fixture
def read(tmp_path):
    def reader(text):
        path = tmp_path / "clip.trk"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return read_osp(path)

    return reader


# --------------------------------------------------------------------------- what is read


def test_project_gives_scale_axes_and_times(read):
    content = read(project())
    assert content.scale_px_per_m == 400.0
    assert content.origin_px == (130.75, 207.25)
    assert content.angle_rad == pytest.approx(math.pi / 6)
    assert (content.delta_t_ms, content.start_frame, content.step) == (66.0, 3, 2)
    assert (content.video, content.length_unit, content.calibrated) == ("videos/clip.mp4", "m", True)


def test_marks_are_shifted_to_pixel_centres_and_sorted_by_frame(read):
    marks = read(project(bodies=body("ball", {7: (10.5, 20.5), 2: (1.0, 2.0)}))).marks
    frames, xy_px = marks["ball"]
    assert frames.tolist() == [2, 7]
    assert xy_px.tolist() == [[0.5, 1.5], [10.0, 20.0]]
    assert not xy_px.flags.writeable
    assert not frames.flags.writeable


def test_marks_of_other_tracks_and_empty_bodies_are_left_out(read):
    bodies = (
        body("a", {0: (1, 1)}) + body("a", {0: (2, 2)}) + body("none", {}) + body("tape", {0: (3, 3)}, "TapeMeasure")
    )
    assert sorted(read(project(bodies=bodies)).marks) == ["a", "a 2"]


def test_marks_with_a_frame_shift_count_frames_of_the_file(read):
    clip = video() + prop("frameshift", 5, "int")
    frames, _ = read(project(clip=clip, bodies=body("a", {1: (1, 1)}))).marks["a"]
    assert frames.tolist() == [6]


@pytest.mark.parametrize(
    ("unit", "px_per_m"), [("m", 400.0), ("cm", 40_000.0), ("mm", 400_000.0), ("ft", 400 / 0.3048)]
)
def test_scale_in_another_length_unit_is_converted_to_metres(read, unit, px_per_m):
    assert read(project(unit=unit)).scale_px_per_m == pytest.approx(px_per_m)


def test_length_unit_not_stated_is_taken_as_metres_and_reported_empty(read):
    content = read(project(unit=""))
    assert (content.scale_px_per_m, content.length_unit) == (400.0, "")


def test_scale_never_calibrated_is_not_known(read):
    content = read(project(where=coords(axes(xscale=1.0)), bodies=body("a", {0: (1, 1)})))
    assert math.isnan(content.scale_px_per_m)
    assert not content.calibrated
    assert list(content.marks) == ["a"]


def test_frame_time_not_stated_is_nan_and_video_not_stated_is_none(read):
    content = read(project(clip="", control=""))
    assert math.isnan(content.delta_t_ms)
    assert (content.video, content.start_frame, content.step) == (None, 0, 1)


def test_axes_stored_for_several_frames_but_alike_are_read(read):
    assert read(project(where=coords(axes(), axes()))).scale_px_per_m == 400.0


def test_first_image_of_a_sequence_is_the_video(read):
    paths = (
        '<property name="paths" type="array"><property name="[0]" type="string">shots/a 00.jpg</property></property>'
    )
    assert read(project(clip=held("video", f"{CORE}.ImageVideo", paths))).video == "shots/a 00.jpg"


def test_filter_that_moves_no_pixel_is_accepted(read):
    assert read(project(clip=video(extra=filters("BrightnessFilter")))).calibrated
    assert read(project(clip=video(extra=filters("RotateFilter", enabled="false")))).calibrated


def filters(kind, enabled="true"):
    item = held("item", f"{CORE}.{kind}", prop("enabled", enabled, "boolean"))
    return f'<property name="filters" type="collection">{item}</property>'


def test_archive_names_its_video_by_the_member_that_is_there(tmp_path):
    with zipfile.ZipFile(tmp_path / "a.trz", "w") as archive:
        archive.writestr("a.trk", project(clip=video("C:\\films\\clip.mp4")))
        archive.writestr("videos/clip.mp4", b"")
    assert read_osp(tmp_path / "a.trz").video == "videos/clip.mp4"


# --------------------------------------------------------------------------- archives of several


@pytest.fixture
def two_in_one(tmp_path):
    """An archive with two projects, each with its own video; ``b`` shows more frames."""
    with zipfile.ZipFile(tmp_path / "two.trz", "w") as archive:
        for name, frames in (("a", 4), ("b", 6)):
            clip = write_video(tmp_path / f"{name}.mp4", [np.full((48, 64), 80, np.uint8)] * frames)
            archive.write(clip, f"videos/{name}.mp4")
            bodies = body(name, {k: (k, k) for k in range(frames)})
            archive.writestr(f"deep/{name}.trk", project(clip=video(f"videos/{name}.mp4"), bodies=bodies))
    return tmp_path / "two.trz"


@pytest.mark.parametrize("name", ["b", "b.trk", "deep/b.trk"])
def test_one_of_several_projects_is_read_by_name(two_in_one, name):
    assert list(read_osp(f"{two_in_one}:{name}").marks) == ["b"]


@pytest.mark.parametrize("name", ["b", "b.mp4", "videos/b.mp4", "b.trk"])
def test_one_of_several_videos_is_opened_by_its_own_name_or_that_of_its_project(two_in_one, name):
    clip = open_video(f"{two_in_one}:{name}")
    assert len(list(clip.frames())) == 6
    assert clip.sha256 == sha256_of(two_in_one)


def test_name_that_is_not_there_is_refused_with_those_that_are(two_in_one):
    with pytest.raises(CalibrationError, match=r"no single project named 'c'; .* deep/a.trk, deep/b.trk"):
        read_osp(f"{two_in_one}:c")
    with pytest.raises(VideoError, match=r"no single video or project named 'c'; .* videos/a.mp4, videos/b.mp4"):
        open_video(f"{two_in_one}:c")


def test_import_writes_what_the_next_command_takes(two_in_one, tmp_path, cli):
    """40 px are 0.1 m, at the frame rate that is stated."""
    outcome = cli("import", f"{two_in_one}:b", "--fps", "50", "-o", tmp_path / "b.csv")
    assert outcome.status == 0, outcome.err
    world = read_trajectory(tmp_path / "b-world.csv")
    assert outcome.err.startswith(f"next: iris-sysid fit {tmp_path / 'b-world.csv'} --model auto")
    assert world.t_s == pytest.approx(np.arange(6) / 50)
    moved = np.linalg.norm(world.position[-1] - world.position[0])
    assert moved == pytest.approx(5 * math.sqrt(2) / 400)


def test_import_of_a_project_without_a_scale_writes_px_alone(tmp_path, cli):
    (tmp_path / "a.trk").write_text(project(where=coords(axes(xscale=1.0)), bodies=body("a", {0: (1, 1), 1: (2, 2)})))
    assert cli("import", tmp_path / "a.trk", "-o", tmp_path / "a.csv").status == 0
    assert not (tmp_path / "a-world.csv").exists()
    outcome = cli("import", tmp_path / "a.trk", "-o", tmp_path / "b.csv", "--world", tmp_path / "w.csv")
    assert "has no scale: calibrate it in Tracker" in outcome.err


# --------------------------------------------------------------------------- a real one


def test_balltoss_reads_as_published():
    content = read_osp(recording("tracker_balltoss/BallToss.trz"))
    assert content.scale_px_per_m == pytest.approx(398.709, abs=5e-4)
    assert content.angle_rad == pytest.approx(math.radians(0.04401895816986783))
    assert (content.delta_t_ms, content.video) == (66.0, "videos/BallToss_new_BallToss.mp4")
    frames, _ = content.marks["ball"]
    assert frames.tolist() == list(range(2, 13))


def test_balltoss_marks_agree_with_the_balls_centroid_only_after_the_half_pixel_shift():
    """Tracker's origin is the corner of the first pixel: without the shift the marks lie 1.2 px off the ball."""
    path = recording("tracker_balltoss/BallToss.trz")
    luma = np.stack([frame.luma for frame in open_video(path).frames()]).astype(np.int16)
    change = np.abs(luma - np.median(luma, axis=0))
    frames, xy_px = read_osp(path).marks["ball"]
    inside = (frames >= 3) & (frames <= 11)  # before, a hand holds the ball; after, it leaves the image
    offset = np.array([xy - centroid_near(change[k], xy) for k, xy in zip(frames[inside], xy_px[inside], strict=True)])
    rms = np.sqrt(np.mean(np.sum(offset**2, axis=1)))
    unshifted_rms = np.sqrt(np.mean(np.sum((offset + 0.5) ** 2, axis=1)))
    assert rms < 0.7
    assert unshifted_rms > 1.1
    assert np.abs(offset.mean(axis=0)) == pytest.approx([0.0, 0.5], abs=0.2)  # the hand clicked half a pixel low


def centroid_near(change, xy):
    """Centre of the largest changed patch within 40 px."""
    left, top = (np.round(xy).astype(int) - 40).clip(0)
    window = (change[top : top + 81, left : left + 81] > 25).astype(np.uint8)
    _, _, stats, centres = cv2.connectedComponentsWithStats(window)
    return centres[1 + np.argmax(stats[1:, cv2.CC_STAT_AREA])] + [left, top]


# --------------------------------------------------------------------------- what is refused

BILLION_LAUGHS = '<!DOCTYPE x [<!ENTITY a "ha"><!ENTITY b "&a;&a;&a;&a;&a;&a;&a;&a;&a;&a;">]>'
EXTERNAL = '<!DOCTYPE x [<!ENTITY a SYSTEM "file:///etc/passwd">]>'


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (project(head=BILLION_LAUGHS, unit="&b;"), "declares a document type or entities"),
        (project(head=EXTERNAL, unit="&a;"), "declares a document type or entities"),
        (project(head='<!DOCTYPE x SYSTEM "http://localhost/x.dtd">'), "declares a document type"),
        (project().encode("utf-16"), "XML is broken"),
        (project()[:300], "XML is broken"),
        ("", "XML is broken"),
        (b"\x00\xff\x00", "XML is broken"),
        ("<svg/>", "its root is <svg>, not a TrackerPanel"),
        ('<object class="org.other.Panel"/>', r"its root is org\.other\.Panel"),
        (project(where=""), "has no coordinate system"),
        (project(where=coords()), "has no coordinate system"),
        (project(where=coords(axes(xscale="NaN"))), "xscale is NaN, not a finite number"),
        (project(where=coords(axes(x="Infinity"))), "xorigin is Infinity, not a finite number"),
        (project(where=coords(axes(angle="north"))), "angle is missing or no number .'north'"),
        (project(where=coords(prop("xorigin", 1.0))), "yorigin is missing or no number"),
        (project(where=coords(axes(xscale=400, yscale=500))), "scale is 400 px per unit in x and 500 in y"),
        (project(where=coords(axes(xscale=-400))), "scale is -400 px per unit"),
        (
            project(where=coords(axes(), axes(x=140))),
            "the origin of the axes changes within the clip .xorigin from 131",
        ),
        (project(where=coords(axes(), axes(xscale=410))), "the scale of the axes changes within the clip"),
        (project(unit="furlong"), "length unit is 'furlong'; it must be one of m, cm"),
        (project(clip=video(extra=filters("RotateFilter"))), "shown through a RotateFilter"),
        (project(clip=video(extra=filters("PerspectiveFilter"))), "remove the filter in Tracker"),
        (project(bodies=body("a", {0: ("NaN", 1.0)})), "x is NaN, not a finite number"),
        (project(bodies=body("a", {"1e9": (1.0, 1.0)})), r"a mark has the frame number '\[1e9\]'"),
    ],
)
def test_project_that_cannot_be_used_is_refused_with_the_reason(read, text, message):
    with pytest.raises(CalibrationError, match=message) as caught:
        read(text)
    assert "\n" not in str(caught.value)
    assert "clip.trk" in str(caught.value)


def test_project_that_is_not_there_is_refused(tmp_path):
    with pytest.raises(CalibrationError, match=r"cannot read .*none\.trk: No such file"):
        read_osp(tmp_path / "none.trk")


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ({}, "holds no project"),
        ({"a.mp4": b""}, "holds no project .*trk"),
        ({"a.trk": b"", "b.trk": b""}, r"holds 2 projects; name one as FILE.trz:NAME: a.trk, b.trk"),
    ],
)
def test_archive_without_one_project_is_refused(tmp_path, members, message):
    with zipfile.ZipFile(tmp_path / "a.trz", "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    with pytest.raises(CalibrationError, match=message):
        read_osp(tmp_path / "a.trz")


@pytest.mark.parametrize("name", ["a.trk", "a.trz"])
def test_pipe_is_refused_instead_of_waited_for(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(CalibrationError, match="not an ordinary file"):
        read_osp(tmp_path / name)


def test_archive_that_is_none_is_refused(tmp_path):
    (tmp_path / "a.trz").write_bytes(b"not a zip")
    with pytest.raises(CalibrationError, match="not an archive that can be unpacked"):
        read_osp(tmp_path / "a.trz")


def test_project_in_an_archive_that_unpacks_to_too_much_is_refused(tmp_path):
    with (
        zipfile.ZipFile(tmp_path / "a.trz", "w", zipfile.ZIP_DEFLATED) as archive,
        archive.open("a.trk", "w") as member,
    ):
        for _ in range(65):
            member.write(bytes(2**20))
    with pytest.raises(CalibrationError, match="has 68157440 bytes; a Tracker project has at most"):
        read_osp(tmp_path / "a.trz")


def test_marks_become_a_track_at_the_projects_times():
    (body,) = marked_tracks(read_osp(recording("tracker_balltoss") / "BallToss.trz"))
    assert body.body == "ball"
    assert body.n_valid == 11
    np.testing.assert_allclose(np.diff(body.t_s), 0.066, atol=1e-12)
    assert np.isnan(body.sigma_px).all()


@pytest.mark.parametrize("name", ["startframe", "stepsize", "frameshift"])
def test_number_of_frames_beyond_any_clip_is_refused(read, name):
    clip = video() + prop(name, "1e19", "int")
    with pytest.raises(CalibrationError, match=rf"{name} is 1e\+19, more frames than any clip has"):
        read(project(clip=clip, bodies=body("a", {1: (1, 1)})))


def test_archive_whose_names_are_no_text_or_whose_content_is_damaged_is_refused(tmp_path):
    path = tmp_path / "a.trz"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("aé.trk", project())
    data = path.read_bytes()
    start = data.index(b".trk") + 20
    for damaged in (data.replace("é".encode(), b"\xff\xfe"), data[:start] + b"\xff" * 60 + data[start + 60 :]):
        path.write_bytes(damaged)
        with pytest.raises(CalibrationError, match="is not an archive that can be unpacked"):
            read_osp(path)
