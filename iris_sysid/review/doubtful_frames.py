"""The frames in which a track may be wrong, with the reason: what a review asks about, the most doubtful first.

A position is compared with the one that its neighbours foretell, a size and a standard error with those thereabouts,
a gap with its length, bodies with one another, and the fit with the data. None of these needs the truth, and none says
that the track is wrong: a person looks and says so.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from iris_sysid.review.corrected_tracks import doubts_of, edited_mask, in_frame_px
from iris_sysid.types import Array, DoubtKind, FitResult, Mask, Track, Trajectory, runs

MIN_GAP = 3  # frames: a shorter gap is bridged without harm
MIN_STRETCH, MAX_STRETCHES = 5, 6  # frames that a look is worth, and looks at a doubted track
EDGE_RADII = 2.0  # a body whose centre is nearer to the edge, and a step, may leave the image with the next frame
OFF_SCALES, OFF_RADII, OFF_PX = (
    8.0,
    0.6,
    2.0,
)  # a position off its neighbours' course by more than all three is doubtful
MAX_EXCURSION, SAME_SIZE = 60, 0.5  # frames; two leaps cancel each other to this share of their size
SIZE_RATIO = 1.4  # times the median radius thereabouts
SIGMA_RATIO, SIGMA_PX = 6.0, 0.5  # times the median standard error, and px at least
MEETING_RADII = 2.0  # nearer than this, names may have been exchanged
RESIDUAL_SCALES = 6.0  # robust standard deviations of the fit's residual
NEAR = 4  # frames: doubts of one body nearer to one another are one question
AROUND = 10  # frames to either side of one that its size is compared with
USUAL_RADIUS = 8.0  # px, where it is not known
MAD = 1.4826  # median absolute deviation to standard deviation, of a normal
MAX_QUESTIONS = 60


@dataclass(frozen=True, slots=True)
class FrameQuestion:
    """Frames ``first`` to ``last`` in which the track of a body is doubtful; ``frame`` is where to look first.

    ``reasons`` are the findings, the gravest first; ``severity`` orders questions, largest first.
    ``doubts`` are those of the whole track, where it asks about a stretch of a track that is doubted as a whole.
    ``answered`` says whether a person has corrected or confirmed it.
    """

    body: str
    frame: int
    first: int
    last: int
    reasons: tuple[str, ...]
    severity: float
    doubts: tuple[DoubtKind, ...] = ()
    answered: bool = False


def questions_of(
    tracks: Sequence[Track],
    fit: FitResult | None = None,
    trajectory: Trajectory | None = None,
    confirmed: Sequence[tuple[str, int, int]] = (),
    image_size: tuple[int, int] | None = None,
) -> list[FrameQuestion]:
    """The doubtful frames of all tracks, most doubtful first.

    Parameters
    ----------
    tracks
        One per body.
    fit, trajectory
        The latest fit of them, where there is one.
    confirmed
        Body, first and last frame of what a person found right.
    image_size
        Width and height of the images, px: a body that leaves them is not lost.
    """
    found = [question for track in tracks for question in _merged(_of_track(track, tracks, image_size))]
    if tracks and fit is not None and trajectory is not None and fit.usable:
        found += _merged(_of_residual(tracks[0], fit, trajectory))
    found = [question for question in found if question.severity > 0]
    found.sort(key=lambda question: -question.severity)
    by_body = {track.body: track for track in tracks}
    return [_with_answer(question, by_body[question.body], confirmed) for question in found[:MAX_QUESTIONS]]


def _of_track(track: Track, tracks: Sequence[Track], image_size: tuple[int, int] | None) -> Iterable[FrameQuestion]:
    yield from _lost(track, image_size)
    yield from _off_course(track)
    yield from _odd_size(track)
    yield from _uncertain(track)
    for other in tracks:
        if other is not track and track.body < other.body and np.array_equal(track.frame, other.frame):
            yield from _meeting(track, other)
    yield from _of_quality(track)


def _of_quality(track: Track) -> Iterable[FrameQuestion]:
    """Evidence against a whole track, once for each stretch in which it follows one object: one look tells there."""
    doubts = doubts_of(track)
    if not doubts:
        return
    findings, kinds = tuple(doubt.finding for doubt in doubts), tuple(doubt.kind for doubt in doubts)
    for start, stop in _stretches(track):
        found = start + np.flatnonzero(track.valid[start:stop])
        look = int(found[found.size // 2]) if found.size else start
        share = found.size / max(track.n_valid, 1)
        frame = track.frame
        yield FrameQuestion(
            track.body, int(frame[look]), int(frame[start]), int(frame[stop - 1]), findings, 3.0 + share, kinds
        )


def _stretches(track: Track) -> list[tuple[int, int]]:
    """Start and stop of the parts of a track between gaps and places off the course: they hold all of its frames."""
    cuts = [start for start, stop in runs(~track.valid) if start and stop - start >= MIN_GAP]
    cuts += [start for start, _ in _off_places(track)]
    ends, before = [], 0
    for cut in sorted(cuts):
        if cut - before >= MIN_STRETCH and track.valid.size - cut >= MIN_STRETCH:
            ends.append(cut)
            before = cut
    longest = sorted(sorted(ends, key=lambda cut: -_apart(cut, ends, track.valid.size))[: MAX_STRETCHES - 1])
    return list(zip([0, *longest], [*longest, track.valid.size], strict=True))


def _apart(cut: int, ends: Sequence[int], frames: int) -> int:
    """Frames between a cut and the nearest other, or the nearer end of the track."""
    return min(abs(cut - other) for other in (0, *ends, frames) if other != cut)


def _lost(track: Track, image_size: tuple[int, int] | None) -> Iterable[FrameQuestion]:
    """Runs of frames between others in which the body is neither found nor held, and has not left the image."""
    held = np.zeros(track.valid.size, np.bool_) if track.hand is None else track.hand
    found = np.flatnonzero(track.valid)
    if not found.size:
        return
    inside = np.zeros(track.valid.size, np.bool_)
    inside[found[0] : found[-1]] = True
    for start, stop in runs(~track.valid & ~held & inside):
        if stop - start >= MIN_GAP and not _out_of_image(track, start, stop, image_size):
            reason = f"body {track.body} is lost for {stop - start} frames"
            yield _question(track, start, stop, start, reason, 2.0 + min(stop - start, 100) / 100)


def _out_of_image(track: Track, start: int, stop: int, image_size: tuple[int, int] | None) -> bool:
    """Whether a body was at the edge of the image both before and after a gap, given how far it goes in a frame."""
    if image_size is None:
        return False
    xy = in_frame_px(track)
    steps = np.hypot(*np.diff(xy[track.valid], axis=0).T)
    reach = EDGE_RADII * _radius(track) + (float(np.quantile(steps, 0.9)) if steps.size else 0.0)
    ends = xy[[start - 1, stop]]
    inside = np.minimum(ends, np.array(image_size) - 1 - ends).min(axis=1)
    return bool((inside < reach).all())


def _off_course(track: Track) -> Iterable[FrameQuestion]:
    """Positions far from the cubic through their four neighbours."""
    off = _off_neighbours(track.xy_px, track.valid)
    limit = _off_limit(track, off)
    places = _off_places(track)
    excursions = list(_excursions(track, places))
    for start, stop in excursions:
        reason = f"body {track.body} is elsewhere for {stop - start} frames"
        yield _question(track, start, stop, start, reason, 7.0)
    for start, stop in places:
        if any(first <= stop and start <= last for first, last in excursions):
            continue
        worst = start + int(np.nanargmax(off[start:stop]))
        size = float(off[worst])
        reason = f"body {track.body} is {size:.0f} px off the course of its neighbours"
        yield _question(track, start, stop, worst, reason, 4.0 + min(size / limit, 20.0) / 10)


def _off_places(track: Track) -> list[tuple[int, int]]:
    """Start and stop of the runs of positions off the course of their neighbours."""
    off = _off_neighbours(track.xy_px, track.valid)
    return runs(np.isfinite(off) & (off > _off_limit(track, off)))


def _off_limit(track: Track, off: Array) -> float:
    """Distance, px, from the course of the neighbours above which a position is doubtful; infinite for few of them."""
    known = off[np.isfinite(off)]
    if known.size < 10:
        return np.inf
    return max(OFF_SCALES * MAD * float(np.median(known)), OFF_RADII * _radius(track), OFF_PX)


def _excursions(track: Track, places: Sequence[tuple[int, int]]) -> Iterable[tuple[int, int]]:
    """Start and stop of the frames between a leap and one back, at two successive places off the course."""
    leaps = _leaps(track.xy_px)
    before: tuple[int, Array] | None = None
    for start, stop in places:
        near = np.arange(max(0, start - 1), min(stop + 1, len(leaps)))
        sizes = np.hypot(*leaps[near].T)
        if not np.isfinite(sizes).any():
            continue
        at = int(near[int(np.nanargmax(sizes))])
        leap = leaps[at]
        if np.hypot(*np.nansum(leaps[near], axis=0)) < SAME_SIZE * np.nanmax(sizes):
            continue  # there and back within the place
        if before is not None and at - before[0] <= MAX_EXCURSION:
            sum_of_both = float(np.hypot(*(leap + before[1])))
            if sum_of_both < SAME_SIZE * max(float(np.hypot(*leap)), float(np.hypot(*before[1]))):
                yield before[0] + 1, at + 1
                before = None
                continue
        before = (at, leap)


def _leaps(xy: Array) -> Array:
    """What each step (n - 1, 2), px, is beyond the median of the two steps before and after it; positions (n, 2)."""
    steps = np.diff(xy, axis=0)
    padded = np.concatenate([np.full((2, 2), np.nan), steps, np.full((2, 2), np.nan)])
    around = np.stack([padded[k : k + len(steps)] for k in (0, 1, 3, 4)])
    known = np.isfinite(around).any(axis=0)
    usual = np.zeros_like(steps)
    usual[known] = np.nanmedian(around[:, known], axis=0)
    return np.asarray(steps - usual)


def _off_neighbours(xy: Array, valid: Mask) -> Array:
    """Distance (n,), px, of each position (n, 2) from the cubic through the two before and after; NaN at gaps."""
    position = np.where(valid[:, None], xy, np.nan)
    off = np.full(len(xy), np.nan)
    if len(xy) >= 5:
        foretold = (4 * (position[1:-3] + position[3:-1]) - position[:-4] - position[4:]) / 6
        off[2:-2] = np.hypot(*(position[2:-2] - foretold).T)
    return off


def _odd_size(track: Track) -> Iterable[FrameQuestion]:
    """Frames in which the apparent radius is not that of the frames around."""
    if track.radius_px is None:
        return
    radius = np.where(track.valid & (track.radius_px > 0), track.radius_px, np.nan)
    usual = _moving_median(radius)
    with np.errstate(invalid="ignore"):
        ratio = np.maximum(radius / usual, usual / radius)
    odd = (ratio > SIZE_RATIO) & (np.abs(radius - usual) > 1.0)
    for start, stop in runs(odd):
        worst = start + int(np.nanargmax(ratio[start:stop]))
        reason = f"body {track.body} appears {ratio[worst]:.1f} times larger or smaller than around it"
        yield _question(track, start, stop, worst, reason, 1.5 + min(float(ratio[worst]), 5.0) / 5)


def _uncertain(track: Track) -> Iterable[FrameQuestion]:
    """Frames in which the tracker itself knows the position badly."""
    sigma = np.where(track.valid & ~edited_mask(track), track.sigma_px.max(axis=1), np.nan)
    if not np.isfinite(sigma).any():
        return
    usual = float(np.nanmedian(sigma))
    for start, stop in runs(sigma > max(SIGMA_RATIO * usual, SIGMA_PX)):
        worst = start + int(np.nanargmax(sigma[start:stop]))
        reason = f"the tracker knows the position of body {track.body} to {sigma[worst]:.2g} px only"
        yield _question(track, start, stop, worst, reason, 1.0 + min(float(sigma[worst]) / usual, 50.0) / 50)


def _meeting(track: Track, other: Track) -> Iterable[FrameQuestion]:
    """Frames in which two bodies are so near that their names may be exchanged."""
    apart = np.hypot(*(track.xy_px - other.xy_px).T)
    reach = MEETING_RADII * max(_radius(track), _radius(other))
    for start, stop in runs(track.valid & other.valid & (apart < reach)):
        after = min(stop, track.frame.size - 1)
        reason = f"bodies {track.body} and {other.body} meet: are their names right afterwards?"
        yield _question(track, start, stop, after, reason, 2.5)


def _of_residual(track: Track, fit: FitResult, trajectory: Trajectory) -> Iterable[FrameQuestion]:
    """Frames in which the data are farthest from the fit, if far beyond its usual residual."""
    size = np.abs(fit.residual)
    used = fit.used & np.isfinite(size).all(axis=1)
    if used.sum() < 10:
        return
    scale = MAD * np.median(size[used], axis=0)
    ratio = np.where(used, (size / np.where(scale > 0, scale, np.inf)).max(axis=1), np.nan)
    for start, stop in runs(ratio > RESIDUAL_SCALES):
        worst = start + int(np.nanargmax(ratio[start:stop]))
        at = [int(np.argmin(np.abs(track.t_s - trajectory.t_s[k]))) for k in (start, stop - 1, worst)]
        reason = f"the data are {ratio[worst]:.0f} times the usual residual off the fit"
        yield _question(track, at[0], at[1] + 1, at[2], reason, 1.0 + min(float(ratio[worst]), 100.0) / 50)


def _question(track: Track, start: int, stop: int, worst: int, reason: str, severity: float) -> FrameQuestion:
    frame = track.frame
    return FrameQuestion(track.body, int(frame[worst]), int(frame[start]), int(frame[stop - 1]), (reason,), severity)


def _merged(questions: Iterable[FrameQuestion]) -> list[FrameQuestion]:
    """Questions about neighbouring frames of one body as one, with all reasons, the gravest first."""
    merged: list[FrameQuestion] = []
    for question in sorted(questions, key=lambda q: (q.doubts, q.first)):
        before = merged[-1] if merged else None
        if before is None or before.doubts or question.doubts or question.first - before.last > NEAR:
            merged.append(question)
            continue
        worse, milder = (question, before) if question.severity > before.severity else (before, question)
        merged[-1] = replace(
            worse,
            first=min(before.first, question.first),
            last=max(before.last, question.last),
            reasons=tuple(dict.fromkeys([*worse.reasons, *milder.reasons])),
        )
    return merged


def _with_answer(question: FrameQuestion, track: Track, confirmed: Sequence[tuple[str, int, int]]) -> FrameQuestion:
    inside = (track.frame >= question.first) & (track.frame <= question.last)
    corrected = bool(edited_mask(track)[inside].any()) and not question.doubts
    said = any(
        body == question.body and first <= question.first and question.last <= last for body, first, last in confirmed
    )
    return replace(question, answered=corrected or said)


def _radius(track: Track) -> float:
    if track.radius_px is None or not track.n_valid:
        return USUAL_RADIUS
    usual = np.nanmedian(track.radius_px[track.valid]) if np.isfinite(track.radius_px[track.valid]).any() else np.nan
    return float(usual) if np.isfinite(usual) else USUAL_RADIUS


def _moving_median(values: Array) -> Array:
    """The median (n,) of the values (n,) up to AROUND places before and after; their unit."""
    padded = np.concatenate([np.full(AROUND, np.nan), values, np.full(AROUND, np.nan)])
    windows = np.lib.stride_tricks.sliding_window_view(padded, 2 * AROUND + 1)
    some = np.isfinite(windows).any(axis=1)
    medians = np.full(len(values), np.nan)
    medians[some] = np.nanmedian(windows[some], axis=1)
    return medians
