"""Discs: centre and apparent radius of balls and round plates, by a model fitted to the pixels round them.

A first pass finds where bodies are: those that move before a still background, or, where these are few (a ball
that falls away from the camera does not move sideways, it gets smaller), circles that follow each other. Where this
misses one of several bodies, e.g. one that rests until it becomes background, all of them are tracked together.
Shading, shutter and noise are learned from a few frames. The second pass fits every frame.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial

import numpy as np

from iris_sysid.errors import TrackingError
from iris_sysid.types import RADIUS_ERRORS, FrameSource, Track, Tracker, TrackOptions, part_of_progress, with_progress
from trackers._auto.scene import SampledScene
from trackers._auto.verdict import judged
from trackers._background.median import Background
from trackers._detection.detect_frames import SAMPLES, DetectionSetup, detection_setup, observe
from trackers._detection.detection import FrameDetections
from trackers._disc.background import background_without_discs
from trackers._disc.circle_detection import path_of_circles
from trackers._disc.expected_position import ExpectedPath, expected_path_of
from trackers._disc.fit import SeenDisc
from trackers._disc.impact_frames import impact_exposure_error
from trackers._disc.learn_appearance import DiscAppearance, DiscFitter, with_learned_appearance
from trackers._disc.receding_disc import receding_disc
from trackers._frames.ahead import ahead
from trackers._frames.working_image import view_of
from trackers._linking.likely_bodies import LikelyBodies, all_measured
from trackers._linking.select_bodies import held_frames, link_bodies
from trackers._linking.to_track import error_model
from trackers._multi_body.track_together import track_together
from trackers._tracklets.frame_to_frame import Tracklet
from trackers._uncertainty.excess_scatter import with_scatter

MIN_SEEN = 0.8  # of the frames: a body found in fewer frames is also searched by another method
# by how much the autocorrelation of position errors at lag 1 is below that of the lobes, on synthetic clips: the fitted
# shading and blur absorb it
CORRELATION_ABSORBED = 0.25
# errors of the radius over those of the centre: of an outline whose errors at each angle are independent
RADIUS_OF_CENTRE = np.sqrt(0.5)
MAX_BLOB_RADIUS = (
    0.1  # of the image's diagonal, radius: a larger object, e.g. a hand, is measured only once it is the body
)
REPORT_EVERY = 10  # frames between two calls of the progress function
EMPTY = (np.nan,) * 8
LinkedBodies = tuple[
    list[FrameDetections], list[Tracklet], TrackingError | None
]  # detections of each frame, tracklets, reason for their absence
PLANES = ("luma", "red difference", "blue difference")  # by DiscAppearance.channel


def track(video: FrameSource, options: TrackOptions) -> list[Track]:
    """Fit a disc to each body in every frame; centre, radius, intensity and their standard errors.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    options
        ``bodies`` is the number to follow, ``roi`` limits the image, ``colour`` limits the bodies to
        one colour, ``progress`` is called every ten frames.

    Returns
    -------
    list of Track
        ``radius_px`` and ``sigma_radius_px`` beside the position. Position and radius are those at the
        middle of the exposure, whose length is found from the motion. A frame in which no disc is seen is a gap.
        ``origin`` holds estimates: ``shutter`` is the exposure over the time between frames.

    Raises
    ------
    TrackingError
        When nothing moves or changes its size, or the moving body is not round.
    DataError, UnknownNameError
        When the options do not fit the clip, or name an unknown colour.
    """
    setup = detection_setup(video, view_of(video, options), coarse=True)
    detector = replace(setup.detector, streaks=False, refined=False)  # the second pass fits every disc
    rough = replace(setup, detector=detector)
    diagonal = float(np.hypot(setup.view.width, setup.view.height))
    likely = LikelyBodies(options.bodies, diagonal)

    def among(seen: FrameDetections) -> list[bool]:
        chosen = zip(likely.among(seen), seen.detections, strict=True)
        return [meant and detection.radius < MAX_BLOB_RADIUS * diagonal for meant, detection in chosen]

    all_detections = observe(video, rough, _first_half(options), among)
    all_detections, tracklets, refusal = _linked(video, setup, all_detections, options)
    fitter, tracklets = _best_fitter(video, rough, (all_detections, tracklets, refusal), options)
    fits: list[dict[int, SeenDisc]] = [{} for _ in fitter.expected_paths]
    second_half = part_of_progress(options.progress, 1, 2)
    frames = with_progress(video.frames(), second_half, len(all_detections), every=REPORT_EVERY)
    for number, discs in ahead(fitter.seen, frames):
        for body_fits, disc in zip(fits, discs, strict=True):
            if disc is not None:
                body_fits[number] = disc
    if not all(fits):
        raise TrackingError(
            "the moving body is not round: no disc fits it; use the tracker median-background, or restrict the region "
            "with --roi"
        )
    held = [held_frames(tracklet, all_detections) for tracklet in tracklets] or [set[int]()] * len(fits)
    tracks = [
        _track_of(body, (fits[body], fitter.appearances[body]), all_detections, held[body], options)
        for body in range(len(fits))
    ]
    scene = SampledScene(fitter.view, setup.stack.frames, setup.still)
    others = [[other for other in tracks if other is not track] for track in tracks]
    return [replace(track, quality=judged(track, scene, rest)) for track, rest in zip(tracks, others, strict=True)]


def _first_half(options: TrackOptions) -> TrackOptions:
    """The options with progress reported as the first half of the work."""
    return replace(options, progress=part_of_progress(options.progress, 0, 2))


def _linked(
    video: FrameSource, setup: DetectionSetup, all_detections: list[FrameDetections], options: TrackOptions
) -> LinkedBodies:
    """The bodies that move before the background, each followed for itself; all at once where that misses one."""
    tracklets: list[Tracklet] = []
    refusal = None
    try:
        tracklets = link_bodies(all_detections, options.bodies, float(np.hypot(setup.view.width, setup.view.height)))
    except TrackingError as found:
        refusal = found
    if options.bodies > 1 and options.colour is None and _least_seen(tracklets) < MIN_SEEN * len(all_detections):
        with suppress(TrackingError):
            others, joint, _ = track_together(video, view_of(video, options), _first_half(options))
            if _least_seen(joint) > _least_seen(tracklets):
                return others, joint, None
    return all_detections, tracklets, refusal


def _least_seen(tracklets: Sequence[Tracklet]) -> int:
    """Number of detections of the body that has fewest; 0 where there is none."""
    return min((len(tracklet.detections) for tracklet in tracklets), default=0)


def _best_fitter(
    video: FrameSource, setup: DetectionSetup, followed: LinkedBodies, options: TrackOptions
) -> tuple[DiscFitter, list[Tracklet]]:
    """The paths that fit the sampled frames best, ready to be fitted; and the tracklets they follow, if any.

    One body that is not seen to move in most frames is also searched as a circle. How it looks is learned for the
    better path alone: a hand is large, no disc, and would take the longest.
    """
    all_detections, tracklets, refusal = followed
    if options.bodies == 1 and _least_seen(tracklets) < MIN_SEEN * len(all_detections):
        expected_path = path_of_circles(video, setup.view)
        circling = None if expected_path is None else _fitter_for(setup, [expected_path])
        moving = [expected_path_of(tracklet, all_detections) for tracklet in tracklets]
        if circling and (not moving or _shows_more(setup, circling, _fitter_for(setup, moving))):
            return _learned(circling, setup), []
    if not tracklets:
        raise refusal or TrackingError("nothing in the clip moves or changes its size")
    tracklets = all_measured(video, setup, tracklets)
    moving = [expected_path_of(tracklet, all_detections) for tracklet in tracklets]
    return _learned(_fitter_for(setup, moving), setup), tracklets


def _fitter_for(setup: DetectionSetup, expected_paths: Sequence[ExpectedPath]) -> DiscFitter:
    """The fitter for some paths, in colour, before it is known how their bodies look."""
    view = setup.view.with_chroma()
    background = Background(replace(setup.stack, view=view), setup.detector.background.usable)
    return DiscFitter(view, background_without_discs(background, view, setup.numbers, expected_paths), expected_paths)


def _learned(fitter: DiscFitter, setup: DetectionSetup) -> DiscFitter:
    """The fitter that knows how its bodies look; in colour only where that shows a disc much better than luma does."""
    fitter = with_learned_appearance(fitter, setup.stack.frames)
    if setup.view.chroma or any(appearance.channel for appearance in fitter.appearances.values()):
        return fitter
    known = background_without_discs(setup.detector.background, setup.view, setup.numbers, fitter.expected_paths)
    return replace(fitter, view=setup.view, background=known)


def _shows_more(setup: DetectionSetup, fitter: DiscFitter, other: DiscFitter) -> bool:
    """Whether a disc is seen on the path of one fitter in more of the sampled frames than on that of the other."""
    frames = setup.stack.frames
    seen = sum(ahead(partial(fitter.shows_plain, 0), frames))
    expected = sum(frame.index in other.expected_paths[0].discs for frame in frames)
    return seen > expected or seen > sum(ahead(partial(other.shows_plain, 0), frames))


def _origin(appearance: DiscAppearance, options: TrackOptions) -> dict[str, object]:
    return {
        "tracker": TRACKER.name,
        "bodies": options.bodies,
        "roi": options.roi,
        "colour": options.colour,
        "plane": PLANES[appearance.channel],
        "shutter": appearance.shutter,
        "shading_terms": appearance.form.interior,
        "background_terms": appearance.form.exterior,
        "oval": appearance.form.oval,
        "known_background": appearance.form.known_background,
        "noise_correlated": appearance.correlation is not None,
    }


def _track_of(
    body: int,
    fits_and_appearance: tuple[dict[int, SeenDisc], DiscAppearance],
    all_detections: Sequence[FrameDetections],
    held: set[int],
    options: TrackOptions,
) -> Track:
    """The Track of one body; gaps are NaN."""
    fits, appearance = fits_and_appearance
    rows = [
        _row(fits[frame_detections.frame]) if frame_detections.frame in fits else EMPTY
        for frame_detections in all_detections
    ]
    columns = np.array(rows, dtype=np.float64)
    hand = np.zeros(len(all_detections), dtype=np.bool_)
    hand[list(held)] = True
    t_s = np.array([frame_detections.t_s for frame_detections in all_detections])
    free = np.array(
        [k for k, frame_detections in enumerate(all_detections) if frame_detections.frame in fits and not hand[k]],
        dtype=np.int64,
    )
    lobes = np.array([fits[all_detections[k].frame].lobes for k in free])
    noise = np.array([fits[all_detections[k].frame].sigma_lobe for k in free])
    noise_px = float(np.sqrt(np.mean(noise**2))) if noise.size else None
    errors = error_model(free, columns[:, :2], columns[:, 4], lobes, CORRELATION_ABSORBED, noise_px)
    of_radius = replace(errors, outline_px=RADIUS_OF_CENTRE * (errors.outline_px or 0.0))
    if errors.outline_px:  # more than the noise of the pixels: a compressed clip
        of_radius = replace(of_radius, autocorrelation=RADIUS_ERRORS)
    sigma = np.column_stack([with_scatter(t_s, columns[:, axis], columns[:, axis + 2], errors) for axis in (0, 1)])
    return Track(
        t_s=t_s,
        xy_px=columns[:, 0:2],
        sigma_px=np.hypot(sigma, impact_exposure_error(t_s, columns[:, :2], sigma, appearance.shutter)),
        valid=np.isfinite(columns[:, 0]),
        frame=np.array([frame_detections.frame for frame_detections in all_detections]),
        body=str(body + 1),
        radius_px=columns[:, 4],
        sigma_radius_px=with_scatter(t_s, columns[:, 4], columns[:, 5], of_radius),
        intensity=columns[:, 6],
        area_px=columns[:, 7],
        hand=hand,
        origin=_origin(appearance, options),
        error_autocorrelation=errors.autocorrelation,
    )


def _row(fitted: SeenDisc) -> tuple[float, ...]:
    disc = fitted.disc
    centre = (disc.x, disc.y, disc.sigma_x, disc.sigma_y)
    return (*centre, disc.radius, disc.sigma_radius, disc.intensity, np.pi * disc.radius**2)


def _suits(video: FrameSource, options: TrackOptions, moving: bool) -> bool:
    """Whether a body may only change its size, which the difference from a still background rarely shows."""
    return not moving or (options.bodies == 1 and bool(receding_disc(video.sample(SAMPLES), view_of(video, options))))


TRACKER = Tracker(
    name="disc",
    summary="centre and apparent radius of round bodies, by a disc fitted to their pixels",
    track=track,
    suits=_suits,
)
