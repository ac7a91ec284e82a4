"""The falling ball's motion is the fall alone, also where the hand is not seen by itself or the bounce is hidden."""

import numpy as np
import pytest
from scipy.signal import lfilter

from fitters.ode import fit
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.pipeline.one_clip import observe
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.types import Quantity, Segment, Track, Trajectory

T_S = np.arange(120) / 60
RELEASE, BOUNCE = 30, 62  # samples
R0_F, H0, G = 76.0, 0.75, 9.80665


def radius():
    """Held until the release, then away from the camera, and back up after the bounce; the exact radius, px."""
    since = np.clip(T_S - T_S[RELEASE], 0.0, None)
    h_m = H0 + G * since**2 / 2
    up = np.clip(T_S - T_S[BOUNCE], 0.0, None)
    h_m[BOUNCE:] = h_m[BOUNCE] - 2.0 * up[BOUNCE:] + G * up[BOUNCE:] ** 2 / 2
    h_m[BOUNCE:] = np.minimum(h_m[BOUNCE:], h_m[BOUNCE])
    return R0_F / h_m


WHOLE = (Segment("motion", 0, T_S.size, "all"),)


def observed(valid, *, noise=0.02, seed=0, segments=WHOLE):
    values = radius() + np.random.default_rng(seed).normal(0, noise, T_S.size)
    world = Trajectory(
        t_s=T_S, quantities=(Quantity("r", "px"),), position=np.where(valid, values, np.nan)[:, None],
        sigma=np.full((T_S.size, 1), noise), valid=valid, segments=segments,
    )  # fmt: skip
    return PHENOMENA["falling-ball"].observe([world], {})


def motion(trajectory):
    return next((segment.start, segment.stop) for segment in trajectory.segments if segment.label == "motion")


def test_fall_begins_at_the_release_and_ends_before_the_bounce():
    start, stop = motion(observed(np.ones(T_S.size, dtype=bool)))
    assert RELEASE <= start <= RELEASE + 3
    assert BOUNCE - 2 <= stop <= BOUNCE + 1


def test_fall_that_was_taken_for_the_release_because_of_its_bounce_is_found():
    parts = (
        Segment("rest", 0, 33),
        Segment("release", 33, BOUNCE + 1),
        Segment("motion", BOUNCE + 1, T_S.size, "bounces"),
    )
    start, stop = motion(observed(np.ones(T_S.size, dtype=bool), segments=parts))
    assert (start, BOUNCE - 2 <= stop <= BOUNCE + 1) == (33, True)


def test_release_before_the_fall_stays_one():
    parts = (Segment("release", 0, RELEASE + 2), Segment("motion", RELEASE + 2, T_S.size, "falls"))
    trajectory = observed(np.ones(T_S.size, dtype=bool), segments=parts)
    assert trajectory.segments[0].label == "release"
    assert motion(trajectory)[0] == RELEASE + 2


def test_fall_ends_at_a_gap_that_may_hide_the_bounce():
    valid = np.ones(T_S.size, dtype=bool)
    valid[50:70] = False
    assert motion(observed(valid))[1] <= 50


def test_gravity_of_the_fall_alone_is_right_within_its_error():
    pulls = []
    for seed in range(20):
        trajectory = observed(np.ones(T_S.size, dtype=bool), seed=seed)
        result = fit(trajectory, MODELS["apparent-radius"], fixed={"r0_f": R0_F}, free=["gravity"])
        gravity = result.estimates["gravity"]
        pulls.append((gravity.value - G) / gravity.stderr)
    assert np.sqrt(np.mean(np.square(pulls))) < 1.5


def fitted(errors):
    body = Track(
        t_s=T_S, xy_px=np.full((T_S.size, 2), 300.0), sigma_px=np.full((T_S.size, 2), 0.02), frame=np.arange(T_S.size),
        valid=np.ones(T_S.size, dtype=bool), radius_px=radius() + errors, sigma_radius_px=np.full(T_S.size, 0.02),
    )  # fmt: skip
    _, trajectory = observe([body], uncalibrated(), "falling-ball")
    return fit(trajectory, MODELS["apparent-radius"], fixed={"r0_f": R0_F}, free=["gravity"])


def test_gravity_is_right_within_its_random_error_where_errors_of_the_radius_last():
    pulls = []
    for seed in range(30):
        white = np.random.default_rng(seed).normal(0, 0.06, T_S.size + 60)
        gravity = fitted(lfilter([0.8], [1, -0.6], white)[60:])
        pulls.append((gravity.estimates["gravity"].value - G) / gravity.budget["gravity"]["random"])
    assert 0.8 < np.sqrt(np.mean(np.square(pulls))) < 1.4


def test_radius_has_the_common_error_of_an_edge():
    result = fitted(np.random.default_rng(1).normal(0, 0.02, T_S.size))
    assert result.budget["h_0"]["edge of the ball"] == pytest.approx(0.1 / (R0_F / H0) * H0, rel=0.2)
