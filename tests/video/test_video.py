"""Frames and their times, from whole files and from damaged ones; an independent reader (OpenCV) as oracle."""

import gc
import hashlib
import os
import struct
import time
import wave
import zipfile
import zlib
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from fractions import Fraction
from pathlib import Path

import av
import cv2
import numpy as np
import pytest
from PIL import Image

import iris_sysid.video.reader
from iris_sysid.errors import VideoError
from iris_sysid.video.reader import open_video
from tests._project import recording

MILLISECONDS = Fraction(1, 1000)
WIDTH, HEIGHT = 94, 70  # 94: rows of the decoder's buffer are longer than the image's


def image_of(number, width=WIDTH, height=HEIGHT):
    """An image that encodes its number: texture, and a bright block at its own position."""
    texture = np.random.default_rng(5).integers(40, 120, (height, width), dtype=np.uint8)
    x, y = (7 * number) % (width - 12), (3 * number) % (height - 10)
    texture[y : y + 10, x : x + 12] = 200 + number % 20
    return texture


def write_clip(
    path,
    count=30,
    *,
    codec="libx264",
    pixel_format="yuv420p",
    rate=30,
    stamps=None,
    time_base=MILLISECONDS,
    options=None,
    container_options=None,
    rotation=None,
    size=(WIDTH, HEIGHT),
    container_format=None,
):
    """Encode numbered grey images, at the stamps given or at a rate; x264 is lossless by default."""
    options = {"qp": "0", "g": "10"} | (options or {}) if codec == "libx264" else options or {}
    with av.open(str(path), "w", format=container_format, options=container_options or {}) as container:
        stream = container.add_stream(codec, rate=rate, options=options)
        stream.width, stream.height, stream.pix_fmt = *size, pixel_format
        if stamps is not None:
            stream.codec_context.time_base = time_base
        if rotation is not None:
            stream.set_display_rotation(*rotation)
        for number in range(count):
            frame = grey_frame(image_of(number, *size)).reformat(format=pixel_format)
            if stamps is not None:
                frame.pts, frame.time_base = stamps[number], time_base
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


def grey_frame(luma):
    """The grey image as yuv420p, so that the luma plane is kept to the bit."""
    height, width = luma.shape
    chroma = np.full((height // 2, width), 128, np.uint8)
    return av.VideoFrame.from_ndarray(np.vstack([luma, chroma]), format="yuv420p")


def times(path, **options):
    return [frame.t_s for frame in open_video(path, **options).frames()]


def read_by_opencv(path):
    """Times in s and BGR images, in order."""
    capture = cv2.VideoCapture(str(path))
    frames = []
    while True:
        ok, image = capture.read()
        if not ok:
            return [t for t, _ in frames], [frame for _, frame in frames]
        frames.append((capture.get(cv2.CAP_PROP_POS_MSEC) / 1000, image))


# --------------------------------------------------------------------------- times


def uneven_stamps(count):
    steps = np.random.default_rng(3).choice([8, 17, 33, 50], size=count - 1)
    return [500, *(500 + np.cumsum(steps)).tolist()]


@pytest.mark.parametrize("name", ["uneven.mp4", "uneven.mkv", "uneven.mov"])
def test_times_of_uneven_rate_are_exact(tmp_path, name):
    stamps = uneven_stamps(40)
    path = write_clip(tmp_path / name, 40, stamps=stamps, options={"bf": "2"})
    assert times(path) == [stamp / 1000 for stamp in stamps]


def test_times_of_uneven_rate_agree_with_opencv_but_for_the_start_it_drops(tmp_path):
    path = write_clip(tmp_path / "uneven.mp4", 40, stamps=uneven_stamps(40), options={"bf": "2"})
    by_opencv, _ = read_by_opencv(path)
    assert times(path)[0] == 0.5
    assert np.array(times(path)) - 0.5 == pytest.approx(np.array(by_opencv) - by_opencv[0], abs=1e-9)


@pytest.mark.parametrize(("rate", "name"), [(Fraction(60000, 1001), "a.mp4"), (Fraction(30000, 1001), "a.mov")])
def test_times_of_a_broken_rate_are_the_nearest_floats(tmp_path, rate, name):
    path = write_clip(tmp_path / name, 90, rate=rate)
    assert times(path) == [float(k / rate) for k in range(90)]


def test_times_of_a_gif_are_its_delays(tmp_path):
    delays_ms = [100, 50, 200, 10, 30, 100]
    images = [Image.fromarray(image_of(k)) for k in range(6)]
    images[0].save(tmp_path / "a.gif", save_all=True, append_images=images[1:], duration=delays_ms, optimize=False)
    assert times(tmp_path / "a.gif") == pytest.approx(np.cumsum([0, *delays_ms[:-1]]) / 1000, abs=1e-12)


def test_gif_delay_of_zero_is_a_tenth_of_a_second(tmp_path):
    images = [Image.fromarray(image_of(k)) for k in range(4)]
    images[0].save(tmp_path / "a.gif", save_all=True, append_images=images[1:], duration=70, optimize=False)
    data = (tmp_path / "a.gif").read_bytes()
    second = data.index(b"!\xf9\x04", data.index(b"!\xf9\x04") + 1)
    written(tmp_path / "a.gif", data[: second + 4] + bytes(2) + data[second + 6 :])
    assert times(tmp_path / "a.gif") == pytest.approx([0.0, 0.07, 0.17, 0.24])


def test_times_with_fps_are_frame_number_over_rate(tmp_path):
    path = write_clip(tmp_path / "slow.mp4", 20, rate=Fraction(30000, 1001))
    assert times(path, fps=240) == [k / 240 for k in range(20)]
    assert times(path, fps=59.94) == [k / 59.94 for k in range(20)]


def test_start_and_stop_are_included_and_keep_frame_numbers(tmp_path):
    path = write_clip(tmp_path / "a.mp4", 30, rate=10)
    video = open_video(path, start_s=0.5, stop_s=1.2)
    frames = list(video.frames())
    assert [frame.index for frame in frames] == list(range(5, 13))
    assert [frame.t_s for frame in frames] == [k / 10 for k in range(5, 13)]
    assert video.n_expected == 8


def test_start_and_stop_select_on_the_overridden_times(tmp_path):
    path = write_clip(tmp_path / "a.mp4", 30, rate=10)
    video = open_video(path, fps=100, start_s=0.1)
    assert [frame.index for frame in video.frames()] == list(range(10, 30))
    assert video.n_expected == 20


def test_part_without_a_frame_is_an_error_that_names_the_times(tmp_path):
    path = write_clip(tmp_path / "a.mp4", 10, rate=10)
    with pytest.raises(VideoError, match=r"no frame lies between 5 s and 6 s; 10 frames were read, up to 0.9 s"):
        times(path, start_s=5, stop_s=6)


def test_frames_with_the_time_of_the_one_before_are_left_out_and_counted(tmp_path):
    stamps = [0, 10, 20, 24, 30, 40, 41, 50]  # of 0.1 ms, in a file that counts ms
    path = write_clip(tmp_path / "a.mkv", 8, stamps=stamps, time_base=Fraction(1, 10_000), codec="ffv1")
    video = open_video(path)
    frames = list(video.frames())
    assert [frame.index for frame in frames] == [0, 1, 2, 4, 5, 7]
    assert [frame.t_s for frame in frames] == [0.0, 0.001, 0.002, 0.003, 0.004, 0.005]
    assert (
        "2 frames were left out, each with the same time as the frame before it (the first is frame 3)" in video.warning
    )


def test_frame_that_is_missing_by_the_files_own_times_is_said_where_the_frame_rate_counts_frames(tmp_path):
    stamps = [k for k in range(12) if k != 7]
    path = write_clip(tmp_path / "a.mkv", len(stamps), stamps=stamps, time_base=Fraction(1, 25), codec="ffv1")
    assert times(path) == [k / 25 for k in stamps]
    video = open_video(path, fps=25.0)
    assert [frame.t_s for frame in video.frames()] == [k / 25 for k in range(11)]
    assert "own times are uneven, 40 to 80 ms a frame (first at frame 7)" in video.warning
    assert video.complete


def test_frame_rate_given_for_even_times_is_no_fault(tmp_path):
    path = write_clip(tmp_path / "a.mkv", 40, rate=24, codec="ffv1")  # 41 and 42 ms
    video = open_video(path, fps=240.0)
    assert len(list(video.frames())) == 40
    assert not video.warning


def remux(source, target, stamp):
    """Copy a clip's packets with presentation stamps changed by ``stamp(number, packet)``."""
    with av.open(str(source)) as reader, av.open(str(target), "w") as writer:
        copied = reader.streams.video[0]
        stream = writer.add_stream_from_template(copied)
        for number, packet in enumerate(reader.demux(copied)):
            if packet.dts is not None:
                packet.pts = stamp(number, packet)
                packet.stream = stream
                writer.mux(packet)
    return target


def test_times_that_run_backwards_are_an_error(tmp_path):
    path = write_clip(tmp_path / "a.mkv", 12, codec="ffv1", rate=10)
    swapped = remux(path, tmp_path / "b.mkv", lambda k, packet: packet.pts + {5: 250}.get(k, 0))
    message = r"b.mkv: times run backwards: 0.6 s in frame 6, after 0.75 s; 7 .*frames were read"
    with pytest.raises(VideoError, match=message):
        times(swapped)
    assert len(times(swapped, keep_partial=True)) == 6
    assert len(times(swapped, fps=10)) == 12


def test_clip_without_times_needs_fps(tmp_path):
    path = write_clip(tmp_path / "a.h264", 12)
    with pytest.raises(VideoError, match=r"a.h264 holds images without times; give the frame rate \(--fps\)"):
        open_video(path)
    assert times(path, fps=50) == [k / 50 for k in range(12)]


# --------------------------------------------------------------------------- pixels


@pytest.mark.parametrize("size", [(WIDTH, HEIGHT), (64, 48), (130, 34)])
def test_luma_is_the_coded_plane_to_the_bit_and_in_order(tmp_path, size):
    path = write_clip(tmp_path / "a.mp4", 25, options={"bf": "3"}, size=size)
    video = open_video(path)
    frames = list(video.frames())
    assert (video.width, video.height, video.n_expected, video.decoded) == (*size, 25, 25)
    assert [frame.index for frame in frames] == list(range(25))
    for frame in frames:
        np.testing.assert_array_equal(frame.luma, image_of(frame.index, *size))


def test_luma_may_be_kept_after_everything_else_is_gone(tmp_path):
    kept = [frame.luma for frame in open_video(write_clip(tmp_path / "a.mp4", 60)).frames()]
    gc.collect()
    (tmp_path / "a.mp4").unlink()
    for number, luma in enumerate(kept):
        np.testing.assert_array_equal(luma, image_of(number))
        assert not luma.flags.writeable


def test_luma_is_no_copy(tmp_path):
    frame = next(open_video(write_clip(tmp_path / "a.mp4", 3)).frames())
    assert not frame.luma.flags.owndata
    assert frame.luma.strides[0] > WIDTH


def test_frames_can_be_read_again_and_side_by_side(tmp_path):
    video = open_video(write_clip(tmp_path / "a.mp4", 12))
    for frame, other in zip(video.frames(), video.frames(), strict=True):
        np.testing.assert_array_equal(frame.luma, other.luma)
    assert len(list(video.frames())) == 12


@pytest.mark.parametrize(
    ("codec", "pixel_format", "shift"),
    [("ffv1", "yuv420p10le", 2), ("ffv1", "gray16le", 8)],
)
def test_luma_of_deep_video_is_its_upper_eight_bits(tmp_path, codec, pixel_format, shift):
    path = write_clip(tmp_path / "a.mkv", 3, codec=codec, pixel_format=pixel_format)
    with av.open(str(path)) as container:
        deep = next(container.decode(video=0)).to_ndarray()[:HEIGHT, :WIDTH]
    np.testing.assert_array_equal(next(open_video(path).frames()).luma, deep >> shift)


@pytest.mark.parametrize(("pixel_format", "named"), [("yuvj420p", "full"), ("yuv420p", "limited")])
def test_luma_range_is_left_as_coded_and_named(tmp_path, pixel_format, named):
    with av.open(str(tmp_path / "a.mkv"), "w") as container:
        stream = container.add_stream("ffv1", rate=10)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        stream.codec_context.color_range = {"limited": 1, "full": 2}[named]
        container.mux(stream.encode(grey_frame(np.tile(np.arange(0, 256, 4, dtype=np.uint8), (48, 1)))))
        container.mux(stream.encode())
    video = open_video(tmp_path / "a.mkv")
    assert video.facts["luma_range"] == named
    np.testing.assert_array_equal(next(video.frames()).luma[0], np.arange(0, 256, 4))


def test_bgr_agrees_with_opencv(tmp_path):
    path = write_colour_clip(tmp_path / "a.mp4")
    _, by_opencv = read_by_opencv(path)
    for frame, expected in zip(open_video(path).frames(), by_opencv, strict=True):
        bgr = frame.bgr()
        assert bgr.shape == (48, 64, 3)
        assert np.abs(bgr.astype(int) - expected).max() <= 3
        bgr[:] = 0  # the caller's own array


def test_one_frame_may_be_asked_for_its_colour_by_several_threads(tmp_path):
    frame = next(open_video(write_colour_clip(tmp_path / "a.mp4")).frames())
    alone = frame.bgr()
    with ThreadPoolExecutor(4) as pool:
        for bgr in pool.map(lambda _: frame.bgr(), range(400)):
            np.testing.assert_array_equal(bgr, alone)


def write_colour_clip(path, count=4, **options):
    """A clip with a red left, a green right and a blue lower half."""
    rgb = np.zeros((48, 64, 3), np.uint8)
    rgb[:24, :32], rgb[:24, 32:], rgb[24:] = (200, 30, 30), (30, 200, 30), (30, 30, 200)
    codec = options.pop("codec", "libx264")
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=10, options={"qp": "0"} if codec == "libx264" else {})
        stream.width, stream.height, stream.pix_fmt = 64, 48, options.pop("pixel_format", "yuv444p")
        if "rotation" in options:
            stream.set_display_rotation(*options.pop("rotation"))
        for _ in range(count):
            container.mux(
                stream.encode(av.VideoFrame.from_ndarray(rgb, format="rgb24").reformat(format=stream.pix_fmt))
            )
        container.mux(stream.encode())
    return path


def test_luma_of_a_gif_is_the_grey_of_its_colours(tmp_path):
    rgb = np.zeros((40, 60, 3), np.uint8)
    rgb[:20], rgb[20:] = (255, 0, 0), (10, 200, 90)
    Image.fromarray(rgb).save(tmp_path / "a.gif")
    frame = next(open_video(tmp_path / "a.gif").frames())
    assert frame.luma[5, 5] == pytest.approx(0.299 * 255, abs=1)
    assert frame.luma[30, 5] == pytest.approx(0.299 * 10 + 0.587 * 200 + 0.114 * 90, abs=1)
    assert frame.bgr()[30, 5].tolist() == [90, 200, 10]


# --------------------------------------------------------------------------- rotation


@pytest.mark.parametrize(("counterclockwise", "clockwise"), [(0, 0), (90, 270), (180, 180), (270, 90), (-90, 90)])
def test_rotated_clip_is_given_as_displayed_like_opencv_does(tmp_path, counterclockwise, clockwise):
    path = write_colour_clip(tmp_path / "a.mp4", rotation=(counterclockwise,))
    _, by_opencv = read_by_opencv(path)
    video = open_video(path)
    frame = next(video.frames())
    assert video.rotation_deg == clockwise
    assert frame.luma.shape == (video.height, video.width) == by_opencv[0].shape[:2]
    assert np.abs(frame.bgr().astype(int) - by_opencv[0]).max() <= 3
    upright = next(open_video(write_colour_clip(tmp_path / "b.mp4")).frames()).luma
    np.testing.assert_array_equal(frame.luma, np.rot90(upright, counterclockwise // 90))
    assert frame.luma.flags.c_contiguous or clockwise == 0
    assert not frame.luma.flags.writeable


@pytest.mark.parametrize("turn", range(4))
@pytest.mark.parametrize("flip", [(False, False), (True, False), (False, True)])
def test_mirrored_clip_is_given_as_its_matrix_says(tmp_path, turn, flip):
    path = write_colour_clip(tmp_path / "a.mp4", rotation=(90 * turn, *flip))
    upright = next(open_video(write_colour_clip(tmp_path / "b.mp4")).frames()).luma
    np.testing.assert_array_equal(next(open_video(path).frames()).luma, by_matrix(path, upright))


def by_matrix(path, image):
    """The image moved point by point by the file's own display matrix (ISO 14496-12, 8.2.2)."""
    with av.open(str(path)) as container:
        matrix = next(container.decode(video=0)).side_data.get("DISPLAYMATRIX")
    if matrix is None:
        return image
    (a, b, _), (c, d, _) = np.sign(np.frombuffer(matrix, np.int32).reshape(3, 3))[:2].tolist()
    y, x = np.indices(image.shape)
    moved_x, moved_y = a * x + c * y, b * x + d * y
    moved_x, moved_y = moved_x - moved_x.min(), moved_y - moved_y.min()
    displayed = np.zeros((moved_y.max() + 1, moved_x.max() + 1), np.uint8)
    displayed[moved_y, moved_x] = image
    return displayed


# --------------------------------------------------------------------------- sampling


def test_sample_is_spread_evenly_over_the_clip(tmp_path):
    video = open_video(write_clip(tmp_path / "a.mp4", 60))
    frames = video.sample(6)
    assert [frame.index for frame in frames] == [5, 15, 25, 35, 45, 55]
    assert [frame.t_s for frame in frames] == [k / 30 for k in (5, 15, 25, 35, 45, 55)]
    for frame in frames:
        np.testing.assert_array_equal(frame.luma, image_of(frame.index))


def test_sample_of_a_short_clip_is_the_clip(tmp_path):
    assert len(open_video(write_clip(tmp_path / "a.mp4", 7)).sample(25)) == 7


def test_sample_keeps_to_the_wanted_part(tmp_path):
    video = open_video(write_clip(tmp_path / "a.mp4", 60), fps=10, start_s=2, stop_s=3.9)
    assert [frame.index for frame in video.sample(5)] == [22, 26, 30, 34, 38]


@pytest.mark.parametrize("name", ["a.mp4", "a.mkv", "a.avi", "a.ts"])
@pytest.mark.parametrize("bounds", [{}, {"start_s": 1.0, "stop_s": 5.0}])
def test_sample_near_key_frames_gives_the_frames_of_a_full_pass(tmp_path, monkeypatch, name, bounds):
    path = write_clip(tmp_path / name, 200, options={"bf": "2", "g": "12"})
    monkeypatch.setattr(iris_sysid.video.reader, "SAMPLING_PIXELS", 50 * WIDTH * HEIGHT)
    video = open_video(path, **bounds)
    whole = {frame.index: frame for frame in video.frames()}
    frames = video.sample(20)
    assert video.decoded == 200 or bounds  # the sample itself made no pass
    assert 15 <= len(frames) <= 20
    indices = [frame.index for frame in frames]
    assert indices == sorted(set(indices))
    assert max(np.diff(indices)) <= 3 * len(whole) / 20
    for frame in frames:
        assert frame.t_s == whole[frame.index].t_s
        np.testing.assert_array_equal(frame.luma, whole[frame.index].luma)


def test_sample_near_key_frames_does_not_keep_step_with_them(tmp_path, monkeypatch):
    """A motion with the period of the key frames would else be sampled at one position, and enter the background."""
    path = write_clip(tmp_path / "a.mp4", 200, options={"g": "10"})
    monkeypatch.setattr(iris_sysid.video.reader, "SAMPLING_PIXELS", 100 * WIDTH * HEIGHT)
    places = [frame.index % 10 for frame in open_video(path).sample(20)]
    assert len(set(places)) >= 4


def test_sample_of_a_large_clip_with_few_key_frames_reads_it_through(tmp_path, monkeypatch):
    path = write_clip(tmp_path / "a.mp4", 60, options={"g": "250"})
    monkeypatch.setattr(iris_sysid.video.reader, "SAMPLING_PIXELS", 1)
    assert [frame.index for frame in open_video(path).sample(3)] == [10, 30, 50]


@pytest.mark.parametrize("frames", [40, 200])
def test_sample_of_large_images_holds_as_many_of_a_short_clip_as_of_a_long_one(tmp_path, monkeypatch, frames):
    path = write_clip(tmp_path / "a.mp4", frames, options={"g": "4"})
    monkeypatch.setattr(iris_sysid.video.reader, "HELD_PIXELS", 13 * WIDTH * HEIGHT)
    assert len(open_video(path).sample(40)) == 13
    monkeypatch.setattr(iris_sysid.video.reader, "HELD_PIXELS", 1)
    assert len(open_video(path).sample(40)) == 9
    assert len(open_video(path).sample(5)) == 5


@pytest.mark.parametrize("count", [1, 2, 5, 16, 50])
def test_sample_of_a_clip_of_unknown_length_is_even_and_bounded(tmp_path, count):
    indices = [frame.index for frame in open_video(write_clip(tmp_path / "a.h264", 50), fps=30).sample(count)]
    assert max(1, count // 2) <= len(indices) <= count
    assert len(set(np.diff(indices))) <= 1


def test_sample_of_no_frames_is_refused(tmp_path):
    with pytest.raises(VideoError, match="0 frames to sample; ask for at least 1"):
        open_video(write_clip(tmp_path / "a.mp4", 3)).sample(0)


# --------------------------------------------------------------------------- healthy, but odd


def test_clip_cut_by_an_edit_list_is_whole(tmp_path):
    """The file holds 30 frames and shows 20; the header counts 30."""
    path = write_clip(tmp_path / "a.mp4", 30, rate=10, options={"bf": "0", "g": "30"})
    cut = tmp_path / "b.mp4"
    with av.open(str(path)) as reader, av.open(str(cut), "w", options={"use_editlist": "1"}) as writer:
        copied = reader.streams.video[0]
        stream = writer.add_stream_from_template(copied)
        for packet in reader.demux(copied):
            if packet.dts is not None:
                packet.pts -= int(1 / copied.time_base)
                packet.dts -= int(1 / copied.time_base)
                packet.stream = stream
                writer.mux(packet)
    video = open_video(cut)
    frames = list(video.frames())
    assert [frame.t_s for frame in frames] == [k / 10 for k in range(20)]
    np.testing.assert_array_equal(frames[0].luma, image_of(10))
    assert (video.n_expected, video.warning) == (20, "")


def test_avi_with_repeated_frames_is_whole(tmp_path):
    stamps = [k for k in range(40) if k not in (10, 11, 12, 25)]
    path = write_clip(tmp_path / "a.avi", 36, codec="mpeg4", stamps=stamps, time_base=Fraction(1, 30))
    assert times(path) == [k / 30 for k in stamps]


def test_avi_with_images_out_of_the_order_of_the_file_keeps_their_times(tmp_path):
    path = write_clip(tmp_path / "a.avi", 40, options={"bf": "3", "b-pyramid": "normal", "refs": "4", "g": "20"})
    frames = list(open_video(path).frames())
    assert [frame.t_s - frames[0].t_s for frame in frames] == pytest.approx([k / 30 for k in range(40)], abs=1e-12)
    for number, frame in enumerate(frames):
        np.testing.assert_array_equal(frame.luma, image_of(number))
    assert len(open_video(path).sample(5)) == 5


@pytest.mark.parametrize(
    ("name", "codec", "options"),
    [
        ("a.mp4", "libx264", {"bf": "4", "b-pyramid": "normal", "refs": "4"}),
        ("fragments.mp4", "libx264", {"bf": "2"}),
        ("a.ts", "libx264", {"bf": "2"}),
        ("a.webm", "libvpx", {"auto-alt-ref": "1", "lag-in-frames": "16"}),
        ("a.webm", "libvpx-vp9", {}),
        ("a.avi", "mpeg4", {"bf": "2"}),
        ("a.avi", "mjpeg", {}),
        ("a.mpg", "mpeg2video", {"bf": "2"}),
        ("a.mkv", "libx265", {"x265-params": "log-level=none"}),
        ("interlaced.ts", "libx264", {"qp": "20", "x264-params": "interlaced=1", "bf": "2"}),
    ],
)
def test_healthy_file_is_read_without_complaint(tmp_path, name, codec, options):
    fragments = {"movflags": "frag_keyframe+empty_moov"} if "fragments" in name else {}
    pixel_format = "yuvj420p" if codec == "mjpeg" else "yuv420p"
    path = write_clip(
        tmp_path / name,
        48,
        codec=codec,
        options=options,
        container_options=fragments,
        size=(96, 72),
        pixel_format=pixel_format,
        rate=25,
    )
    video = open_video(path)
    assert len(list(video.frames())) == 48
    assert np.diff(times(path)) == pytest.approx(1 / 25, abs=6e-4)  # Matroska counts ms
    assert video.warning == ""
    assert video.n_expected in ((0,) if name.endswith((".ts", ".mpg")) else (47, 48, 49))


def test_clip_with_sound_is_read(tmp_path):
    path = tmp_path / "a.mkv"
    with av.open(str(path), "w") as container:
        images, sound = container.add_stream("ffv1", rate=10), container.add_stream("pcm_s16le", rate=8000)
        images.width, images.height, images.pix_fmt = WIDTH, HEIGHT, "yuv420p"
        for number in range(10):
            container.mux(images.encode(grey_frame(image_of(number))))
        samples = av.AudioFrame.from_ndarray(np.zeros((1, 40_000), np.int16), format="s16", layout="mono")
        samples.sample_rate = 8000
        container.mux(sound.encode(samples))
        container.mux(images.encode())
        container.mux(sound.encode())
    assert times(path) == [k / 10 for k in range(10)]  # the sound goes on for 4 s: no frame is missing


@pytest.mark.parametrize(
    "name",
    [
        "with space.mp4", "ünïcode ☃.mp4", "-dash.mp4", "%03d.mp4", "a%d*?[0-9].mp4", "http:host.mp4", "concat:a|b.mp4",
        "pipe:0.mp4", "quote'\".mp4", "no_suffix", "clip.JPG", "subfile,,start,0,end,9,,:a.mp4",
        os.fsdecode(b"not-utf8-\xff.mp4"),
    ],
)  # fmt: skip
def test_odd_name_is_only_a_name(tmp_path, monkeypatch, name):
    write_clip(tmp_path / "a.mp4", 5).rename(tmp_path / name)
    assert len(times(tmp_path / name)) == 5
    monkeypatch.chdir(tmp_path)
    assert len(times(name)) == 5


@pytest.mark.parametrize(
    "playlist",
    [
        "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\nsecret.ts\n#EXT-X-ENDLIST\n",
        "ffconcat version 1.0\nfile secret.ts\n",
    ],
)
def test_playlist_disguised_as_video_opens_no_other_file(tmp_path, playlist):
    write_clip(tmp_path / "secret.ts", 5)
    (tmp_path / "a.mp4").write_text(playlist)
    with pytest.raises(VideoError, match=r"a\.mp4 cannot be read as a video: it is a text file that begins with"):
        open_video(tmp_path / "a.mp4")


def test_title_that_is_no_text_is_no_obstacle(tmp_path):
    path = write_clip(tmp_path / "a.mp4", 3)
    with av.open(str(path)) as reader, av.open(str(tmp_path / "b.mp4"), "w") as writer:
        writer.metadata["title"] = "TITLE"
        stream = writer.add_stream_from_template(reader.streams.video[0])
        for packet in reader.demux(reader.streams.video[0]):
            if packet.dts is not None:
                packet.stream = stream
                writer.mux(packet)
    renamed = (tmp_path / "b.mp4").read_bytes().replace(b"TITLE", b"\xff\xfe\xe9\xff\x80")
    assert b"\xe9" in renamed
    assert len(times(written(tmp_path / "b.mp4", renamed))) == 3


def test_sha256_is_that_of_the_file(tmp_path):
    path = write_clip(tmp_path / "a.mp4", 3)
    assert open_video(path).sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


# --------------------------------------------------------------------------- damaged, or no video at all


def cut_to(path, part):
    path.write_bytes(path.read_bytes()[: int(path.stat().st_size * part)])
    return path


def zeroed_at(path, part, count=3000):
    data = bytearray(path.read_bytes())
    start = int(len(data) * part)
    data[start : start + count] = bytes(count)
    path.write_bytes(data)
    return path


def big_clip(path, **options):
    return write_clip(path, 60, size=(160, 120), **options)


FAST_START = {"container_options": {"movflags": "faststart"}}


@pytest.mark.parametrize(
    ("damaged", "fewest", "most", "message"),
    [
        (lambda p: cut_to(big_clip(p / "a.mp4", **FAST_START), 0.6), 20, 40, "is cut off or damaged"),
        (lambda p: zeroed_at(big_clip(p / "a.mp4", **FAST_START), 0.5), 10, 40, "cannot be decoded|is damaged"),
        (lambda p: cut_to(big_clip(p / "a.mkv"), 0.5), 5, 40, "it ends at .* s, its header says 2.000 s|is damaged"),
        (lambda p: cut_to(big_clip(p / "a.avi", codec="mjpeg", pixel_format="yuvj420p"), 0.5), 20, 40, "cut off"),
        (lambda p: zeroed_at(big_clip(p / "a.avi", codec="mjpeg", pixel_format="yuvj420p"), 0.5), 50, 59, "ends early"),
        (lambda p: cut_to(big_clip(p / "a.ts"), 0.5).rename(p / "b.ts"), 10, 60, ""),  # promises nothing
    ],
)
def test_damaged_clip_is_an_error_that_counts_or_is_kept_in_part(tmp_path, damaged, fewest, most, message):
    path = damaged(tmp_path)
    kept = open_video(path, keep_partial=True)
    luma = [frame.luma for frame in kept.frames()]
    assert fewest <= len(luma) <= most
    np.testing.assert_array_equal(luma[0].shape, (120, 160))
    if not message:
        return
    assert kept.decoded == len(luma)
    assert f"{len(luma)} of 60 promised frames were read" in kept.warning
    with pytest.raises(VideoError, match=message) as caught:
        times(path)
    assert "of 60 promised frames were read" in str(caught.value)
    assert "--keep-partial" in str(caught.value)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("a.ogg", {"codec": "libvpx"}),
        ("a.ts", {}),
        ("a.flv", {"codec": "flv"}),
        ("a.wmv", {"codec": "wmv2"}),
        ("a.mkv", {}),
        ("fragments.mp4", {"container_options": {"movflags": "frag_keyframe+empty_moov"}}),
    ],
)
def test_cut_of_a_file_that_promises_no_end_is_said(tmp_path, name, options):
    data = big_clip(tmp_path / name, **options).read_bytes()
    assert (open_video(tmp_path / name).complete, open_video(tmp_path / name).warning) == (True, "")
    for number, size in enumerate(np.linspace(0.5, 0.85, 12) * len(data)):
        path = written(tmp_path / f"{number}{name}", data[: int(size) // 188 * 188 - 88])
        with suppress(VideoError):  # nothing of it can be read: that is said as well
            video = open_video(path, keep_partial=True)
            assert list(video.frames())
            assert not video.complete
            assert video.warning


def test_bit_that_changed_in_an_ogg_file_is_said(tmp_path):
    data = big_clip(tmp_path / "a.ogg", codec="libvpx").read_bytes()
    said = []
    for place in np.linspace(0.05, 0.95, 10):
        changed = bytearray(data)
        changed[int(place * len(data))] ^= 0x10
        with suppress(VideoError):  # no frame of it can be read: that is said as well
            video = open_video(written(tmp_path / "b.ogg", changed), keep_partial=True)
            list(video.frames())
            assert not video.complete
            said.append(video.warning)
    assert any("is damaged" in warning for warning in said)


def test_packets_missing_within_a_transport_stream_are_said(tmp_path):
    data = big_clip(tmp_path / "a.ts").read_bytes()
    middle = len(data) // 2 // 188 * 188
    video = open_video(written(tmp_path / "b.ts", data[:middle] + data[middle + 5 * 188 :]), keep_partial=True)
    list(video.frames())
    assert not video.complete
    assert "b.ts" in video.warning


def test_jump_of_the_time_is_said(tmp_path):
    stamps = [*range(20), *range(4_000_000, 4_000_010)]
    path = write_clip(tmp_path / "a.mkv", 30, stamps=[40 * stamp for stamp in stamps])
    video = open_video(path)
    list(video.frames())
    assert video.warning == "the time jumps from 0.76 s to 160000 s in frame 20"
    assert not video.complete


@pytest.mark.parametrize("harm", [lambda path: cut_to(path, 0.6), lambda path: zeroed_at(path, 0.5)])
def test_damaged_gif_is_an_error_that_counts(tmp_path, harm):
    path = harm(big_clip(tmp_path / "a.gif", codec="gif", pixel_format="rgb8"))
    with pytest.raises(VideoError, match=r"a.gif: its end is missing or damaged; \d+ frames were read, of a number"):
        times(path)
    assert 5 < len(times(path, keep_partial=True)) < 60


def test_frames_before_the_damage_are_those_of_the_whole_clip(tmp_path):
    path = cut_to(big_clip(tmp_path / "a.mp4", options={"bf": "2"}, **FAST_START), 0.7)
    for frame in open_video(path, keep_partial=True).frames():
        np.testing.assert_array_equal(frame.luma, image_of(frame.index, 160, 120))


def test_frame_whose_data_changed_is_damage_where_the_decoder_sees_it(tmp_path):
    path = big_clip(tmp_path / "a.avi", codec="mpeg2video", options={"g": "12", "b": "2000000"})
    with av.open(str(path)) as container:
        packet = [packet for packet in container.demux(video=0) if packet.size][30]
    data = bytearray(path.read_bytes())
    middle = slice(packet.pos + packet.size // 2, packet.pos + packet.size * 3 // 4, 20)
    data[middle] = bytes(byte ^ 0x55 for byte in data[middle])
    written(path, data)
    with pytest.raises(
        VideoError, match=r"a.avi: the data of a frame is damaged; \d\d of 60 promised frames were read"
    ):
        times(path)


def test_packets_that_silently_give_no_image_are_counted_as_lost(tmp_path):
    path = write_clip(tmp_path / "a.mkv", 20, codec="libx265", options={"x265-params": "log-level=none:keyint=1"})
    delimiter = b"\x46\x01\x50"  # an access unit delimiter: a packet without an image that is no error
    with av.open(str(path)) as reader, av.open(str(tmp_path / "b.mkv"), "w") as writer:
        stream = writer.add_stream_from_template(reader.streams.video[0])
        for number, packet in enumerate(reader.demux(reader.streams.video[0])):
            if packet.dts is None:
                continue
            hollow = av.Packet((len(delimiter).to_bytes(4) + delimiter) * 3) if number % 3 == 1 else packet
            hollow.pts, hollow.dts, hollow.time_base = packet.pts, packet.dts, packet.time_base
            hollow.stream = stream
            writer.mux(hollow)
    with pytest.raises(VideoError, match=r"b.mkv: 7 frames could not be decoded; 13 "):
        times(tmp_path / "b.mkv")


def test_size_that_changes_within_the_clip_is_damage(tmp_path):
    small, large = write_clip(tmp_path / "a.h264", 10), write_clip(tmp_path / "b.h264", 10, size=(160, 120))
    small.write_bytes(small.read_bytes() + large.read_bytes())
    with pytest.raises(VideoError, match="the image's size changes to 160x120 px; 10 frames were read"):
        times(small, fps=30)


def test_file_that_is_gone_after_it_was_opened_is_an_error(tmp_path):
    video = open_video(write_clip(tmp_path / "a.mp4", 5))
    (tmp_path / "a.mp4").unlink()
    with pytest.raises(VideoError, match=r"a.mp4: it can no longer be opened .*; 0 of 5 promised frames were read"):
        list(video.frames())
    with pytest.raises(VideoError, match="it can no longer be opened"):
        video.sample(3)


def test_reading_damaged_files_prints_nothing(tmp_path, capfd):
    path = zeroed_at(big_clip(tmp_path / "a.mp4", **FAST_START), 0.5)
    capfd.readouterr()
    times(path, keep_partial=True)
    assert capfd.readouterr() == ("", "")


def sound_only(path):
    with wave.open(str(path), "wb") as file:
        file.setparams((1, 2, 8000, 0, "NONE", ""))
        file.writeframes(bytes(16_000))
    return path


def sound_only_mp4(path):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("aac", rate=8000)
        samples = av.AudioFrame.from_ndarray(np.zeros((1, 8000), np.float32), format="fltp", layout="mono")
        samples.sample_rate = 8000
        container.mux(stream.encode(samples))
        container.mux(stream.encode())
    return path


def frameless_mp4(path):
    """A whole MP4 whose video track lists no frame: every sample table's count is set to 0."""
    data = bytearray(write_clip(path, 5, options={"bf": "0"}).read_bytes())
    for box, counts in ((b"stsz", (8,)), (b"stts", (4,)), (b"stsc", (4,)), (b"stco", (4,)), (b"stss", (4,))):
        start = data.index(box) + 4
        for offset in counts:
            data[start + offset : start + offset + 4] = bytes(4)
    path.write_bytes(data)
    return path


def written(path, content):
    path.write_bytes(content)
    return path


def huge_gif(path):
    head = b"GIF89a" + struct.pack("<HHBBB", 65535, 65535, 0x80, 0, 0) + bytes(3) + b"\xff" * 3
    return written(path, head + b"," + struct.pack("<HHHHB", 0, 0, 1, 1, 0) + b"\x02\x02\x44\x01\x00;")


def huge_avi(path):
    """A raw video whose header claims 20000x100 px; it holds none."""
    data = bytearray(write_clip(path, 2, codec="rawvideo", pixel_format="bgr24").read_bytes())
    start = data.index(b"strf") + 8
    data[start + 4 : start + 12] = struct.pack("<II", 20_000, 100)
    return written(path, data)


def png(width, height):
    def chunk(kind, content):
        return struct.pack(">I", len(content)) + kind + content + struct.pack(">I", zlib.crc32(kind + content))

    head = struct.pack(">IIBBBBB", width, height, 8, 0, 0, 0, 0)
    return b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", head) + chunk(b"IDAT", zlib.compress(bytes(99))) + chunk(b"IEND", b"")


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda p: p / "none.mp4", "there is no file .*none.mp4"),
        (lambda p: Path("/dev/null"), "/dev/null is a device or pipe"),
        (lambda p: written(p / "a.mp4", b""), "cannot be read as a video: it is empty .0 bytes.; no frame was read"),
        (lambda p: written(p / "a.mp4", b"t,x\n0,1\n"), "it is a text file that begins with 't,x'"),
        (
            lambda p: written(p / "a.mp4", bytes(range(256)) * 9),
            "its format is unknown, or its beginning is damaged",
        ),
        (lambda p: cut_to(big_clip(p / "a.mp4"), 0.6), "it is an MP4 without its index .moov box."),
        (lambda p: cut_to(big_clip(p / "a.mp4", **FAST_START), 0.02), "without its index|no frame could be read"),
        (lambda p: sound_only(p / "a.wav"), "a.wav holds no video, only: audio; no frame was read"),
        (lambda p: sound_only_mp4(p / "a.mp4"), "a.mp4 holds no video, only: audio"),
        (lambda p: frameless_mp4(p / "a.mp4"), "no frame in it that can be decoded|no frame could be read"),
        (lambda p: huge_gif(p / "a.gif"), "gives no size of its images, or one beyond 268435456 px"),
        (lambda p: huge_avi(p / "a.avi"), "claims images of 20000x100 px; at most 16384 px a side"),
        (lambda p: written(p / "a.png", png(8, 8)), "a.png cannot be read as a video"),
    ],
)
@pytest.mark.parametrize("keep_partial", [False, True])
def test_file_that_gives_no_frames_is_refused_with_the_reason(tmp_path, made, message, keep_partial):
    path = made(tmp_path)
    began = time.process_time()
    with pytest.raises(VideoError, match=message) as caught:
        open_video(path, keep_partial=keep_partial)
    assert time.process_time() - began < 2
    assert "\n" not in str(caught.value)
    assert path.name in str(caught.value)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"fps": 0}, r"the frame rate must be above 0 and finite, not 0 \(--fps\)"),
        ({"fps": -30}, "not -30"),
        ({"fps": float("nan")}, "not nan"),
        ({"fps": float("inf")}, "not inf"),
        ({"start_s": 2, "stop_s": 1}, "the part from 2 s to 1 s is empty"),
        ({"start_s": float("nan")}, "the part from nan s"),
    ],
)
def test_option_that_makes_no_sense_is_refused(tmp_path, options, message):
    with pytest.raises(VideoError, match=message):
        open_video(write_clip(tmp_path / "a.mp4", 3), **options)


# --------------------------------------------------------------------------- folders of images


def write_pictures(folder, numbers=range(12), name="frame_{}.png"):
    folder.mkdir(exist_ok=True)
    for number in numbers:
        Image.fromarray(image_of(number)).save(folder / name.format(number), lossless=True)
    return folder


def test_images_come_in_natural_order_with_times_from_fps(tmp_path):
    video = open_video(write_pictures(tmp_path / "shots"), fps=4)
    frames = list(video.frames())
    assert [frame.t_s for frame in frames] == [k / 4 for k in range(12)]
    assert (video.n_expected, video.width, video.height, video.warning) == (12, WIDTH, HEIGHT, "")
    for frame in frames:
        np.testing.assert_array_equal(frame.luma, image_of(frame.index))
        np.testing.assert_array_equal(frame.bgr()[..., 1], image_of(frame.index))


def test_images_without_fps_are_refused(tmp_path):
    with pytest.raises(VideoError, match=r"shots holds images without times; give the frame rate \(--fps\)"):
        open_video(write_pictures(tmp_path / "shots"))


@pytest.mark.parametrize("suffix", ["png", "jpg", "jpeg", "bmp", "tif", "tiff", "webp", "pgm", "PNG"])
def test_images_of_each_kind_agree_with_opencv(tmp_path, suffix):
    write_pictures(tmp_path / "shots", range(2), "a{}." + suffix)
    frame = next(open_video(tmp_path / "shots", fps=1).frames())
    expected = cv2.imread(str(tmp_path / "shots" / f"a0.{suffix}"), cv2.IMREAD_GRAYSCALE)
    assert np.abs(frame.luma.astype(int) - expected).max() <= 2


def test_tiff_images_that_opencv_wrote_are_read(tmp_path):
    grey = np.random.default_rng(0).integers(0, 255, (48, 64), np.uint8)
    cv2.imwrite(str(tmp_path / "1.tiff"), grey)
    assert np.array_equal(next(open_video(tmp_path, fps=1).frames()).luma, grey)


def test_images_of_sixteen_bits_give_their_upper_eight(tmp_path):
    (tmp_path / "shots").mkdir()
    Image.fromarray(image_of(0).astype(np.uint16) * 256 + 77).save(tmp_path / "shots" / "a.png")
    np.testing.assert_array_equal(next(open_video(tmp_path / "shots", fps=1).frames()).luma, image_of(0))


@pytest.mark.parametrize("exif", [1, 3, 6, 8])
def test_images_are_turned_as_their_exif_says_like_opencv_does(tmp_path, exif):
    (tmp_path / "shots").mkdir()
    path = tmp_path / "shots" / "a.jpg"
    tags = Image.Exif()
    tags[0x0112] = exif
    Image.fromarray(image_of(4)).save(path, exif=tags, quality=95)
    video = open_video(tmp_path / "shots", fps=1)
    expected = cv2.imread(str(path), cv2.IMREAD_GRAYSCALE)
    assert (video.height, video.width) == expected.shape
    assert np.abs(next(video.frames()).luma.astype(int) - expected).max() <= 2


def test_images_sampled_near_nothing_are_picked_by_number(tmp_path, monkeypatch):
    monkeypatch.setattr(iris_sysid.video.reader, "SAMPLING_PIXELS", 1)
    frames = open_video(write_pictures(tmp_path / "shots", range(40)), fps=10).sample(10)
    assert len(frames) == 10
    for frame in frames:
        np.testing.assert_array_equal(frame.luma, image_of(frame.index))
        assert frame.t_s == frame.index / 10


def test_numbers_that_jump_are_noted(tmp_path):
    video = open_video(write_pictures(tmp_path / "shots", [0, 1, 2, 5, 6, 7]), fps=10)
    assert "numbers jump from frame_2.png to frame_5.png" in video.warning
    assert open_video(write_pictures(tmp_path / "even", range(0, 30, 3)), fps=10).warning == ""


def test_hidden_files_in_a_folder_are_passed_over(tmp_path):
    write_pictures(tmp_path / "shots", range(3))
    (tmp_path / "shots" / "._frame_1.png").write_bytes(b"junk")
    (tmp_path / "shots" / "notes.txt").write_text("notes")
    assert len(times(tmp_path / "shots", fps=1)) == 3


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda p: write_pictures(p, range(2), "b{}.jpg"), "several kinds, 5 png and 2 mjpeg; leave one kind"),
        (lambda p: [file.unlink() for file in p.iterdir()], "is a folder without images .*it holds 0 other files"),
        (lambda p: written(p / "frame_0.png", b""), "none of its 5 images was read: frame_0.png is empty or damaged"),
        (lambda p: written(p / "frame_0.png", b"text"), "none of its 5 images was read: frame_0.png cannot be read"),
        (lambda p: written(p / "frame_0.png", png(30_000, 30_000)), "none of its 5 images was read"),
        (lambda p: written(p / "frame_0.png", png(20_000, 10)), "claims images of 20000x10 px|images was read"),
    ],
)
def test_folder_that_cannot_be_read_is_refused(tmp_path, spoil, message):
    spoil(write_pictures(tmp_path / "shots", range(5)))
    with pytest.raises(VideoError, match=message):
        open_video(tmp_path / "shots", fps=1)


def test_folder_with_a_video_but_no_images_names_the_video(tmp_path):
    write_clip(tmp_path / "a.mp4", 2)
    with pytest.raises(VideoError, match=r"without images .*; give the video in it: a\.mp4"):
        open_video(tmp_path)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "frame_3.png is empty or damaged"),
        (b"junk", "frame_3.png cannot be read"),
        (png(20, 10), "frame_3.png is 20x10 px, not 94x70 like the first|cannot be read|damaged"),
    ],
)
def test_damaged_image_ends_the_sequence(tmp_path, content, message):
    folder = write_pictures(tmp_path / "shots", range(6))
    written(folder / "frame_3.png", content)
    with pytest.raises(VideoError, match=message) as caught:
        times(folder, fps=1)
    assert "3 of 6 promised frames were read" in str(caught.value)
    assert len(times(folder, fps=1, keep_partial=True)) == 3


@pytest.mark.parametrize("suffix", ["png", "jpg", "tiff"])
def test_cut_off_image_is_damage(tmp_path, suffix):
    folder = write_pictures(tmp_path / "shots", range(3), "a{}." + suffix)
    cut_to(folder / f"a1.{suffix}", 0.6)
    with pytest.raises(VideoError, match=f"a1.{suffix} .*; 1 of 3 promised frames were read"):
        times(folder, fps=1)


# --------------------------------------------------------------------------- archives


def pack(path, members, **options):
    with zipfile.ZipFile(path, "w", **options) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return path


def clip_bytes(folder, count=5):
    return write_clip(folder / "packed.mp4", count).read_bytes()


def picture_bytes(folder, count=5):
    write_pictures(folder / "packed", range(count))
    return {f"shots/{file.name}": file.read_bytes() for file in (folder / "packed").iterdir()}


@pytest.mark.parametrize("name", ["a.zip", "a.trz", "A.ZIP"])
def test_video_in_an_archive_is_read(tmp_path, name):
    path = pack(
        tmp_path / name, {"videos/clip.mp4": clip_bytes(tmp_path), "thumb.png": b"", "__MACOSX/._clip.mp4": b""}
    )
    video = open_video(path)
    assert [frame.t_s for frame in video.frames()] == [k / 30 for k in range(5)]
    assert video.sha256 == hashlib.sha256(path.read_bytes()).hexdigest()


def test_images_in_an_archive_are_read(tmp_path):
    path = pack(tmp_path / "a.zip", picture_bytes(tmp_path, 12))
    frames = list(open_video(path, fps=2).frames())
    assert [frame.t_s for frame in frames] == [k / 2 for k in range(12)]
    for frame in frames:
        np.testing.assert_array_equal(frame.luma, image_of(frame.index))
    with pytest.raises(VideoError, match="give the frame rate"):
        open_video(path)


@pytest.mark.parametrize("name", ["../../evil.mp4", "/tmp/evil.mp4", "C:\\evil.mp4", "a/../../evil.mp4"])
def test_member_that_points_outside_is_unpacked_under_our_own_name(tmp_path, monkeypatch, name):
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    content = clip_bytes(tmp_path)
    video = open_video(pack(tmp_path / "a.zip", {name: content}))
    assert len(list(video.frames())) == 5
    assert [file.name for file in (tmp_path / "scratch").rglob("*.mp4")] == ["clip.mp4"]
    assert not list(tmp_path.parent.glob("evil*"))


def test_unpacked_video_goes_with_its_last_user(tmp_path, monkeypatch):
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    video = open_video(pack(tmp_path / "a.zip", {"clip.mp4": clip_bytes(tmp_path)}))
    frames = video.frames()
    del video
    assert len(list(frames)) == 5
    del frames
    gc.collect()
    assert not list((tmp_path / "scratch").iterdir())


def test_archive_that_fails_leaves_nothing_behind(tmp_path, monkeypatch):
    (tmp_path / "scratch").mkdir()
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path / "scratch"))
    with pytest.raises(VideoError, match=r"a.zip:clip.mp4 cannot be read as a video: it is a text file"):
        open_video(pack(tmp_path / "a.zip", {"clip.mp4": b"text"}))
    assert not list((tmp_path / "scratch").iterdir())


def bomb(path, name="clip.mp4"):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive, archive.open(name, "w") as member:
        for _ in range(120):
            member.write(bytes(2**20))
    return path


def blank_png(path):
    """A picture of 268 million pixels in a file of some kilobytes."""
    chunks = [(b"IHDR", struct.pack(">IIBBBBB", 16384, 16384, 1, 0, 0, 0, 0)), (b"IDAT", zlib.compress(bytes(2**20)))]
    written_out = (
        struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data)) for kind, data in chunks
    )
    return written(path, b"\x89PNG\r\n\x1a\n" + b"".join(written_out))


def damaged_lzma(path):
    with zipfile.ZipFile(path, "w", zipfile.ZIP_LZMA) as archive:
        archive.writestr("clip.mp4", bytes(range(256)) * 20)
    data = bytearray(path.read_bytes())
    data[60:140] = b"\xff" * 80
    return written(path, data)


def broken(path, content):
    """An archive whose member was changed after it was packed, so that its checksum is wrong."""
    data = bytearray(pack(path, {"clip.mp4": content}).read_bytes())
    data[data.index(b"clip.mp4") + 200] ^= 0xFF
    return written(path, data)


def encrypted(path, content):
    data = bytearray(pack(path, {"clip.mp4": content}).read_bytes())
    data[6] |= 1
    central = data.index(b"PK\x01\x02")
    data[central + 8] |= 1
    return written(path, data)


@pytest.mark.parametrize(
    ("made", "message"),
    [
        (lambda p: written(p / "a.zip", b"no zip"), "a.zip cannot be unpacked as an archive: File is not a zip file"),
        (lambda p: cut_to(pack(p / "a.zip", {"a.mp4": clip_bytes(p)}), 0.5), "cannot be unpacked as an archive"),
        (lambda p: broken(p / "a.zip", clip_bytes(p)), "cannot be unpacked as an archive: Bad CRC-32"),
        (lambda p: encrypted(p / "a.zip", clip_bytes(p)), "cannot be unpacked as an archive: .*encrypted"),
        (lambda p: bomb(p / "a.zip"), "claims 125829120 bytes unpacked from .*: more than a video can be"),
        (lambda p: bomb(p / "a.zip", "1.bmp"), "claims 125829120 bytes unpacked from .*; an image may have"),
        (lambda p: blank_png(p / "1.png").parent, "none of its 1 images was read: 1.png cannot be read"),
        (lambda p: damaged_lzma(p / "a.zip"), "cannot be unpacked as an archive: Corrupt input data"),
        (lambda p: pack(p / "a.zip", {}), "holds no video and no images"),
        (lambda p: pack(p / "a.zip", {"a.txt": b"x"}), "holds no video and no images"),
        (
            lambda p: pack(p / "a.zip", {"b.mp4": b"", "a.mp4": b""}),
            r"holds 2 videos; name one as FILE:NAME: a.mp4, b.mp4",
        ),
        (
            lambda p: pack(p / "a.zip", {"a/1.png": b"", "b/1.png": b""}),
            "images in 2 folders; it must hold one video",
        ),
        (lambda p: pack(p / "a.zip", {"a/1.png": b"x"}), "none of its 1 images was read"),
    ],
)
def test_archive_that_cannot_be_read_is_refused(tmp_path, made, message):
    with pytest.raises(VideoError, match=message) as caught:
        open_video(made(tmp_path), fps=1)
    assert "\n" not in str(caught.value)


def test_archive_with_several_videos_gives_the_one_its_tracker_project_names(tmp_path):
    path = pack(
        tmp_path / "a.trz",
        {"a.mp4": b"", "videos/b.mp4": clip_bytes(tmp_path), "a.trk": tracker_project("videos/b.mp4")},
    )
    assert len(times(path)) == 5


def test_archive_with_thumbnails_gives_the_images_its_tracker_project_names(tmp_path):
    members = picture_bytes(tmp_path) | {"thumb.png": b"", "a.trk": tracker_project("shots/frame_0.png")}
    assert len(times(pack(tmp_path / "a.trz", members), fps=1)) == 5


def tracker_project(video):
    values = {"xorigin": 1, "yorigin": 1, "angle": 0, "xscale": 9, "yscale": 9}
    numbers = "".join(f'<property name="{name}">{value}</property>' for name, value in values.items())
    return (
        '<object class="x.TrackerPanel"><property name="videoclip"><object class="VideoClip"><property name="video">'
        f'<object class="Video"><property name="path">{video}</property></object></property></object></property>'
        '<property name="coords"><object class="Coords"><property name="framedata"><property name="[0]">'
        f'<object class="FrameData">{numbers}</object></property></property></object></property></object>'
    )


# --------------------------------------------------------------------------- real recordings


@pytest.mark.parametrize(
    ("name", "count", "step"),
    [
        ("juangomez_pendulum/pendulum.mp4", 305, 4 / 119),
        ("iris_footage/pendulum.gif", 40, 0.1),
        ("iris_footage/Sliding_cone.gif", 43, 0.1),
        ("iris_footage/Two_Moving_Pendulums.gif", 55, 0.1),
        ("phystrack/Projectile_Motion__30Deg_2_726mps.MP4", 663, 1001 / 30000),
        ("phystrack/Projectile_Motion__60Deg_2_699mps.MP4", 579, 1001 / 30000),
        ("phystrack/SlidingFriction_R1.MP4", 505, 1001 / 30000),
        ("phystrack/SlidingFriction_R3.MP4", 634, 1001 / 30000),
        ("phystrack/CaromPuck_HeadOn.MP4", 752, 1001 / 30000),
        ("tracker_balltoss/BallToss.trz", 13, 0.066),
    ],
)
def test_real_clip_is_read_to_its_last_frame(name, count, step):
    video = open_video(recording(name))
    frames = list(video.frames())
    assert len(frames) == video.n_expected == video.decoded == count
    assert [frame.t_s for frame in frames] == pytest.approx(np.arange(count) * step, abs=1e-9)
    assert video.warning == ""
    assert len(video.sample(11)) == 11


def test_real_clip_agrees_with_opencv_in_time_and_image():
    path = recording("juangomez_pendulum/pendulum.mp4")
    by_opencv, images = read_by_opencv(path)
    frames = list(open_video(path).frames())
    assert [frame.t_s for frame in frames] == pytest.approx(by_opencv, abs=1e-6)
    assert np.abs(frames[200].bgr().astype(int) - images[200]).max() <= 3
