"""Several clips at once: shared values against closed forms, random effects against a published analysis."""

import numpy as np
import pytest

from fitters.noise.random_effects import random_effects
from fitters.ode import simulate
from fitters.ode.several_clips import fit_clips
from iris_sysid.errors import FitError
from iris_sysid.registry import MODELS
from iris_sysid.types import Estimate, Trajectory

PENDULUM, FALL = MODELS["pendulum"], MODELS["free-fall"]

# Colditz et al. 1994 (BCG vaccine, 13 trials): log risk ratios and their variances as in the R package metafor.
BCG = np.array(
    [
        (-0.8893, 0.3256),
        (-1.5854, 0.1946),
        (-1.3481, 0.4154),
        (-1.4416, 0.0200),
        (-0.2175, 0.0512),
        (-0.7861, 0.0069),
        (-1.6209, 0.2230),
        (0.0120, 0.0040),
        (-0.4694, 0.0564),
        (-1.3713, 0.0730),
        (-0.3394, 0.0124),
        (0.4459, 0.5325),
        (-0.0173, 0.0714),
    ]
)


def clip_of(model, values, t_s, noise, seed):
    position = simulate(model, t_s, values).observed
    position = position + noise * np.random.default_rng(seed).standard_normal(position.shape)
    return Trajectory(t_s, model.observed, position, np.full_like(position, np.nan), np.ones(t_s.size, bool))


def falls(gravities, noises, n=80):
    starts = [(1.5, -0.3), (1.2, 0.4), (1.0, 0.0), (0.8, 0.2)]
    return [
        clip_of(FALL, {"gravity": g, "z_0": z, "vz_0": v}, np.arange(n) / 240, noise, seed)
        for seed, (g, noise, (z, v)) in enumerate(zip(gravities, noises, starts, strict=False))
    ]


def swings(lengths, seed=0, seconds=6, noise=2e-3):
    rng = np.random.default_rng(seed)
    return [
        clip_of(
            PENDULUM,
            {"length": length, "damping": 0.08, "theta_0": 0.4 + 0.1 * k, "omega_0": 0.1},
            np.arange(60 * seconds) / 60,
            noise,
            rng.integers(1 << 30),
        )
        for k, length in enumerate(lengths)
    ]


def test_random_effects_reproduce_the_published_meta_analysis_of_bcg_vaccine():
    """metafor 4: REML tau^2 = 0.3132, Q = 152.2330 (12), Knapp-Hartung -0.7145 +- 0.1807, tau 0.3460 to 1.0543."""
    effects = random_effects(BCG[:, 0], np.sqrt(BCG[:, 1]), "1")
    assert effects.between.value**2 == pytest.approx(0.3132, abs=2e-4)
    assert effects.between.interval == pytest.approx((0.3460, 1.0543), abs=5e-4)
    assert effects.mean.value == pytest.approx(-0.7145, abs=2e-4)
    assert effects.mean.stderr == pytest.approx(0.1807, abs=2e-4)
    assert effects.mean.interval == pytest.approx((-1.1082, -0.3209), abs=5e-4)
    assert (effects.q, effects.degrees) == (pytest.approx(152.233, rel=5e-3), 12)  # four digits of each variance


def test_random_effects_of_equal_values_have_no_scatter_and_an_interval_that_begins_at_zero():
    effects = random_effects(np.array([1.01, 0.99, 1.0, 1.0]), np.full(4, 0.05), "m")
    assert effects.between.value == 0.0
    assert effects.between.interval[0] == 0.0
    assert effects.between.interval[1] < 0.1
    assert effects.mean.stderr == pytest.approx(0.05 / 2)


@pytest.mark.slow
def test_intervals_of_mean_and_of_scatter_cover_over_repeated_experiments():
    hits = []
    for seed in range(2000):
        rng = np.random.default_rng(seed)
        stderrs = rng.uniform(0.05, 0.2, 10)
        values = 1.0 + 0.1 * rng.standard_normal(10) + stderrs * rng.standard_normal(10)
        effects = random_effects(values, stderrs, "m")
        hits.append(
            [
                estimate.interval[0] <= truth <= estimate.interval[1]
                for estimate, truth in ((effects.mean, 1.0), (effects.between, 0.1))
            ]
        )
    assert np.all((np.mean(hits, axis=0) > 0.93) & (np.mean(hits, axis=0) < 0.97)), np.mean(hits, axis=0)


def test_shared_gravity_of_falls_equals_weighted_least_squares_in_one_matrix():
    clips = falls([9.8, 9.8, 9.8], [1e-3, 2e-3, 4e-3])
    joint = fit_clips(clips, FALL, shared=["gravity"])
    assert joint.status == "ok", joint.message
    rows, seen = [], []
    for k, clip in enumerate(clips):
        own = np.zeros((clip.n, 6))
        own[:, 2 * k], own[:, 2 * k + 1] = 1.0, clip.t_s
        sigma = joint.clips[k].rms[0]
        rows.append(np.column_stack([-(clip.t_s**2) / 2, own]) / sigma)
        seen.append(clip.position[:, 0] / sigma)
    matrix = np.concatenate(rows)
    expected = np.linalg.lstsq(matrix, np.concatenate(seen), rcond=None)[0][0]
    stderr = np.sqrt(np.linalg.inv(matrix.T @ matrix)[0, 0])
    assert joint.shared["gravity"].value == pytest.approx(expected, abs=0.05 * stderr)
    assert joint.budget["gravity"]["random"] == pytest.approx(stderr, rel=0.05)
    assert joint.budget["gravity"]["random"] == pytest.approx(stderr, rel=0.05)


def test_shared_length_of_pendulums_is_known_better_than_from_any_clip_alone():
    joint = fit_clips(swings([0.6] * 4), PENDULUM, shared=["length"])
    length = joint.shared["length"]
    assert joint.status == "ok", joint.message
    assert abs(length.value - 0.6) < 3 * length.stderr
    assert length.stderr < 0.6 * joint.scatter["length"].within
    assert joint.scatter["length"].p_value > 0.01
    assert set(joint.population) == {"damping"}
    assert joint.population["damping"].mean.value == pytest.approx(0.08, abs=0.005)
    for clip in joint.clips:
        assert clip.estimates["length"].value == length.value
        assert "length" not in clip.free


def test_scatter_between_trials_is_reported_apart_from_the_error_within_one():
    truth = 0.6 + 0.01 * np.random.default_rng(5).standard_normal(8)
    joint = fit_clips(swings(truth, seconds=4), PENDULUM)
    spread = joint.population["length"]
    assert spread.between.value == pytest.approx(np.std(truth, ddof=1), rel=0.05)
    assert spread.between.interval[0] < np.std(truth, ddof=1) < spread.between.interval[1]
    assert spread.within < 0.1 * spread.between.value
    assert spread.mean.stderr == pytest.approx(spread.between.value / np.sqrt(8), rel=0.1)
    assert joint.shared == {}


def test_error_of_gravity_does_not_average_out_over_clips():
    known = Estimate(9.80665, 0.098, "m/s^2")
    for shared in ([], ["length"]):
        joint = fit_clips(swings([0.6] * 4), PENDULUM, shared=shared, fixed={"gravity": known})
        assert joint.estimates["length"].stderr == pytest.approx(0.006, rel=0.05)


def test_error_that_all_samples_share_in_several_patterns_does_not_average_out_over_clips():
    clips = swings([0.6] * 2)
    clock = [np.gradient(clip.position[:, 0], clip.t_s)[:, None] * clip.t_s[:, None] * 0.01 for clip in clips]
    whole = [c.with_(systematic={"clock": np.array([w])}) for c, w in zip(clips, clock, strict=True)]
    split = [c.with_(systematic={"clock": np.array([w, w]) / np.sqrt(2)}) for c, w in zip(clips, clock, strict=True)]
    single, double = (
        fit_clips(group, PENDULUM, shared=["length"]).budget["length"]["clock"] for group in (whole, split)
    )
    assert single == pytest.approx(2 * 0.01 * 0.6, rel=0.05)  # a clock wrong by 1 % makes a length wrong by 2 %
    assert double == pytest.approx(single, rel=1e-6)


def test_sharing_what_differs_is_contradicted_in_the_message():
    joint = fit_clips(falls([9.6, 9.8, 10.0], [1e-3] * 3), FALL, shared=["gravity"])
    assert "gravity is shared, but differs between clips by more than its error" in joint.message


def test_constant_that_is_shared_is_estimated():
    known = [Estimate(0.6, 1e-4, "m")]
    joint = fit_clips(swings([0.6] * 3), PENDULUM, shared=["gravity"], fixed={"length": known[0]})
    gravity = joint.shared["gravity"]
    assert abs(gravity.value - 9.80665) < 3 * gravity.stderr
    assert joint.budget["gravity"]["length"] == pytest.approx(9.80665 * 1e-4 / 0.6, rel=0.02)


def test_parameter_named_per_clip_has_no_mean():
    joint = fit_clips(swings([0.6, 0.7]), PENDULUM, per_clip=["length"])
    assert set(joint.population) == {"damping"}


def test_failed_clip_is_named_and_left_out():
    clips = swings([0.6] * 3)
    short = clip_of(PENDULUM, {"length": 0.6, "damping": 0.08, "theta_0": 0.4, "omega_0": 0.1}, np.arange(4) / 60, 0, 1)
    joint = fit_clips([*clips, short], PENDULUM, shared=["length"])
    assert joint.status == "ok"
    assert "clip 4 is too-short" in joint.message
    assert joint.shared["length"].source == "shared by 3 clips"


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"shared": ["mass"]}, "shared: model 'pendulum' has no parameter 'mass'"),
        ({"shared": ["length"], "per_clip": ["length"]}, "length cannot be both shared and per clip"),
        ({"shared": ["length"], "fixed": {"length": 0.6}}, "length cannot be both shared and fixed"),
    ],
)
def test_call_that_makes_no_sense_is_refused(options, message):
    with pytest.raises(FitError, match=message):
        fit_clips(swings([0.6, 0.6]), PENDULUM, **options)


def test_one_clip_is_no_pooled_fit():
    with pytest.raises(FitError, match="needs 2 of them, not 1"):
        fit_clips(swings([0.6]), PENDULUM)
