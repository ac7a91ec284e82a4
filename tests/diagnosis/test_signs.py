"""Friction only brakes, a leak only empties: a residual that fits the opposite gives a note, not an effect."""

import re

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.ode import fit, simulate
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.library import two_sided
from iris_sysid.diagnosis.score_test import screen
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.report.diagnosis_page import write_diagnosis
from iris_sysid.types import Trajectory

ONE_SIDED = {name for name, effect in EFFECTS.items() if effect.parameters[0].lower == 0.0}
THROW = {"x_0": 0.02, "z_0": 0.78, "vx_0": 2.09, "vz_0": 2.46}
DRAIN = {"outflow": 0.03, "h_0": 0.25}
SWING = {"length": 0.5, "damping": 0.03, "theta_0": 0.7, "omega_0": 0.0}


def clip(name: str, values: dict[str, float], hidden: dict[str, float], seconds: float, noise: float) -> Trajectory:
    model = with_effects(MODELS[name], [EFFECTS[effect] for effect in hidden])
    sizes = {EFFECTS[effect].parameters[0].name: size for effect, size in hidden.items()}
    t_s = np.arange(round(60 * seconds)) / 60
    seen = simulate(model, t_s, {**values, **sizes}).observed
    seen = seen + noise * np.random.default_rng(1).standard_normal(seen.shape)
    valid = np.ones(t_s.size, dtype=bool)  # no camera whose effects could imitate a gain of energy
    return Trajectory(t_s, MODELS[name].observed, seen, np.full_like(seen, np.nan), valid, sensor="gauge")


def test_effects_that_only_take_away_have_no_size_below_zero():
    frictions = ["coulomb-friction", "linear-drag", "quadratic-drag", "velocity-weakening-friction"]
    limits = ["input-backlash", "input-dead-zone", "input-delay", "input-saturation"]
    memories = ["hidden-mode", "hysteresis", "presliding"]
    readings = ["rectified-reading", "sensor-lag", "sensor-saturation"]
    assert sorted(ONE_SIDED) == sorted([*frictions, *limits, *memories, *readings, "leak", "overflow"])


def test_throw_that_gains_energy_gets_a_note_and_no_drag():
    hidden = {"linear-drag": -0.1}
    diagnosis = diagnose(clip("projectile", THROW, hidden, 0.8, 2e-4), MODELS["projectile"])
    ((name, size),) = hidden.items()
    assert not ONE_SIDED & {effect.name for effect in diagnosis.added}
    assert not ONE_SIDED & {effect for names in diagnosis.indistinguishable.values() for effect in names}
    (note,) = [note.text for note in diagnosis.notes if note.kind == "rejected-sign"]
    assert name in note
    assert float(note.partition(" = ")[2].split()[0]) == pytest.approx(size, rel=0.25)  # to first order


def test_swing_whose_drag_falls_with_speed_gets_no_drag_below_zero():
    diagnosis = diagnose(clip("pendulum", SWING, {"quadratic-drag": -0.05}, 4.0, 2e-3), MODELS["pendulum"])
    assert all(
        diagnosis.sizes[effect.parameters[0].name].value > 0 for effect in diagnosis.added if effect.name in ONE_SIDED
    )


def test_damping_below_zero_gets_a_note():
    diagnosis = diagnose(clip("pendulum", {**SWING, "damping": -0.1}, {}, 4.0, 2e-3), MODELS["pendulum"])
    assert diagnosis.added == ()
    (note,) = diagnosis.notes
    assert note.kind == "negative-damping"
    assert note.text.startswith("damping is -0.1")


def test_tank_that_fills_from_below_gets_no_leak_below_zero():
    diagnosis = diagnose(clip("torricelli", DRAIN, {"leak": -0.01}, 8.0, 2e-4), MODELS["torricelli"])
    assert not {"leak", "overflow"} & {effect.name for effect in diagnosis.added}


@pytest.mark.slow
def test_braking_effects_are_still_named_with_their_size_and_shown_before_and_after(tmp_path):
    measured = clip("projectile", THROW, {"linear-drag": 0.1}, 0.8, 2e-4)
    diagnosis = diagnose(measured, MODELS["projectile"])
    first = diagnosis.added[0].name
    assert "linear-drag" in (first, *diagnosis.indistinguishable[first])
    assert not [note for note in diagnosis.notes if note.kind == "rejected-sign"]
    page = write_diagnosis(diagnosis, measured, tmp_path).read_text(encoding="utf-8")
    assert ">Fit with the added effects, assuming no further missing effect<" in page
    assert ">Fit without the added effects<" in page


def test_page_of_a_diagnosis_that_adds_nothing_shows_one_fit_and_no_unit_of_one(tmp_path):
    measured = clip("projectile", THROW, {}, 0.8, 2e-4)
    page = write_diagnosis(diagnose(measured, MODELS["projectile"]), measured, tmp_path).read_text(encoding="utf-8")
    assert ">Fit<" in page
    assert "the added effects" not in page
    assert not re.search(r"\d 1</td>", page)


def test_size_is_fitted_on_both_sides_of_zero_so_that_none_has_no_bias():
    open_below = two_sided(EFFECTS["quadratic-drag"])
    assert open_below.parameters[0].lower == -np.inf
    assert two_sided(EFFECTS["slack-tether"]) is EFFECTS["slack-tether"]


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_cord_is_screened_where_its_size_says_that_it_pulls_less(side):
    """Beside a fitted stiffness, less pull on one side is nearly more pull on the other: noise would choose."""
    model = MODELS["linear-oscillator"]
    truth = {"stiffness": 30.0, "damping": 0.05, "z_0": 0.15, "vz_0": 0.05, "slack_tether": 0.002, "slack_side": side}
    t_s = np.arange(600) / 60
    clean = simulate(with_effects(model, [EFFECTS["slack-tether"]]), t_s, truth).observed
    for seed in range(6):
        seen = clean + 2e-4 * np.random.default_rng(seed).standard_normal(clean.shape)
        measured = Trajectory(t_s, model.observed, seen, np.full_like(seen, np.nan), np.ones(600, bool))
        assert screen([EFFECTS["slack-tether"]], fit(measured, model), measured).scores["slack-tether"].size > 0.0
