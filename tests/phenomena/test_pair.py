"""Two pendulums that collide: synthetic clips and the benchmark's own footage, by impacts and by kappa."""

import numpy as np
import pytest

from fitters.integrator.event_times import event_times
from fitters.ode import FitOptions, fit
from iris_sysid.calibration.pixel_scale import uncalibrated
from iris_sysid.errors import DataError
from iris_sysid.pipeline.one_clip import observe, track
from iris_sysid.registry import MODELS, PHENOMENA
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.types import Quantity, Segment, TrackOptions, Trajectory
from iris_sysid.video.reader import open_video
from tests._project import recording

NOISE_M = 1e-4  # a tenth of a pixel of a clip with 1000 px/m
NAMES = ("two-moving-pendulums", "two-moving-pendulum-one-static")


def synthetic(phenomenon, angle=45, seed=0, swapped=False):
    """The world trajectories of both bodies with noise, and the truth."""
    truth = plan_clip(phenomenon, setting=f"pendulum_{angle}", duration_s=5.0, seed=seed).truth
    rng, world = np.random.default_rng(seed), []
    for name in "21" if swapped else "12":
        body = truth.body(name)
        position = body[["x_m", "z_m"]].to_numpy() + NOISE_M * rng.standard_normal((len(body), 2))
        hand = int((body.phase == "hand").sum())
        segments = (Segment("hand", 0, hand), Segment("motion", hand, len(body)))
        quantities = (Quantity("x", "m"), Quantity("z", "m"))
        sigma = np.full(position.shape, NOISE_M)
        valid = np.ones(len(body), dtype=bool)
        world.append(Trajectory(body.t_s.to_numpy(), quantities, position, sigma, valid, segments=segments))
    return world, truth


def impacts_fit(phenomenon, world):
    chosen = PHENOMENA[phenomenon]
    trajectory = chosen.observe(world, {})
    return trajectory, fit(trajectory, MODELS[chosen.model], free=chosen.free)


@pytest.mark.parametrize("angle", [20, 90])
@pytest.mark.parametrize("phenomenon", NAMES)
def test_lengths_restitution_and_contact_times_of_the_twin_are_found(phenomenon, angle):
    world, truth = synthetic(phenomenon, angle)
    trajectory, result = impacts_fit(phenomenon, world)
    assert result.ok, result.message
    known = truth.parameters
    for name, share in (("length_1", 0.005), ("length_2", 0.005), ("restitution", 0.02)):
        assert result.estimates[name].value == pytest.approx(known[name].value, rel=share), name
    radii = [known[f"ball_radius_{k}"].value for k in (1, 2)]
    assert result.estimates["contact_distance"].value == pytest.approx(sum(radii), abs=2e-3)
    assert result.estimates["mass_ratio"].value == pytest.approx((radii[1] / radii[0]) ** 3, rel=0.03)
    values = {name: estimate.value for name, estimate in result.estimates.items() if name not in ("contact_distance",)}
    happened = event_times(result.model, trajectory.t_s[trajectory.t_s >= result.t0_s], values)
    impacts = [event.t_s for event in happened if event.name == "impact"]
    true = [t for t, name in truth.events if name == "impact" and t < trajectory.t_s[-1]]
    np.testing.assert_allclose(impacts[:6], true[:6], atol=0.5 / 60)


def test_bodies_in_the_other_order_give_the_same():
    plain, swapped = (impacts_fit(NAMES[0], synthetic(NAMES[0], swapped=k)[0])[1] for k in (False, True))
    assert swapped.estimates["length_1"].value == pytest.approx(plain.estimates["length_1"].value, rel=2e-3)
    assert swapped.estimates["theta1_0"].value < 0 < swapped.estimates["theta2_0"].value


def test_held_and_slack_samples_are_not_the_motion():
    world, _ = synthetic(NAMES[0])
    position = world[0].position.copy()
    position[30:40] *= 0.97  # the cord of the first is slack after the release
    trajectory = PHENOMENA[NAMES[0]].observe([world[0].with_(position=position), world[1]], {})
    labels = [segment.label for segment in trajectory.segments]
    assert labels == ["hand", "release", "motion"]
    assert trajectory.segments[2].start == 40


@pytest.mark.parametrize(
    ("bodies", "message"),
    [(1, "there are 1; see --bodies"), (0, "there are 0")],
)
def test_pair_needs_two_bodies(bodies, message):
    with pytest.raises(DataError, match=message):
        PHENOMENA[NAMES[0]].observe(synthetic(NAMES[0])[0][:bodies], {})


def test_pair_needs_the_same_times():
    world, _ = synthetic(NAMES[0])
    with pytest.raises(DataError, match="not at the same times"):
        PHENOMENA[NAMES[0]].observe([world[0], world[1].with_(t_s=world[1].t_s + 0.1)], {})


@pytest.mark.slow
def test_footage_of_two_pendulums_is_followed_through_its_impacts_where_kappa_is_not():
    video = open_video(recording("iris_footage/Two_Moving_Pendulums.gif"))
    tracks = track(video, "median-background", TrackOptions(bodies=2))
    _, trajectory = observe(tracks, uncalibrated(), NAMES[0])
    impacts = fit(trajectory, MODELS["pendulum-impact"], free=PHENOMENA[NAMES[0]].free)
    spring = fit(trajectory, MODELS["coupled-pendulums"], options=FitOptions(multistart=2))
    assert np.all(impacts.rms < 0.04)
    assert np.all(spring.rms > 3 * impacts.rms)
    for body in (1, 2):  # rope 0.50 m, the ball's centre a radius below its end
        assert impacts.estimates[f"length_{body}"].value == pytest.approx(0.5, abs=0.06)
