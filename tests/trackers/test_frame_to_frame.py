"""Sightings of successive frames joined into paths, and which of them are measured."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from iris_sysid.types import TrackOptions
from tests._drawn import DrawnClip, disc, noisy, paint, swing
from trackers._detection.detect_frames import detection_setup, measure_rough, observe
from trackers._detection.detection import Detection, EdgeObject, FrameDetections
from trackers._detection.subpixel_centroid import Centre
from trackers._frames.working_image import view_of
from trackers._linking.at_edge import with_frames_at_edge
from trackers._linking.likely_bodies import LikelyBodies
from trackers._linking.select_bodies import link_bodies, with_fragments
from trackers._tracklets.frame_to_frame import Tracklet, link

RADIUS, SPEED = 20.0, 50.0  # px, px a frame: farther than the two are wide together


def detection(frame, x, brightening):
    """A ball of that radius that differs by 50 grey levels from a background of 100."""
    centre = Centre(x, 100.0, 0.05, 0.05, np.pi * RADIUS**2, 5.0, 50.0, 100.0 + brightening, 1.0, cut=False)
    return Detection(frame, frame / 60, centre, 0, 0, brightening, 10.0, 1.0, hand=False)


def meeting(first, second):
    """Two balls that meet between frames 9 and 10 and turn round."""
    turned = np.abs(np.arange(20) - 9.5)
    return [
        FrameDetections(
            k,
            k / 60,
            (detection(k, 300 - RADIUS - SPEED * t, first), detection(k, 300 + RADIUS + SPEED * t, second)),
            (),
        )
        for k, t in enumerate(turned)
    ]


def test_speck_whose_outline_is_not_sharp_at_all_is_no_body():
    seen = meeting(50.0, 50.0)
    speck = replace(detection(3, 500.0, 50.0), sharpness=0.0)
    seen[3] = replace(seen[3], detections=(*seen[3].detections, speck))
    paths = link_bodies(seen, 2, 800.0)
    assert [len(path.detections) for path in paths] == [20, 20]


def test_a_dark_and_a_light_ball_that_strike_one_another_keep_their_paths():
    paths = link(meeting(-50.0, 50.0), 200.0, 100.0)
    assert [len(path.detections) for path in paths] == [20, 20]
    for path in paths:
        assert len({detection.brightening for detection in path.detections}) == 1


def test_a_ball_that_comes_before_a_darker_wall_is_the_same_ball():
    seen = [FrameDetections(k, k / 60, (detection(k, 50.0 + 30 * k, -50.0),), ()) for k in range(20)]
    bright = [replace(d, brightening=50.0) for frame in seen[10:] for d in frame.detections]  # its own luma stays
    seen = seen[:10] + [replace(frame, detections=(d,)) for frame, d in zip(seen[10:], bright, strict=True)]
    (path,) = link_bodies(seen, 1, 800.0)
    assert len(path.detections) == 20


def test_a_piece_that_shares_a_frame_with_a_body_adds_its_other_frames():
    body = Tracklet([detection(k, 50.0 + 30 * k, 50.0) for k in range(10, 30)])
    piece = Tracklet([detection(k, 50.0 + 30 * k, 50.0) for k in range(11)])
    (joined,) = with_fragments([body], [piece])
    assert [seen.frame for seen in joined.detections] == list(range(30))
    double = Tracklet([detection(k, 90.0 + 30 * k, 50.0) for k in range(5, 20)])
    (alone,) = with_fragments([Tracklet(list(joined.detections[10:]))], [double])
    assert alone.first.frame == 10, "seen together as long, they are two bodies"


def leaving(sides):
    """A ball that leaves to the right, and objects at the edge of the image afterwards: left, top, right, bottom."""
    path = [FrameDetections(k, k / 60, (detection(k, 100.0 + 10 * k, 50.0),), ()) for k in range(8)]
    cut = [FrameDetections(8 + k, (8 + k) / 60, (), (EdgeObject(box, 1000.0, RADIUS),)) for k, box in enumerate(sides)]
    return Tracklet([frame.detections[0] for frame in path]), path + cut


def test_a_body_that_the_edge_cuts_is_placed_by_its_visible_side():
    body, seen = leaving([(161, 80, 200, 120), (171, 80, 200, 120), (181, 82, 200, 118)])
    found = with_frames_at_edge(body, seen, (0, 0, 200, 200), 1)
    assert [d.frame for d in found.detections] == list(range(10)), "of the third less than half is visible"
    ninth = found.detections[8]
    assert (ninth.x, ninth.y) == (180.5, 99.5)
    assert ninth.centre.sigma_x == pytest.approx(12**-0.5), "40 px wide, it is known to a pixel's rounding"


def test_a_hand_that_reaches_the_body_holds_it():
    body, seen = leaving([(161, 80, 200, 120)])
    hand = EdgeObject((140, 60, 200, 200), 8000.0, 2 * RADIUS)
    with_hand = [*seen[:-1], replace(seen[-1], edge_objects=(*seen[-1].edge_objects, hand))]
    assert len(with_frames_at_edge(body, with_hand, (0, 0, 200, 200), 1).detections) == 8


def test_another_object_at_the_edge_is_not_the_body():
    hand = (150, 20, 200, 160)
    elsewhere = (161, 10, 200, 50)
    for box in (hand, elsewhere):
        body, seen = leaving([box])
        assert len(with_frames_at_edge(body, seen, (0, 0, 200, 200), 1).detections) == 8


def test_balls_that_look_alike_go_where_they_were_predicted():
    paths = link(meeting(-50.0, -50.0), 200.0, 100.0)
    left = next(path for path in paths if path.first.x < 300)
    assert left.last.x > 300, "alike in all, they are taken to pass one another: that is for the group to decide"


def clip_with_things_at_rest(n=60):
    """A disc that swings, and eight squares that stand there in the last third of the clip."""
    path, images = swing(n, (80, 60), (45, 10)), []
    for k, (x, y) in enumerate(path):
        image = np.full((96, 160), 120.0)
        if k >= 2 * n // 3:
            for left in range(6, 150, 18):
                image[8:16, left : left + 8] = 60.0
        images.append(paint(image, disc(image.shape, x, y, 8), 200.0))
    return path, DrawnClip(noisy(images, 2.0))


def test_of_many_differences_only_the_likely_body_is_measured():
    path, clip = clip_with_things_at_rest()
    setup = detection_setup(clip, view_of(clip, TrackOptions()))
    seen = observe(clip, setup, TrackOptions(), LikelyBodies(1, 186.0).among)
    measured = [sum(detection.measured for detection in frame.detections) for frame in seen]
    assert len(seen[-1].detections) == 9
    assert max(measured[-10:]) == 1
    body = [
        min(frame.detections, key=lambda found: np.hypot(found.x - x, found.y - y))
        for frame, (x, y) in zip(seen, path, strict=True)
    ]
    assert all(found.measured for found in body)
    assert np.abs([(found.x, found.y) for found in body] - path).max() < 0.2


def test_what_was_left_rough_is_measured_afterwards_as_if_at_once():
    _, clip = clip_with_things_at_rest()
    setup = detection_setup(clip, view_of(clip, TrackOptions()))
    all_at_once = observe(clip, setup, TrackOptions())
    rough = observe(clip, setup, TrackOptions(), lambda seen: [False] * len(seen.detections))
    assert not any(found.measured for frame in rough for found in frame.detections)
    chosen = {rough[k].detections[j] for k, j in ((3, 0), (45, 0), (45, 4), (59, 8))}
    then = measure_rough(clip, setup, chosen)
    expected = {found for k in (3, 45, 59) for found in all_at_once[k].detections}
    assert set(then) == chosen
    assert set(then.values()) <= expected
    assert all(np.hypot(found.x - then[found].x, found.y - then[found].y) < 1.0 for found in chosen)
