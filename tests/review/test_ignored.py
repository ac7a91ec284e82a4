"""A thing that is no body, marked by a click, is left out when the bodies are followed again."""

import numpy as np
import pytest

from iris_sysid.errors import TrackingError
from iris_sysid.review.request import ReviewRequest, request_of
from iris_sysid.review.session import followed
from iris_sysid.types import TrackMark
from tests._drawn import DrawnClip, disc, noisy, paint, swing

SHAPE = (150, 220)
BALLS = (swing(120, (110, 45), (80, 8)), swing(120, (110, 110), (70, 6), period=83.0))  # (n, 2) px
MARK = 40


@pytest.fixture(scope="module")
def clip():
    """Two discs that swing apart from each other."""
    background = np.full(SHAPE, 90.0)
    images = []
    for one, other in zip(*BALLS, strict=True):
        image = paint(background, disc(SHAPE, *one, 9.0), 210.0)
        images.append(paint(image, disc(SHAPE, *other, 7.0), 190.0))
    return DrawnClip(noisy(images, 2.0))


def at(track):
    """Which of the two a track follows in most frames."""
    off = [np.hypot(*(track.xy_px - ball).T) for ball in BALLS]
    return int(np.argmin([np.nanmedian(part) for part in off])), min(float(np.nanmedian(part)) for part in off)


def mark_on(which):
    return TrackMark("", *BALLS[which][MARK], MARK)


def test_the_other_thing_is_followed_when_one_is_to_be_ignored(clip):
    (first,) = followed(clip, ReviewRequest(), ReviewRequest().track_options)
    chosen, off_px = at(first)
    assert off_px < 0.5
    request = ReviewRequest(ignored=(mark_on(chosen),))
    (second,) = followed(clip, request, request.track_options)
    assert at(second)[0] == 1 - chosen
    assert at(second)[1] < 0.5
    assert second.body == first.body


def test_nothing_but_what_is_to_be_ignored_is_said(clip):
    request = ReviewRequest(ignored=(mark_on(0), mark_on(1)))
    with pytest.raises(TrackingError, match="ignored"):
        followed(clip, request, request.track_options)


def test_what_is_ignored_is_recorded_and_read_back():
    request = ReviewRequest(ignored=(TrackMark("", 1.5, 2.5, 7),))
    assert request_of(request.recorded()).ignored == request.ignored
    assert request_of(ReviewRequest().recorded()).ignored == ()
