"""The smoother is the least-squares estimate it should be, and its errors are right."""

import numpy as np
import pytest
from filterpy.kalman import KalmanFilter
from scipy.stats import chi2

from iris_sysid import DataError, Quantity, Segment, Trajectory
from iris_sysid.trajectory.smoothing import log_likelihood, smooth
from iris_sysid.trajectory.white_jerk_model import diffuse_start, innovations, process_noise, transition
from tests._project import recording


def trajectory(t_s, values, sigma, valid=None, **more):
    values = np.asarray(values, float).reshape(len(t_s), -1)
    valid = np.ones(len(t_s), bool) if valid is None else np.asarray(valid)
    values = np.where(valid[:, None], values, np.nan)
    names = tuple(Quantity(name, "m") for name in "xyz"[: values.shape[1]])
    return Trajectory(t_s, names, values, np.broadcast_to(sigma, values.shape), valid, **more)


def uneven_with_gaps(rng, n=40):
    t_s = np.cumsum(rng.uniform(0.01, 0.06, n))
    valid = rng.random(n) > 0.2
    valid[[1, 3, 20, 21, 22, 23]] = False
    valid[[0, -1]] = True
    return t_s, valid


def white_jerk_motion(rng, t_s, psd, start=(0.0, 0.0, 0.0)):
    """Value and rate (n, 2) of a coordinate driven by white jerk."""
    states = [np.array(start)]
    for dt in np.diff(t_s):
        states.append(transition(dt) @ states[-1] + rng.multivariate_normal(np.zeros(3), process_noise(dt, psd)))
    return np.array(states)[:, :2]


def least_squares(t_s, values, sigma, valid, psd):
    """All states at once by generalised least squares, no prior: (n, 3) and covariance (3 n, 3 n)."""
    n = len(t_s)
    rows, right = [], []
    for k in np.flatnonzero(valid):
        row = np.zeros(3 * n)
        row[3 * k] = 1.0 / sigma[k]
        rows.append(row[None])
        right.append([values[k] / sigma[k]])
    for k, dt in enumerate(np.diff(t_s)):
        row = np.zeros((3, 3 * n))
        row[:, 3 * k : 3 * k + 3] = -transition(dt)
        row[:, 3 * k + 3 : 3 * k + 6] = np.eye(3)
        whiten = np.linalg.inv(np.linalg.cholesky(process_noise(dt, psd)))
        rows.append(whiten @ row)
        right.append(np.zeros(3))
    q, r = np.linalg.qr(np.concatenate(rows))
    inverse = np.linalg.inv(r)
    return (inverse @ (q.T @ np.concatenate(right))).reshape(n, 3), inverse @ inverse.T


@pytest.mark.parametrize("psd", [0.3, 40.0, 5000.0])
def test_smooth_with_uneven_times_and_gaps_equals_least_squares_over_all_states(psd):
    rng = np.random.default_rng(5)
    t_s, valid = uneven_with_gaps(rng)
    sigma = rng.uniform(0.005, 0.02, (t_s.size, 2))
    values = np.stack([np.sin(4 * t_s), t_s**2], axis=1) + sigma * rng.standard_normal((t_s.size, 2))
    smoothed = smooth(trajectory(t_s, values, sigma, valid), psd=psd).smoothed
    for column in range(2):
        states, covariance = least_squares(t_s, values[:, column], sigma[:, column], valid, psd)
        np.testing.assert_allclose(smoothed.position[:, column], states[:, 0], rtol=0, atol=1e-9)
        np.testing.assert_allclose(smoothed.velocity[:, column], states[:, 1], rtol=0, atol=1e-9 / 0.02)
        blocks = covariance.reshape(t_s.size, 3, t_s.size, 3)[np.arange(t_s.size), :, np.arange(t_s.size)]
        rows = [column, 2 + column]
        np.testing.assert_allclose(smoothed.covariance[:, rows][:, :, rows], blocks[:, :2, :2], rtol=1e-7)
    assert np.all(smoothed.covariance[:, 0, 1] == 0)


def test_smooth_without_process_noise_equals_the_fitted_parabola():
    rng = np.random.default_rng(2)
    t_s = np.arange(50) / 50
    values = 1 - 4.9 * t_s**2 + 0.01 * rng.standard_normal(50)
    smoothed = smooth(trajectory(t_s, values, 0.01), psd=0.0).smoothed
    parabola = np.polynomial.Polynomial.fit(t_s, values, 2)
    np.testing.assert_allclose(smoothed.position[:, 0], parabola(t_s), atol=1e-9)
    np.testing.assert_allclose(smoothed.velocity[:, 0], parabola.deriv()(t_s), atol=1e-8)


@pytest.mark.parametrize("psd", [1e-3, 1.0, 1e4])
def test_likelihood_equals_that_of_filterpy(psd):
    rng = np.random.default_rng(3)
    t, valid = uneven_with_gaps(rng)
    z, variance = np.sin(3 * t), rng.uniform(0.5, 2, t.size) * 1e-4
    start = diffuse_start(t[valid], z[valid], variance[valid], psd)
    ours = innovations(t[valid], z[valid], variance[valid], psd, start.state, start.covariance)
    third = np.flatnonzero(valid)[2]
    kalman = KalmanFilter(dim_x=3, dim_z=1)
    kalman.H = np.array([[1.0, 0.0, 0.0]])
    kalman.x, kalman.P = start.state[:, None], start.covariance
    total = 0.0
    for k in range(third + 1, t.size):
        dt = t[k] - t[k - 1]
        kalman.predict(F=transition(dt), Q=process_noise(dt, psd))
        kalman.update(z[k] if valid[k] else None, R=variance[k])
        if valid[k]:  # at a gap log_likelihood keeps its last value
            total += kalman.log_likelihood
    assert log_likelihood(*ours) == pytest.approx(total, rel=1e-9)


def test_psd_chosen_from_the_data_is_the_true_one():
    rng = np.random.default_rng(8)
    t_s = np.cumsum(rng.uniform(0.01, 0.03, 3000))
    motion = white_jerk_motion(rng, t_s, psd=50.0)[:, 0]
    smoothed = smooth(trajectory(t_s, motion + 0.01 * rng.standard_normal(t_s.size), 0.01)).smoothed
    assert smoothed.psd[0] == pytest.approx(50.0, rel=0.35)
    low, high = chi2.interval(0.95, t_s.size - 3)
    assert low < smoothed.nis[0] * (t_s.size - 3) < high


def test_unknown_noise_is_estimated_with_the_process_noise():
    rng = np.random.default_rng(9)
    t_s = np.arange(3000) / 60
    motion = white_jerk_motion(rng, t_s, psd=5.0)[:, 0]
    measured = motion + 0.01 * rng.standard_normal(t_s.size)
    known = smooth(trajectory(t_s, measured, 0.01)).smoothed
    unknown = smooth(trajectory(t_s, measured, np.nan)).smoothed
    ratio = np.sqrt(unknown.covariance[1500, 0, 0] / known.covariance[1500, 0, 0])
    assert ratio == pytest.approx(1.0, abs=0.05)
    assert unknown.nis[0] == pytest.approx(1.0)
    stated = smooth(trajectory(t_s, measured, np.nan), psd=unknown.psd[0]).smoothed
    np.testing.assert_allclose(stated.position, unknown.position, atol=2e-4)


@pytest.mark.parametrize("sigma_known", [True, False])
def test_pull_of_position_and_velocity_is_one_on_motion_under_white_jerk(sigma_known):
    rng = np.random.default_rng(10)
    pulls = []
    for _ in range(20):
        t_s, valid = uneven_with_gaps(rng, 300)
        motion = white_jerk_motion(rng, t_s, psd=80.0)
        sigma = 0.01 if sigma_known else np.nan
        got = smooth(trajectory(t_s, motion[:, 0] + 0.01 * rng.standard_normal(t_s.size), sigma, valid)).smoothed
        error = np.stack([got.position[:, 0], got.velocity[:, 0]], axis=1) - motion
        pulls.append(error / np.sqrt(got.covariance[:, [0, 1], [0, 1]]))
    spread = np.std(np.concatenate(pulls), axis=0)
    assert np.all((spread > 0.9) & (spread < 1.1)), spread


@pytest.mark.parametrize("frames_per_s", [10, 30, 240])
def test_pull_on_a_pendulum_is_below_one_but_not_by_much(frames_per_s):
    rng = np.random.default_rng(11)
    t_s = np.arange(400) / frames_per_s
    theta, omega = np.cos(4.3 * t_s), -4.3 * np.sin(4.3 * t_s)
    got = smooth(trajectory(t_s, theta + 0.002 * rng.standard_normal(400), 0.002)).smoothed
    position = np.std((got.position[:, 0] - theta) / np.sqrt(got.covariance[:, 0, 0]))
    velocity = np.std((got.velocity[:, 0] - omega) / np.sqrt(got.covariance[:, 1, 1]))
    assert 0.7 < position < 1.1
    assert 0.4 < velocity < 1.1


def test_standard_error_grows_into_a_gap_and_nothing_is_nan_there():
    t_s = np.arange(60) / 30
    valid = np.ones(60, bool)
    valid[25:36] = False
    rng = np.random.default_rng(4)
    smoothed = smooth(trajectory(t_s, np.sin(5 * t_s) + 0.01 * rng.standard_normal(60), 0.01, valid)).smoothed
    sd = np.sqrt(smoothed.covariance[:, 0, 0])
    assert np.all(np.diff(sd[24:31]) > 0)
    assert np.all(np.diff(sd[30:37]) < 0)
    assert np.all(np.isfinite(smoothed.velocity))
    assert np.max(np.abs(smoothed.position[:, 0] - np.sin(5 * t_s))) < 5 * sd.max()


def test_before_the_first_and_after_the_last_sample_nothing_is_claimed():
    t_s = np.arange(30) / 30
    valid = (t_s > 0.2) & (t_s < 0.7)
    smoothed = smooth(trajectory(t_s, t_s**2, 0.01, valid)).smoothed
    np.testing.assert_array_equal(np.isfinite(smoothed.position[:, 0]), valid)


def test_an_impact_is_not_smoothed_away():
    t_s = np.arange(120) / 60
    height = np.where(t_s < 1, 1 - t_s, 0.8 * (t_s - 1))
    segments = (
        Segment("motion", 0, 60),
        Segment("contact", 60, 61, "velocity jumps"),
        Segment("motion", 61, 120),
    )
    rng = np.random.default_rng(6)
    measured = height + 0.002 * rng.standard_normal(120)
    cut = smooth(trajectory(t_s, measured, 0.002, segments=segments)).smoothed
    whole = smooth(trajectory(t_s, measured, 0.002)).smoothed
    true = np.where(t_s < 1, -1.0, 0.8)
    near = np.r_[50:60, 61:70]
    assert np.sqrt(np.mean((cut.velocity[near, 0] - true[near]) ** 2)) < 0.03
    assert np.sqrt(np.mean((whole.velocity[near, 0] - true[near]) ** 2)) > 0.1
    assert np.isnan(cut.velocity[60, 0])
    assert cut.position[60, 0] == measured[60]


def test_process_noise_is_chosen_in_the_motion_only():
    rng = np.random.default_rng(7)
    t_s = np.arange(120) / 60
    shaken = np.where(t_s < 1, 0.2 * np.sin(40 * t_s), 0.2 * np.sin(40.0) - (t_s - 1) ** 2)
    segments = (Segment("hand", 0, 60), Segment("motion", 60, 120))
    measured = shaken + 0.002 * rng.standard_normal(120)
    chosen = smooth(trajectory(t_s, measured, 0.002, segments=segments)).smoothed.psd[0]
    alone = smooth(trajectory(t_s[60:], measured[60:], 0.002)).smoothed.psd[0]
    psd = smooth(trajectory(t_s, measured, 0.002)).smoothed.psd[0]
    assert chosen < 1e-6
    assert alone < 1e-6
    assert psd > 1e3


@pytest.mark.parametrize("count", [1, 2])
def test_fewer_than_three_samples_are_returned_as_measured(count):
    got = smooth(trajectory(np.arange(count) / 10, np.arange(count), 0.5)).smoothed
    np.testing.assert_array_equal(got.position[:, 0], np.arange(count))
    np.testing.assert_array_equal(got.covariance[:, 0, 0], 0.25)
    assert np.all(np.isnan(got.velocity))


def test_three_samples_are_passed_exactly():
    got = smooth(trajectory(np.arange(3) / 10, [0.0, 0.1, 0.4], 0.01)).smoothed
    np.testing.assert_allclose(got.position[:, 0], [0.0, 0.1, 0.4], atol=1e-12)
    np.testing.assert_allclose(got.velocity[:, 0], [0.0, 2.0, 4.0], atol=1e-9)


@pytest.mark.parametrize("sigma", [0.01, np.nan])
def test_constant_data_stand_still(sigma):
    got = smooth(trajectory(np.arange(100) / 30, np.full(100, 3.25), sigma)).smoothed
    np.testing.assert_allclose(got.position, 3.25, atol=1e-9)
    np.testing.assert_allclose(got.velocity, 0.0, atol=1e-7)
    assert np.all(np.isfinite(got.covariance))


@pytest.mark.parametrize("sigma", [1e-7, np.nan])
@pytest.mark.parametrize("scale", [1e-6, 1.0, 1e6])
def test_noise_free_motion_is_returned_as_it_is(sigma, scale):
    t_s = np.arange(200) / 60
    got = smooth(trajectory(t_s, scale * np.cos(4 * t_s), sigma * scale)).smoothed
    np.testing.assert_allclose(got.position[:, 0], scale * np.cos(4 * t_s), atol=1e-5 * scale)
    np.testing.assert_allclose(got.velocity[3:-3, 0], -4 * scale * np.sin(4 * t_s[3:-3]), atol=1e-3 * scale)


@pytest.mark.parametrize(
    ("change", "psd", "message"),
    [
        ({"valid": np.zeros(20, bool)}, None, "none of the 20 samples is valid"),
        ({"sigma": np.zeros((20, 1))}, None, r"sigma\[0\] of x is 0: a standard error must be above zero"),
        ({"sigma": np.full((20, 1), np.inf)}, None, "finite"),
        ({}, -1.0, "must be finite and at least zero"),
        ({}, np.nan, "must be finite and at least zero"),
        ({}, [1.0, 2.0], "psd has 2 values for 1 quantities"),
    ],
)
def test_smooth_refuses_with_the_reason(change, psd, message):
    fine = trajectory(np.arange(20) / 10, np.arange(20), 0.1)
    with pytest.raises(DataError, match=message):
        smooth(fine.with_(**change), psd=psd)


def test_webcam_pendulum_of_whole_pixels_has_the_noise_of_rounding():
    folder = recording("alexiev_pendulum")
    t_s = np.loadtxt(folder / "length_68_t.csv")
    x_px = np.loadtxt(folder / "length_68_x.csv")
    got = smooth(trajectory(t_s, x_px, np.nan)).smoothed
    residual = x_px - got.position[:, 0]
    assert 0.1 < residual.std() < 1.0
