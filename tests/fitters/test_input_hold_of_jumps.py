"""An input that keeps its values between jumps is held; one that ramps is not told by its look."""

import numpy as np

from fitters.input_hold import jumps
from iris_sysid import Quantity, Trajectory

N = 200


def driven(values):
    place = np.zeros((N, 1))
    everywhere = np.ones(N, bool)
    inputs = None if values is None else np.asarray(values, dtype=float)[:, None]
    named = () if values is None else (Quantity("u", "V"),)
    return Trajectory(np.arange(N) / 10, (Quantity("z", "m"),), place, place, everywhere, named, inputs)


def test_jumps_that_lie_apart_are_held():
    steps = np.repeat([0, 3, -1, 2], 50)
    assert jumps([driven(steps)])
    assert jumps([driven(np.where(np.arange(N) == 70, np.nan, steps))])


def test_ramps_noise_and_single_steps_tell_nothing():
    rest = np.concatenate([np.zeros(150), np.linspace(0, 5, 50)])  # mostly still, then a ramp
    noise = np.random.default_rng(0).standard_normal(N)
    for values in (rest, noise, np.arange(N) > 100, np.zeros(N), None):
        assert not jumps([driven(values)])
    assert not jumps([driven(np.repeat([0, 3, -1, 2], 50)), driven(noise)])
