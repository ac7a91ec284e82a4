"""Interlaced clips: two moments in alternate rows, of which one is kept."""

import av
import numpy as np
import pytest

from iris_sysid.registry import TRACKERS
from iris_sysid.types import TrackOptions
from iris_sysid.video.reader import open_video
from tests._drawn import moving_disc, swing

SIZE, FRAMES = (96, 160), 40


def fields(path):
    """Images (h, w) whose even rows show the odd-numbered moments of a path (2 n, 2), odd rows the others."""
    moments = list(moving_disc(path, 9, SIZE).frames())
    woven = [moments[2 * k].luma.copy() for k in range(len(path) // 2)]
    for k, image in enumerate(woven):
        image[1::2] = moments[2 * k + 1].luma[1::2]
    return woven


def write(path, images, options):
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=30, options={"qp": "0", **options})
        stream.width, stream.height, stream.pix_fmt = SIZE[1], SIZE[0], "yuv420p"
        for image in images:
            # samples as they are: a conversion would scale grey levels to the limited range
            frame = av.VideoFrame(SIZE[1], SIZE[0], "yuv420p")
            for plane, level in zip(frame.planes, (image, 128, 128), strict=True):
                rows = np.zeros((plane.height, plane.line_size), np.uint8)
                rows[:, : plane.width] = level
                plane.update(rows)
            container.mux(stream.encode(frame))
        container.mux(stream.encode())
    return path


@pytest.fixture(scope="module")
def swinging():
    return swing(2 * FRAMES, (80, 48), (50, 24), period=90.0)


@pytest.mark.parametrize("tracker", ["disc", "median-background"])
def test_disc_of_an_interlaced_clip_is_where_its_upper_field_has_it(tmp_path, swinging, tracker):
    clip = open_video(write(tmp_path / "a.mp4", fields(swinging), {"x264-params": "interlaced=1"}))
    (track,) = TRACKERS[tracker].track(clip, TrackOptions())
    assert track.n_valid >= 0.9 * FRAMES
    error = (track.xy_px - swinging[::2])[track.valid]
    across, down = np.sqrt(np.mean(error**2, axis=0))
    assert across < 0.03  # 0.25 by disc with both moments in one image
    assert down < 0.1  # half of the rows: an outline that no lens blurs is sampled too coarsely
    assert (error / track.sigma_px[track.valid]).std(axis=0).max() < 2.0  # 25 and more


def test_rows_between_are_interpolated_only_where_the_clip_says_that_it_is_interlaced(tmp_path, swinging):
    images = fields(swinging)[:3]
    plain = next(open_video(write(tmp_path / "p.mp4", images, {})).frames())
    np.testing.assert_array_equal(plain.luma, images[0])
    woven = next(open_video(write(tmp_path / "i.mp4", images, {"x264-params": "interlaced=1"})).frames())
    np.testing.assert_array_equal(woven.luma[::2], images[0][::2])
    rows = images[0][::2].astype(float)
    np.testing.assert_allclose(woven.luma[1:-1:2], (rows[:-1] + rows[1:]) / 2, atol=0.5)
    np.testing.assert_array_equal(woven.luma[-1], images[0][-2])
    assert woven.bgr().shape == (*SIZE, 3)
    np.testing.assert_array_equal(woven.bgr()[-1], woven.bgr()[-2])
