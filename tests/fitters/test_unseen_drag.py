"""Falls whose drag the data cannot rule out, and a gravity that is not that of the Earth."""

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.ode import FitOptions, fit
from fitters.ode.several_clips import fit_clips
from fitters.ode.unseen_drag import UNSEEN_DRAG, root_mean_square
from iris_sysid.registry import MODELS
from iris_sysid.trajectory.consistency.earth_gravity import earth_gravity_doubt
from iris_sysid.types import Estimate, Quantity, Trajectory

GRAVITY = 9.81


def fallen(t_s, drag):
    """How far a body fell from rest against a drag k v^2: ln cosh((g k)^(1/2) t) / k."""
    return GRAVITY * t_s**2 / 2 if drag == 0 else np.log(np.cosh(np.sqrt(GRAVITY * drag) * t_s)) / drag


def fall(drag, seed=0, count=15, rate_hz=30.0, noise=3e-3, unit="m", across=None):
    t_s = np.arange(count) / rate_hz
    columns = [2.0 - fallen(t_s, drag)] if across is None else [across * t_s, 2.0 - fallen(t_s, drag)]
    place = np.column_stack(columns)
    place = place + noise * np.random.default_rng(seed).standard_normal(place.shape)
    quantities = tuple(Quantity(name, unit) for name in (["z"] if across is None else ["x", "z"]))
    return Trajectory(t_s, quantities, place, np.full_like(place, np.nan), np.ones(count, bool))


def covers(result):
    low, high = result.estimates["gravity"].interval
    return low <= GRAVITY <= high


@pytest.mark.parametrize(("drag", "least"), [(0.0, 37), (0.02, 35), (0.13, 31)])
def test_interval_of_a_short_fall_holds_gravity_with_and_without_drag(drag, least):
    assert sum(covers(fit(fall(drag, seed), "free-fall")) for seed in range(40)) >= least


def test_gravity_that_has_absorbed_drag_is_not_good():
    verdicts = [fit(fall(0.13, seed), "free-fall").verdict for seed in range(20)]
    assert sum(verdict.good for verdict in verdicts) <= 3
    assert sum("drag" in verdict.text for verdict in verdicts) >= 17
    assert all(fit(fall(0.0, seed), "free-fall").verdict.good for seed in range(20))


def test_allowance_for_drag_is_part_of_the_budget_of_a_short_fall():
    result = fit(fall(0.0), "free-fall")
    parts = result.budget["gravity"]
    assert parts[UNSEEN_DRAG] > parts["random"]
    assert result.estimates["gravity"].stderr == pytest.approx(np.hypot(parts["random"], parts[UNSEEN_DRAG]))
    assert f"the errors include {UNSEEN_DRAG}" in result.notes
    thrown = fit(fall(0.0, across=0.5), "projectile", free=["gravity"])
    assert thrown.budget["gravity"][UNSEEN_DRAG] > 0


def test_data_that_rule_drag_out_leave_no_allowance():
    result = fit(fall(0.0, count=480, rate_hz=240.0, noise=1e-3), "free-fall")
    assert result.budget["gravity"][UNSEEN_DRAG] < 0.1 * result.budget["gravity"]["random"]
    assert result.verdict.good


def test_allowance_is_the_same_in_any_unit_of_length():
    metres = fit(fall(0.0), "free-fall").budget["gravity"]
    clip = fall(0.0, unit="px")
    pixels = fit(clip.with_(position=500.0 * clip.position), "free-fall").budget["gravity"]
    assert pixels[UNSEEN_DRAG] == pytest.approx(500.0 * metres[UNSEEN_DRAG], rel=1e-3)


def test_no_allowance_in_vacuum_with_a_known_gravity_or_with_drag_in_the_equation():
    clip, free_fall = fall(0.0), MODELS["free-fall"]
    assert UNSEEN_DRAG not in fit(clip, free_fall, options=FitOptions(unseen_drag=False)).budget["gravity"]
    assert UNSEEN_DRAG not in fit(clip, with_effects(free_fall, ["quadratic-drag"])).budget["gravity"]
    assert UNSEEN_DRAG not in fit(clip, free_fall, fixed={"gravity": 9.81}).budget["z_0"]


def test_mass_and_radius_of_the_body_narrow_the_allowance():
    steel = {"mass": Estimate(0.0327, 0.0, "kg"), "ball_radius": Estimate(0.01, 0.0, "m")}
    balloon = {"mass": Estimate(0.004, 0.0, "kg"), "ball_radius": Estimate(0.12, 0.0, "m")}
    plain, heavy, light = (
        fit(fall(0.0).with_(geometry=stated), "free-fall").budget["gravity"][UNSEEN_DRAG]
        for stated in ({}, steel, balloon)
    )
    assert heavy < 0.5 * plain < plain < light


def test_mean_square_of_drag_is_that_of_its_posterior():
    rng = np.random.default_rng(0)
    unseen = rng.standard_normal(50)
    noise = 1e-3 * rng.standard_normal(50)
    assert root_mean_square(0.3 * unseen + noise, unseen, 3) == pytest.approx(0.3, rel=0.01)  # clearly seen
    assert root_mean_square(noise, unseen, 3) < 1e-3  # clearly none
    assert 0.2 < root_mean_square(1e3 * noise, 1e-3 * unseen, 3) < 1.0  # the prior: nothing is known


@pytest.mark.parametrize(
    ("value", "stderr", "doubted"), [(9.07, 0.06, True), (9.81, 1e-4, False), (9.70, 0.05, False), (10.5, 0.1, True)]
)
def test_gravity_outside_the_range_on_earth_is_doubted(value, stderr, doubted):
    doubt = earth_gravity_doubt(Estimate(value, np.hypot(stderr, 0.5), "m/s^2"), 0.5)
    assert (doubt is not None) == doubted
    assert earth_gravity_doubt(Estimate(value, stderr, "px/s^2")) is None


def test_fall_that_is_counted_downwards_is_told_so():
    doubt = earth_gravity_doubt(Estimate(-9.81, 0.1, "m/s^2"))
    assert doubt is not None
    assert "counted downwards" in doubt.finding


def test_gravity_that_was_stated_is_not_doubted():
    moon = {"gravity": Estimate(9.0, 0.2, "m/s^2")}
    clip = fall(0.13)
    assert any("Earth" in doubt.finding for doubt in fit(clip, "free-fall").doubts)
    assert not any("Earth" in doubt.finding for doubt in fit(clip, "free-fall", fixed=moon, free=["gravity"]).doubts)


def test_gravity_shared_by_several_falls_allows_for_the_drag_that_they_have_in_common():
    hits = 0
    for seed in range(10):
        clips = [fall(0.13, 3 * seed + k) for k in range(3)]
        pooled = fit_clips(clips, "free-fall", shared=["gravity"])
        low, high = pooled.shared["gravity"].interval
        hits += low <= GRAVITY <= high
        assert pooled.verdict.word == "doubtful"
        assert pooled.budget["gravity"][UNSEEN_DRAG] > 0.1
    assert hits >= 8
    in_vacuum = fit_clips(clips, "free-fall", shared=["gravity"], options=FitOptions(unseen_drag=False))
    assert UNSEEN_DRAG not in in_vacuum.budget["gravity"]
