"""A refit finds an effect from its size to first order, on a long swing that the size alone leads out of phase."""

from types import MappingProxyType

import numpy as np
import pytest

from fitters.ode import FitRequest, fit
from iris_sysid.diagnosis.refit import ModelWithEffects, refitted
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Trajectory
from validation.independent.motions import MOTIONS, integrate

PENDULUM, FORCING = MODELS["pendulum"], EFFECTS["periodic-forcing"]
VALUES = MappingProxyType({"length": 0.263, "damping": 0.03, "x0": 1.46, "v0": -0.96})
T_S = np.arange(1000) / 20
NOISE = 2e-3
SIZE, RATE, PHASE = 2.4, 9.88, 1.0


def test_force_of_long_swing_is_found_from_its_size_to_first_order():
    seen = integrate(MOTIONS["pendulum"], VALUES, T_S, lambda t, x, v, base: SIZE * np.sin(RATE * t + PHASE))[:, :1]
    seen = seen + NOISE * np.random.default_rng(0).standard_normal(seen.shape)
    clip = Trajectory(
        T_S, PENDULUM.observed, seen, np.full_like(seen, np.nan), np.ones(T_S.size, bool), sensor="encoder"
    )
    base = fit(clip, PENDULUM)
    request = FitRequest(clip, PENDULUM)
    model = ModelWithEffects((base,), (np.full((T_S.size, 1), NOISE),))
    start = {FORCING.name: (0.95 * SIZE, (RATE + 0.02, PHASE - 0.2, 0.0))}
    found = refitted([request], model, PENDULUM, [FORCING], [start])
    assert found.fits[0].estimates["periodic_forcing"].value == pytest.approx(SIZE, rel=0.02)
    assert found.squares == pytest.approx(T_S.size, rel=0.15)
