"""One experiment for every model, to be repeated with fresh noise: for the tests of error bars and their benchmark."""

import numpy as np
from scipy.signal import lfilter

from fitters.ode import FitOptions, fit, simulate
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

NOISE = 2e-3
ALL_THERE_IS = FitOptions(unseen_drag=False)  # the equation is the truth, and its errors are those of the noise
FALSE_MISFITS = 0.02  # share of complete equations called a misfit: one in 1000 by the test's own level, 1 of 5200 seen
EXPERIMENTS = {name: (dict(model.example.values), model.example.t_s) for name, model in MODELS.items()}


def correlated(rng, shape, rho, warm_up=300):
    """AR(1) noise of unit standard deviation along the first axis."""
    white = rng.standard_normal((shape[0] + warm_up, *shape[1:]))
    return lfilter([1.0], [1.0, -rho], white, axis=0)[warm_up:] * np.sqrt(1 - rho**2)


def clip(model, noise) -> Trajectory:
    values, t_s = EXPERIMENTS[model.name]
    inputs = model.example.driven(t_s)
    position = simulate(model, t_s, values, inputs=inputs).observed + noise
    unknown, valid = np.full_like(position, np.nan), np.ones(t_s.size, bool)
    return Trajectory(t_s, model.observed, position, unknown, valid, model.inputs, inputs)


def repeated(name, rho, seeds):
    """Errors, standard errors and hits (seeds, k) of the fitted values; Cramer-Rao bound (k,) for white noise."""
    model = MODELS[name]
    values, t_s = EXPERIMENTS[name]
    truth = np.array(list(values.values()))
    inputs = model.example.driven(t_s)
    size = NOISE * np.std(simulate(model, t_s, values, inputs=inputs).observed, axis=0)
    rows, misfits = [], 0
    for seed in seeds:
        noise = size * correlated(np.random.default_rng(seed), (t_s.size, len(model.observed)), rho)
        result = fit(clip(model, noise), model, options=ALL_THERE_IS)
        assert result.status in ("ok", "misfit"), result.message
        misfits += result.status == "misfit"
        estimates = [result.estimates[name] for name in values]
        intervals = np.array([estimate.interval for estimate in estimates])
        rows.append(
            [
                [estimate.value for estimate in estimates] - truth,
                [estimate.stderr for estimate in estimates],
                (intervals[:, 0] <= truth) & (truth <= intervals[:, 1]),
            ]
        )
    assert misfits <= FALSE_MISFITS * len(seeds), misfits
    bound = np.sqrt(np.diag(np.linalg.inv(result.fisher))) * np.sqrt(np.mean((size / result.rms) ** 2))
    return *np.array(rows, dtype=float).transpose(1, 0, 2), bound
