"""Effects of the world against SciPy's own integration of the physics: each is seen, and its size comes out right."""

from dataclasses import dataclass, field, replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.compose_effects import with_effect, with_effects
from fitters.effect_sensitivity import shaped
from fitters.effects._times import own_rate
from fitters.ode import FitOptions, fit
from iris_sysid.diagnosis.score_test import screen
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import OdeModel, Quantity, Trajectory

GRAVITY = 9.80665
T_S = np.arange(900) / 60
NOISE = 1e-5  # rad or m
NEW = (
    "zero-wander",
    "even-reading",
    "odd-reading",
    "wrong-pivot",
    "exposure-lag",
    "elliptical-swing",
    "buoyancy",
    "drag-crisis",
    "clearance",
)


def integrated(slopes, start, t_s=T_S):
    found = solve_ivp(slopes, (0.0, t_s[-1]), start, t_eval=t_s, rtol=1e-10, atol=1e-12, max_step=0.02)
    assert found.success
    return found.y


def swing(t_s=T_S, length=0.8, damping=0.05, start=0.7):
    def slopes(t, state):
        return state[1], -damping * state[1] - GRAVITY / length * np.sin(state[0])

    return integrated(slopes, (start, 0.0), t_s)[0]


def spring(t_s=T_S, start=0.2):
    return integrated(lambda t, state: (state[1], -0.1 * state[1] - 20.0 * state[0]), (start, 0.0), t_s)[0]


def wandering():
    return swing() + 0.01 * np.cos(2 * np.pi * 0.13 * T_S + 0.7)


def read_obliquely():
    position = spring()
    return position + 0.3 * position**2


def read_off_scale():
    position = spring()
    return position + 0.8 * position**3


def about_another_pivot():
    """The direction of the bob as seen from a point 5 % of the cord to the right of the pivot, and 3 % above it."""
    angle = swing()
    bob, point = np.array([np.sin(angle), -np.cos(angle)]), np.array([0.05, 0.03])
    seen = bob - point[:, None]
    return np.arctan2(seen[0], -seen[1])


def two_bodies(late_s=0.01):
    def slopes(t, state):
        first, second = state[:2]
        return (*state[2:], -9.0 * first - 2.0 * (first - second), -9.0 * second - 2.0 * (second - first))

    found = solve_ivp(slopes, (-1.0, T_S[-1]), (0.2, -0.05, 0.3, 0.0), dense_output=True, rtol=1e-10, atol=1e-12)
    return np.column_stack([found.sol(T_S)[0], found.sol(T_S - late_s)[1]])


def on_a_sphere(width=0.04):
    """The plane's angle of a bob on a cord of 1 m that swings 0.2 rad far, and ``width`` sideways."""

    def slopes(t, state):
        position, velocity = state[:3], state[3:]
        tension = velocity @ velocity - GRAVITY * position[2]  # over mass and length
        return np.concatenate([velocity, -tension * position - [0.0, 0.0, GRAVITY]])

    start = (np.sin(0.2), 0.0, -np.cos(0.2), 0.0, width * np.sqrt(GRAVITY), 0.0)
    x, _, z, *_ = integrated(slopes, start, np.arange(2400) / 60)
    return np.arctan2(x, -z)


def in_a_fluid(lightness=0.1):
    """A sphere whose density is 10 times the fluid's: it also sets half of the fluid that it displaces in motion."""
    pull = -(1.0 - lightness) * GRAVITY / (1.0 + lightness / 2)
    return integrated(lambda t, state: (state[1], pull), (1.5, 0.0), np.arange(60) / 120)[0]


def in_a_crisis(critical=15.0):
    def slopes(t, state):
        speed = np.hypot(*state[2:])
        drag = 0.004 * speed * (1.0 - 0.75 / (1.0 + np.exp(-(speed - critical) / (0.1 * critical))))
        return *state[2:], -drag * state[2], -drag * state[3] - GRAVITY

    return integrated(slopes, (0.0, 1.0, 4.0, 25.0), np.arange(400) / 100)[:2].T


def with_play(gap=0.02):
    def slopes(t, state):
        position, velocity = state
        return velocity, -20.0 * (position - np.clip(position, -gap, gap))

    return integrated(slopes, (0.2, 0.0))[0]


@dataclass(frozen=True)
class Case:
    effect: str
    model: str
    seen: object
    truth: dict[str, float]
    within: float  # of the size, relative
    rate_hz: float = 60.0
    fixed: dict[str, float] = field(default_factory=dict)
    sensor: str = "unknown"


CASES = (
    Case("zero-wander", "pendulum", wandering, {"zero_wander": 0.01, "wander_rate": 2 * np.pi * 0.13}, 0.01),
    Case("even-reading", "linear-oscillator", read_obliquely, {"even_reading": 0.3}, 0.02, sensor="encoder"),
    Case("odd-reading", "linear-oscillator", read_off_scale, {"odd_reading": 0.8}, 0.02, sensor="encoder"),
    Case("wrong-pivot", "pendulum", about_another_pivot, {"wrong_pivot": np.hypot(0.05, 0.03)}, 0.02),
    Case("exposure-lag", "coupled-oscillators", two_bodies, {"exposure_lag": 0.01}, 0.02, sensor="gauge"),
    Case("elliptical-swing", "pendulum", on_a_sphere, {"elliptical_swing": 0.04}, 0.04),
    Case("buoyancy", "free-fall", in_a_fluid, {"buoyancy": 1 - 0.9 / 1.05}, 0.01, 120.0, {"gravity": GRAVITY}),
    Case("drag-crisis", "projectile", in_a_crisis, {"drag_crisis": 0.004, "crisis_speed": 15.0}, 0.01, 100.0),
    Case("clearance", "linear-oscillator", with_play, {"clearance": 1.0, "clearance_gap": 0.02}, 0.07, sensor="gauge"),
)


def clip_of(case):
    seen = np.asarray(case.seen()).reshape(-1, len(MODELS[case.model].observed))
    seen = seen + NOISE * np.random.default_rng(0).standard_normal(seen.shape)
    t_s, valid = np.arange(len(seen)) / case.rate_hz, np.ones(len(seen), bool)
    return Trajectory(t_s, MODELS[case.model].observed, seen, np.full_like(seen, np.nan), valid, sensor=case.sensor)


def constants_of(model):
    return {parameter.name for parameter in model.parameters if parameter.constant}


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect)
def test_effect_is_seen_in_what_the_physics_gives_and_its_size_is_right(case):
    model, clip, effect = MODELS[case.model], clip_of(case), EFFECTS[case.effect]
    plain = fit(clip, model, fixed=case.fixed)
    score = screen([effect], plain, clip).scores[case.effect]
    assert score.gain > 0.3  # to first order, along a motion that may be far from the true one
    start = dict(zip([parameter.name for parameter in effect.parameters], (score.size, *score.shape), strict=True))
    start |= {name: plain.estimates[name].value for name in plain.free}
    composed = with_effect(model, shaped(effect, score.shape))
    start = {name: value for name, value in start.items() if name not in constants_of(composed)}
    found = fit(clip, composed, fixed=case.fixed, start=start, options=FitOptions(multistart=0))
    assert found.usable, found.message
    assert max(found.rms) < 0.1 * max(plain.rms)
    for name, value in case.truth.items():
        assert abs(found.estimates[name].value) == pytest.approx(value, rel=case.within), name
    fitted = [found.estimates[parameter.name].value for parameter in effect.parameters]
    assert effect.sensible is None or effect.sensible(clip.t_s, fitted)


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.effect)
def test_few_shapes_are_tried(case):
    clip, effect = clip_of(case), EFFECTS[case.effect]
    shapes = [()] if effect.trials is None else effect.trials(clip.t_s, clip.position)
    assert 1 <= len(shapes) <= 40
    assert all(len(shape) in (0, len(effect.parameters) - 1) for shape in shapes)


@pytest.mark.parametrize("case", [case for case in CASES if case.effect == "drag-crisis"], ids=["drag-crisis"])
def test_drag_crisis_is_not_the_plain_drag_of_any_power(case):
    clip, model = clip_of(case), MODELS[case.model]
    drag = EFFECTS["quadratic-drag"]
    free = replace(drag, parameters=tuple(replace(p, constant=p.role == "shape") for p in drag.parameters))
    plain, crisis = (fit(clip, with_effect(model, effect)) for effect in (free, EFFECTS["drag-crisis"]))
    assert max(plain.rms) > 10 * max(crisis.rms)


def test_wander_is_slower_than_the_motion_and_more_than_a_drift():
    wander = EFFECTS["zero-wander"]
    shapes = wander.trials(T_S, swing()[:, None])
    own = shapes[0][-1]
    assert own / (2 * np.pi) == pytest.approx(np.sqrt(GRAVITY / 0.8) / (2 * np.pi), rel=0.05)
    assert all(wander.sensible(T_S, (0.01, *shape)) for shape in shapes)
    assert not wander.sensible(T_S, (0.01, own, 0.0, 0.0, own))
    assert not wander.sensible(T_S, (0.01, 0.1, 0.0, 0.0, own))


@pytest.mark.parametrize("hertz", [0.3, 1.1, 7.0])
def test_own_rate_is_that_of_a_damped_swing_with_gaps_whose_zero_drifts(hertz):
    swinging = np.exp(-0.05 * T_S) * np.cos(2 * np.pi * hertz * T_S + 0.3) + 0.1 * T_S + 2.0
    swinging[200:220] = np.nan
    assert own_rate(T_S + 5.0, swinging[:, None]) == pytest.approx(2 * np.pi * hertz, rel=0.03)


def test_own_rate_of_a_fall_is_two_cycles_a_clip():
    assert own_rate(T_S, (1.0 - T_S**2)[:, None]) == pytest.approx(2 * np.pi * 2.0 / T_S[-1])


@pytest.mark.parametrize(("name", "size", "reach"), [("even-reading", 0.5, 0.7), ("odd-reading", 0.5, 0.9)])
def test_reading_that_is_far_off_is_no_error_of_a_reading(name, size, reach):
    sensible = EFFECTS[name].sensible
    assert not sensible(T_S, (size, 0.0, reach))
    assert sensible(T_S, (size, 0.0, reach / 2))


def test_angle_about_a_wrong_pivot_is_that_of_the_points():
    angle = np.linspace(-1.5, 1.5, 31)[:, None]
    distance, direction = 0.2, 0.6
    seen = EFFECTS["wrong-pivot"].observe(angle[:, 0], angle, angle, np.array([distance, direction]))
    right = np.sin(angle) - distance * np.cos(direction), np.cos(angle) + distance * np.sin(direction)
    np.testing.assert_allclose(seen, np.arctan2(*right), atol=1e-12)


def test_wrong_pivot_of_an_arm_that_turns_around_has_no_jumps():
    angle = np.linspace(0.0, 20.0, 400)[:, None]
    seen = EFFECTS["wrong-pivot"].observe(angle[:, 0], angle, angle, np.array([0.1, 0.0]))
    assert np.max(np.abs(seen - angle)) < 0.11


def test_lag_makes_sense_only_where_something_fixes_the_clock():
    lag = EFFECTS["exposure-lag"]
    assert not any(lag.applies(MODELS[name]) for name in ("pendulum", "projectile", "torricelli"))
    assert lag.applies(MODELS["coupled-oscillators"])
    assert lag.applies(driven())


def driven():
    return OdeModel(
        name="driven",
        summary="a body on a spring that is driven",
        equation=r"\ddot x = F - \zeta \dot x - k x",
        source="the test",
        states=(Quantity("x", "m"), Quantity("v", "m/s")),
        parameters=MODELS["linear-oscillator"].parameters,
        observed=(Quantity("x", "m"),),
        inputs=(Quantity("force", "m/s^2"),),
        rhs=lambda t, state, params, inputs: (
            state[1],
            inputs[0] - params[1] * state[1] - params[0] * state[0],
        ),
        guess=lambda trajectory: {"stiffness": 8.0, "damping": 0.3, "x_0": 0.0, "v_0": 0.0},
    )


def test_lag_of_what_is_driven_is_its_delay():
    def push(t):
        return np.sin(1.3 * t) + 0.5 * np.sin(4.1 * t)

    found = solve_ivp(
        lambda t, state: (state[1], push(t) - 0.4 * state[1] - 9.0 * state[0]),
        (-1.0, T_S[-1]), (0.1, 0.0), dense_output=True, rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    seen = found.sol(T_S - 0.01)[0][:, None] + NOISE * np.random.default_rng(0).standard_normal((T_S.size, 1))
    model = driven()
    clip = Trajectory(
        T_S, model.observed, seen, np.full_like(seen, np.nan), np.ones(T_S.size, bool), model.inputs, push(T_S)[:, None]
    )
    fitted = fit(clip, with_effects(model, ["exposure-lag"]))
    assert fitted.estimates["exposure_lag"].value == pytest.approx(0.01, rel=0.05)


@pytest.mark.parametrize(("model", "known"), [("pendulum", {"length": 0.8}), ("free-fall", {"gravity": GRAVITY})])
def test_buoyancy_is_seen_where_length_or_gravity_is_known_and_only_there(model, known):
    case = Case("buoyancy", model, swing if model == "pendulum" else in_a_fluid, {}, 0.0)
    clip = clip_of(case)
    for fixed, visible in ((known, True), ({}, False)):
        scores = screen([EFFECTS["buoyancy"]], fit(clip, MODELS[model], fixed=fixed), clip).scores
        assert (scores["buoyancy"].gain > 0) == visible


def test_buoyancy_does_not_make_a_falling_body_roll():
    assert not EFFECTS["rolling-inertia"].applies(MODELS["free-fall"])
    assert not EFFECTS["rolling-inertia"].applies(MODELS["projectile"])
    assert EFFECTS["rolling-inertia"].applies(MODELS["incline"])
    assert not EFFECTS["buoyancy"].applies(MODELS["incline"])


def test_newcomers_are_less_plausible_than_what_is_usual():
    usual = [EFFECTS[name] for name in ("quadratic-drag", "coulomb-friction", "camera-tilt", "cubic-stiffness")]
    assert max(EFFECTS[name].plausibility for name in NEW) < min(effect.plausibility for effect in usual)
