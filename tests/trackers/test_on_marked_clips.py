"""The default tracker on real clips with marks made by eye, with no option but the number of bodies.

Only open clips, and every second one of them by chance, as a clip takes up to two minutes: all of them, and those that
are sealed, are scored by ``python -m validation.real_tracks``.
"""

import pytest

from tests._project import recording
from validation.real_marks import marked_clips
from validation.real_tracks import outcome

OPEN = {clip.name: clip for clip in marked_clips("open")}
CHANCE = marked_clips("open", first=(len(OPEN) + 1) // 2)
QUICK = ("incline-marble-1", "sliding-friction-3", "throw-dark-red", "throw-green-PV4", "tracker-ball-toss")


def tracked(name):
    clip = OPEN[name]
    recording(clip.clip)
    return outcome(clip)


@pytest.mark.parametrize("name", QUICK)
def test_body_is_followed(name):
    assert tracked(name).followed


@pytest.mark.slow
@pytest.mark.parametrize("name", sorted(clip.name for clip in CHANCE))
def test_no_track_is_wrong_without_saying_so(name):
    assert not tracked(name).wrong
