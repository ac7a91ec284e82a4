"""No result depends on the zero of the clock, the unit of length, the direction of an axis, or the order of bodies."""

import re
from dataclasses import replace

import numpy as np
import pytest

from fitters.compose_effects import with_effect
from fitters.effect_sensitivity import shaped
from fitters.ode import FitOptions, fit, simulate
from fitters.ode.fit_problem import known_values
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Trajectory

NOISE = 1e-3  # of the motion
METRES = re.compile(r"(?<![a-zA-Z])m(?:\^(-?[\d.]+))?(?![a-zA-Z])")
EITHER_WAY = ("pendulum", "linear-pendulum", "linear-oscillator", "coupled-oscillators", "coupled-pendulums")
PAIRS = ("coupled-oscillators", "coupled-pendulums")
QUICK = FitOptions(multistart=0)
LONG = ("contact-chain", "impact-chain", "pendulum-impact", "slack-cord")  # seconds each
DRIVEN = [name for name, model in MODELS.items() if model.inputs]
MODELS_TESTED = [pytest.param(name, marks=pytest.mark.slow) if name in LONG else name for name in MODELS]


def metres_in(unit: str) -> float:
    """The power of the metre in a unit: -1 in 1/m, 0.5 in m^0.5/s."""
    above, _, below = unit.partition("/")
    power = sum(float(found or 1) for found in METRES.findall(above))
    return power - sum(float(found or 1) for found in METRES.findall(below))


def clip_of(model, position, t_s, inputs=None):
    unknown, valid = np.full_like(position, np.nan), np.ones(t_s.size, bool)
    return Trajectory(t_s, model.observed, position, unknown, valid, model.inputs, inputs)


def measured(model):
    example = model.example
    inputs = example.driven(example.t_s)
    position = simulate(model, example.t_s, dict(example.values), inputs=inputs).observed
    noise = np.random.default_rng(3).standard_normal(position.shape)
    return position + NOISE * np.std(position, axis=0) * noise


def constants(model):
    """The constants that the example gives, and their own defaults where those are numbers."""
    known = {p.name: p.default for p in model.parameters if p.constant and p.default is not None}
    return known | {
        p.name: model.example.values[p.name] for p in model.parameters if p.constant and p.name in model.example.values
    }


def fitted(model, position, t_s, fixed, factor=1.0):
    """A fit that starts near the truth; ``factor`` is that of all lengths."""
    units = model.units()
    start = {n: v * factor ** metres_in(units[n]) for n, v in model.example.values.items() if n not in fixed}
    clip = clip_of(model, position, t_s, model.example.driven(model.example.t_s))
    result = fit(clip, model, fixed=fixed, start=start, options=QUICK)
    assert result.usable, result.message
    return result


def assert_same(first, second, scale):
    """Values, standard errors and intervals agree to a small part of their error, after scaling by name."""
    assert first.status == second.status
    for name in first.free:
        before, after, by = first.estimates[name], second.estimates[name], scale(name)
        if not (np.isfinite(before.stderr) and before.stderr > 0):
            continue
        assert after.value / by == pytest.approx(before.value, abs=0.05 * before.stderr), name
        assert after.stderr / abs(by) == pytest.approx(before.stderr, rel=0.05), name


@pytest.mark.parametrize("name", MODELS_TESTED)
def test_fit_is_the_same_whenever_the_clock_starts(name):
    model, t_s = MODELS[name], MODELS[name].example.t_s
    position, known = measured(model), constants(model)
    assert_same(fitted(model, position, t_s, known), fitted(model, position, t_s + 60.0, known), lambda name: 1.0)


@pytest.mark.parametrize("factor", [100.0, 1e3])
@pytest.mark.parametrize("name", [name for name in MODELS_TESTED if name not in DRIVEN])  # N holds a metre
def test_fit_is_the_same_in_any_unit_of_length(name, factor):
    model, t_s = MODELS[name], MODELS[name].example.t_s
    model = replace(
        model, parameters=tuple(replace(p, lower=unbounded(p, -1), upper=unbounded(p, 1)) for p in model.parameters)
    )
    units, known = model.units(), constants(model)
    columns = np.array([factor ** metres_in(quantity.unit) for quantity in model.observed])
    converted = {n: v * factor ** metres_in(units[n]) for n, v in known.items()}
    first = fitted(model, measured(model), t_s, known)
    second = fitted(model, measured(model) * columns, t_s, converted, factor)
    assert_same(first, second, lambda name: factor ** metres_in(units[name]))


def unbounded(parameter, side):
    """Bounds in metres suit metres: away with them, and with none else."""
    bound = parameter.lower if side < 0 else parameter.upper
    return (
        bound if metres_in(parameter.unit) == 0 or bound == 0 else (1e-9 if bound > 0 and side < 0 else side * np.inf)
    )


@pytest.mark.parametrize("name", EITHER_WAY)
def test_fit_is_the_same_with_the_axis_the_other_way_round(name):
    model, t_s = MODELS[name], MODELS[name].example.t_s
    position, known = measured(model), constants(model)
    flipped = {f"{state.name}_0" for state in model.states}
    mirrored = replace(
        model,
        example=replace(model.example, values={n: -v if n in flipped else v for n, v in model.example.values.items()}),
    )
    second = fitted(mirrored, -position, t_s, known)
    assert_same(fitted(model, position, t_s, known), second, lambda name: -1.0 if name in flipped else 1.0)


@pytest.mark.parametrize("name", PAIRS)
def test_shared_values_are_the_same_with_the_bodies_the_other_way_round(name):
    model, t_s = MODELS[name], MODELS[name].example.t_s
    position, known = measured(model), constants(model)
    swap = {n: other_body(n) for n in model.example.values}
    values = {swap[n]: v for n, v in model.example.values.items()}
    swapped = replace(model, example=replace(model.example, values=values))
    second = fitted(swapped, position[:, ::-1].copy(), t_s, {swap.get(n, other_body(n)): v for n, v in known.items()})
    first = fitted(model, position, t_s, known)
    for each in first.free:
        before, after = first.estimates[each], second.estimates[other_body(each)]
        assert after.value == pytest.approx(before.value, abs=0.05 * before.stderr), each
        assert after.stderr == pytest.approx(before.stderr, rel=0.05), each


def other_body(name):
    """length1 is length2 of the other, theta1_0 is theta2_0."""
    return re.sub(r"[12](?=_0$|$)", lambda found: {"1": "2", "2": "1"}[found.group()], name)


# --------------------------------------------------------------------------- effects

T_S = np.arange(200) / 50
COURSE = 0.3 + 0.25 * np.sin(5.0 * T_S + 0.4) * np.exp(-0.1 * T_S)
VELOCITY, BASE = np.gradient(COURSE, T_S), np.gradient(np.gradient(COURSE, T_S), T_S)
FORCES = [effect for effect in EFFECTS.values() if effect.acceleration is not None]
HIDDEN = 0.3


def forces(effect, t_s, course, velocity, base, unit="m", factor=1.0):
    """The force (shapes, n) of an effect of size 0.5 in each shape to try; lengths are in 1 / factor metres."""
    shapes = [()] if effect.trials is None else effect.trials(t_s, course[:, None])
    rows = []
    for shape in shapes:
        tried = shaped(effect, shape)
        size = 0.5 * factor ** metres_in(effect.parameters[0].unit.replace("{x}", unit))
        params = (size, *(parameter.default for parameter in tried.parameters[1:]))
        hidden = [HIDDEN * factor ** metres_in(state.unit.replace("{x}", unit)) for state in effect.hidden]
        more = (tuple(hidden),) if hidden else ()
        force = effect.acceleration(t_s, course, velocity, np.abs(velocity), base, params, *more)
        rows.append(force * np.ones_like(course))
    return np.array(rows)


@pytest.mark.parametrize("effect", FORCES, ids=lambda effect: effect.name)
@pytest.mark.parametrize("factor", [1e2, 1e3])
def test_force_of_an_effect_is_the_same_in_any_unit_of_length(effect, factor):
    first = forces(effect, T_S, COURSE, VELOCITY, BASE)
    second = forces(effect, T_S, *(factor * each for each in (COURSE, VELOCITY, BASE)), factor=factor)
    np.testing.assert_allclose(second / factor, first, rtol=1e-6, atol=1e-6 * np.max(np.abs(first)))


@pytest.mark.parametrize("effect", FORCES, ids=lambda effect: effect.name)
def test_force_of_an_effect_is_the_same_whenever_the_clock_starts(effect):
    first = forces(effect, T_S, COURSE, VELOCITY, BASE)
    np.testing.assert_allclose(forces(effect, T_S + 60.0, COURSE, VELOCITY, BASE), first, atol=1e-6)


@pytest.mark.parametrize(
    "effect",
    [e for e in FORCES if e.applies(MODELS["pendulum"]) or e.applies(MODELS["incline"])],
    ids=lambda effect: effect.name,
)
def test_force_of_an_effect_with_the_axis_the_other_way_round_is_one_that_is_tried(effect):
    """Up to its sign, and to dry friction on the whole way: more friction beyond a seam is less friction before it."""
    swing = COURSE - 0.3
    first = forces(effect, T_S, swing, VELOCITY, BASE)
    second = -forces(effect, T_S, -swing, -VELOCITY, -BASE)
    brakes = EFFECTS["coulomb-friction"]
    basis = np.vstack([first, forces(brakes, T_S, swing, VELOCITY, BASE)])
    left = second - second @ np.linalg.pinv(basis, rcond=1e-9) @ basis
    assert np.max(np.abs(left)) < 1e-3 * np.max(np.abs(second))


def test_shape_that_a_diagnosis_takes_from_the_motion_holds_where_the_scale_is_not_known():
    """A constant in metres is unknown in a clip in pixels; a speed that was taken from that clip is not."""
    model = with_effect(MODELS["coasting-ball"], EFFECTS["coulomb-friction"])
    t_s = MODELS["coasting-ball"].example.t_s
    way = simulate(MODELS["coasting-ball"], t_s, dict(MODELS["coasting-ball"].example.values)).observed
    pixels = tuple(replace(quantity, unit="px") for quantity in model.observed)
    clip = replace(clip_of(model, 1e3 * way, t_s), quantities=pixels)
    assert known_values(model, clip, {}, ())["coulomb_turnover"].value == 0.03
