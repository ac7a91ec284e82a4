"""The force that a model lacks, against forces that SciPy integrates and the library does not know."""

import numpy as np
import pytest
from scipy.interpolate import CubicSpline

from fitters.ode import FitRequest, fit
from iris_sysid import MODELS, Quantity, Trajectory, diagnose
from iris_sysid.diagnosis.missing_force import missing_force, missing_forces, with_form
from validation.independent import effects
from validation.independent.motions import MOTIONS, integrate
from validation.independent.noise import NOISES

# a force on each motion, well above the noise: (motion, force, size, shape)
HIDDEN = {
    "pendulum, |v|^1.5": ("pendulum", effects.power_drag, 0.05, {"power": 1.5}),
    "pendulum, |v|^2": ("pendulum", effects.power_drag, 0.05, {"power": 2.0}),
    "pendulum, cubic": ("pendulum", effects.cubic, 0.3, {}),
    "pendulum, sine": ("pendulum", effects.sinusoid, 0.03, {"rate": 5.3, "phase": 1.0, "start": 0.0}),
    "pendulum, drift": ("pendulum", effects.growing_force, 0.002, {"start": 0.0}),
    "oscillator, |v|^1.5": ("linear-oscillator", effects.power_drag, 0.1, {"power": 1.5}),
    "incline, |v|^2": ("incline", effects.power_drag, 0.02, {"power": 2.0}),
    "throw, |v|^1.5": ("projectile", effects.power_drag, 0.01, {"power": 1.5}),
    "tank, cubic": ("torricelli", effects.cubic, 0.02, {}),
    "decay, sine": ("exponential-decay", effects.sinusoid, 3.0, {"rate": 5.3, "phase": 1.0, "start": 0.0}),
}
SEEDS = range(4)


def filmed(model, term, size, shape, seed, noise="white"):
    """A noisy table of a motion under a hidden force, and that force (n, d) at its samples."""
    motion, rng = MOTIONS[model], np.random.default_rng(seed)
    values, t_s = motion.draw(rng), motion.times()

    def force(t, position, velocity, base):
        return term(t, position, velocity, base, size, {**shape, **values})

    course = integrate(motion, values, t_s, force)
    position, velocity = course[:, : motion.size], course[:, motion.size :]
    states = course if motion.order == 2 else position
    bases = [motion.law(t, state, values) for t, state in zip(t_s, states, strict=True)]
    along = [force(*row) for row in zip(t_s, position, velocity, bases, strict=True)]
    measured = NOISES[noise](position, motion.noise, rng)
    quantities = tuple(Quantity(name, unit) for name, unit in motion.observed)
    clip = Trajectory(t_s, quantities, measured, np.full_like(measured, np.nan), np.ones(t_s.size, bool))
    return clip, np.array(along)


def estimated(clip, model):
    request = FitRequest(clip, MODELS[model])
    fitted = fit(clip, MODELS[model])
    return request, fitted, missing_force(request, fitted)


def visible(along, missing, fitted):
    """A force (n, d) at the nodes, without what the parameters imitate: differences of the model's own equation."""
    truth = along.T.ravel()
    model, values = fitted.model, {name: estimate.value for name, estimate in fitted.estimates.items()}
    count = missing.force.shape[1]
    states = np.hstack([missing.position, missing.velocity])[:, : len(model.states)]
    columns = []
    for name in set(fitted.free) - set(model.initial_names):
        step = 1e-5 * (abs(values[name]) or 1.0)
        rates = []
        for side in (step, -step):
            params = tuple(values[p.name] + (side if p.name == name else 0.0) for p in model.parameters)
            rows = [model.rhs(t, tuple(row), params)[-count:] for t, row in zip(missing.t_s, states, strict=True)]
            rates.append(np.array(rows).T.ravel())
        columns.append((rates[0] - rates[1]) / (2 * step))
    table = np.column_stack(columns) if columns else np.zeros((truth.size, 1))
    return (truth - table @ np.linalg.lstsq(table, truth, rcond=1e-6)[0]).reshape(count, -1).T


@pytest.mark.parametrize("name", HIDDEN)
def test_band_holds_the_hidden_force(name):
    model, *hidden = HIDDEN[name]
    inside, found = [], []
    for seed in SEEDS:
        clip, along = filmed(model, *hidden, seed)
        _, fitted, missing = estimated(clip, model)
        at_nodes = np.column_stack([CubicSpline(clip.t_s, column)(missing.t_s) for column in along.T])
        lower, upper = missing.band
        truth = visible(at_nodes, missing, fitted)
        inside.append(np.mean((lower <= truth) & (truth <= upper)))
        found.append(missing.significant)
    assert np.mean(inside) >= 0.9, inside
    assert sum(found) >= len(SEEDS) - 1


@pytest.mark.parametrize("model", MOTIONS)
@pytest.mark.parametrize("noise", NOISES)
def test_nothing_is_missing_in_clean_data(model, noise):
    for seed in SEEDS:
        clip, _ = filmed(model, effects.linear_drag, 0.0, {}, seed, noise)
        request, fitted, missing = estimated(clip, model)
        lower, upper = missing.band
        assert np.mean((lower <= 0) & (upper >= 0)) > 0.9
        assert not missing.significant
        assert with_form(request, fitted, missing).form is None


@pytest.mark.parametrize(("model", "size"), [("linear-oscillator", 0.2), ("pendulum", 0.1), ("projectile", 0.05)])
def test_power_of_the_speed_is_found_within_its_error(model, size):
    pulls = []
    for seed in SEEDS:
        clip, _ = filmed(model, effects.power_drag, size, {"power": 1.5}, seed)
        form = with_form(*estimated(clip, model)).form
        assert form.kind == "against-velocity"
        assert form.share > 0.9
        if form.shape is not None:
            assert form.shape.stderr < 0.5
            pulls.append((form.shape.value - 1.5) / form.shape.stderr)
    assert len(pulls) >= len(SEEDS) - 1
    assert np.max(np.abs(pulls)) < 3.5


def test_sine_has_its_frequency():
    model, *hidden = HIDDEN["pendulum, sine"]
    form = with_form(*estimated(filmed(model, *hidden, 0)[0], model)).form
    assert form.kind == "sine"
    assert form.shape.unit == "Hz"
    assert abs(2 * np.pi * form.shape.value - 5.3) < 4 * 2 * np.pi * form.shape.stderr


def test_pulse_has_its_moment():
    motion, rng = MOTIONS["pendulum"], np.random.default_rng(0)
    values, t_s = motion.draw(rng), motion.times()
    theta = integrate(motion, values, t_s, kicks={3.217: np.array([0.05])})[:, :1]
    theta = theta + motion.noise * rng.standard_normal(theta.shape)
    clip = Trajectory(t_s, (Quantity("theta", "rad"),), theta, np.full_like(theta, np.nan), np.ones(t_s.size, bool))
    form = with_form(*estimated(clip, "pendulum")).form
    assert form.kind == "pulse"
    assert abs(form.shape.value - 3.217) < 0.2


def test_effects_that_were_added_explain_the_force():
    model, *hidden = HIDDEN["pendulum, |v|^2"]
    diagnosis = diagnose(filmed(model, *hidden, 3)[0], MODELS[model])
    missing = diagnosis.missing_force
    assert [effect.name for effect in diagnosis.added] == ["quadratic-drag"]
    lower, upper = missing.band
    assert np.mean((lower <= missing.by_effects) & (missing.by_effects <= upper)) > 0.9
    assert diagnosis.remaining_force is None


def test_no_force_is_estimated_from_very_few_samples():
    clip, _ = filmed("free-fall", effects.linear_drag, 0.0, {}, 0)
    few = clip.with_(valid=np.arange(clip.n) < 6)
    fitted = fit(few, MODELS["free-fall"])
    assert missing_forces(FitRequest(few, MODELS["free-fall"]), fitted, fitted, (), True) == (None, None)
