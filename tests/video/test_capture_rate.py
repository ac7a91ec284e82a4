"""The rate at which a phone recorded, as its file of slow motion states it."""

from fractions import Fraction

import av
import pytest

from iris_sysid import open_video, run
from iris_sysid.classroom.groups import Group, GroupRequest, Source
from iris_sysid.classroom.measure import measure_groups
from iris_sysid.classroom.summary import summary_of
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import ClipOptions


def tagged(source, target, slower=1, rate=None):
    """The same images, ``slower`` times as slow, in a file that states the rate of the recording."""
    with av.open(str(source)) as played, av.open(str(target), "w", options={"movflags": "use_metadata_tags"}) as made:
        stream = played.streams.video[0]
        coded = made.add_stream("libx264", rate=Fraction(stream.average_rate) / slower)
        coded.width, coded.height, coded.pix_fmt, coded.options = stream.width, stream.height, "yuv420p", {"crf": "12"}
        if rate is not None:
            made.metadata["com.android.capture.fps"] = rate
        for frame in played.decode(stream):
            image = av.VideoFrame.from_ndarray(frame.to_ndarray(format="bgr24"), format="bgr24")
            made.mux(coded.encode(image))
        made.mux(coded.encode())
    return target


@pytest.mark.parametrize(("rate", "stated"), [("240.000000", 240.0), (None, None), ("fast", None), ("-1", None)])
def test_capture_rate_is_a_fact_where_the_file_states_a_number(pendulum_clip, tmp_path, rate, stated):
    assert open_video(tagged(pendulum_clip, tmp_path / "a.mp4", rate=rate)).facts.get("capture_rate") == stated


def test_slow_motion_is_told_by_the_file_and_the_option_that_is_named_mends_it(pendulum_clip, tmp_path):
    slow = tagged(pendulum_clip, tmp_path / "slow.mp4", slower=4, rate="30.0")
    result = run(slow, "pendulum")
    (doubt,) = result.fit.doubts
    assert (doubt.kind, doubt.remedy) == ("clock", "give --fps 30")
    assert result.trajectory.doubts == result.fit.doubts
    mended = run(slow, "pendulum", clip=ClipOptions(fps=30.0))
    assert not mended.fit.doubts
    assert abs(mended.fit.estimates["length"].value - 0.5) < 0.01


def test_file_that_is_played_as_it_was_recorded_is_not_doubted(pendulum_clip, tmp_path):
    assert not run(tagged(pendulum_clip, tmp_path / "a.mp4", rate="30.01"), "pendulum").fit.doubts


def test_class_names_the_rate_that_the_file_states(pendulum_clip, tmp_path):
    slow = tagged(pendulum_clip, tmp_path / "slow.mp4", slower=2, rate="30.0")
    group = Group(Source("7", slow), GroupRequest(PHENOMENA["pendulum"]))
    documents, _ = measure_groups([group], tmp_path / "out")
    (named,) = summary_of(documents, [""]).named
    assert named.cause == "a 15 fps file of a 30 fps recording: the file says that it was recorded at 30 fps"
