"""Sightings of successive frames joined into paths."""

from __future__ import annotations

import numpy as np

from trackers._detection.detection import Detection, FrameDetections
from trackers._detection.subpixel_centroid import Centre
from trackers._linking.frame_to_frame import link

RADIUS, SPEED = 20.0, 50.0  # px, px a frame: farther than the two are wide together


def detection(frame, x, brightening):
    """A ball of that radius that differs from what is behind it by 50 grey levels."""
    centre = Centre(x, 100.0, 0.05, 0.05, np.pi * RADIUS**2, 5.0, 50.0, 100.0, 1.0, cut=False)
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


def test_a_dark_and_a_light_ball_that_strike_one_another_keep_their_paths():
    paths = link(meeting(-50.0, 50.0), 200.0, 100.0)
    assert [len(path.detections) for path in paths] == [20, 20]
    for path in paths:
        assert len({detection.brightening for detection in path.detections}) == 1


def test_balls_that_look_alike_go_where_they_were_predicted():
    paths = link(meeting(-50.0, -50.0), 200.0, 100.0)
    left = next(path for path in paths if path.first.x < 300)
    assert left.last.x > 300, "alike in all, they are taken to pass one another: that is for the group to decide"
