"""One clip under review: its state and its log, the fit that follows, the tracker, and the files that are saved."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from itertools import count
from pathlib import Path
from threading import RLock, Thread
from typing import Any

import numpy as np

from iris_sysid.errors import DataError, IrisError, TrackingError, VideoError
from iris_sysid.io.archives import member_of
from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_track
from iris_sysid.io.files import sha256_of
from iris_sysid.pipeline import one_clip
from iris_sysid.review.corrected_tracks import Tracks, edited_mask, in_frame_px, passes
from iris_sysid.review.edits import BoardCorners, Edit, ScaleBar, Tracked
from iris_sysid.review.fit_process import fitted_apart
from iris_sysid.review.fit_queue import FitOutcome, FitQueue
from iris_sysid.review.history import History, ReviewState
from iris_sysid.review.log import LOG_NAME, Entry, LogWriter
from iris_sysid.review.preview import MAX_FRAMES, thinned
from iris_sysid.review.request import ReviewRequest
from iris_sysid.types import Run, Track, TrackMark, TrackOptions
from iris_sysid.video.empty_track import unfollowed
from iris_sysid.video.frame_access import FrameAccess
from iris_sysid.video.reader import Video, open_video

LONG = 5000  # frames; the fit of as many takes about as long as a process needs to start


class BehindError(IrisError):
    """A page that does not show the present version requested a change; ``version`` is the present one."""

    def __init__(self, version: int) -> None:
        super().__init__("another page has changed this review since; its state is loaded, then do it again")
        self.version = version


class ReplacedError(VideoError):
    """The clip on disk is not the one that the review was opened with."""


@dataclass(slots=True)
class Tracking:
    """What the tracker is doing: frames done of those expected, and why it failed; a message to a person."""

    running: bool = False
    done: int = 0
    expected: int = 0
    problem: str = ""
    stop: bool = False


class Session:
    """A review of one clip; its methods may be called from several threads.

    Attributes
    ----------
    clip
        The file of the clip.
    folder
        Where the log is, and where results are saved.
    frames
        The images of the clip.
    history
        The edits, and what can be undone.
    fits
        The fits of the states.
    tracking
        What the tracker is doing.
    saved_version
        The version that was saved last; None where none was.
    """

    def __init__(self, clip: Path, folder: Path, start: ReviewState) -> None:
        self.clip, self.folder = clip, folder
        self._log: LogWriter
        video = open_video(clip, fps=start.request.clip.fps, keep_partial=True)
        self._stamp = clip_stamp(clip)
        self.frames = FrameAccess(video)
        self.tracking = Tracking()
        self.saved_version: int | None = None
        self._lock = RLock()
        self._read: dict[str, Tracks] = {}
        self.history = History(start, self.tracks_in)
        self.fits = FitQueue(self._run_of, self._preview_of)

    # ----------------------------------------------------------------------- state

    @property
    def video(self) -> Video:
        """The clip whose frames are shown."""
        return self.frames.video

    @property
    def version(self) -> int:
        """Number of changes so far."""
        return self.history.version

    @property
    def state(self) -> ReviewState:
        """Tracks and request after the edits."""
        return self.history.state

    @property
    def scale_points(self) -> tuple[float, ...] | None:
        """The ends of the scale bar or the corners of the board that a person marked last, px; None without one."""
        marked = [edit for edit in self.history.edits if isinstance(edit, ScaleBar | BoardCorners)]
        if not marked:
            return None
        return marked[-1].ends if isinstance(marked[-1], ScaleBar) else marked[-1].corners

    @property
    def n_frames(self) -> int:
        """Number of frames of the clip."""
        tracks = self.state.tracks
        last = int(tracks[0].frame[-1]) + 1 if tracks else 0
        return len(self.video.frame_times) or max(self.video.n_expected, last)

    def record_in(self, log: LogWriter) -> None:
        """Write every later change to that ``log``."""
        self._log = log

    def replay(self, entry: Entry) -> None:
        """Take over an ``entry`` that the log holds already. DataError when it does not fit to those before."""
        self.history.made(entry, self.history.tried(entry))
        if entry.what == "save":
            self.saved_version = self.version

    def change(self, what: str, version: int, edit: Edit | None = None) -> int:
        """Make an edit, an ``undo`` or a ``redo``, once it is in the log; gives the new version.

        ``version`` is the one that the person saw: BehindError when there is a later one, ReplacedError when the clip
        was replaced, IrisError when the edit cannot be made, or the log cannot be written; nothing has changed then.
        """
        if isinstance(edit, Tracked):
            raise DataError("tracks come from the tracker: ask for tracking instead")
        with self._lock:
            if version != self.version:
                raise BehindError(self.version)
            return self._make(Entry(what, edit))

    def _make(self, entry: Entry) -> int:
        self.check_clip()
        state = self.history.tried(entry)
        self._log.add(entry, self.version + 1)
        self.history.made(entry, state)
        self.fits.ask(self.version, state)
        return self.version

    def check_clip(self) -> None:
        """ReplacedError when the clip on disk is no longer the one that was opened."""
        if clip_stamp(self.clip) != self._stamp:
            raise ReplacedError(f"{self.clip.name} was replaced or changed while it was open; start the review again")

    def jpeg(self, number: int, width: int | None = None) -> bytes:
        """The frame of that ``number`` as JPEG, at most ``width`` px wide.

        VideoError when there is no such frame, ReplacedError when the clip was replaced.
        """
        self.check_clip()
        return self.frames.jpeg(number, width)

    def tracks_in(self, file: str) -> Tracks:
        """The tracks in a ``file`` of the folder; DataError when it is not there or damaged."""
        if file not in self._read:
            self._read[file] = tuple(read_track(self.folder / file))
        return self._read[file]

    def keep_tracks(self, file: str, tracks: Sequence[Track]) -> None:
        """Say what the tracks in a ``file`` of the folder are, where they are at hand: it is not read then."""
        self._read[file] = tuple(tracks)

    # ----------------------------------------------------------------------- fit

    def _run_of(self, state: ReviewState, is_old: Callable[[], bool]) -> Run | None:
        """The run of a state; None where no phenomenon was chosen, or nothing tracked. That of a long clip ends early.

        AbandonedError when ``is_old`` said so.
        """
        bodies = self._bodies(state)
        fit = self._fit_of(state.request, bodies)
        if fit is None:
            return None
        if bodies[0].t_s.size < LONG:
            return fit(self._whole_video)
        return fitted_apart(fit, self._whole_video, is_old)

    def _preview_of(self, state: ReviewState) -> tuple[Run | None, int] | None:
        """The run of some frames of a long clip, and of how many each is one; None where all are as quick."""
        bodies = self._bodies(state)
        if not bodies or bodies[0].t_s.size <= MAX_FRAMES:
            return None
        some, every = thinned(bodies)
        fit = self._fit_of(state.request, some)
        return fit and fit(self._whole_video), max(every, 2)

    def _bodies(self, state: ReviewState) -> list[Track]:
        """The tracks that are fitted; none where no phenomenon was chosen."""
        phenomenon = state.request.phenomenon
        return [] if phenomenon is None else self.with_origin(state)[: max(1, phenomenon.bodies)]

    def _fit_of(self, request: ReviewRequest, bodies: Sequence[Track]) -> Callable[[Video], Run] | None:
        if request.phenomenon is None or not bodies:
            return None
        return partial(one_clip.run_tracked, tracks=bodies, request=request, source=self.clip)

    @cached_property
    def _whole_video(self) -> Video:
        """The clip for fits and figures; that of the page is in use by other threads."""
        return self._opened()

    def _opened(self) -> Video:
        return one_clip.open_clip(self.clip, self.state.request.clip)

    def with_origin(self, state: ReviewState) -> list[Track]:
        """The tracks of a ``state``, whose origin says what it was made of and what was done by hand."""
        options = state.request.recorded()
        return [
            replace(track, origin={**track.origin, "options": options, "review": _by_hand(track, state)})
            for track in state.tracks
        ]

    # ----------------------------------------------------------------------- tracking

    def track(self) -> None:
        """Have the tracker follow the bodies anew, in a thread; DataError where it is at work already."""
        with self._lock:
            if self.tracking.running:
                raise DataError("the tracker is at work already; wait for it, or stop it")
            self.check_clip()
            self.tracking = Tracking(running=True)
            Thread(target=self._track, name="tracker", daemon=True).start()

    def stop_tracking(self) -> None:
        """Have the tracker end at the next frame."""
        self.tracking.stop = True

    def _track(self) -> None:
        now = self.tracking
        try:
            self._add_tracks(self._followed())
        except IrisError as error:
            now.problem = str(error)
        except Exception as error:  # the page shows what happened; the thread has no other reader
            now.problem = f"unexpected {type(error).__name__}: {error}"
        finally:
            now.running = False

    def _followed(self) -> list[Track]:
        request, video = self.state.request, self._opened()
        options = replace(marked_all(request.track_options, self.state.tracks), progress=self._progress)
        try:
            tracks = followed(video, request, options)
        except TrackingError:
            nothing = None if self.tracking.stop or self.state.tracks else unfollowed(self.video)
            if nothing is not None:
                self._add_tracks(one_clip.from_source([nothing], self.clip, request.recorded()))
            raise
        return one_clip.from_source(tracks, self.clip, request.recorded(), complete=video.complete)

    def _progress(self, done: int, expected: int) -> None:
        self.tracking.done, self.tracking.expected = done, expected
        if self.tracking.stop:
            raise TrackingError("the tracker was stopped; the tracks are as they were")

    def _add_tracks(self, tracks: list[Track]) -> None:
        """Write tracks to a new file of the folder, and make them an edit."""
        with self._lock:
            file = self.new_track_file()
            write_track(tracks, self.folder / file)
            self.add_tracks_of(file)

    def add_tracks_of(self, file: str) -> None:
        """Make the tracks in a ``file`` of the folder an edit."""
        with self._lock:
            self._make(Entry("edit", Tracked(file=file)))

    def new_track_file(self) -> str:
        """The name of the next file of tracks."""
        numbers = [path.stem.rpartition("-")[2] for path in self.folder.glob("review-track-*.csv")]
        return f"review-track-{max((int(text) for text in numbers if text.isdecimal()), default=0) + 1}.csv"

    # ----------------------------------------------------------------------- save

    def save(self, version: int) -> list[str]:
        """Write the files of a run, of the version that the person saw; gives their names.

        Without a fit only the track is written.

        Parameters
        ----------
        version
            The version shown.

        Raises
        ------
        BehindError
            When there is a later version.
        IrisError
            When nothing was tracked, or a file cannot be written.
        """
        if version != self.version:
            raise BehindError(self.version)
        self.check_clip()
        outcome = self.fits.outcome(version, timeout_s=120.0, whole=True)
        with self._lock:
            if version != self.version:
                raise BehindError(self.version)
            names = self._write(outcome)
            self.mark_saved()
            return names

    def mark_saved(self) -> None:
        """Write in the log that the folder holds the results of this version."""
        self._log.add(Entry("save"), self.version)
        self.saved_version = self.version

    def _write(self, outcome: FitOutcome | None) -> list[str]:
        if outcome is not None and outcome.run is not None:
            one_clip.save(outcome.run, self.folder, overwrite=True)
            return list(one_clip.FILES)
        if not self.state.tracks:
            raise DataError("there is nothing to save: no body was tracked or placed")
        write_track(self.with_origin(self.state), self.folder / "track.csv", overwrite=True)
        return ["track.csv"]

    def close(self) -> None:
        """End the threads."""
        self.tracking.stop = True
        self.fits.close()
        self.frames.close()


def marked_all(options: TrackOptions, tracks: Sequence[Track]) -> TrackOptions:
    """The options with every body marked where some are, as the tracker needs it.

    The other bodies are marked where the tracks have them, in the frame nearest to the first mark.
    """
    named = {mark.body for mark in options.marks}
    others = [track for track in tracks if track.body not in named and track.n_valid]
    marks = list(options.marks)
    for track in others[: max(options.bodies - len(named), 0)] if marks else ():
        found = np.flatnonzero(track.valid)
        row = int(found[np.argmin(np.abs(track.frame[found] - options.marks[0].frame))])
        x_px, y_px = in_frame_px(track)[row].tolist()
        marks.append(TrackMark(track.body, x_px, y_px, int(track.frame[row])))
    return replace(options, marks=tuple(marks))


def followed(video: Video, request: ReviewRequest, options: TrackOptions) -> list[Track]:
    """The tracks of a request: what is to be ignored is followed like a body, and then left out.

    TrackingError when the bodies cannot be followed, or only what is to be ignored is found.
    """
    hands = _with_names(request.ignored)
    if not hands:
        return one_clip.track(video, request.tracker, options)
    marks = (*options.marks, *hands) if options.marks else ()
    more = replace(options, bodies=options.bodies + len({hand.body for hand in hands}), marks=marks)
    try:
        tracks = one_clip.track(video, request.tracker, more)
    except TrackingError:
        tracks = one_clip.track(video, request.tracker, options)  # the tracker finds fewer objects
    left = [track for track in tracks if not any(passes(track, hand) for hand in hands)]
    if not left:
        raise TrackingError("nothing was found but what is to be ignored; show the body in a frame or two")
    names = [track.body for track in left] if options.marks else map(str, count(1))
    return [replace(track, body=name) for track, name in zip(left[: options.bodies], names, strict=False)]


def _with_names(ignored: Sequence[TrackMark]) -> list[TrackMark]:
    """The marks of one object in several frames under one name; those in one frame are different objects."""
    seen: Counter[int] = Counter()
    named = []
    for mark in ignored:
        seen[mark.frame] += 1
        named.append(replace(mark, body=f"ignored {seen[mark.frame]}"))
    return named


def clip_stamp(clip: Path) -> tuple[int, ...]:
    """What tells one file from another of the same name: its number, size and time of change; all of a folder's."""
    path, _ = member_of(clip)
    try:
        files = sorted(path.iterdir()) if path.is_dir() else [path]
        stats = [file.stat() for file in files]
    except OSError as error:
        raise ReplacedError(f"{clip} can no longer be read ({error.strerror}); start the review again") from error
    return tuple(number for stat in stats for number in (stat.st_ino, stat.st_size, stat.st_mtime_ns))


def _by_hand(track: Track, state: ReviewState) -> dict[str, Any]:
    """What a person did to a track, for its origin."""
    edited = edited_mask(track)
    return {
        "log": LOG_NAME,
        "placed": int((edited & track.valid).sum()),
        "removed": int((edited & ~track.valid).sum()),
        "confirmed": [[first, last] for body, first, last in state.confirmed if body == track.body],
    }


def check_same_clip(clip: Path, origin: Mapping[str, Any]) -> None:
    """DataError when the ``clip`` is not the one that a track's ``origin`` names by its sha256."""
    stated = origin.get("sha256")
    if stated is not None and sha256_of(clip) != stated:
        raise DataError(f"{clip} is not the clip that was tracked: its sha256 differs; give that one with --clip")
