"""Blocks left out are not seen by the fit that predicts them; motions integrated by SciPy, and a changed block."""

from types import MappingProxyType

import numpy as np
import pytest

from fitters.compose_effects import with_effects
from fitters.ode import FitRequest, fit
from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.diagnosis.held_out_blocks import (
    BLOCKS,
    BLOCKS_OF_SEVERAL,
    BlockErrors,
    blocks_of,
    every_block,
    held_out_errors,
    wins,
)
from iris_sysid.diagnosis.refit import ModelWithEffects, fit_from, refitted
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.types import Array, Trajectory
from validation.independent.motions import MOTIONS, integrate

PENDULUM, SWING = MODELS["pendulum"], MOTIONS["pendulum"]
VALUES = MappingProxyType({"length": 0.5, "damping": 0.05, "x0": 0.8, "v0": 0.1})
T_S = np.arange(360) / 60
NOISE = 5e-4
DRAG = EFFECTS["quadratic-drag"]
THREE_EFFECTS = [DRAG, EFFECTS["constant-force"], EFFECTS["impact"]]


def table(theta: Array, seed: int = 0) -> Trajectory:
    seen = theta + NOISE * np.random.default_rng(seed).standard_normal(theta.shape)
    unknown, valid = np.full_like(seen, np.nan), np.ones(T_S.size, dtype=bool)
    return Trajectory(T_S, PENDULUM.observed, seen, unknown, valid, sensor="encoder")


def dragged(size: float = 0.3) -> Array:
    return integrate(SWING, VALUES, T_S, lambda t, x, v, base: -size * np.abs(v) * v)[:, :1]


def with_drag(*clips: Trajectory) -> tuple[list[FitRequest], ModelWithEffects]:
    """The requests of some clips, and the pendulum with drag fitted to each; samples weigh by the noise."""
    requests, composed = [FitRequest(clip, PENDULUM) for clip in clips], with_effects(PENDULUM, [DRAG])
    fits = tuple(fit_from(request, composed, {}) for request in requests)
    units = tuple(np.full((T_S.size, 1), NOISE) for _ in clips)
    return requests, ModelWithEffects(fits, units, (DRAG,))


def test_block_is_predicted_by_a_fit_that_did_not_see_it():
    requests, model = with_drag(table(dragged()))
    blocks = every_block(model.fits)
    assert len(blocks[0]) == BLOCKS
    first = held_out_errors(requests, model, blocks)
    changed, third = requests[0].trajectory.position.copy(), blocks[0][2]
    changed[third] += 0.05 * np.random.default_rng(1).standard_normal((third.size, 1))
    other = [FitRequest(requests[0].trajectory.with_(position=changed), PENDULUM)]
    second = held_out_errors(other, model, blocks)
    assert second.values[0]["quadratic_drag"][2] == first.values[0]["quadratic_drag"][2]  # to the last digit
    assert second.squares[2] > 100 * first.squares[2]  # but the error is over the changed samples
    assert second.values[0]["quadratic_drag"][3] != first.values[0]["quadratic_drag"][3]  # which other fits do see


def test_error_over_blocks_is_the_noise_for_the_true_equation_and_more_without_the_drag():
    requests, model = with_drag(table(dragged()))
    blocks = every_block(model.fits)
    base = ModelWithEffects((fit(requests[0].trajectory, PENDULUM),), model.units)
    right, wrong = held_out_errors(requests, model, blocks), held_out_errors(requests, base, blocks)
    assert right.mean == pytest.approx(1.0, rel=0.25)  # 320 samples tell the variance to 8 %; free values cost 2 %
    assert right.rms == pytest.approx(NOISE, rel=0.12)
    np.testing.assert_array_equal(right.counts, wrong.counts)
    assert wrong.mean > 10 * right.mean
    assert right.share_below(wrong) == 1.0
    assert wrong.share_below(right) == 0.0
    gain, stderr = right.gain_over(wrong)
    assert gain == pytest.approx(wrong.mean - right.mean)
    assert gain > 3 * stderr > 0


def test_error_before_and_after_is_over_the_same_blocks_at_the_noise():
    diagnosis = diagnose(table(dragged()), PENDULUM, effects=THREE_EFFECTS)
    assert [effect.name for effect in diagnosis.added] == ["quadratic-drag"]
    assert diagnosis.after.heldout == pytest.approx(NOISE, rel=0.12)
    assert diagnosis.before.heldout > 3 * NOISE
    assert diagnosis.after.weighed == pytest.approx(1.0, rel=0.25)


def test_effect_in_the_last_block_alone_leaves_the_error_over_it():
    kicked = integrate(SWING, VALUES, T_S, kicks={5.8: np.array([0.3])})[:, :1]
    diagnosis = diagnose(table(kicked), PENDULUM, effects=THREE_EFFECTS)
    assert diagnosis.after.heldout > 3 * NOISE  # nothing that was seen tells of a blow to come
    assert diagnosis.after.heldout <= diagnosis.before.heldout


def test_with_several_clips_the_size_comes_from_the_others():
    requests, model = with_drag(*(table(dragged(size), seed) for seed, size in enumerate((0.1, 0.3))))
    blocks = every_block(model.fits)
    assert [len(each) for each in blocks] == [BLOCKS_OF_SEVERAL, BLOCKS_OF_SEVERAL]
    both = held_out_errors(requests, model, blocks)
    for request, own in zip(requests, blocks, strict=True):
        _, alone = with_drag(request.trajectory)
        assert held_out_errors([request], alone, [own]).mean < 1.5  # each clip has a drag that explains it
    assert both.mean > 10  # and no other clip's drag does
    same, model = with_drag(*(table(dragged(), seed) for seed in (0, 1)))
    assert held_out_errors(same, model, blocks).mean == pytest.approx(1.0, rel=0.25)


def test_outlier_of_a_block_that_is_left_out_is_not_seen_either():
    requests, model = with_drag(table(dragged()))
    blocks = [[np.delete(block, 20) for block in every_block(model.fits)[0]]]
    changed = requests[0].trajectory.position.copy()
    changed[np.arange(60, 360, 40)] += 0.01
    first = held_out_errors(requests, model, blocks)
    second = held_out_errors([FitRequest(requests[0].trajectory.with_(position=changed), PENDULUM)], model, blocks)
    np.testing.assert_array_equal(first.squares, second.squares)


def test_block_bootstrap_shares_are_those_of_the_scatter_over_blocks():
    counts, worse = np.full(8, 40.0), BlockErrors(np.full(8, 2.0), np.full(8, 40.0), 1.0)
    one = BlockErrors(np.array([1.0, 3.0] * 4), counts, 1.0)  # better and worse in turn: nothing is sure
    always = BlockErrors(np.full(8, 1.9), counts, 1.0)  # a little better everywhere: sure
    assert one.share_below(worse) == pytest.approx(0.363, abs=0.03)  # P(fewer than 4 of 8 are the worse ones)
    assert always.share_below(worse) == 1.0
    assert one.gain_over(worse) == (0.0, pytest.approx(1 / np.sqrt(8), rel=0.05))
    shares = wins({"one": one, "always": always})
    assert list(shares) == ["always", "one"]
    assert shares["one"] == pytest.approx(0.363, abs=0.03)


def test_block_that_no_model_predicts_decides_no_more_than_others():
    counts, others = np.full(8, 40.0), np.full(7, 1.0)
    worse = BlockErrors(np.array([9e4, *1e3 * others]), counts, 1.0, usual=1e3)
    better = BlockErrors(np.array([1e5, *10.0 * others]), counts, 1.0, usual=1e3)
    assert better.share_below(worse) > 0.99
    assert better.score < 0.6 * worse.score
    assert better.mean > 0.9 * worse.mean
    assert better.scores[1:] == pytest.approx(10.0, rel=0.01)  # what is usual counts as it is


def test_failed_fit_is_infinitely_wrong_and_never_wins():
    counts = np.full(4, 40.0)
    failed = BlockErrors(np.array([1.0, np.inf, 1.0, 1.0]), counts, np.inf)
    right = BlockErrors(np.full(4, 5.0), counts, 1.0)
    assert right.share_below(failed) == pytest.approx(1 - 0.75**4, abs=0.03)  # bootstraps that hold the failed block
    assert failed.mean == np.inf


def test_blocks_are_what_follows_the_first_and_leave_enough():
    base = fit(table(integrate(SWING, VALUES, T_S)[:, :1]), PENDULUM)
    blocks = blocks_of(base, 8)
    np.testing.assert_array_equal(np.concatenate(blocks), np.arange(40, 360))
    assert {block.size for block in blocks} == {40}
    assert blocks_of(base, 360) == []  # a block without a sample


def test_clip_with_too_few_samples_for_its_values_has_no_blocks():
    short = table(integrate(SWING, VALUES, T_S)[:, :1])
    valid = np.zeros(T_S.size, dtype=bool)
    valid[:90:10] = True
    assert blocks_of(fit(short.with_(valid=valid), PENDULUM), 1) == []


def test_effect_of_which_the_rest_says_nothing_is_absent_in_its_block():
    lost, step = T_S[-20], 0.1
    late = np.where(lost < T_S, T_S + step, T_S)
    seen, unaware = (integrate(SWING, VALUES, times, None)[:, :1] for times in (late, T_S))
    clip = table(seen)
    request, drop = FitRequest(clip, PENDULUM), EFFECTS["dropped-frame"]
    base = ModelWithEffects((fit_from(request, PENDULUM, {}),), (np.full((T_S.size, 1), NOISE),))
    shape = [parameter.default for parameter in drop.parameters[1:]]
    shape[[each.name for each in drop.parameters[1:]].index("drop_time")] = float(lost)
    found = refitted([request], base, PENDULUM, [drop], [{drop.name: (step, tuple(shape))}])
    assert found.fits[0].estimates["dropped_frame"].value == pytest.approx(step, rel=0.05)
    blocks = every_block(found.fits)
    errors = held_out_errors([request], found, blocks)
    assert np.isnan(errors.values[0]["dropped_frame"][-1])
    missed = np.mean((seen - unaware)[blocks[0][-1]] ** 2) / NOISE**2
    assert errors.squares[-1] == pytest.approx(missed, rel=0.05)
    assert errors.squares[:-1].max() < 3.0  # the others are predicted to the noise
