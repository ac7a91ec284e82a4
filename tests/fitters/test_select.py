"""The governing equation chosen from the bank, by what it predicts of the samples held out."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.compose_effects import with_effects
from fitters.ode import simulate
from fitters.selection.observables import observables_of, raw_of
from fitters.selection.select import _chosen, select_model
from iris_sysid.errors import FitError
from iris_sysid.registry import MODELS
from iris_sysid.types import ModelCandidate, Quantity, Trajectory

NOISE = 2e-4  # m
SWING = {"length": 0.5, "damping": 0.06, "theta_0": 0.6, "omega_0": 0.0}


def track(t_s, columns, units, noise=NOISE, seed=0):
    place = np.column_stack(list(columns.values()))
    place = place + np.asarray(noise) * np.random.default_rng(seed).standard_normal(place.shape)
    quantities = tuple(Quantity(name, unit) for name, unit in zip(columns, units, strict=True))
    return Trajectory(t_s, quantities, place, np.full_like(place, np.nan), np.ones(t_s.size, bool))


def on_arc(t_s, model="pendulum", values=SWING):
    theta = simulate(MODELS[model], t_s, values).observed[:, 0]
    return {"x": 0.2 + 0.5 * np.sin(theta), "z": 1.1 - 0.5 * np.cos(theta)}


@pytest.mark.slow
def test_position_of_a_bob_is_taken_for_the_angle_of_a_pendulum_about_a_pivot_that_nobody_gave():
    t_s = np.arange(120) / 30
    choice = select_model(track(t_s, on_arc(t_s), ["m", "m"]))
    assert (choice.chosen.model, choice.chosen.observable) == ("pendulum", "angle")
    assert choice.chosen.fit.estimates["length"].value == pytest.approx(0.5, rel=0.01)
    linear = next(candidate for candidate in choice.ranking if candidate.model == "linear-pendulum")
    assert linear.heldout > 5 * choice.chosen.heldout


@pytest.mark.parametrize("length", [0.15, 0.2])
def test_short_pendulum_with_much_drag_is_a_pendulum_and_incomplete(length):
    """A light bob on a short cord: the drag leaves more than 2 % of the motion, ten times the noise."""
    t_s = np.arange(240) / 30
    values = {"length": length, "damping": 0.03, "theta_0": 0.5, "omega_0": 0.0, "quadratic_drag": 0.3}
    theta = simulate(with_effects("pendulum", ["quadratic-drag"]), t_s, values).observed[:, 0]
    arc = {"x": length * np.sin(theta), "z": -length * np.cos(theta)}
    bank = {name: MODELS[name] for name in ("pendulum", "angular-oscillator", "linear-oscillator", "free-fall")}
    choice = select_model(track(t_s, arc, ["m", "m"]), bank)
    assert choice.nearest.residual > 5
    assert choice.chosen.model == "pendulum"
    assert not choice.verdict.complete


def test_fall_and_slide_are_distinguished_by_their_direction():
    t_s = np.arange(30) / 60
    fall = track(t_s, {"x": np.full(30, 0.3), "z": 1.5 - 9.8 * t_s**2 / 2}, ["m", "m"])
    way = 5.0 * t_s**2 / 2
    slide = track(t_s, {"x": way * np.cos(1.2), "z": 1.0 - way * np.sin(1.2)}, ["m", "m"])
    assert select_model(fall).chosen.model == "free-fall"
    chosen = select_model(slide).chosen
    assert chosen.model == "incline"
    assert chosen.fit.estimates["angle"].value == pytest.approx(1.2, abs=0.01)
    assert chosen.fit.estimates["acceleration"].value == pytest.approx(5.0, rel=0.01)


def test_columns_are_taken_by_their_unit_whatever_their_name():
    """A height that drains away under a name that suggests a way along a board."""
    t_s = np.arange(200) / 20
    level = simulate(MODELS["torricelli"], t_s, {"outflow": 0.03, "h_0": 0.25}).observed[:, 0]
    assert select_model(track(t_s, {"s": level}, ["m"], 2e-5)).chosen.model == "torricelli"


@pytest.mark.slow
def test_nothing_is_chosen_when_no_model_of_the_bank_fits():
    t_s = np.arange(120) / 30
    wander = np.cumsum(np.random.default_rng(3).standard_normal((120, 2)), axis=0)
    smooth = np.stack([np.convolve(column, np.hanning(13) / 6, mode="same") for column in wander.T])
    choice = select_model(track(t_s, {"x": smooth[0], "z": smooth[1]}, ["m", "m"], 1e-4))
    assert choice.chosen is None
    assert choice.message.startswith("none of these: the nearest, ")
    assert choice.nearest.residual > 3


def test_ranking_holds_every_model_that_suits_with_its_errors():
    t_s = np.arange(120) / 60
    bank = {name: MODELS[name] for name in ("pendulum", "linear-pendulum", "free-fall")}
    choice = select_model(track(t_s, on_arc(t_s), ["m", "m"]), bank)
    assert {candidate.model for candidate in choice.ranking} == set(bank)
    assert choice.heldout_margin > 1
    assert choice.bic_margin > 0


def test_short_clip_and_unknown_observable_are_refused():
    t_s = np.arange(8) / 60
    with pytest.raises(FitError, match="only 8 usable samples, 12 are needed"):
        select_model(track(t_s, on_arc(t_s), ["m", "m"]))
    with pytest.raises(FitError, match="no model of the bank observes"):
        select_model(track(np.arange(30) / 60, {"q": np.arange(30.0), "w": np.ones(30)}, ["kg", "A"]))


def test_every_observable_of_a_track_counts_the_same_channels():
    t_s = np.arange(60) / 60
    clip = track(t_s, {**on_arc(t_s), "r": 40 + t_s}, ["m", "m", "px"], [NOISE, NOISE, 0.05])
    observables = observables_of(raw_of(clip, np.ones(60, bool)), np.arange(60) < 40)
    assert {observable.name for observable in observables} == {
        "position",
        "height",
        "distance",
        "angle",
        "apparent radius",
    }
    assert all(observable.quantities.shape[1] + observable.rest.shape[1] == 3 for observable in observables)


# --------------------------------------------------------------------------- events, and several bodies


def few(*names):
    return {name: MODELS[name] for name in names}


def test_cord_that_never_goes_slack_is_no_evidence_for_one_that_may():
    t_s = np.arange(200) / 60
    choice = select_model(track(t_s, on_arc(t_s), ["m", "m"]), few("pendulum", "slack-cord"))
    assert choice.chosen.model == "pendulum"
    idle = {candidate.model: candidate.idle for candidate in choice.ranking}
    assert idle == {"pendulum": False, "slack-cord": True}


def test_smooth_motion_is_no_oscillation_about_a_place_that_it_never_passes():
    """A slide with drag: a spring at rest far ahead predicts it better than a constant acceleration does."""
    t_s = np.arange(120) / 120
    slopes = lambda t, state: [state[1], 3.0 - 0.6 * state[1] ** 2]  # noqa: E731
    way = solve_ivp(slopes, (0.0, 1.0), [0.0, 0.0], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
    choice = select_model(track(t_s, {"s": way}, ["m"], 1e-3), few("incline", "linear-oscillator", "free-fall"))
    assert choice.chosen.model == "incline"
    idle = {candidate.model: candidate.idle for candidate in choice.ranking}
    assert idle == {"incline": False, "linear-oscillator": True, "free-fall": True}  # 3 m/s^2 are not gravity
    assert choice.verdict.word == "doubtful"


def test_level_that_drains_faster_than_its_equation_is_still_a_level():
    t_s = np.arange(240) / 4
    slopes = lambda t, level: -0.012 * np.sqrt(np.maximum(level, 0.0)) - 0.004 * level  # noqa: E731
    level = solve_ivp(slopes, (0.0, 60.0), [0.4], "DOP853", t_s, rtol=1e-10, atol=1e-12).y[0]
    choice = select_model(track(t_s, {"h": level}, ["m"], 8e-4))
    assert choice.chosen.model == "torricelli"
    assert "incline" not in {candidate.model for candidate in choice.ranking}


def test_fall_seen_by_a_camera_that_leans_is_still_a_fall():
    t_s, lean = np.arange(30) / 60, 0.02
    drop = 9.8 * t_s**2 / 2
    fall = track(t_s, {"x": 0.3 + drop * np.sin(lean), "z": 1.5 - drop * np.cos(lean)}, ["m", "m"])
    chosen = select_model(fall, few("free-fall", "incline", "projectile")).chosen
    assert (chosen.model, chosen.observable) == ("free-fall", "tilted height")


def test_two_pendulums_that_strike_one_another_are_chosen_by_the_motion_of_both():
    t_s = np.arange(150) / 60
    values = {"length_1": 0.5, "length_2": 0.5, "damping_1": 0.05, "damping_2": 0.05, "restitution": 0.9}
    values |= {"pivot_ratio": 0.08, "theta1_0": -0.5, "theta2_0": 0.0, "omega1_0": 0.0, "omega2_0": 0.0}
    model = MODELS["pendulum-impact"]
    known = {p.name: p.default for p in model.parameters if p.default is not None}
    theta = simulate(model, t_s, {**known, **values}).observed
    bodies = [
        track(t_s, {"x": pivot + 0.5 * np.sin(angle), "z": 1 - 0.5 * np.cos(angle)}, ["m", "m"], seed=seed)
        for seed, (angle, pivot) in enumerate(zip(theta.T, (0.0, 0.04), strict=True))
    ]
    choice = select_model(bodies, few("pendulum", "pendulum-impact", "linear-pendulum"))
    assert (choice.chosen.model, choice.chosen.observable) == ("pendulum-impact", "angles")
    assert choice.heldout_margin > 10


def test_two_pendulums_on_a_common_spring_are_chosen_from_their_angles():
    """SciPy integrates; an angle of each is given, from the vertical."""
    t_s, pull, coupling = np.arange(480) / 40, 9.80665 / np.array([0.95, 0.98]), 0.9

    def rates(_t, state):
        angles, rates = state[:2], state[2:]
        return [*rates, *(-pull * np.sin(angles) - 0.015 * rates - coupling * (angles - angles[::-1]))]

    angles = solve_ivp(rates, (0, t_s[-1]), [0.4, 0, 0, 0], t_eval=t_s, rtol=1e-9, atol=1e-9).y[:2]
    both = track(t_s, {"theta1": angles[0], "theta2": angles[1]}, ["rad", "rad"], 2e-3)
    chosen = select_model(both, few("pendulum", "coupled-pendulums")).chosen
    assert chosen.model == "coupled-pendulums"
    assert chosen.fit.estimates["coupling"].interval[0] < coupling < chosen.fit.estimates["coupling"].interval[1]


def rolling_at_cups():
    """A ball that rolls at two cups, which tumble off when it reaches them, and a third that it never reaches."""
    t_s = np.arange(120) / 60
    way = 3.0 * (1 - np.exp(-0.8 * t_s)) / 0.8
    hit = int(np.argmax(way > 2.0))
    rng, after = np.random.default_rng(5), np.arange(120) >= hit
    tumbling = [np.cumsum(after * (0.02 + 0.02 * rng.standard_normal(120))) for _ in range(4)]
    places = [
        {"x": np.where(after, way[hit] + 0.4 * tumbling[3], way), "z": np.zeros(120)},
        {"x": 2.2 + tumbling[0], "z": 0.1 + 0.3 * tumbling[1]},
        {"x": 2.4 + tumbling[2], "z": np.full(120, 0.1)},
        {"x": np.full(120, 3.5), "z": np.full(120, 0.1)},
    ]
    return [track(t_s, place, ["m", "m"], seed=seed) for seed, place in enumerate(places)]


def test_where_no_equation_fits_all_bodies_one_is_chosen_for_the_first_until_the_others_move():
    choice = select_model(rolling_at_cups(), few("coasting-ball", "incline", "stopping-block", "projectile"))
    assert (choice.chosen.model, choice.chosen.observable) == ("coasting-ball", "distance, until others move")
    assert choice.chosen.fit.estimates["damping"].value == pytest.approx(0.8, rel=0.02)


def test_body_at_rest_has_no_say():
    bodies = rolling_at_cups()
    alone = bodies[0].with_(valid=np.arange(120) < 50)
    choice = select_model([alone, bodies[3]], few("coasting-ball", "incline"))
    assert (choice.chosen.model, choice.chosen.observable) == ("coasting-ball", "distance")


def test_level_line_is_no_incline():
    t_s = np.arange(40) / 60
    way = 2.0 * t_s - 0.4 * t_s**2
    level = track(t_s, {"x": way, "z": np.zeros(40)}, ["m", "m"])
    assert "incline" not in {candidate.model for candidate in select_model(level).ranking}
    sloping = track(t_s, {"x": way * np.cos(0.2), "z": -way * np.sin(0.2)}, ["m", "m"])
    assert "incline" in {candidate.model for candidate in select_model(sloping).ranking}


def candidate(model, heldout, bic):
    return ModelCandidate(model, "distance", heldout, 1.0, bic, bool(np.isfinite(bic)), None, "", 5)


def test_model_whose_fit_to_all_samples_failed_comes_after_those_that_were_fitted():
    choice = _chosen([candidate("failed", 1.0, np.inf), candidate("fitted", 4.0, 30.0)], 5)
    assert [candidate.model for candidate in choice.ranking] == ["fitted", "failed"]
    assert choice.chosen.model == "fitted"


def test_where_every_fit_failed_none_is_chosen():
    choice = _chosen([candidate("worse", 2.0, np.inf), candidate("better", 1.0, np.inf)], 5)
    assert choice.chosen is None
    assert choice.nearest.model == "better"


def falling(drag, seed=0):
    """A metre of fall with quadratic drag, exactly: v = v_1 tanh(g t / v_1), seen with 1 mm of noise."""
    t_s = np.arange(60) / 120
    z = -9.80665 * t_s**2 / 2 if drag == 0 else -np.log(np.cosh(np.sqrt(9.80665 * drag) * t_s)) / drag
    return track(t_s, {"z": z}, ["m"], noise=1e-3, seed=seed)


def test_equation_that_predicts_far_worse_than_the_noise_explains_is_doubted():
    with_drag = select_model(falling(0.3), ["free-fall"])
    assert with_drag.chosen.heldout > 4 * with_drag.chosen.expected
    assert any(doubt.kind == "poorly-predicted" for doubt in with_drag.verdict.number_reasons)
    for seed in range(5):
        right = select_model(falling(0.0, seed), ["free-fall"])
        assert not any(doubt.kind == "poorly-predicted" for doubt in right.verdict.reasons)


@pytest.mark.parametrize("seed", [2, 4, 6])
def test_equation_whose_own_value_may_be_zero_comes_after_one_that_explains_as_much(seed):
    bank = {name: MODELS[name] for name in ("free-fall", "rocket-coast")}
    t_s = np.arange(12) * 0.02
    fall = track(t_s, {"z": -0.5 * 9.81 * t_s**2}, ["m"], 5e-4, seed)
    choice = select_model(fall, bank)
    assert choice.nearest.model == "free-fall"
    assert choice.bic_margin < 0


def test_tank_does_not_fill_by_itself():
    t_s = np.arange(12) * 0.02
    rise = track(t_s, {"y": 0.5 * 9.81 * t_s**2}, ["m"], 5e-4)
    assert select_model(rise).nearest.model != "torricelli"
