"""Sub-pixel centroids of bodies that move before a still background, weighted by the coverage of each pixel."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from iris_sysid.errors import DataError, TrackingError
from iris_sysid.types import FrameSource, Measurer, Track, TrackOptions, with_progress
from trackers._detection.detect_frames import REPORT_EVERY, DetectionSetup, detection_setup
from trackers._detection.detection import Detection, FrameCandidates, FrameDetections
from trackers._frames.ahead import ahead
from trackers._frames.working_image import view_of
from trackers._linking.to_track import track_of
from trackers._tracklets.frame_to_frame import Tracklet
from trackers._tracklets.least_cost import least_cost_pairs

MIN_REACH_PX = 3.0  # a body is met within its radius, or this, px
FAR = 1e6
Seen = tuple[FrameDetections, dict[int, Detection | None]]  # of one frame, and the detection of each body by its number


def measure(video: FrameSource, tracks: Sequence[Track], options: TrackOptions) -> list[Track]:
    """Measure each body where its track says that it is, in one pass over the clip.

    Parameters
    ----------
    video
        The clip; its camera stands still.
    tracks
        Where the bodies are, px, and their radii.
    options
        ``roi``, ``colour`` and ``progress`` as any tracker's.

    Returns
    -------
    list of Track
        With standard errors, areas and intensities. A gap is where a track has one, nothing that moves is within a
        radius of it, or another body is nearer to that.

    Raises
    ------
    TrackingError
        When nothing moves where a track is.
    VideoError
        When there are fewer than three frames.
    DataError
        When a track has no frame in common with the clip, or the options do not fit it.
    """
    setup = detection_setup(video, view_of(video, options), coarse=True)
    rows = [{int(number): row for row, number in enumerate(track.frame) if track.valid[row]} for track in tracks]

    def measured(work: tuple[FrameCandidates, dict[int, int], Sequence[Detection]]) -> Seen:
        found, chosen, before = work
        which = [k in chosen.values() for k in range(len(found.blobs))]
        detections = setup.detector.each_measured(found, which, before)
        frame = FrameDetections(found.frame.index, found.frame.t_s, (), found.edge_objects)
        return frame, {body: detections[k] for body, k in chosen.items()}

    all_detections: list[FrameDetections] = []
    paths: list[list[Detection]] = [[] for _ in tracks]
    frames = with_progress(video.frames(), options.progress, video.n_expected, every=REPORT_EVERY)
    candidates = setup.search_windows().candidates(setup.detector, frames)
    for frame, seen in ahead(measured, _chosen(candidates, tracks, rows)):
        all_detections.append(frame)
        for body, detection in seen.items():
            if detection is not None:
                paths[body].append(detection)
    shown = {frame.frame for frame in all_detections}
    for track in tracks:
        if not shown & set(track.frame.tolist()):
            raise DataError(f"the track of body {track.body} has no frame in common with the clip")
    lost = [track.body for track, path in zip(tracks, paths, strict=True) if not path]
    if lost:
        raise TrackingError(f"nothing moves where the track of body {lost[0]} is; is it a track of this clip?")
    return [
        track_of(Tracklet(path), all_detections, track.body, _origin(track, setup, options), alone=len(tracks) == 1)
        for track, path in zip(tracks, paths, strict=True)
    ]


def _chosen(
    candidates: Iterator[FrameCandidates], tracks: Sequence[Track], rows: Sequence[dict[int, int]]
) -> Iterator[tuple[FrameCandidates, dict[int, int], Sequence[Detection]]]:
    """Each frame's candidates, which of them each body is, and the candidates of the frame before."""
    before: Sequence[Detection] = ()
    for found in candidates:
        at = {body: row[found.frame.index] for body, row in enumerate(rows) if found.frame.index in row}
        yield found, _nearest(found.detections, tracks, at), before
        before = found.detections


def _nearest(detections: Sequence[Detection], tracks: Sequence[Track], at: dict[int, int]) -> dict[int, int]:
    """The number of the detection that each body is, at the least distance of all together."""
    if not detections or not at:
        return {}
    places = np.array([(seen.x, seen.y) for seen in detections])
    away = np.full((len(at), len(places)), FAR)
    for number, (body, row) in enumerate(at.items()):
        radius = tracks[body].radius_px
        reach = MIN_REACH_PX if radius is None else max(MIN_REACH_PX, float(np.nan_to_num(radius[row])))
        distance = np.hypot(*(places - tracks[body].xy_px[row]).T)
        away[number] = np.where(distance <= reach, distance, FAR)
    bodies = list(at)
    pairs = zip(*least_cost_pairs(away), strict=True)
    return {bodies[number]: int(k) for number, k in pairs if away[number, k] < FAR}


def _origin(track: Track, setup: DetectionSetup, options: TrackOptions) -> dict[str, object]:
    stated = {"roi": options.roi, "colour": options.colour, "colour_used": setup.view.chroma}
    return {**track.origin, **stated, "measurer": MEASURER.name}


MEASURER = Measurer(
    name="coverage",
    summary="centroid by the coverage of each pixel, before the still background",
    measure=measure,
)
