"""Discs: centre and apparent radius of balls and round plates, by a model fitted to the pixels round them.

A first pass finds where bodies are: those that move before a still background, or, where these are few (a ball
that falls away from the camera does not move sideways, it gets smaller), circles that follow one another. Several
bodies of which one is missed, as where it hangs so long in one place that it became background, are followed at once.
A few frames teach the shading, the shutter and the noise. The second pass fits every frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import Frame, FrameSource, Track, Tracker, TrackOptions, part_of_progress, with_progress
from trackers._background.median import Background
from trackers._detection.detect_frames import Stage, observe, stage_of
from trackers._detection.detection import Glimpse
from trackers._disc.background import behind
from trackers._disc.circle_detection import course_of_circles
from trackers._disc.expected_position import Course, course_of
from trackers._disc.fit import DiscFit
from trackers._disc.impact_frames import struck_within
from trackers._disc.learn_appearance import Lesson, Workshop, taught
from trackers._frames.working_image import view_of
from trackers._linking.frame_to_frame import Path
from trackers._linking.select_bodies import follow, held_frames
from trackers._linking.to_track import error_model
from trackers._multi_body.track_together import together
from trackers._uncertainty.excess_scatter import with_scatter

WELL_SEEN = 0.8  # of the frames: where a body is found less often, it is looked for in another way as well
# by how much the autocorrelation of position errors at lag 1 is below that of the lobes, on synthetic clips: the fitted
# shading and blur absorb it
CORRELATION_ABSORBED = 0.25
REPORT_EVERY = 10  # frames between two calls of the progress function
EMPTY = (np.nan,) * 8
_Followed = tuple[list[Glimpse], list[Path], TrackingError | None]  # what frames show, paths, why there are none
PLANES = ("luma", "red difference", "blue difference")  # by Lesson.channel


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Fit a disc to each body in every frame; centre, radius, intensity and their standard errors.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    options
        ``bodies`` is the number to follow, ``roi`` limits the picture, ``colour`` limits the bodies to
        one colour, ``progress`` is called now and then.

    Returns
    -------
    list of Track
        ``radius_px`` and ``sigma_radius_px`` beside the position. Position and radius are those at the
        middle of the exposure, whose length is found from the motion. A frame in which no disc is seen is a gap.
        ``origin`` says what was found: ``shutter`` is the exposure over the time between frames.

    Raises
    ------
    TrackingError
        When nothing moves or changes its size, or what does is not round.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    stage = stage_of(video, view_of(video, options))
    rough = replace(stage, lens=replace(stage.lens, streaks=False))  # the second pass fits every disc
    glimpses = observe(video, rough, _first_half(options))
    if not glimpses:
        raise TrackingError("the clip gave no frames; is the part between --start and --stop empty?")
    glimpses, paths, refusal = _followed(video, stage, glimpses, options)
    workshop, paths = _workshop(video, stage, (glimpses, paths, refusal), options)
    fits: list[dict[int, DiscFit]] = [{} for _ in workshop.courses]
    second_half = part_of_progress(options.progress, 1, 2)
    for frame in with_progress(video.frames(), second_half, len(glimpses), every=REPORT_EVERY):
        picture = workshop.view.picture(frame)
        for body, found in enumerate(fits):
            fitted = workshop.fit(body, frame.index, picture)
            if fitted is not None:
                found[frame.index] = fitted
    if not all(fits):
        raise TrackingError(
            "what moves is not round: no disc could be fitted to it; use the tracker median-background, "
            "or limit the picture with --roi"
        )
    held = [held_frames(path, glimpses) for path in paths] or [set[int]()] * len(fits)
    return [
        _track_of(body, (fits[body], workshop.lessons[body]), glimpses, held[body], options)
        for body in range(len(fits))
    ]


def _first_half(options: TrackOptions) -> TrackOptions:
    """The options with progress reported as the first half of the work."""
    return replace(options, progress=part_of_progress(options.progress, 0, 2))


def _followed(video: FrameSource, stage: Stage, glimpses: list[Glimpse], options: TrackOptions) -> _Followed:
    """The bodies that move before the background, each followed for itself; all at once where that misses one."""
    paths: list[Path] = []
    refusal = None
    try:
        paths = follow(glimpses, options.bodies, float(np.hypot(stage.view.width, stage.view.height)))
    except TrackingError as found:
        refusal = found
    if options.bodies > 1 and options.colour is None and _least_seen(paths) < WELL_SEEN * len(glimpses):
        with suppress(TrackingError):
            others, joint, _ = together(video, stage.view, _first_half(options))
            if _least_seen(joint) > _least_seen(paths):
                return others, joint, None
    return glimpses, paths, refusal


def _least_seen(paths: Sequence[Path]) -> int:
    """Sightings of the body that has fewest; 0 where there is none."""
    return min((len(path.sightings) for path in paths), default=0)


def _workshop(
    video: FrameSource, stage: Stage, followed: _Followed, options: TrackOptions
) -> tuple[Workshop, list[Path]]:
    """The courses that fit the sampled frames best, ready to be fitted; and the paths they follow, if any."""
    glimpses, paths, refusal = followed
    frames = stage.stack.frames
    by_motion = _taught(stage, frames, [course_of(path, glimpses) for path in paths]) if paths else None
    if options.bodies > 1 or _least_seen(paths) >= WELL_SEEN * len(glimpses):
        if by_motion is None:
            raise refusal or TrackingError("nothing moves in the clip")
        return by_motion, paths
    course = course_of_circles(video, stage.view)
    by_circles = None if course is None else _taught(stage, frames, [course])
    if by_circles is None and by_motion is None:
        raise refusal or TrackingError("nothing in the clip moves or changes its size")
    if by_motion is None or (by_circles is not None and _shown(by_circles, frames) > _shown(by_motion, frames)):
        return by_circles, []  # type: ignore[return-value]  # one of the two is there
    return by_motion, paths


def _taught(stage: Stage, frames: Sequence[Frame], courses: Sequence[Course]) -> Workshop:
    """The workshop for some courses, in colour only where that shows a disc much better than luma does."""
    view, numbers = stage.view.with_chroma(), [frame.index for frame in frames]
    coloured = Background(replace(stage.stack, view=view), stage.lens.background.usable)
    workshop = taught(Workshop(view, behind(coloured, view, numbers, courses), courses), frames)
    if stage.view.chroma or any(lesson.channel for lesson in workshop.lessons.values()):
        return workshop
    known = behind(stage.lens.background, stage.view, numbers, courses)
    return replace(workshop, view=stage.view, behind=known)


def _shown(workshop: Workshop, frames: Sequence[Frame]) -> int:
    """In how many of some frames a disc is seen where it is expected."""
    return sum(workshop.fit(0, frame.index, workshop.view.picture(frame)) is not None for frame in frames)


def _origin(lesson: Lesson, options: TrackOptions) -> dict[str, object]:
    return {
        "tracker": TRACKER.name,
        "bodies": options.bodies,
        "roi": options.roi,
        "colour": options.colour,
        "plane": PLANES[lesson.channel],
        "shutter": lesson.shutter,
        "shading_terms": lesson.form.interior,
        "background_terms": lesson.form.exterior,
        "oval": lesson.form.oval,
        "known_background": lesson.form.known_background,
        "noise_correlated": lesson.correlation is not None,
    }


def _track_of(
    body: int,
    found: tuple[dict[int, DiscFit], Lesson],
    glimpses: Sequence[Glimpse],
    held: set[int],
    options: TrackOptions,
) -> Track:
    """The Track of one body; gaps are NaN."""
    fits, lesson = found
    rows = [_row(fits[glimpse.frame]) if glimpse.frame in fits else EMPTY for glimpse in glimpses]
    columns = np.array(rows, dtype=np.float64)
    hand = np.zeros(len(glimpses), dtype=np.bool_)
    hand[list(held)] = True
    t_s = np.array([glimpse.t_s for glimpse in glimpses])
    free = np.array([k for k, one in enumerate(glimpses) if one.frame in fits and not hand[k]], dtype=np.int64)
    lobes = np.array([fits[glimpses[k].frame].lobes for k in free])
    errors = error_model(free, columns[:, :2], columns[:, 4], lobes, CORRELATION_ABSORBED)
    sigma = np.column_stack([with_scatter(t_s, columns[:, axis], columns[:, axis + 2], errors) for axis in (0, 1)])
    return Track(
        t_s=t_s,
        xy_px=columns[:, 0:2],
        sigma_px=np.hypot(sigma, struck_within(t_s, columns[:, :2], sigma, lesson.shutter)),
        valid=np.isfinite(columns[:, 0]),
        frame=np.array([glimpse.frame for glimpse in glimpses]),
        body=str(body + 1),
        radius_px=columns[:, 4],
        sigma_radius_px=with_scatter(t_s, columns[:, 4], columns[:, 5], errors),
        intensity=columns[:, 6],
        area_px=columns[:, 7],
        hand=hand,
        origin=_origin(lesson, options),
        error_autocorrelation=errors.autocorrelation,
    )


def _row(fitted: DiscFit) -> tuple[float, ...]:
    disc = fitted.disc
    place = (disc.x, disc.y, disc.sigma_x, disc.sigma_y)
    return (*place, disc.radius, disc.sigma_radius, disc.intensity, np.pi * disc.radius**2)


TRACKER = Tracker(
    name="disc",
    summary="centre and apparent radius of round bodies, by a disc fitted to their pixels",
    track=track,
)
