"""A model with effects is compiled as its pieces, which give what the whole gives in plain Python."""

from __future__ import annotations

import numpy as np
import pytest

from fitters.compose_effects import forced, with_effects
from fitters.integrator import compile_rhs
from fitters.integrator.compile_rhs import compiled_rhs
from fitters.integrator.dormand_prince import slopes_along

SETS = [
    ("pendulum", ["quadratic-drag", "coulomb-friction", "parameter-drift"]),
    ("projectile", ["quadratic-drag", "buoyancy"]),
    ("coupled-pendulums", ["coulomb-friction", "quadratic-drag", "parameter-drift"]),
    ("torricelli", ["leak", "parameter-drift"]),
]


@pytest.mark.parametrize(("base", "effects"), SETS)
@pytest.mark.parametrize("wrapped", [lambda model: model, forced], ids=["as it is", "forced"])
def test_pieces_give_what_the_whole_gives(base, effects, wrapped):
    rng, model = np.random.default_rng(3), wrapped(with_effects(base, effects))
    states = rng.uniform(0.1, 1.0, (1, len(model.states), 3))
    params = rng.uniform(0.1, 1.0, (len(model.parameters), 3))
    inputs = rng.uniform(0.1, 1.0, (1, len(model.inputs)))
    out = np.empty_like(states)
    slopes_along(compiled_rhs(model).columns, np.array([0.3]), states, params, inputs, out)
    for c in range(3):
        given = (tuple(inputs[0]),) if model.inputs else ()
        np.testing.assert_allclose(
            out[0, :, c], model.rhs(0.3, tuple(states[0, :, c]), tuple(params[:, c]), *given), rtol=1e-13
        )


def test_a_base_and_an_effect_are_compiled_once_for_all_models_that_hold_them(monkeypatch):
    compiled_rhs(with_effects("pendulum", ["quadratic-drag", "coulomb-friction"]))
    counted, plain = [], compile_rhs.compiled_columns
    monkeypatch.setattr(
        compile_rhs, "compiled_columns", lambda *given, **how: counted.append(given) or plain(*given, **how)
    )
    compiled_rhs(with_effects("pendulum", ["coulomb-friction", "quadratic-drag"]))
    assert not counted
