"""What a console shows of every result: three lines at most, without arrays."""

import pytest

from iris_sysid import (
    EFFECTS,
    MODELS,
    PHENOMENA,
    TRACKERS,
    Estimate,
    diagnose,
    discover,
    fit,
    fit_clips,
    plan,
    scale_from_text,
    select_model,
    simulate,
    smooth,
)
from tests.types.test_pickling import T_S, dragged

CLIP = dragged()
MADE = {
    "trajectory": lambda: CLIP,
    "smoothed": lambda: smooth(CLIP).smoothed,
    "fit": lambda: fit(CLIP, "pendulum"),
    "failed fit": lambda: fit(CLIP.with_(valid=T_S < 0.05), "pendulum"),
    "identifiability": lambda: fit(CLIP, "pendulum").identifiability,
    "several clips": lambda: fit_clips([CLIP, dragged(1)], "pendulum", shared=["length"]),
    "choice": lambda: select_model(CLIP, ["pendulum"]),
    "diagnosis": lambda: diagnose(CLIP, "pendulum", effects=["quadratic-drag"]),
    "plan": lambda: plan(diagnose(CLIP, "pendulum", effects=["quadratic-drag", "coulomb-friction"]), CLIP),
    "discovery": lambda: discover(CLIP, resampled=5),
    "simulation": lambda: simulate(fit(CLIP, "pendulum"), T_S),
    "calibration": lambda: scale_from_text("640px=1m"),
    **{
        f"{registry.kind}s": (lambda registry=registry: registry) for registry in (MODELS, EFFECTS, PHENOMENA, TRACKERS)
    },
    **{name: (lambda name=name: MODELS[name]) for name in MODELS},
    **{name: (lambda name=name: EFFECTS[name]) for name in EFFECTS},
}


@pytest.mark.parametrize("name", MADE)
def test_shown_in_three_lines_without_arrays(name):
    shown = repr(MADE[name]())
    assert len(shown.splitlines()) <= 3
    assert len(shown) <= 500
    assert "array(" not in shown
    assert " at 0x" not in shown


def test_fit_shows_its_verdict_its_values_and_its_noise():
    first, second, third = repr(fit(CLIP, "pendulum")).splitlines()
    assert first.startswith("FitResult of pendulum, ")
    assert ": usable: length good to " in first
    assert "equation incomplete: it explains 99.9 % of the motion" in first
    assert "length = 0.49" in second
    assert "±" in second
    assert third.strip().startswith("theta: residual 0.013")


@pytest.mark.parametrize(
    ("estimate", "shown"),
    [
        (Estimate(0.51234567, 0.0012345, "m"), "0.512346 ± 0.0012 m"),
        (Estimate(9.80665, 0.0, "m/s^2"), "9.80665 m/s^2"),
        (Estimate(2.0, float("nan"), "1"), "2"),
    ],
)
def test_estimate_as_text(estimate, shown):
    assert str(estimate) == shown
