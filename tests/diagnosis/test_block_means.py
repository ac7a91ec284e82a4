"""Long records by blocks: the same scores and the same ranks for less, and no blocks where motion is fast."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from fitters.ode import FitRequest, fit
from iris_sysid import EFFECTS, MODELS, Quantity, Trajectory
from iris_sysid.diagnosis import block_means as module
from iris_sysid.diagnosis import fit_cache
from iris_sysid.diagnosis.block_means import Residuals, block_means
from iris_sysid.diagnosis.fit_cache import FitCache
from iris_sysid.diagnosis.library import EffectLibrary
from iris_sysid.diagnosis.refit import ModelWithEffects, with_free_geometry
from iris_sysid.diagnosis.score_test import screen

NOISE = 2e-3
NAMES = ("quadratic-drag", "linear-drag", "cubic-stiffness", "constant-force", "zero-offset", "time-scale")
MORE = ("parameter-drift", "camera-tilt", "radial-distortion")


def swinging(rate_hz: float, n: int, drag: float, lost: slice = slice(0), noise: float = NOISE) -> Trajectory:
    """A pendulum of 1.2 m with quadratic drag, by SciPy; with samples that are lost."""
    t_s = np.delete(np.arange(n) / rate_hz, lost)
    solution = solve_ivp(
        lambda t, y: (y[1], -9.80665 / 1.2 * np.sin(y[0]) - drag * abs(y[1]) * y[1]),
        t_s[[0, -1]], (0.5, 0.0), t_eval=t_s, method="DOP853", rtol=1e-10, atol=1e-12,
    )  # fmt: skip
    theta = solution.y[0] + noise * np.random.default_rng(5).standard_normal(t_s.size)
    shape = (t_s.size, 1)
    return Trajectory(
        t_s, (Quantity("theta", "rad"),), theta.reshape(shape), np.full(shape, np.nan), np.ones(t_s.size, bool)
    )


def test_scores_by_block_means_are_those_of_all_samples(monkeypatch):
    clip = swinging(400.0, 31_000, 0.001, lost=np.s_[8000:8357])
    fitted = fit(clip, "pendulum")
    effects = [EFFECTS[name] for name in NAMES]
    few = screen(effects, fitted, clip)
    monkeypatch.setattr(module, "MIN_BLOCKS", clip.n)
    every = screen(effects, fitted, clip)
    assert few.directions.shape[1] <= every.directions.shape[1] / 2.9
    for name in NAMES:
        short, full = few.scores[name], every.scores[name]
        assert short.size == pytest.approx(full.size, rel=0.01, abs=0.05 * full.stderr, nan_ok=True)
        assert short.stderr == pytest.approx(full.stderr, rel=0.05, nan_ok=True)
        assert few.cosine("quadratic-drag", name) == pytest.approx(every.cosine("quadratic-drag", name), abs=0.01)


def test_motion_that_is_fast_for_its_samples_is_not_averaged():
    clip = swinging(30.0, 300, 0.0)
    t_s = np.arange(25_000) / 3.0
    fast = np.sin(2.8 * t_s)[:, None]
    fitted = replace(fit(clip, "pendulum"), t_s=t_s, used=np.ones(t_s.size, bool), predicted=fast, residual=0.0 * fast)
    given = Residuals(fitted, clip, np.ones_like(fast), np.ones_like(fast))
    assert block_means(given) is given


def test_noise_of_a_mean_shrinks_but_what_is_stated_does_not():
    clip = swinging(400.0, 30_000, 0.0)
    fitted = fit(clip, "pendulum")
    ones = np.ones((fitted.n, 1))
    means = block_means(Residuals(fitted, clip, NOISE * ones, 0.1 * ones))
    inside = slice(1, -1)
    np.testing.assert_allclose(means.noise[inside], NOISE / np.sqrt(3))
    np.testing.assert_allclose(means.stated, 0.1)
    assert np.std(means.fitted.residual / means.noise) == pytest.approx(1.0, abs=0.03)
    assert np.std(means.trajectory.position - means.fitted.predicted) == pytest.approx(NOISE / np.sqrt(3), rel=0.03)


def far_off(n: int) -> FitCache:
    """A cache of a pendulum with strong quadratic drag that its model lacks: over 10 times the noise remain."""
    clip, model = swinging(120.0, n, 0.05, noise=1e-4), MODELS["pendulum"]
    request, fitted = with_free_geometry(FitRequest.stated(clip, model))
    library = EffectLibrary([EFFECTS[name] for name in (*NAMES, *MORE)], model, [clip])
    base = ModelWithEffects.without_effects([request], [fitted])
    assert base.far_off
    return FitCache([request], model, library, base, 0.3, lambda text: None)


def test_far_from_the_noise_only_the_best_effects_are_refitted_to_all_samples(monkeypatch):
    cache, sizes, refit = far_off(12_000), [], fit_cache.refitted

    def counted(clips, *args):
        sizes.append(clips[0].trajectory.n)
        return refit(clips, *args)

    monkeypatch.setattr(fit_cache, "refitted", counted)
    screening = cache.screening(cache.base)
    singles = [screening.single(name) for name in screening.names if name in screening.visible]
    found = cache.refits(cache.base, singles)
    assert found[0].names == {"quadratic-drag"}
    assert found[0].fits[0].n > 11_000
    assert sizes.count(12_000) == fit_cache.REFITTED < len(singles) == sum(size < 6_000 for size in sizes)
    assert cache.refitted(cache.base) == {single.names[0] for single in singles}  # none is judged by its score alone
    monkeypatch.setattr(fit_cache, "RANKED", 12_000)
    every = far_off(12_000).refits(cache.base, singles)
    assert [model.names for model in every[:2]] == [model.names for model in found[:2]]
    assert every[0].sizes_of("quadratic_drag") == found[0].sizes_of("quadratic_drag")
