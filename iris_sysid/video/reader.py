"""Video files, GIFs, image sequences and archives as frames with the container's exact times.

Times are ``pts * time_base`` of each frame, as the file states them: an uneven rate stays uneven, and
the first frame keeps its own time, which need not be 0. Where all stamps are the times of an even rate, rounded
(whole milliseconds in Matroska), they get those times. Frames are decoded in order; an index or a
nominal rate is never used to guess a time. Reading is defensive: a name is never taken for a protocol
or a pattern, and the claims of a header are checked against the decoded frames.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Generator, Iterator, Mapping, Sequence
from contextlib import closing
from dataclasses import dataclass
from fractions import Fraction
from functools import cached_property, partial
from pathlib import Path
from typing import Protocol

import av

from iris_sysid.errors import VideoError
from iris_sysid.io.archives import member_of
from iris_sysid.io.files import sha256_of
from iris_sysid.types import Frame
from iris_sysid.video.container import DamageError, open_container
from iris_sysid.video.image_sequence import open_archive, open_folder
from iris_sysid.video.pixel_formats import Orientation, bgr_of, chroma_of, coding_of, luma_of

# Pixels that may be decoded to sample a clip: 30 frames of 3840x2160, 120 of 1920x1080
SAMPLING_PIXELS = 250_000_000
# Pixels of a sample that are held in memory, beyond 9 frames: 13 frames of 3840x2160, 53 of 1920x1080
HELD_PIXELS, HELD_FRAMES = 110_000_000, 9
# A background needs this many different moments, or a third of those asked for
MIN_KEY_FRAMES = 8
JUMP_S, JUMP = 60.0, 1000.0  # s, and intervals of frames: a longer step in time is damage, or two recordings in one
LONG_STEP = 1.75  # times the shortest step between frames: one may be missing
GOLDEN = (math.sqrt(5) - 1) / 2


class _Source(Protocol):
    """Where images come from: a container, a folder, an archive."""

    label: str
    width: int
    height: int
    orientation: Orientation
    time_base: Fraction | None
    rate: float | None
    first_s: float | None
    note: str

    @property
    def expected(self) -> int: ...
    @property
    def cut(self) -> str: ...
    @property
    def facts(self) -> Mapping[str, object]: ...
    def images(self) -> Generator[tuple[float | None, av.VideoFrame]]: ...
    def survey(self) -> list[tuple[int, bool]]: ...
    def seconds(self, stamp: int) -> float | None: ...
    def orientation_for(self, image: av.VideoFrame) -> Orientation: ...
    def pick(self, bursts: Sequence[tuple[int, Sequence[int]]]) -> Iterator[tuple[int, av.VideoFrame]]: ...
    def images_from(self, stamp: int) -> Generator[tuple[int, av.VideoFrame]]: ...


@dataclass(frozen=True, slots=True)
class _Clock:
    """The time of a frame, and the requested range of times (s, both ends included)."""

    fps: float | None
    start_s: float
    stop_s: float

    def time(self, index: int, seconds: float | None) -> float:
        """The frame's own time, or its number over the true frame rate where one was given."""
        if self.fps is not None:
            return index / self.fps
        if seconds is None:
            raise DamageError(f"frame {index} has no time; if all are there, give the frame rate (--fps)")
        return seconds

    def count(self, frames: int, rate: float | None, first_s: float) -> int:
        """Estimated number of requested frames out of all; 0 when unknown."""
        if self.start_s == -math.inf and self.stop_s == math.inf:
            return frames
        rate, first_s = (self.fps, 0.0) if self.fps else (rate, first_s)
        if not rate:
            return 0
        # 1e-6 of a frame: rounding of a time that was meant to be a frame's own
        low = max(0, math.ceil((max(self.start_s, first_s) - first_s) * rate - 1e-6))
        high = frames - 1 if self.stop_s == math.inf else math.floor((self.stop_s - first_s) * rate + 1e-6)
        return max(0, min(high, frames - 1) - low + 1)


@dataclass(slots=True)
class _OwnSteps:
    """Steps, s, between the file's own times where a frame rate is given: a long one may be a missing frame.

    ``rounding_s`` is the unit of the times; ``first_long`` the frame after the first long step, 0 where there is none.
    """

    rounding_s: float
    before_s: float = math.inf
    shortest_s: float = math.inf
    longest_s: float = 0.0
    first_long: int = 0

    def add(self, index: int, seconds: float) -> None:
        step_s = seconds - self.before_s
        self.before_s = seconds
        if not math.isfinite(step_s) or step_s <= 0:
            return
        self.shortest_s, self.longest_s = min(self.shortest_s, step_s), max(self.longest_s, step_s)
        if not self.first_long and self.longest_s > LONG_STEP * self.shortest_s + self.rounding_s:
            self.first_long = index

    def text(self) -> str:
        """The fault, in words."""
        return (
            f"the file's own times are uneven, {1e3 * self.shortest_s:.3g} to {1e3 * self.longest_s:.3g} ms a frame "
            f"(first at frame {self.first_long}); --fps counts frames: if one is missing, all times after it are early"
        )


class Video:
    """Frames of one clip, in order, with exact times; made by :func:`open_video`.

    Attributes
    ----------
    path
        The opened source.
    width, height
        Size in px as displayed, rotation applied.
    rotation_deg
        Clockwise rotation from the coded to the displayed image; it is applied to every frame.
    time_base
        The unit of the file's time stamps in s; None for images.
    rate
        The frame rate that the header states, 1/s, on average; None when it does not. No time is computed from it.
    facts
        ``format``, ``codec``, ``pixel_format``, ``luma_range``, ``transfer``, ``pixel_aspect`` of the file, and
        ``capture_rate``, 1/s, where a phone states the rate at which it recorded.
    decoded
        Frames of the file read in the latest pass, those outside the part that is wanted included.
    """

    def __init__(self, path: Path, source: _Source, clock: _Clock, keep_partial: bool) -> None:
        self.path = path
        self.width, self.height = source.width, source.height
        self.rotation_deg = source.orientation.rotation_deg
        self.time_base = source.time_base
        self.rate = source.rate
        self.facts = dict(source.facts)
        self.decoded = 0
        self._source = source
        self._clock = clock
        self._keep_partial = keep_partial
        self._damage = ""
        self._jump = ""
        self._repeated: list[int] = []
        self._uneven: _OwnSteps | None = None
        self._sampled: tuple[int, list[Frame]] | None = None

    def __repr__(self) -> str:
        return f"Video({str(self.path)!r}, {self.width}x{self.height} px, {self.n_expected} frames)"

    @property
    def n_expected(self) -> int:
        """Frames that the file promises, of the part that is wanted; by its duration if need be, 0 if unknown."""
        return self._clock.count(self._source.expected, self._source.rate, self._source.first_s or 0.0)

    @property
    def warning(self) -> str:
        """Faults found in the latest pass, as text; empty when there were none."""
        notes = [self._source.note, self._damage, self._jump]
        if self._source.cut and not self._damage:
            notes.append(f"{self._source.label} may lack its end: {self._source.cut}")
        if self._repeated:
            notes.append(
                f"{len(self._repeated)} frames were left out, each with the same time as the frame before it "
                f"(the first is frame {self._repeated[0]})"
            )
        if self._uneven is not None and self._uneven.first_long:
            notes.append(self._uneven.text())
        return "; ".join(filter(None, notes))

    @property
    def complete(self) -> bool:
        """Whether nothing in the file, as far as the latest pass went, says that a part of the clip is missing."""
        return not (self._damage or self._jump or self._source.cut)

    @cached_property
    def sha256(self) -> str:
        """SHA-256 of the file, or of the folder's names and files, computed on first access."""
        return sha256_of(self.path)

    def frames(self) -> Iterator[Frame]:
        """Decode the clip from its start and yield the requested frames, in display order.

        ``index`` is the number of the frame in the file, from 0. ``t_s`` is the frame's own time as the
        container has it, or ``index / fps``; it strictly increases: a frame with the same time as the one
        before is left out and counted in ``warning``. ``luma`` is read-only, may be kept, and is not a copy
        (see :func:`open_video`).

        Damage is noticed by reports of the decoder, by packets that are cut off, and by comparing the frames that
        came with what the index or the header promises. Bits changed within a frame's data are not always
        noticed, and a transport stream or bare stream that was cut promises nothing to compare with.

        Raises
        ------
        VideoError
            Where the file is damaged, times run backwards, or frames are missing at the end, unless
            ``keep_partial``: then the frames end there and ``warning`` says why. Also when a frame has no
            time, and when no frame lies in the requested part.
        """
        self._sampled = None
        for index, t_s, image in self._wanted():
            yield self._frame(index, t_s, image)

    def sample(self, count: int) -> list[Frame]:
        """About ``count`` frames spread evenly over the requested part, in order, for the background.

        A small clip is decoded once. Of a large one, only key frames and a few frames after each are
        decoded, where it has enough key frames: their moments are then even to about half the distance of
        key frames. At most ``count`` frames are held, fewer of a large clip: as many as 13 frames of 3840x2160, so
        that the length of a clip does not count. ``index`` and times are those of :meth:`frames`. The same number asked
        for again, before :meth:`frames` is read, gives the same frames without decoding them again.

        Raises
        ------
        VideoError
            When ``count`` is below 1, and as :meth:`frames` where all frames have to be decoded.
        """
        if count < 1:
            raise VideoError(f"{self._source.label}: {count} frames to sample; ask for at least 1")
        count = min(count, max(HELD_FRAMES, HELD_PIXELS // (self.width * self.height)))
        if self._sampled is None or self._sampled[0] != count:
            self._sampled = (count, self._sample(count))
        return list(self._sampled[1])

    @cached_property
    def frame_times(self) -> list[float]:
        """Time, s, of every frame of the file, without decoding one; [] where only decoding tells."""
        return [self._clock.time(k, self._source.seconds(stamp)) for k, (stamp, _) in enumerate(self._survey)]

    @cached_property
    def _survey(self) -> list[tuple[int, bool]]:
        """Stamp, and whether a key frame, of every frame; [] where two frames have the same stamp, or none has one."""
        survey = self._source.survey()
        return survey if len({stamp for stamp, _ in survey}) == len(survey) else []

    def frames_from(self, number: int) -> Iterator[Frame]:
        """The frames of the file from that number on, whatever part is wanted, without the checks of :meth:`frames`.

        Decoding starts at the key frame before it; at the first frame where only decoding tells the times. VideoError
        where the file is damaged.
        """
        try:
            if not self._survey:
                yield from (self._frame(*timed) for timed in self._timed() if timed[0] >= number)
                return
            stamps = [stamp for stamp, _ in self._survey]
            key = max((k for k, (_, is_key) in enumerate(self._survey[: number + 1]) if is_key), default=0)
            for stamp, image in self._source.images_from(stamps[key]):
                k = bisect_left(stamps, stamp, lo=key)
                if k >= number and k < len(stamps) and stamps[k] == stamp:
                    yield self._frame(k, self.frame_times[k], image)
        except DamageError as damage:
            raise VideoError(f"{self._source.label}: {damage}") from damage

    def _sample(self, count: int) -> list[Frame]:
        survey = self._source.survey()
        wanted = [k for k, (stamp, _) in enumerate(survey) if self._is_wanted(k, self._source.seconds(stamp))]
        if not wanted:
            return _thinned(self.frames(), count)
        keys = [k for k, (_, is_key) in enumerate(survey) if is_key and wanted[0] <= k <= wanted[-1]]
        affordable = SAMPLING_PIXELS // (self.width * self.height)
        if wanted[-1] < affordable or len(keys) < max(MIN_KEY_FRAMES, count // 3):
            chosen = {wanted[(2 * k + 1) * len(wanted) // (2 * count)] for k in range(count)}
            return [self._frame(*time) for time in self._wanted(max(chosen)) if time[0] in chosen]
        return self._sample_near_keys(survey, _near_keys(keys, wanted, count, affordable))

    def _sample_near_keys(self, survey: Sequence[tuple[int, bool]], near: Mapping[int, Sequence[int]]) -> list[Frame]:
        number = {stamp: k for k, (stamp, _) in enumerate(survey)}
        bursts = [(survey[key][0], [survey[k][0] for k in chosen]) for key, chosen in near.items()]
        times = {
            stamp: self._clock.time(number[stamp], self._source.seconds(stamp))
            for _, burst in bursts
            for stamp in burst
        }
        picked = self._source.pick(bursts)
        frames = [self._frame(number[stamp], times[stamp], image) for stamp, image in picked]
        return frames or _thinned(self.frames(), len(times))

    def _is_wanted(self, index: int, seconds: float | None) -> bool:
        return self._clock.start_s <= self._clock.time(index, seconds) <= self._clock.stop_s

    def _frame(self, index: int, t_s: float, image: av.VideoFrame) -> Frame:
        orientation = self._source.orientation_for(image)
        luma = luma_of(image, orientation)
        return Frame(
            index,
            t_s,
            luma,
            partial(bgr_of, image, orientation),
            partial(chroma_of, image, orientation),
            coding_of(image),
            bool(image.key_frame),
        )

    def _wanted(self, last: int | None = None) -> Iterator[tuple[int, float, av.VideoFrame]]:
        """Number, time and image of each requested frame, up to number ``last``."""
        self._damage, self._jump, self._repeated, self.decoded, found = "", "", [], 0, 0
        self._uneven = None if self._clock.fps is None else _OwnSteps(float(self.time_base or 0))
        t_s = -math.inf
        try:
            with closing(self._timed()) as timed:
                for index, t_s, image in timed:
                    if t_s > self._clock.stop_s or (last is not None and index > last):
                        break
                    if t_s >= self._clock.start_s:
                        found += 1
                        yield index, t_s, image
        except DamageError as damage:
            self._damage = self._said(str(damage))
            if not found:
                raise VideoError(f"{self._damage}, none of them in the part that is wanted") from damage
            if not self._keep_partial:
                raise VideoError(f"{self._damage}; to use what was read, keep it (--keep-partial)") from damage
        if not found:
            raise VideoError(
                f"{self._source.label}: no frame lies between {self._clock.start_s:g} s and {self._clock.stop_s:g} s; "
                f"{self.decoded} frames were read, up to {t_s:g} s"
            )

    def _timed(self) -> Generator[tuple[int, float, av.VideoFrame]]:
        """Number, time and image of every frame; times strictly increase."""
        before, shortest = -math.inf, math.inf
        with closing(self._source.images()) as images:
            for index, (seconds, image) in enumerate(images):
                self.decoded = index + 1
                if self._uneven is not None and seconds is not None:
                    self._uneven.add(index, seconds)
                t_s = self._clock.time(index, seconds)
                if t_s < before:
                    raise DamageError(f"times run backwards: {t_s:.6g} s in frame {index}, after {before:.6g} s")
                if t_s == before:
                    self._repeated.append(index)
                    continue
                if index and t_s - before > max(JUMP_S, JUMP * shortest):
                    self._jump = f"the time jumps from {before:.6g} s to {t_s:.6g} s in frame {index}"
                shortest = min(shortest, t_s - before)
                before = t_s
                yield index, t_s, image

    def _said(self, reason: str) -> str:
        expected = self._source.expected
        promised = f"{self.decoded} of {expected} promised frames were read"
        unknown = f"{self.decoded} frames were read, of a number that the file does not say"
        return f"{self._source.label}: {reason}; {promised if self.decoded < expected else unknown}"


def open_video(
    path: str | Path,
    *,
    fps: float | None = None,
    start_s: float | None = None,
    stop_s: float | None = None,
    keep_partial: bool = False,
) -> Video:
    """Open a clip: a video file, a GIF, a folder of images, or a ``.zip``/``.trz`` of these.

    ``luma`` of a frame is the plane as it is coded, without conversion or copy: 16-235 in limited range,
    0-255 in full range (``facts["luma_range"]`` says which), the upper 8 bits of deeper video. Images
    without such a plane (GIF, PNG) and turned ones are converted once. Images in a folder are taken in
    the natural order of their names; hidden files are passed over. A delay of 0 in a GIF is 0.1 s, as in browsers.

    Parameters
    ----------
    path
        A file, or a folder of images of one kind; ``archive.trz:NAME`` where an archive holds several clips.
    fps
        True frame rate in 1/s: the time of frame k of the file is then exactly k / fps. For slow motion,
        and for images, which carry no times.
    start_s, stop_s
        Only frames with start <= t <= stop are given, in s of the times that the frames get (with ``fps``:
        the overridden ones). The whole clip when None.
    keep_partial
        Let the frames of a damaged file end where it can no longer be read, instead of raising.

    Returns
    -------
    Video
        Frames are decoded on access, each time again.

    Raises
    ------
    VideoError
        When there is no such file; when it is not a video, is empty, holds no image that can be decoded, or
        claims images beyond 16384 px a side or 2^28 px; for images without ``fps``; for an archive that
        is damaged, encrypted, or too large; for a rate or times that make no sense.
    """
    path = Path(path)
    label = str(path).encode("utf-8", "replace").decode()
    clock = _clock(fps, start_s, stop_s, label)
    return Video(path, _open_source(path, label, fps), clock, keep_partial)


def _open_source(named: Path, label: str, fps: float | None) -> _Source:
    path, wanted = member_of(named)
    try:
        if path.is_dir():
            source: _Source = open_folder(path, label)
        elif not path.exists():
            raise VideoError(f"there is no file {label}")
        elif not path.is_file():
            raise VideoError(f"{label} is a device or pipe, not an ordinary file")
        elif path.suffix.lower() in (".zip", ".trz"):
            source = open_archive(path, label, wanted)
        else:
            source = open_container(path, label)
    except (OSError, ValueError) as error:  # ValueError: a NUL character in the name
        raise VideoError(f"cannot read {label}: {getattr(error, 'strerror', None) or error}") from error
    if fps is None and source.first_s is None:
        raise VideoError(f"{label} holds images without times; give the frame rate (--fps)")
    return source


def _clock(fps: float | None, start_s: float | None, stop_s: float | None, label: str) -> _Clock:
    if fps is not None and not (math.isfinite(fps) and fps > 0):
        raise VideoError(f"{label}: the frame rate must be above 0 and finite, not {fps} (--fps)")
    start, stop = -math.inf if start_s is None else start_s, math.inf if stop_s is None else stop_s
    if not start <= stop:
        raise VideoError(f"{label}: the part from {start} s to {stop} s is empty (--start, --stop)")
    return _Clock(fps, start, stop)


# --------------------------------------------------------------------------- choosing frames to sample


def _thinned(frames: Iterator[Frame], count: int) -> list[Frame]:
    """Every 1st, 2nd, 4th, ... frame of a clip of unknown length, so that at most ``count`` are held."""
    kept: list[Frame] = []
    stride = 1
    for position, frame in enumerate(frames):
        if position % stride:
            continue
        if len(kept) == count:
            kept, stride = kept[::2], 2 * stride
            if position % stride:
                continue
        kept.append(frame)
    return kept


def _near_keys(keys: Sequence[int], wanted: Sequence[int], count: int, affordable: int) -> dict[int, list[int]]:
    """Frames to decode after each key frame, so that about ``affordable`` frames have to be decoded in all.

    Moments are drawn one from each of ``count`` equal stretches, at positions that follow the golden ratio,
    so that they do not keep step with a motion that repeats. Each is then drawn towards the key frame
    before it.
    """
    ends = [*keys[1:], wanted[-1] + 1]
    depth = max(1, affordable // min(count, len(keys)))
    near: dict[int, list[int]] = {}
    key = 0
    for k in range(count):
        target = wanted[int((k + (k * GOLDEN) % 1) * len(wanted) / count)]
        while key + 1 < len(keys) and keys[key + 1] <= target:
            key += 1
        start, length = keys[key], ends[key] - keys[key]
        chosen = start + max(0, target - start) * min(depth, length) // length
        if chosen not in near.setdefault(start, []):
            near[start].append(chosen)
    return near
