"""The demo's clip, and the table that sets estimates beside the truth."""

import numpy as np
import pytest

from iris_sysid.cli.demo import HIDDEN, compare, render_demo
from iris_sysid.synthetic import read_truth
from iris_sysid.synthetic.plan import plan_clip
from iris_sysid.types import Estimate, FitResult, OdeModel, Quantity


def fit_with(estimates, free):
    """A fit result that holds only estimates."""
    states = (Quantity("theta", "rad"), Quantity("omega", "rad/s"))
    model = OdeModel("pendulum", "", "", "", states, (), (), lambda t, s, p: s, lambda trajectory: {})
    nothing = np.empty((0, 0))
    return FitResult(
        model=model,
        status="ok",
        estimates=estimates,
        free=free,
        covariance=nothing,
        t_s=np.empty(0),
        used=np.empty(0, dtype=bool),
        predicted=nothing,
        residual=nothing,
        noise=np.empty(0),
        rms=np.empty(0),
        aic=0.0,
        bic=0.0,
        jacobian=nothing,
        fisher=nothing,
        condition=1.0,
        correlation=0.0,
        t0_s=0.0,
    )


def test_demo_clip_has_an_effect_hidden_in_it(tmp_path):
    clip, truth = render_demo(tmp_path / "demo", size=(160, 90), seconds=0.5)
    assert clip == tmp_path / "demo" / "pendulum.mp4"
    assert clip.is_file()
    assert truth.effects == HIDDEN == {"quadratic-drag": 0.12}
    assert read_truth(clip).parameters == truth.parameters


def test_demo_clip_is_the_same_again(tmp_path):
    for name in ("a", "b"):
        render_demo(tmp_path / name, size=(160, 90), seconds=0.5)
    assert (tmp_path / "a/pendulum.mp4").read_bytes() == (tmp_path / "b/pendulum.mp4").read_bytes()


def test_comparison_counts_the_difference_in_standard_errors():
    truth = plan_clip("pendulum", size=(64, 36), duration_s=0.5).truth
    estimates = {
        "length": Estimate(0.502, 0.001, "m"),
        "damping": Estimate(0.05, 0.01, "1/s"),
        "gravity": Estimate(9.80665, 0.0, "m/s^2", "assumed"),
        "theta_0": Estimate(0.3, 0.1, "rad"),
    }
    table = compare(truth, fit_with(estimates, ("length", "damping", "theta_0")))
    assert list(table.index) == ["length", "damping"]
    assert table.off.tolist() == pytest.approx([2.0, -1.0])
    assert table.truth.tolist() == [0.5, 0.06]
    assert table.unit.tolist() == ["m", "1/s"]


def test_comparison_uses_the_length_that_the_equation_has():
    truth = plan_clip("pendulum", effects={"finite-bob": 0.03}, size=(64, 36), duration_s=0.5).truth
    table = compare(truth, fit_with({"length": Estimate(0.53, 0.01, "m")}, ("length",)))
    assert table.truth["length"] == pytest.approx(0.5306792)


def test_comparison_knows_the_hidden_effects():
    truth = plan_clip("pendulum", effects={"quadratic-drag": 0.08}, size=(64, 36), duration_s=0.5).truth
    table = compare(truth, fit_with({"quadratic_drag": Estimate(0.09, 0.01, "1/rad")}, ("quadratic_drag",)))
    assert table.off["quadratic_drag"] == pytest.approx(1.0)


def test_comparison_without_standard_error_has_no_difference():
    truth = plan_clip("pendulum", size=(64, 36), duration_s=0.5).truth
    table = compare(truth, fit_with({"length": Estimate(0.5, float("nan"), "m")}, ("length",)))
    assert np.isnan(table.off["length"])
