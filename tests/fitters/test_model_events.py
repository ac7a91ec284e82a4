"""Events: closed forms, an independent integrator, the saltation matrix, endless bounces, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.compose_effects import forced, with_effect
from fitters.integrator.event_times import event_times
from fitters.ode import sensitivity, simulate
from iris_sysid.errors import FitError
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.types import Event

BALL = MODELS["bouncing-ball"]
DROP = {"restitution": 0.8, "floor": 0.03, "gravity": 9.81, "z_0": 1.03, "vz_0": 0.0}


def bounced(t_s, restitution=0.8, floor=0.03, gravity=9.81, z_0=1.03, vz_0=0.0):
    """Height of a bouncing ball by its parabolas, until its speed is below that at which it settles."""
    up = np.sqrt(vz_0**2 + 2 * gravity * (z_0 - floor))
    landing, height = (vz_0 + up) / gravity, []
    start, speed, base = 0.0, vz_0, z_0
    for t in t_s:
        while t > landing and up > 0:
            start, base = landing, floor
            up = speed = up * restitution if up * restitution > 1e-3 else 0.0
            landing = start + 2 * speed / gravity
        height.append(base + speed * (t - start) - gravity / 2 * (t - start) ** 2 if up > 0 else floor)
    return np.array(height)


@pytest.mark.parametrize("fps", [8, 60, 1000])
def test_bounces_equal_their_parabolas_at_any_frame_rate_and_end_on_the_floor(fps):
    t_s = np.arange(6 * fps) / fps
    observed = simulate(BALL, t_s, DROP).observed[:, 0]
    np.testing.assert_allclose(observed, bounced(t_s), atol=1e-12)
    assert observed[-1] == pytest.approx(0.03, abs=1e-12)


def test_times_of_the_bounces_are_those_of_the_closed_form():
    events = event_times(BALL, np.arange(240) / 60, DROP)
    first = np.sqrt(2 / 9.81)
    flights = 2 * first * 0.8 ** np.arange(1, 12)
    np.testing.assert_allclose([event.t_s for event in events[:12]], first + np.cumsum([0, *flights]), atol=1e-12)
    assert {event.name for event in events} == {"impact"}


@pytest.mark.parametrize("name", ["restitution", "floor", "gravity", "z_0", "vz_0"])
def test_sensitivities_through_many_bounces_equal_those_of_the_closed_form(name):
    t_s = np.arange(150) / 60  # 7 bounces
    slopes = sensitivity(BALL, t_s, DROP, [name])[:, 0, 0]
    step = 1e-6
    above, below = (bounced(t_s, **(DROP | {name: DROP[name] + sign * step})) for sign in (1, -1))
    np.testing.assert_allclose(slopes, (above - below) / (2 * step), atol=1e-5 * np.abs(slopes).max())


def test_sensitivity_after_one_impact_is_the_saltation_matrix_times_that_before():
    gravity, restitution, t_s = 9.81, 0.8, np.array([0.0, 0.6])
    first = np.sqrt(2 / gravity)
    speed = gravity * first
    # S = dR/dx + (f+ - dR/dx f-) (dg/dx) / (dg/dx f-), with R = (z, -e v), g = z, f = (v, -gravity)
    jump = np.diag([1.0, -restitution])
    before, after = np.array([-speed, -gravity]), np.array([restitution * speed, -gravity])
    saltation = jump + np.outer(after - jump @ before, [1.0, 0.0]) / before[0]
    flight = lambda t: np.array([[1.0, t], [0.0, 1.0]])  # noqa: E731
    expected = flight(0.6 - first) @ saltation @ flight(first)
    slopes = sensitivity(replace(BALL, observed=BALL.states, observe=None), t_s, DROP, ["z_0", "vz_0"])[1]
    np.testing.assert_allclose(slopes, expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("scene", "setting"),
    [
        (f"{kind}", f"pendulum_{angle}")
        for kind in ("two-moving-pendulums", "two-moving-pendulum-one-static")
        for angle in (45, 90)
    ],
)
def test_colliding_pendulums_equal_the_twin_also_while_they_stay_together(scene, setting):
    truth = plan_clip(scene, setting=setting, duration_s=8.0, overrides={"restitution": 0.6}).truth
    bodies = [truth.body(name).query("phase != 'hand'") for name in "12"]
    known = {name: parameter.value for name, parameter in truth.parameters.items()}
    start = {f"theta{k}_0": float(body.theta_rad.iloc[0]) for k, body in enumerate(bodies, 1)}
    start |= {f"omega{k}_0": float(body.omega_rad_s.iloc[0]) for k, body in enumerate(bodies, 1)}
    values = {name: known[name] for name in ("length_1", "length_2", "damping_1", "damping_2", "restitution")} | start
    values["mass_ratio"] = (known["ball_radius_2"] / known["ball_radius_1"]) ** 3
    values["contact_ratio"] = (known["ball_radius_1"] + known["ball_radius_2"]) / known["length_1"]
    values["pivot_ratio"] = known["pivot_gap"] / known["length_1"]
    t_s = bodies[0].t_s.to_numpy()
    observed = simulate(MODELS["pendulum-impact"], t_s, values).observed
    np.testing.assert_allclose(observed, np.column_stack([body.theta_rad for body in bodies]), atol=2e-5)
    mine = [event.t_s for event in event_times(MODELS["pendulum-impact"], t_s, values) if event.name == "impact"]
    theirs = [t for t, name in truth.events if name == "impact"]
    np.testing.assert_allclose(mine[:5], theirs[:5], atol=1e-6)


def test_balls_that_start_beyond_the_horizontal_do_not_count_as_overlapping():
    values = {"length_1": 0.5, "length_2": 0.5, "mass_ratio": 1.0, "restitution": 0.8, "contact_ratio": 0.12}
    start = {"theta1_0": -1.8, "theta2_0": 1.8, "omega1_0": 0.0, "omega2_0": 0.0}
    events = event_times(MODELS["pendulum-impact"], np.arange(60) / 60, values | start)
    assert 0.4 < events[0].t_s < 0.5


def test_slack_cord_equals_free_flight_then_a_pendulum():
    values = {"length": 0.5, "pivot_x": 0.0, "pivot_z": 0.0, "damping": 0.0, "gravity": 9.81}
    start = {"x_0": 0.4, "z_0": 0.0, "vx_0": 0.0, "vz_0": 0.0}
    t_s = np.arange(90) / 60
    observed = simulate(MODELS["slack-cord"], t_s, values | start).observed
    (taut,) = event_times(MODELS["slack-cord"], t_s, values | start)
    assert taut.t_s == pytest.approx(np.sqrt(2 * 0.3 / 9.81))  # it falls by 0.3 m until 0.4^2 + 0.3^2 = 0.5^2
    flying = t_s < taut.t_s
    np.testing.assert_allclose(
        observed[flying], np.column_stack([0.4 + 0 * t_s, -9.81 / 2 * t_s**2])[flying], atol=1e-12
    )
    angle, omega = np.arctan2(0.4, 0.3), -9.81 * taut.t_s * 0.8 / 0.5  # the cord takes the speed along it
    swing = solve_ivp(
        lambda t, y: [y[1], -9.81 / 0.5 * np.sin(y[0])], (taut.t_s, 1.5), [angle, omega], rtol=1e-12, atol=1e-13,
        t_eval=t_s[~flying],
    )  # fmt: skip
    expected = 0.5 * np.column_stack([np.sin(swing.y[0]), -np.cos(swing.y[0])])
    np.testing.assert_allclose(observed[~flying], expected, atol=1e-8)


def test_cord_goes_slack_over_the_top_and_jerks_taut_again():
    values = {"length": 0.5, "pivot_x": 0.0, "pivot_z": 0.0, "damping": 0.0}
    start = {"x_0": 0.0, "z_0": -0.4999, "vx_0": 4.2, "vz_0": 0.0}  # not enough to go round: 5 g L = 4.95^2
    events = event_times(MODELS["slack-cord"], np.arange(60) / 60, values | start)
    assert [event.name for event in events[:3]] == ["taut", "slack", "taut"]


@pytest.mark.parametrize("speed", [1.5, -1.5])
def test_block_stops_where_dry_friction_holds_it(speed):
    t_s = np.arange(120) / 60
    observed = simulate(
        MODELS["stopping-block"], t_s, {"friction": 2.0, "pull": 0.5, "s_0": 0.0, "v_0": speed}
    ).observed
    brake = 2.0 - 0.5 * np.sign(speed)
    moved = np.minimum(t_s, abs(speed) / brake)
    expected = np.sign(speed) * (abs(speed) * moved - brake * moved**2 / 2)
    np.testing.assert_allclose(observed[:, 0], expected, atol=1e-9)


def test_block_that_friction_cannot_hold_turns_and_slides_back():
    values = {"friction": 0.5, "pull": 2.0, "s_0": 0.0, "v_0": -1.0}
    observed = simulate(MODELS["stopping-block"], [0.0, 0.4, 1.4], values).observed[:, 0]  # brakes with 2.5, then 1.5
    np.testing.assert_allclose(observed, [0.0, -0.2, -0.2 + 1.5 / 2], atol=1e-9)


def test_struck_chain_keeps_its_momentum_and_loses_the_energy_that_restitution_says():
    values = {"damping_1": 0.0, "damping": 0.0, "restitution": 0.5, "mass_ratio": 0.25, "contact_12": 0.1}
    values |= {"contact_23": 0.1, "z1_0": 0.0, "z2_0": 0.3, "z3_0": 5.0, "v1_0": 1.0, "v2_0": 0.0, "v3_0": 0.0}
    speed = simulate(MODELS["impact-chain"], [0.0, 0.1, 0.5], values).states[-1, 3:]
    assert speed @ [1.0, 0.25, 0.25] == pytest.approx(1.0)
    assert speed[1] - speed[0] == pytest.approx(0.5)


def test_effect_of_size_zero_leaves_a_motion_with_impacts_as_it_is():
    model = with_effect(BALL, EFFECTS["quadratic-drag"])
    t_s = np.arange(90) / 60
    plain = simulate(BALL, t_s, DROP).observed
    np.testing.assert_allclose(simulate(model, t_s, DROP).observed, plain, atol=1e-12)
    pushed = simulate(forced(BALL), t_s, DROP, inputs=np.zeros((t_s.size, 1))).observed
    np.testing.assert_allclose(pushed, plain, atol=1e-12)


def test_input_force_acts_between_the_bounces():
    t_s = np.arange(90) / 60
    lifted = simulate(forced(BALL), t_s, DROP, inputs=np.full((t_s.size, 1), 1.0)).observed[:, 0]
    np.testing.assert_allclose(lifted, bounced(t_s, gravity=8.81), atol=1e-10)


def test_events_that_pile_up_without_end_give_nan_from_there_on():
    endless = replace(BALL, events=(Event("impact", BALL.events[0].crossing, _never_settles),))
    observed = simulate(endless, np.arange(130) / 60, {**DROP, "restitution": 0.5}).observed[:, 0]
    assert np.isfinite(observed[:60]).all()
    assert np.isnan(observed[-1])


def _never_settles(t, state, params):
    return state[0], -params[0] * state[1], 0.0


def test_event_that_numba_cannot_compile_is_refused_with_what_it_must_look_like():
    broken = replace(BALL, events=(Event("impact", lambda t, state, params: [state[0]][0] + "x", _never_settles),))
    with pytest.raises(FitError, match=r"numba cannot compile the events of model 'bouncing-ball'.*state ending with"):
        simulate(broken, [0.0, 1.0], DROP)


def test_event_times_of_a_model_without_events_are_refused():
    with pytest.raises(FitError, match="'pendulum' has no events"):
        event_times(MODELS["pendulum"], [0.0, 1.0], {})


def test_event_times_need_every_value():
    with pytest.raises(FitError, match="needs a value for z_0"):
        event_times(BALL, [0.0, 1.0], {"vz_0": 0.0})


# --------------------------------------------------------------------------- friction along the floor


SKIP = {
    "restitution": 0.8,
    "friction": 0.08,
    "floor": 0.0,
    "x_0": 0.0,
    "z_0": 1.0,
    "vx_0": 3.0,
    "vz_0": 0.0,
    "rim_0": 0.0,
}


def skipped(t_s, **changes):
    return simulate(MODELS["skipping-ball"], t_s, SKIP | {"gravity": 9.81, "rim_0": 0.0} | changes).states


def test_bounce_slips_by_the_law_of_friction_then_grips_and_the_ball_rolls():
    states = skipped(np.arange(0, 3.0, 1e-2))
    speeds = states[np.flatnonzero(np.diff(states[:, 2], prepend=np.nan) != 0), 2]
    landing = np.sqrt(2 * 9.81)
    slipped = 3.0 - 0.08 * 1.8 * landing
    assert speeds[:2] == pytest.approx([3.0, slipped], abs=1e-9)
    rim = 0.08 * 1.8 * landing / 0.4
    assert speeds[2:] == pytest.approx((slipped + 0.4 * rim) / 1.4, abs=1e-9)  # it grips: rim and centre go alike
    assert states[-1, 4] == pytest.approx(states[-1, 2], abs=1e-9)


@pytest.mark.parametrize(("friction", "spin"), [(0.05, 0.0), (0.3, 9.0), (2.0, -4.0), (0.0, 5.0)])
def test_bounces_keep_the_angular_momentum_about_the_point_of_contact(friction, spin):
    states = skipped(np.arange(0, 2.5, 1e-2), friction=friction, rim_0=spin)
    np.testing.assert_allclose(states[:, 2] + 0.4 * states[:, 4], 3.0 + 0.4 * spin, atol=1e-9)
    power = states[:, 2] ** 2 + 0.4 * states[:, 4] ** 2
    assert np.all(np.diff(power) < 1e-9)  # friction takes energy only


def test_without_friction_the_ball_bounces_as_one_that_is_dropped():
    t_s = np.arange(0, 2.0, 1e-2)
    dropped = simulate(BALL, t_s, DROP | {"floor": 0.0, "z_0": 1.0}).observed[:, 0]
    np.testing.assert_allclose(skipped(t_s, friction=0.0)[:, 1], dropped, atol=1e-9)
