"""One experiment for every model, to be repeated with fresh noise: for the tests of error bars and their benchmark."""

import numpy as np
from scipy.signal import lfilter

from fitters.ode import fit, simulate
from iris_sysid.registry import MODELS
from iris_sysid.types import Trajectory

NOISE = 2e-3
EXPERIMENTS = {
    "pendulum": ({"length": 0.6, "damping": 0.08, "theta_0": 1.2, "omega_0": 0.3}, np.arange(600) / 60),
    "incline": ({"acceleration": 2.1, "s_0": 0.05, "v_0": 0.2}, np.arange(300) / 300),
    "free-fall": ({"gravity": 9.79, "z_0": 1.5, "vz_0": -0.3}, np.arange(300) / 500),
    "projectile": ({"x_0": 0.1, "z_0": 0.2, "vx_0": 1.8, "vz_0": 2.5}, np.arange(300) / 400),
    "exponential-decay": ({"decay_rate": 0.9, "intensity_0": 1.0}, np.arange(600) / 200),
    "linear-oscillator": ({"stiffness": 20.0, "damping": 0.3, "z_0": 0.2, "vz_0": -0.5}, np.arange(600) / 60),
    "angular-oscillator": ({"stiffness": 0.1, "damping": 0.05, "phi_0": 6.3, "omega_0": 0.0}, np.arange(900) / 60),
    "torricelli": ({"outflow": 0.02, "h_0": 0.25}, np.arange(600) / 20),
    "apparent-radius": ({"r0_f": 60.0, "h_0": 0.8, "v_0": 0.3}, np.arange(400) / 600),
    "coupled-pendulums": (
        {"length_1": 0.5, "length_2": 0.45, "damping_1": 0.1, "damping_2": 0.15, "coupling": 2.0}
        | {"theta1_0": 1.0, "theta2_0": -0.3, "omega1_0": 0.0, "omega2_0": 0.2},
        np.arange(600) / 60,
    ),
    "contact-chain": (
        {"coupling": 3.0, "damping": 0.4, "z1_0": -0.3, "z2_0": 0.0, "z3_0": 0.1}
        | {"v1_0": 1.5, "v2_0": 0.0, "v3_0": 0.1},
        np.arange(600) / 60,
    ),
    "linear-pendulum": ({"length": 0.6, "damping": 0.08, "theta_0": 0.2, "omega_0": 0.3}, np.arange(600) / 60),
    "pendulum-impact": (
        {"length_1": 0.5, "length_2": 0.45, "damping_1": 0.1, "damping_2": 0.15, "restitution": 0.8}
        | {"mass_ratio": 0.7, "contact_ratio": 0.12, "theta1_0": -1.0, "theta2_0": 0.6}
        | {"omega1_0": 0.1, "omega2_0": 0.2},
        np.arange(400) / 80,
    ),
    "bouncing-ball": ({"restitution": 0.8, "floor": 0.03, "z_0": 1.0, "vz_0": -0.2}, np.arange(400) / 100),
    "skipping-ball": (
        {"restitution": 0.8, "friction": 0.08, "floor": 0.03, "x_0": 0.1, "z_0": 1.0, "vx_0": 3.0, "vz_0": -0.2}
        | {"rim_0": 0.0},
        np.arange(300) / 100,
    ),
    "stopping-block": ({"friction": 2.5, "s_0": 0.1, "v_0": 1.7}, np.arange(300) / 240),
    "coasting-ball": ({"damping": 0.4, "s_0": 0.1, "v_0": 1.7}, np.arange(300) / 240),
    "coupled-oscillators": (
        {"stiffness_1": 7.8, "stiffness_2": 3.1, "damping_1": 0.04, "damping_2": 0.05, "coupling_1": 78.0}
        | {"coupling_2": 32.0, "z1_0": 0.0, "z2_0": -0.14, "v1_0": -0.1, "v2_0": 0.0},
        np.arange(500) / 60,
    ),
    "slack-cord": (
        {"length": 0.5, "pivot_x": 0.1, "pivot_z": 0.7, "damping": 0.1}
        | {"x_0": 0.52, "z_0": 0.72, "vx_0": -0.1, "vz_0": 0.0},
        np.arange(400) / 80,
    ),
    "impact-chain": (
        {"damping_1": 0.4, "damping": 0.9, "restitution": 0.6, "mass_ratio": 0.3, "contact_12": 0.12}
        | {"contact_23": 0.1, "z1_0": -0.6, "z2_0": 0.0, "z3_0": 0.25, "v1_0": 1.5, "v2_0": 0.0, "v3_0": 0.02},
        np.arange(300) / 150,
    ),
}


def correlated(rng, shape, rho, warm_up=300):
    """AR(1) noise of unit standard deviation along the first axis."""
    white = rng.standard_normal((shape[0] + warm_up, *shape[1:]))
    return lfilter([1.0], [1.0, -rho], white, axis=0)[warm_up:] * np.sqrt(1 - rho**2)


def clip(model, noise) -> Trajectory:
    values, t_s = EXPERIMENTS[model.name]
    position = simulate(model, t_s, values).observed + noise
    return Trajectory(t_s, model.observed, position, np.full_like(position, np.nan), np.ones(t_s.size, bool))


def repeated(name, rho, seeds):
    """Errors, standard errors and hits (seeds, k) of the fitted values; Cramer-Rao bound (k,) for white noise."""
    model = MODELS[name]
    values, t_s = EXPERIMENTS[name]
    truth = np.array(list(values.values()))
    size = NOISE * np.std(simulate(model, t_s, values).observed, axis=0)
    rows = []
    for seed in seeds:
        noise = size * correlated(np.random.default_rng(seed), (t_s.size, len(model.observed)), rho)
        result = fit(clip(model, noise), model)
        assert result.ok, result.message
        estimates = [result.estimates[name] for name in values]
        intervals = np.array([one.interval for one in estimates])
        rows.append(
            [
                [one.value for one in estimates] - truth,
                [one.stderr for one in estimates],
                (intervals[:, 0] <= truth) & (truth <= intervals[:, 1]),
            ]
        )
    bound = np.sqrt(np.diag(np.linalg.inv(result.fisher))) * np.sqrt(np.mean((size / result.rms) ** 2))
    return *np.array(rows, dtype=float).transpose(1, 0, 2), bound
