"""The benchmark's tensor format: as its own script writes it, read back with exact times, and never trusted."""

import json

import av
import cv2
import numpy as np
import pytest

from iris_sysid import open_video, track
from iris_sysid.errors import DataError, OutputError, VideoError
from iris_sysid.video.tensor_writer import write_tensor
from tests._drawn import disc, noisy, paint
from tests.conftest import SHAPE, WALL, write_video

FRAMES = 60


@pytest.fixture(scope="module")
def clip(tmp_path_factory):
    """A bright disc that moves 1.2 px a frame, 60 frames at 30 fps; its centres (n, 2) in px."""
    centres = np.column_stack([25 + 1.2 * np.arange(FRAMES), np.full(FRAMES, 48.0)])
    images = noisy([paint(WALL, disc(SHAPE, x, y, 9.0), 220.0) for x, y in centres], 1.0)
    return write_video(tmp_path_factory.mktemp("tensor") / "disc.mp4", images), centres


@pytest.fixture(scope="module")
def tensor(clip, tmp_path_factory):
    path = tmp_path_factory.mktemp("made") / "disc.npy"
    return path, write_tensor(open_video(clip[0]), path, frames=5, size=(64, 48))


def by_the_benchmarks_recipe(path, size, frames, step):
    """Resized, grey, over 255, one window a frame but for the last ``step``: as its video2npy.py does."""
    capture, images = cv2.VideoCapture(str(path)), []
    while (read := capture.read())[0]:
        images.append(cv2.cvtColor(cv2.resize(read[1], size), cv2.COLOR_BGR2GRAY) / 255.0)
    windows = len(images) - frames * step
    return np.array([np.stack(images[i : i + frames * step : step])[:, None] for i in range(windows)])


def test_tensor_is_the_one_that_the_benchmarks_recipe_makes(clip, tmp_path):
    write_tensor(open_video(clip[0]), tmp_path / "a.npy", frames=5, step=6, size=(64, 48))
    ours, theirs = np.load(tmp_path / "a.npy"), by_the_benchmarks_recipe(clip[0], (64, 48), 5, 6)
    assert ours.dtype == np.float32
    assert ours.shape == (36, 5, 1, 48, 64)
    assert theirs.shape == (30, 5, 1, 48, 64)  # it leaves out the last six windows
    assert np.max(np.abs(ours[:30] - theirs)) <= 1.01 / 255  # the decoders round colour differently by one level


def test_time_step_is_that_between_two_images_of_a_window(clip, tmp_path):
    document = write_tensor(open_video(clip[0]), tmp_path / "a.npy", frames=4, step=3)
    assert document.time_step_s == pytest.approx(3 / 30, abs=1e-12)
    assert document.time_step_spread_s == pytest.approx(0, abs=1e-12)
    assert json.loads((tmp_path / "a.npy.json").read_text())["origin"]["source"] == "disc.mp4"


def test_uneven_times_show_in_the_spread(tmp_path):
    path = tmp_path / "uneven.mkv"
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=1000)
        stream.width, stream.height, stream.pix_fmt = 64, 48, "yuv420p"
        for k in range(20):
            frame = av.VideoFrame.from_ndarray(np.full((48, 64, 3), 90 + k, np.uint8), format="rgb24")
            frame.pts = 20 * k + (10 if k > 10 else 0)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    document = write_tensor(open_video(path), tmp_path / "a.npy", frames=3, step=2, size=(16, 12))
    assert document.time_step_s == pytest.approx(0.040)
    assert document.time_step_spread_s == pytest.approx(0.010)


@pytest.mark.parametrize("stride", [1, 4, 7])
def test_reading_back_gives_every_frame_once_with_its_own_time(stride, clip, tmp_path):
    write_tensor(open_video(clip[0]), tmp_path / "a.npy", frames=5, step=2, stride=stride, size=(64, 48))
    known = {frame.t_s: frame for frame in open_video(clip[0]).frames()}
    read = list(open_video(tmp_path / "a.npy").frames())
    assert len(read) == len({frame.t_s for frame in read}) > 25
    for frame in read:
        grey = cv2.cvtColor(cv2.resize(known[frame.t_s].bgr(), (64, 48)), cv2.COLOR_BGR2GRAY)
        assert np.array_equal(frame.luma, grey)


def test_windows_without_the_file_beside_them_are_put_together_by_their_overlap(tensor, tmp_path):
    (tmp_path / "bare.npy").write_bytes(tensor[0].read_bytes())
    with pytest.raises(VideoError, match="without times; give the frame rate"):
        open_video(tmp_path / "bare.npy")
    bare, whole = open_video(tmp_path / "bare.npy", fps=30), open_video(tensor[0])
    for frame, other in zip(bare.frames(), whole.frames(), strict=True):
        assert frame.t_s == pytest.approx(other.t_s, abs=1e-9)
        assert np.array_equal(frame.luma, other.luma)
    assert "6 apart" in bare.warning


def test_windows_that_do_not_overlap_give_the_first_and_say_so(tmp_path):
    np.save(tmp_path / "apart.npy", np.random.default_rng(0).random((4, 10, 1, 8, 9)))
    clip = open_video(tmp_path / "apart.npy", fps=10)
    assert len(list(clip.frames())) == 10
    assert "only the first was read" in clip.warning


def test_tracking_a_tensor_finds_the_body_where_it_is(clip, tensor):
    centres = clip[1]
    body = track(open_video(tensor[0]), "median-background")[0]
    scale = np.array([SHAPE[1] / 64, SHAPE[0] / 48])
    error = (body.xy_px + 0.5) * scale - 0.5 - centres
    assert body.valid.mean() > 0.95
    assert np.sqrt(np.nanmean(error**2)) < 0.3  # px of the clip, of which one of the tensor has two


def test_colour_and_whole_levels_are_read_too(tmp_path):
    levels = np.zeros((1, 3, 3, 10, 12), np.uint8)
    levels[:, :, 0] = 200
    np.save(tmp_path / "red.npy", levels)
    frame = next(open_video(tmp_path / "red.npy", fps=10).frames())
    assert frame.bgr()[0, 0].tolist() == [0, 0, 200]


# --------------------------------------------------------------------------- files that are not what they should be


def header(shape: str, descr: str = "'<f4'") -> bytes:
    text = f"{{'descr': {descr}, 'fortran_order': False, 'shape': {shape}, }}".encode()
    text += b" " * (-(len(text) + 11) % 64) + b"\n"
    return b"\x93NUMPY\x01\x00" + len(text).to_bytes(2, "little") + text


GOOD = np.full((2, 3, 1, 8, 9), 0.5, np.float32)


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"", "no .npy file that can be read"),
        (b"PK\x03\x04 an archive", "no .npy file that can be read"),
        (header("(2, 3, 1, 8, 9"), "no .npy file that can be read"),
        (b"\x80\x04\x95 a pickle", "no .npy file that can be read"),
        (header("(2, 3, 1, 8, 9)", "'|O'"), "holds object"),
        (header("(2, 3, 1, 8, 9)", "'<c8'"), "holds complex64"),
        (header("(2, 3, 1, 8, 9)", "[('a', '<f4')]"), "which is no brightness"),
        (header("(2, 3, 1, 8, 9)"), "it is damaged"),
        (header("(3, 1, 8, 9)"), "a tensor is"),
        (header("(2, 3, 8, 9, 1)"), "a tensor is"),
        (header("(2, 3, 1, -8, -9)"), "a tensor is"),
        (header("(0, 3, 1, 8, 9)"), "a tensor is"),
        (header("(2, 3, 1, 99999999, 9)"), "claims images of 9x99999999"),
        (header("(99999999999, 3, 1, 8, 9)"), "more than any clip has"),
        (header("(1000000, 90000, 1, 8000, 9000)"), "its header promises"),
        (header("(" * 400 + "2" + ")" * 400), "no .npy file that can be read|a tensor is"),
        (header("__import__('os').abort()"), "no .npy file that can be read"),
        (b"\x93NUMPY\x03\x00" + header("(2, 3, 1, 8, 9)")[8:], "version"),
    ],
)
def test_a_file_that_is_no_tensor_is_refused(content, message, tmp_path):
    (tmp_path / "bad.npy").write_bytes(content)
    with pytest.raises(VideoError, match=message):
        open_video(tmp_path / "bad.npy", fps=60)


@pytest.mark.parametrize("value", [np.nan, np.inf, -0.5, 255.0])
def test_values_that_are_no_brightness_are_refused_with_their_position(value, tmp_path):
    bad = GOOD.copy()
    bad[0, 1, 0, 3, 3] = value
    np.save(tmp_path / "bad.npy", bad)
    with pytest.raises(VideoError, match=r"image 1 of window 0 has values from .* not from 0 to 1"):
        list(open_video(tmp_path / "bad.npy", fps=60).frames())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"shape": [2, 10, 1, 48, 64]}, "make the tensor again"),
        ({"step": 5}, "make the tensor again|holds"),
        ({"t_s": [0.0]}, "holds 1 times for"),
        ({"stride": 0}, "stride"),
        ({"t_s": ["soon"]}, "t_s"),
        ({"version": 2}, "another version"),
    ],
)
def test_a_file_beside_the_tensor_that_is_not_its_own_is_refused(change, message, tensor, tmp_path):
    (tmp_path / "a.npy").write_bytes(tensor[0].read_bytes())
    document = json.loads(tensor[0].with_name("disc.npy.json").read_text())
    (tmp_path / "a.npy.json").write_text(json.dumps(document | change))
    with pytest.raises(VideoError, match=message):
        open_video(tmp_path / "a.npy")


def test_a_step_that_the_images_contradict_is_refused(tensor, tmp_path):
    np.save(tmp_path / "a.npy", np.load(tensor[0])[:, ::-1])
    (tmp_path / "a.npy.json").write_bytes(tensor[0].with_name("disc.npy.json").read_bytes())
    with pytest.raises(VideoError, match="do not overlap as"):
        open_video(tmp_path / "a.npy")


def test_a_clip_shorter_than_a_window_is_refused(clip, tmp_path, nothing_written):
    nothing_written()
    with pytest.raises(DataError, match="31 frames; a window of 10, 6 apart, needs 55"):
        write_tensor(open_video(clip[0], stop_s=1.0), tmp_path / "a.npy")


def test_numbers_that_make_no_window_and_other_names_are_refused(clip, tmp_path):
    for options in ({"frames": 0}, {"step": 0}, {"stride": -1}):
        with pytest.raises(DataError, match="must be a whole number from 1"):
            write_tensor(open_video(clip[0]), tmp_path / "a.npy", **options)
    with pytest.raises(DataError, match=r"a tensor is a .npy file"):
        write_tensor(open_video(clip[0]), tmp_path / "a.csv")


def test_the_command_writes_both_files_and_the_same_bytes_again(cli, clip, tmp_path):
    outcome = cli("tensors", clip[0], "-o", tmp_path / "a.npy", "--frames", 4, "--step", 3, "--size", "20x16")
    assert outcome.status == 0, outcome.err
    assert "51x4x1x16x20, time step 0.1 s" in outcome.err
    first = (tmp_path / "a.npy").read_bytes(), (tmp_path / "a.npy.json").read_bytes()
    assert cli("tensors", clip[0], "-o", tmp_path / "a.npy").status == 1
    again = cli("tensors", clip[0], "-o", tmp_path / "a.npy", "--frames", 4, "--step", 3, "--size", "20x16", "--force")
    assert again.status == 0
    assert ((tmp_path / "a.npy").read_bytes(), (tmp_path / "a.npy.json").read_bytes()) == first


def test_an_existing_file_is_kept_before_any_frame_is_read(tensor, clip):
    before = tensor[0].read_bytes()
    with pytest.raises(OutputError, match="exists already"):
        write_tensor(open_video(clip[0]), tensor[0])
    assert tensor[0].read_bytes() == before
