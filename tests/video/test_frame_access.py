"""Frames by number: the same images as in order, in any order, from any thread, in bounded memory."""

import time
from concurrent.futures import ThreadPoolExecutor

import cv2
import numpy as np
import pytest

from iris_sysid.errors import VideoError
from iris_sysid.video.frame_access import FrameAccess
from iris_sysid.video.reader import open_video
from tests.conftest import discs, write_video


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A hundred frames, each with its own image, in one group of pictures of 250."""
    path = tmp_path_factory.mktemp("access") / "clip.mp4"
    return write_video(path, [np.round(discs((10.0 + k, 40.0))).astype(np.uint8) for k in range(100)])


@pytest.fixture(scope="module")
def in_order(clip):
    return {frame.index: frame.luma.copy() for frame in open_video(clip).frames()}


@pytest.fixture
def access(clip):
    access = FrameAccess(open_video(clip), held_bytes=20 * 96 * 128 * 3 // 2)
    yield access
    access.close()


ORDERS = {
    "forward": range(100),
    "back": range(99, -1, -1),
    "jumps": np.random.default_rng(3).integers(0, 100, 60).tolist(),
    "to and fro": [50, 49, 50, 51, 30, 31, 32, 31, 30, 29, 99, 0],
}


@pytest.mark.parametrize("order", ORDERS)
def test_frame_of_a_number_is_the_one_that_reading_in_order_gives(order, access, in_order):
    for number in ORDERS[order]:
        frame = access.frame(number)
        assert frame.index == number
        assert np.array_equal(frame.luma, in_order[number])


def test_frames_asked_for_by_several_threads_are_right(access, in_order):
    numbers = np.random.default_rng(5).integers(0, 100, 200).tolist()
    with ThreadPoolExecutor(4) as pool:
        for number, frame in zip(numbers, pool.map(access.frame, numbers), strict=True):
            assert np.array_equal(frame.luma, in_order[number])


def test_no_more_frames_are_held_than_fit(access):
    for number in (*range(100), *range(99, 0, -7)):
        access.frame(number)
        assert len(access._held) <= access.most_held == 20


def test_frames_further_back_are_there_before_they_are_asked_for(access):
    access.frame(60)
    access.frame(59)
    stop = time.monotonic() + 20
    while 55 not in access._held:
        assert time.monotonic() < stop, "frame 55 was not prepared"
        time.sleep(0.01)


@pytest.mark.parametrize("number", [100, 10**8, -1])
def test_number_beyond_the_clip_is_refused_with_the_count(number, access):
    with pytest.raises(VideoError, match=f"no frame {number} to show; it has about 100"):
        access.frame(number)


def test_times_are_known_without_decoding(clip):
    video = open_video(clip)
    assert video.frame_times == [frame.t_s for frame in open_video(clip).frames()]
    assert video.decoded == 0


def test_jpeg_shows_the_frame_as_wide_as_asked_for(access):
    image = cv2.imdecode(np.frombuffer(access.jpeg(5, width=64), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image.shape == (48, 64)
    whole = cv2.imdecode(np.frombuffer(access.jpeg(5), np.uint8), cv2.IMREAD_GRAYSCALE)
    assert whole.shape == (96, 128)
    assert np.hypot(*(np.argwhere(whole > 150).mean(axis=0) - (40.0, 15.0))) < 0.5


def test_folder_of_images_and_gif_give_their_frames(tmp_path, in_order):
    folder = tmp_path / "images"
    folder.mkdir()
    for k in range(12):
        cv2.imwrite(str(folder / f"{k}.png"), in_order[k])
    access = FrameAccess(open_video(folder, fps=30.0))
    try:
        for number in (11, 3, 4, 0):
            assert np.abs(access.frame(number).luma.astype(int) - in_order[number]).max() <= 1
    finally:
        access.close()
