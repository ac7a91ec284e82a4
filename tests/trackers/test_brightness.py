"""Lamps drawn with NumPy through each camera curve, written out here a second time: their decay is the light's."""

from dataclasses import replace

import av
import numpy as np
import pytest

from iris_sysid import TRACKERS, open_video, uncalibrated
from iris_sysid.errors import DataError, TrackingError
from iris_sysid.pipeline.one_clip import observe_and_fit
from iris_sysid.registry import PHENOMENA
from iris_sysid.types import Frame, PixelCoding, TrackOptions, Transfer
from tests._drawn import disc, paint

FPS, RATE, START_S = 60.0, 1.2, 0.5
SIZE = (120, 200)
ROWS, COLUMNS = np.mgrid[: SIZE[0], : SIZE[1]]
DISTANCE = np.hypot(COLUMNS - 83.3, ROWS - 57.8)
LAMP = 0.55 / (1 + np.exp((DISTANCE - 14) / 1.5)) + 0.08 * np.exp(-((DISTANCE / 16) ** 2))  # its light, 1 at white
AMBIENT = 0.03 + 0.05 * (COLUMNS / SIZE[1]) + 0.02 * np.sin(COLUMNS / 3.0) * np.sin(ROWS / 4.0)
CODES = {  # light to code, from the standards' formulas
    "bt709": lambda light: np.where(light < 0.018, 4.5 * light, 1.099 * light**0.45 - 0.099),
    "srgb": lambda light: np.where(light < 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055),
    "linear": lambda light: light,
    "gamma=2.2": lambda light: light ** (1 / 2.2),
    "gamma=2.8": lambda light: light ** (1 / 2.8),
    "hlg": lambda light: np.where(
        light <= 1 / 12,
        np.sqrt(3 * light),
        0.17883277 * np.log(np.maximum(12 * light - 0.28466892, 1e-9)) + 0.55991073,
    ),
    "pq": lambda light: (
        ((0.8359375 + 18.8515625 * (0.1 * light) ** 0.1593017578125) / (1 + 18.6875 * (0.1 * light) ** 0.1593017578125))
        ** 78.84375
    ),  # white is 1000 cd/m^2
}


class Filmed:
    """A FrameSource of codes (h, w) from 0 to 1, or (h, w, 3) red, green, blue, made into levels with noise."""

    width, height = SIZE[1], SIZE[0]

    def __init__(self, codes, *, tag="", limited=False, noise=1.5, seed=0):
        rng = np.random.default_rng(seed)
        self.coding = PixelCoding(transfer=tag, limited=limited)
        black, span = (16, 219) if limited else (0, 255)
        self.levels = [
            np.clip(np.rint(black + span * code + rng.normal(0, noise, code.shape)), 0, 255).astype(np.uint8)
            for code in codes
        ]
        self.n_expected = len(self.levels)

    def frames(self):
        return map(self._frame, range(len(self.levels)))

    def sample(self, count):
        return [self._frame(int(k)) for k in np.unique(np.linspace(0, len(self.levels) - 1, count).astype(int))]

    def _frame(self, k):
        levels = self.levels[k]
        if levels.ndim == 3:
            luma = np.rint(levels @ [0.299, 0.587, 0.114]).astype(np.uint8)
            return Frame(k, k / FPS, luma, lambda: levels[..., ::-1], coding=self.coding)
        grey = np.full(levels.shape, 128, np.uint8)
        return Frame(k, k / FPS, levels, self.refused, lambda: (grey, grey), self.coding)

    def refused(self):
        raise AssertionError("the planes are there")


def shining(seconds=4.0, rate=RATE):
    """Light (n,) over its full strength: constant, then fading."""
    t_s = np.arange(round(seconds * FPS)) / FPS
    return np.exp(-rate * np.maximum(t_s - START_S, 0.0))


def lamp(curve, seconds=4.0, strength=1.0, gain=None, room=None, **options):
    light = shining(seconds)
    gain, room = (np.ones(light.size) if one is None else one for one in (gain, room))
    images = [
        CODES[curve](np.clip(g * (strength * level * LAMP + r * AMBIENT), 0, 1))
        for level, g, r in zip(light, gain, room, strict=True)
    ]
    return Filmed(images, **options)


def tracked(clip, transfer=None):
    (track,) = TRACKERS["intensity"].track(clip, TrackOptions(transfer=transfer))
    return track


def decay(track):
    return observe_and_fit([track], uncalibrated(), PHENOMENA["led"], {})[2]


def doubts(track):
    return {doubt.kind for doubt in track.quality.doubts}


def exact(curve):
    name, _, gamma = curve.partition("=")
    return Transfer(name, float(gamma or 1), stderr=0.0)


@pytest.mark.parametrize("limited", [False, True])
@pytest.mark.parametrize("curve", CODES)
def test_decay_rate_is_that_of_the_light_for_every_curve_and_range(curve, limited):
    fit = decay(tracked(lamp(curve, limited=limited), exact(curve)))
    rate = fit.estimates["decay_rate"]
    assert rate.value == pytest.approx(RATE, rel=0.006)
    assert abs(rate.value - RATE) < 3 * rate.stderr


@pytest.mark.parametrize("curve", ["bt709", "srgb", "gamma=2.2"])
def test_curve_is_taken_from_the_tag_with_an_error_that_is_that_of_the_exponent(curve):
    track = tracked(lamp(curve, tag=curve))
    fit = decay(track)
    assert track.transfer.source == "tag"
    assert fit.estimates["decay_rate"].value == pytest.approx(RATE, rel=0.006)
    changed = replace(track, intensity=track.intensity**1.1, sigma_intensity=None)
    shift = decay(changed).estimates["decay_rate"].value - RATE
    assert fit.budget["decay_rate"]["transfer function"] == pytest.approx(shift, rel=0.3)
    assert "unknown-transfer" not in doubts(track)


@pytest.mark.parametrize("curve", ["bt709", "srgb", "gamma=2.2", "gamma=2.8"])
def test_untagged_clip_is_in_doubt_and_its_interval_holds_the_truth(curve):
    track = tracked(lamp(curve))
    low, high = decay(track).estimates["decay_rate"].interval
    assert doubts(track) == {"unknown-transfer"}
    assert low < RATE < high


@pytest.mark.parametrize("true", ["bt709", "srgb"])
def test_tag_of_another_video_curve_still_gives_an_interval_that_holds_the_truth(true):
    (tag,) = {"bt709", "srgb"} - {true}
    low, high = decay(tracked(lamp(true, tag=tag))).estimates["decay_rate"].interval
    assert low < RATE < high


def test_grey_levels_as_they_are_coded_fade_about_half_as_fast():
    fit = decay(tracked(lamp("gamma=2.2", noise=0.5), exact("linear")))
    assert fit.estimates["decay_rate"].value < 0.75 * RATE


def test_unknown_tag_is_refused_with_the_option_that_helps():
    with pytest.raises(DataError, match="--transfer"):
        tracked(lamp("bt709", tag="H.273 number 9"))


def test_pixels_cut_off_at_white_are_left_out_and_the_ring_around_them_tells_the_decay():
    track = tracked(lamp("srgb", strength=2.5), exact("srgb"))
    rate = decay(track).estimates["decay_rate"]
    assert track.origin["clipped"] > 0.2
    assert track.valid.all()
    assert rate.value == pytest.approx(RATE, rel=0.02)


def flat_lamp(strength):
    """A lamp of one brightness with a hard edge: where it is cut off, all of it is."""
    on = (DISTANCE < 14).astype(float)
    images = [CODES["srgb"](np.clip(strength * level * on + 0.05, 0, 1)) for level in shining()]
    return Filmed(images)


def test_frames_in_which_all_of_the_lamp_is_cut_off_are_gaps_that_are_told():
    track = tracked(flat_lamp(3.0), exact("srgb"))
    rate = decay(track).estimates["decay_rate"]
    cut = 3.0 * shining() + 0.05 > 1.0
    assert not track.valid[cut].any()
    assert track.valid[3.0 * shining() + 0.05 < 0.9].all()
    assert doubts(track) == {"saturated"}
    assert rate.value == pytest.approx(RATE, rel=0.02)


def test_lamp_cut_off_throughout_is_refused():
    with pytest.raises(TrackingError, match=r"cut off at white|nothing in the clip"):
        tracked(flat_lamp(400.0), exact("srgb"))


def test_red_lamp_is_undone_in_red_and_counts_as_cut_off_when_its_red_is():
    colour = np.array([1.0, 0.06, 0.02])
    images = [
        CODES["srgb"](np.clip(1.3 * level * LAMP[..., np.newaxis] * colour + AMBIENT[..., np.newaxis], 0, 1))
        for level in shining()
    ]
    track = tracked(Filmed(images), exact("srgb"))
    assert decay(track).estimates["decay_rate"].value == pytest.approx(RATE, rel=0.01)


def test_exposure_that_steps_up_is_divided_out_by_the_background_and_told():
    n = shining().size
    gain = np.interp(np.arange(n), [0, 90, 92, 150, 152, n], [1, 1, 1.25, 1.25, 1.6, 1.6])
    track = tracked(lamp("srgb", gain=gain), exact("srgb"))
    low, high = decay(track).estimates["decay_rate"].interval
    assert doubts(track) == {"exposure"}
    assert track.origin["exposure"] == "gain"
    assert decay(track).estimates["decay_rate"].value == pytest.approx(RATE, rel=0.03)
    assert low < RATE < high


def test_exposure_that_adapts_slowly_against_the_lamp_is_divided_out():
    gain = 1 + 0.5 * (1 - shining())
    track = tracked(lamp("srgb", gain=gain), exact("srgb"))
    assert decay(track).estimates["decay_rate"].value == pytest.approx(RATE, rel=0.03)
    assert doubts(track) == {"exposure"}


def test_room_light_that_beats_with_the_shutter_is_taken_out_of_the_lamp():
    beat = 1 + 0.3 * np.sin(2 * np.pi * 7.3 * np.arange(shining().size) / FPS)
    steady, flickers = (tracked(lamp("srgb", room=room, seed=3), exact("srgb")) for room in (None, beat))
    assert flickers.origin["exposure"] == "room light"
    np.testing.assert_allclose(flickers.intensity, steady.intensity, atol=0.004)


def test_lamp_that_lights_its_surroundings_is_no_change_of_exposure():
    light = shining()
    images = [CODES["srgb"](level * (LAMP + 0.03) + AMBIENT) for level in light]
    track = tracked(Filmed(images), exact("srgb"))
    assert doubts(track) == set()
    assert decay(track).estimates["decay_rate"].value == pytest.approx(RATE, rel=0.01)


def test_still_background_is_no_change_of_exposure():
    track = tracked(lamp("srgb"), exact("srgb"))
    assert track.origin["exposure"] == "none"
    assert doubts(track) == set()


# --------------------------------------------------------------------------- files


def film(path, images, *, transfer=1, range_=1, options=None, key_every=30, deep=False):
    """Codes (h, w) as H.264, 8 bits, of that range and tag; ``deep``: 10 bits, in the colours of BT.2020."""
    kind, sample, finer = ("yuv420p10le", np.uint16, 4) if deep else ("yuv420p", np.uint8, 1)
    with av.open(str(path), "w") as container:
        stream = container.add_stream("libx264", rate=60)
        stream.width, stream.height, stream.pix_fmt = SIZE[1], SIZE[0], kind
        context, matrix = stream.codec_context, 9 if deep else 1
        context.color_range, context.colorspace, context.color_trc, context.thread_count = range_, matrix, transfer, 1
        stream.options = options or {"qp": "0", "preset": "ultrafast", "bf": "0", "g": str(key_every)}
        black, span = (16, 219) if range_ == 1 else (0, 255)
        rng = np.random.default_rng(1)
        for k, code in enumerate(images):
            frame = av.VideoFrame(SIZE[1], SIZE[0], kind)
            levels = np.clip(
                np.rint(finer * (black + span * code + rng.normal(0, 1.5, code.shape))), 0, 256 * finer - 1
            )
            planes = (levels, *[np.full((SIZE[0] // 2, SIZE[1] // 2), 128 * finer)] * 2)
            for plane, values in zip(frame.planes, planes, strict=True):
                padded = np.zeros((plane.height, plane.line_size // sample().itemsize), sample)
                padded[:, : plane.width] = values
                plane.update(padded)
            frame.pts, frame.color_range = k, range_
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return path


TAGS = [
    (1, "bt709"),
    (6, "bt709"),
    (14, "bt709"),
    (13, "srgb"),
    (8, "linear"),
    (4, "gamma=2.2"),
    (5, "gamma=2.8"),
    (16, "pq"),
    (18, "hlg"),
    (2, ""),
    (9, "H.273 number 9"),
]


@pytest.mark.parametrize(("number", "name"), TAGS)
def test_transfer_function_is_read_from_the_file(tmp_path, number, name):
    clip = open_video(film(tmp_path / "clip.mp4", [np.full(SIZE, 0.5)] * 3, transfer=number))
    frames = list(clip.frames())
    assert [frame.coding.transfer for frame in frames] == [name] * 3
    assert clip.facts["transfer"] == (name or "not stated")
    assert [frame.key for frame in frames] == [True, False, False]


@pytest.mark.parametrize(("range_", "limited"), [(1, True), (2, False)])
def test_range_is_read_from_the_file_and_undone(tmp_path, range_, limited):
    images = [CODES["srgb"](level * LAMP + AMBIENT) for level in shining(2.0)]
    clip = open_video(film(tmp_path / "clip.mp4", images, transfer=13, range_=range_))
    assert next(clip.frames()).coding.limited is limited
    track = tracked(clip)
    inside = DISTANCE < 10
    assert track.intensity[0] < (LAMP + AMBIENT)[inside].max()
    assert decay(track).estimates["decay_rate"].value == pytest.approx(RATE, rel=0.02)


@pytest.mark.parametrize("seed", range(4))
def test_lag_of_compression_is_measured_at_key_frames_and_taken_out(tmp_path, seed):
    rate = 0.7 + 0.3 * seed
    images = [CODES["bt709"](level * LAMP + AMBIENT) for level in shining(5.0, rate)]
    options = {"crf": "27", "preset": "superfast", "bf": "0", "g": "40"}
    track = tracked(open_video(film(tmp_path / "clip.mp4", images, options=options)), exact("bt709"))
    low, high = decay(track).estimates["decay_rate"].interval
    assert track.origin["lag_grey"] > 0.2
    assert low < rate < high
    assert (high - low) / rate < 0.2


@pytest.mark.parametrize(("number", "curve"), [(16, "pq"), (18, "hlg")])
def test_lamp_of_a_ten_bit_hdr_clip_fades_as_its_light_does(tmp_path, number, curve):
    images = [CODES[curve](level * LAMP + AMBIENT) for level in shining()]
    clip = open_video(film(tmp_path / "clip.mp4", images, transfer=number, deep=True))
    coding = next(clip.frames()).coding
    assert (coding.transfer, coding.limited, coding.matrix, coding.lost_bits) == (curve, True, "bt2020", 2)
    rate = decay(tracked(clip)).estimates["decay_rate"]
    assert rate.value == pytest.approx(RATE, rel=0.006)
    assert abs(rate.value - RATE) < 3 * rate.stderr


@pytest.mark.parametrize("curve", ["bt709", "pq", "hlg"])
def test_disc_is_in_its_place_whatever_curve_codes_it_and_seems_larger_where_it_is_brighter(tmp_path, curve):
    path = np.column_stack([100 + 60 * np.cos(0.11 * np.arange(40)), 60 + 30 * np.sin(0.17 * np.arange(40))])
    lights = [paint(np.full(SIZE, 0.02), disc(SIZE, *at, 12.0), 0.35) for at in path]
    numbers = {"bt709": 1, "pq": 16, "hlg": 18}
    images = [CODES[curve](light) for light in lights]
    video = open_video(film(tmp_path / "clip.mp4", images, transfer=numbers[curve], deep=curve != "bt709"))
    (track,) = TRACKERS["median-background"].track(video, TrackOptions())
    error = track.xy_px - path
    assert np.abs(error).max() < 0.05
    assert 0.7 < (error / track.sigma_px).std() < 1.4
    assert 0.08 < np.median(track.radius_px) - 12.0 < 0.25  # codes of mixed light are nearer to white
