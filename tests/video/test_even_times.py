"""Times that a container rounds to whole milliseconds are unrounded where the rate is even, and only there."""

from fractions import Fraction

import numpy as np
import pytest

from iris_sysid import open_video
from iris_sysid.video.even_times import even_times
from tests.video.test_video import write_clip

MILLISECONDS = Fraction(1, 1000)
NTSC = Fraction(60_000, 1001)


def rounded(number, rate):
    return [round(1000 * int(k) / rate) for k in number]


@pytest.mark.parametrize("name", ["even.mkv", "even.webm"])
def test_matroska_gives_times_of_its_even_rate_and_not_whole_milliseconds(tmp_path, name):
    codec = "ffv1" if name.endswith("mkv") else "libvpx"
    path = write_clip(tmp_path / name, 30, codec=codec, rate=60)
    times = np.array([frame.t_s for frame in open_video(path).frames()])
    np.testing.assert_allclose(times, np.arange(30) / 60, rtol=0, atol=1e-9)
    sampled = open_video(path).sample(7)
    np.testing.assert_allclose([frame.t_s for frame in sampled], [frame.index / 60 for frame in sampled], atol=1e-9)


@pytest.mark.parametrize("rate", [Fraction(60), NTSC, Fraction(30)])
def test_dropped_frames_leave_gaps_in_the_even_times(rate):
    number = np.delete(np.arange(200), [17, 18, 90])
    even = even_times(rounded(number, rate), (rate,), MILLISECONDS)
    times = [float(even.unrounded(stamp)) / 1000 for stamp in rounded(number, rate)]
    np.testing.assert_allclose(times, number / float(rate), atol=1e-12)


def test_one_frame_off_its_time_leaves_all_times_as_stated():
    stamps = rounded(range(100), 60)
    stamps[40] += 2
    assert even_times(stamps, (Fraction(60),), MILLISECONDS) is None


def test_wrong_rate_of_the_header_is_not_believed():
    assert even_times(rounded(range(300), 60), (NTSC,), MILLISECONDS) is None
    assert even_times(rounded(range(300), 60), (NTSC, Fraction(60)), MILLISECONDS).interval == Fraction(50, 3)


def test_too_short_an_interval_agrees_with_any_stamps_and_does_not_count():
    stamps = np.cumsum(np.random.default_rng(0).integers(10, 30, 100)).tolist()
    assert even_times(stamps, (Fraction(700), Fraction(90_000)), MILLISECONDS) is None
