"""Clips of different bodies: an effect must go with mass and radius as it is known to; SciPy makes the clips."""

import numpy as np
import pytest

from fitters.ode import FitRequest
from iris_sysid import EFFECTS, MODELS, Estimate, FitError, Quantity, Trajectory, diagnose, fit
from iris_sysid.diagnosis.refit import ModelWithEffects
from tests.diagnosis.test_planning import DRAG, swing

PAIR = ("quadratic-drag", "coulomb-friction")


def weighing(clip: Trajectory, mass_kg: float) -> Trajectory:
    return clip.with_(known={"mass": Estimate(mass_kg, 0.0, "kg", "direct", "balance")})


def with_column(clip: Trajectory, mass_kg: float) -> Trajectory:
    """The clip with one more column of its table, and none of its errors."""
    table = np.column_stack([clip.position, np.full(clip.n, mass_kg)])
    quantities = (*clip.quantities, Quantity("mass", "kg"))
    return Trajectory(clip.t_s, quantities, table, np.full_like(table, np.nan), clip.valid)


def names_with(heavy_drag: float) -> set[str]:
    """The names that two small swings leave, the second with a body four times as heavy."""
    clips = [weighing(swing(0.25), 0.1), weighing(swing(0.25, seed=2, drag=heavy_drag), 0.4)]
    found = diagnose(clips, "pendulum", effects=PAIR)
    return {name for effect in found.added for name in (effect.name, *found.indistinguishable[effect.name])}


def test_drag_that_goes_with_the_mass_is_named_alone_and_drag_that_does_not_is_not():
    assert names_with(DRAG / 4) == {"quadratic-drag"}
    assert "quadratic-drag" not in names_with(DRAG)


def test_factor_of_an_effect_is_known_where_its_scaling_is():
    body = {"mass": 4.0, "radius": 0.5}
    assert EFFECTS["quadratic-drag"].factor(body) == 0.25 * 0.25
    assert EFFECTS["coulomb-friction"].factor(body) is None
    assert EFFECTS["zero-offset"].factor(body) == 1.0


def test_column_that_is_the_same_throughout_states_the_body():
    clips = [with_column(swing(0.25), 0.1), with_column(swing(0.25, seed=1), 0.4)]
    fits = [fit(clip, "pendulum") for clip in clips]
    base = ModelWithEffects.without_effects([FitRequest(clip, MODELS["pendulum"]) for clip in clips], fits)
    assert [body["mass"] for body in base.bodies] == [1.0, pytest.approx(4.0)]
    assert base.factors(EFFECTS["quadratic-drag"]) == [1.0, pytest.approx(0.25)]


def test_mass_of_one_clip_alone_is_refused():
    with pytest.raises(FitError, match="mass is stated for 1 of 2 clips"):
        diagnose([weighing(swing(0.25), 0.1), swing(0.25, seed=1)], "pendulum", effects=PAIR)


def test_size_is_that_of_the_first_body():
    clips = [weighing(swing(1.0), 0.1), weighing(swing(1.0, seed=2, drag=DRAG / 4), 0.4)]
    size = diagnose(clips, "pendulum", effects=PAIR).sizes["quadratic_drag"]
    assert size.value == pytest.approx(DRAG, abs=4 * size.stderr)
    assert size.stderr < 0.05 * DRAG
    assert np.isfinite(size.stderr)
