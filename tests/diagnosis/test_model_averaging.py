"""The interval of an effect's size allows for one more effect that the data do not show."""

from dataclasses import replace

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.ode import fit, simulate
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.model_averaging import (
    CompetingEffect,
    averaged_over_alternatives,
    averaged_over_competitors,
    competing_effect,
    spanning,
    with_larger_error,
)
from iris_sysid.diagnosis.score_test import screen
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Estimate, OdeModel, Score, Trajectory
from validation.blind import hidden_case, outcome

SIZE = Estimate(2.0, 0.1, "1", ci95=(1.8, 2.2))


def throw(model: OdeModel, values: dict[str, float], noise: float, seed: int) -> Trajectory:
    t_s = np.arange(120) / 60
    seen = simulate(model, t_s, values).observed
    seen = seen + noise * np.random.default_rng(seed).standard_normal(seen.shape)
    return Trajectory(t_s, model.observed, seen, np.full_like(seen, np.nan), np.ones(t_s.size, dtype=bool))


def test_size_without_competing_effects_is_unchanged():
    assert averaged_over_competitors(SIZE, []) == SIZE
    assert averaged_over_alternatives(SIZE, []) == SIZE


def test_improbable_effect_changes_nothing():
    assert averaged_over_competitors(SIZE, [CompetingEffect(-50.0, 3.0, 1.0)]).interval == pytest.approx(SIZE.interval)


def test_interval_is_that_of_the_mixture():
    competitors = [CompetingEffect(np.log(0.5), -0.5, 0.2), CompetingEffect(np.log(0.25), 0.8, 0.0)]
    averaged = averaged_over_competitors(SIZE, competitors)
    rng = np.random.default_rng(1)
    which = rng.choice(3, size=2_000_000, p=np.array([1.0, 0.5, 0.25]) / 1.75)
    drawn = rng.normal(np.array([2.0, 1.5, 2.8])[which], np.array([0.1, np.hypot(0.1, 0.2), 0.1])[which])
    np.testing.assert_allclose(averaged.interval, np.quantile(drawn, [0.025, 0.975]), atol=3e-3)
    assert averaged.value == SIZE.value
    assert averaged.stderr / SIZE.stderr == pytest.approx((averaged.interval[1] - averaged.interval[0]) / 0.4)


def test_interval_is_never_narrower_than_without_competing_effects():
    low, high = averaged_over_competitors(replace(SIZE, ci95=(1.0, 3.0)), [CompetingEffect(0.0, 0.0, 0.0)]).interval
    assert (low, high) == (1.0, 3.0)


def test_larger_error_keeps_what_the_interval_holds_already():
    of_few_blocks = Estimate(2.0, 0.6, "1", ci95=(-0.5, 4.5))  # Student's t of few degrees of freedom
    assert with_larger_error(of_few_blocks, 0.5) == of_few_blocks
    assert with_larger_error(of_few_blocks, 1.0) == replace(of_few_blocks, stderr=1.0)
    wider = with_larger_error(of_few_blocks, 2.0)
    assert wider.stderr == 2.0
    assert wider.interval == replace(of_few_blocks, stderr=2.0, ci95=None).interval


def test_effect_that_the_data_cannot_show_does_not_compete():
    hidden = Score("linear-drag", np.nan, np.nan, "1/s", 0.0, 1.0, 0.0)
    assert competing_effect([hidden], "impact", 100.0) is None
    assert competing_effect([replace(hidden, size=1.0, stderr=0.1)], "impact", 100.0) is None  # it moves no such value


def test_shifts_are_what_a_refit_with_the_effect_gives():
    plane, drag = MODELS["incline"], EFFECTS["linear-drag"]
    clip = throw(plane, {"acceleration": 1.2, "s_0": 0.05, "v_0": 0.3}, 2e-4, 3)
    bare = fit(clip, plane)
    shifts = screen([drag], bare, clip).scores["linear-drag"].shifts
    size = 1e-3
    moved = fit(clip, with_effects(plane, [drag]), fixed={"linear_drag": size})
    for name in ("acceleration", "v_0"):
        assert (moved.estimates[name].value - bare.estimates[name].value) / size == pytest.approx(
            shifts[name], rel=0.01
        )


@pytest.mark.slow
def test_drag_too_small_to_be_seen_beside_a_friction_is_in_the_interval_of_that():
    plane, names = MODELS["incline"], ("velocity-weakening-friction", "linear-drag")
    effects = [EFFECTS[name] for name in names]
    truth = {"acceleration": 1.8, "s_0": 0.05, "v_0": 0.3, "weakening_friction": 0.14, "linear_drag": 9e-4}
    named = 0
    for seed in range(4):
        diagnosis = diagnose(throw(with_effects(plane, effects), truth, 2e-4, seed), plane)
        if not diagnosis.added:  # its interval would hold zero
            assert any(note.kind == "weak" for note in diagnosis.notes)
            continue
        first = diagnosis.added[0].name
        if first != names[0]:  # where its size is not known, one that is stands for all that explain as much
            assert names[0] in diagnosis.indistinguishable[first]
            continue
        size, alone = diagnosis.sizes["weakening_friction"], diagnosis.final.estimates["weakening_friction"]
        assert abs(size.value - truth["weakening_friction"]) < 3 * size.stderr
        assert size.stderr >= alone.stderr
        named += 1
    assert named >= 3


@pytest.mark.slow
def test_intervals_of_sizes_cover_where_one_or_two_effects_are_hidden():
    made = [hidden_case(seed, 1 + seed % 2) for seed in range(50_000, 50_128)]
    # only what is hidden in twice the detectable size counts: a case without any need not be diagnosed
    every = [outcome(case) for case in made if case is not None and max(case.factors) > 2.0]
    off = [
        found.off[k]
        for found in every
        if found is not None
        for k, factor in enumerate(found.factors)
        if factor > 2.0 and np.isfinite(found.off[k])
    ]
    assert len(off) > 40
    assert np.mean(np.abs(off) < 1.0) > 0.86  # binomial: 95 % - 3 standard deviations of 45


def test_interval_spans_those_of_models_that_predict_as_well():
    wide = spanning(Estimate(1.0, 0.1, "m"), [Estimate(0.5, 0.05, "m"), Estimate(1.1, 0.02, "m")])
    assert wide.value == 1.0
    assert wide.interval == pytest.approx((0.5 - 1.96 * 0.05, 1.0 + 1.96 * 0.1), rel=1e-3)
    assert wide.value - 1.96 * wide.stderr == pytest.approx(wide.interval[0], rel=1e-3)
    assert spanning(wide, []) is wide
