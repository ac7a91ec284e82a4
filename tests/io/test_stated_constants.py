"""What was stated or left open when a trajectory was made travels with its table, and counts in every later fit."""

import numpy as np
import pytest

from iris_sysid import MODELS, Estimate, Trajectory, diagnose, fit, fit_clips, read_trajectory, write_trajectory

PENDULUM = MODELS["pendulum"]
GRAVITY = Estimate(9.79, 0.02, "m/s^2", "direct", "given")


def swing(n=240, seed=3, vertical=0.02, **fields):
    """Angles of a small swing, from a zero that is off by ``vertical``."""
    t_s = np.arange(n) / 60
    theta = vertical + 0.1 * np.cos(np.sqrt(9.81 / 0.5) * t_s) + 1e-4 * np.random.default_rng(seed).standard_normal(n)
    sigma = np.full((n, 1), 1e-4)
    return Trajectory(t_s, PENDULUM.observed, theta[:, None], sigma, np.ones(n, bool), **fields)


def test_constants_come_back_from_the_table(tmp_path):
    clip = swing(known={"gravity": GRAVITY}, free=("vertical",))
    back = read_trajectory(write_trajectory(clip, tmp_path / "t.csv"))
    assert dict(back.known) == {"gravity": GRAVITY}
    assert back.free == ("vertical",)


def test_fit_holds_what_was_stated_and_estimates_what_was_left_open():
    result = fit(swing(known={"gravity": GRAVITY}, free=("vertical",)), PENDULUM)
    assert result.verdict.good, result.message
    assert result.estimates["gravity"] == GRAVITY
    assert result.estimates["vertical"].value == pytest.approx(0.02, abs=1e-4)


def test_fit_is_told_otherwise():
    clip = swing(known={"gravity": GRAVITY}, free=("vertical",))
    result = fit(clip, PENDULUM, fixed={"gravity": 9.0, "vertical": 0.02})
    assert result.estimates["gravity"].value == 9.0
    assert "vertical" not in result.free


def test_constants_of_another_model_do_not_matter():
    clip = swing(known={"no_such_constant": GRAVITY}, free=("nor_this",))
    assert fit(clip, PENDULUM).free == fit(swing(), PENDULUM).free


def test_value_known_exactly_is_estimated_where_it_is_free():
    exact = Estimate(0.3, 0.0, "rad")
    assert "vertical" in fit(swing(known={"vertical": exact}), PENDULUM, free=["vertical"]).free


def test_fit_to_several_clips_has_the_open_constants_of_each():
    clips = [swing(seed=seed, vertical=angle, free=("vertical",)) for seed, angle in ((1, 0.02), (2, -0.03))]
    pooled = fit_clips(clips, PENDULUM, shared=["length"])
    angles = [clip.estimates["vertical"].value for clip in pooled.clips]
    assert angles == pytest.approx([0.02, -0.03], abs=2e-4)
    assert "vertical" not in pooled.estimates  # each clip's own: no mean is wanted


def test_diagnosis_of_an_open_vertical_names_no_offset():
    assert diagnose(swing(free=("vertical",)), PENDULUM).added == ()


def test_angles_of_a_table_without_an_origin_have_an_open_zero(tmp_path):
    rows = "\n".join(f"{t},{theta}" for t, theta in zip(swing().t_s, swing().position[:, 0], strict=True))
    (tmp_path / "angles.csv").write_text(f"t_s,theta_rad\n{rows}\n")
    assert read_trajectory(tmp_path / "angles.csv").free == ("vertical",)
