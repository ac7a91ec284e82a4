"""Everything public pickles and copies, and a process pool can map a fit: models with effects and own models too."""

import copy
import multiprocessing
import pickle
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from iris_sysid import (
    EFFECTS,
    MODELS,
    PHENOMENA,
    TRACKERS,
    OdeModel,
    Parameter,
    Quantity,
    Track,
    Trajectory,
    diagnose,
    discover,
    fit,
    scale_from_text,
    simulate,
    smooth,
    with_effects,
)

T_S = np.arange(300) / 60
ANGLE = (Quantity("theta", "rad"),)
REGISTERED = [(registry, name) for registry in (MODELS, EFFECTS, PHENOMENA, TRACKERS) for name in registry]


def dragged(seed=0, length=0.5):
    def slope(t, state):
        return state[1], -9.80665 / length * np.sin(state[0]) - 0.2 * abs(state[1]) * state[1]

    theta = solve_ivp(slope, (0, T_S[-1]), (0.9, 0.0), t_eval=T_S, rtol=1e-9, atol=1e-9).y[0]
    theta = (theta + 1e-3 * np.random.default_rng(seed).standard_normal(T_S.size))[:, None]
    sigma, valid = np.full_like(theta, 1e-3), np.ones(T_S.size, dtype=bool)
    return Trajectory(T_S, ANGLE, theta, sigma, valid, origin={"source": "drawn"})


def decay_of(quantity):
    """A model as users write it in a notebook: functions in a function, and a lambda."""

    def rhs(t, state, params):
        return (-params[0] * state[0],)

    return OdeModel(
        name="own-decay",
        summary="an exponential decay",
        equation=r"\dot y = -k y",
        source="the test",
        states=(quantity,),
        parameters=(Parameter("rate", "1/s", "k", default=1.0),),
        observed=(quantity,),
        rhs=rhs,
        guess=lambda trajectory: {"rate": 0.5},
    )


DECAY = decay_of(Quantity("y", "V"))
DECAYING = Trajectory(
    T_S, DECAY.observed, np.exp(-0.7 * T_S)[:, None], np.full((T_S.size, 1), 1e-3), np.ones(T_S.size, dtype=bool)
)


@pytest.fixture(scope="module")
def results():
    clip = dragged()
    track = Track(T_S, np.zeros((T_S.size, 2)), np.ones((T_S.size, 2)), np.ones(T_S.size, bool), np.arange(T_S.size))
    return {
        "trajectory": clip,
        "smoothed": smooth(clip).smoothed,
        "track": track,
        "calibration": scale_from_text("640px=1m"),
        "fit": fit(clip, "pendulum"),
        "diagnosis": diagnose(clip, "pendulum", effects=["quadratic-drag", "zero-offset"]),
        "discovery": discover(clip, resampled=5),
        "model": with_effects("pendulum", ["quadratic-drag", "camera-tilt", "time-scale"]),
        "own model": with_effects(DECAY, ["zero-offset"]),
    }


def sent(item):
    return pickle.loads(pickle.dumps(item))


@pytest.mark.parametrize("copied", [sent, copy.deepcopy], ids=["pickle", "deepcopy"])
@pytest.mark.parametrize(
    "name",
    ["trajectory", "smoothed", "track", "calibration", "fit", "diagnosis", "discovery", "model", "own model"],
)
def test_result_comes_back_the_same(results, name, copied):
    again = copied(results[name])
    assert type(again) is type(results[name])
    assert repr(again) == repr(results[name])


@pytest.mark.parametrize(("registry", "name"), REGISTERED, ids=[name for _, name in REGISTERED])
def test_registered_item_comes_back(registry, name):
    assert sent(registry[name]).name == copy.deepcopy(registry[name]).name == name


def test_arrays_are_read_only_again(results):
    again = sent(results["trajectory"])
    np.testing.assert_array_equal(again.position, results["trajectory"].position)
    assert not again.position.flags.writeable
    assert dict(again.origin) == {"source": "drawn"}


def test_fits_of_a_diagnosis_and_of_a_discovery_still_simulate(results):
    for before in (results["diagnosis"].final, results["discovery"].fits[0]):
        again = sent(before)
        np.testing.assert_array_equal(simulate(again, T_S).observed, simulate(before, T_S).observed)


def test_composed_model_is_compiled_once_for_all_its_copies():
    model = with_effects("pendulum", ["quadratic-drag"])
    assert sent(model).rhs is model.rhs


def test_model_with_lambdas_is_fitted_after_it_came_back():
    assert fit(DECAYING, sent(DECAY)).estimates["rate"].value == pytest.approx(0.7, abs=1e-3)


@pytest.mark.parametrize("method", ["fork", "spawn"])
def test_process_pool_maps_fit(method):
    clips = [dragged(seed) for seed in range(2)]
    model = with_effects("pendulum", ["quadratic-drag"])
    with ProcessPoolExecutor(1, mp_context=multiprocessing.get_context(method)) as pool:
        drag = [result.estimates["quadratic_drag"] for result in pool.map(partial(fit, model=model), clips)]
        (decay,) = pool.map(partial(fit, model=replace(DECAY, name="again")), [DECAYING])
    assert all(abs(estimate.value - 0.2) < 5 * estimate.stderr for estimate in drag)
    assert decay.estimates["rate"].value == pytest.approx(0.7, abs=1e-3)
