"""Every result has a plot with the right things in it, and a notebook shows it with its numbers, escaped."""

import re
from dataclasses import replace

import numpy as np
import pytest
from matplotlib.figure import Figure

from iris_sysid import (
    MODELS,
    DataError,
    Doubt,
    Estimate,
    Quantity,
    Segment,
    Track,
    TrackQuality,
    Trajectory,
    diagnose,
    discover,
    fit,
    plan,
    plot,
    predict,
    smooth,
    to_html,
)
from iris_sysid.diagnosis.planning.rivals import Question
from iris_sysid.report.figures import MAX_POINTS, outline
from tests._motions import pendulum_angle
from tests.diagnosis.test_planning import QUESTION, swing
from tests.types.test_pickling import T_S, dragged

N = T_S.size
CLIP = dragged().with_(
    segments=(Segment("hand", 0, 20), Segment("motion", 20, N)), geometry={"<b>pivot": Estimate(1.0, 0.1, "m")}
)
DOUBT = Doubt("missed", "<script>lost</script>", "give --roi")
ARC = np.column_stack([320 + 200 * np.sin(CLIP.position[:, 0]), 100 + 200 * np.cos(CLIP.position[:, 0])])
TRACK = Track(T_S, ARC, np.ones((N, 2)), np.ones(N, bool), np.arange(N), quality=TrackQuality((DOUBT,)))
FIT = fit(CLIP, "pendulum")
FAILED = fit(CLIP.with_(segments=(), valid=T_S < 0.05), "pendulum")
DIAGNOSIS = diagnose(CLIP, "pendulum", effects=["quadratic-drag"])
DISCOVERY = discover(CLIP, resampled=5)
PREDICTION = predict(FIT, [T_S[-1] + 1.0, T_S[-1] + 0.5, T_S[0] - 1.0])
REPEATED = plan(Question(MODELS["pendulum"], ()), CLIP, changes=[])
UNDECIDED = plan(QUESTION, swing(0.15), changes=[])
RESULTS = {
    "trajectory": (CLIP, ["theta (rad)"]),
    "smoothed": (smooth(CLIP).smoothed, ["position", "velocity"]),
    "track": (TRACK, ["y (px)", "x (px)", "y (px)"]),
    "fit": (FIT, ["theta (rad)", "residual (rad)"]),
    "failed fit": (FAILED, ["theta (rad)", "residual (rad)"]),
    "diagnosis": (DIAGNOSIS, ["theta (rad)", "residual before", "residual after"]),
    "complete": (
        diagnose(CLIP.with_(position=pendulum_angle(T_S, 0.5)[:, None]), "pendulum", effects=["leak"]),
        ["theta (rad)", "residual"],
    ),
    "prediction": (PREDICTION, ["theta (rad)"]),
    "plan of one name": (REPEATED, [""]),
    "plan of two names": (UNDECIDED, ["difference of theta after a refit (rad)", ""]),
    "discovery": (DISCOVERY, ["", "", "theta (rad)", "residual (rad)"]),
}


@pytest.mark.parametrize("name", RESULTS)
def test_plot_returns_its_axes_from_the_top_down(name):
    result, labels = RESULTS[name]
    figure = Figure()
    axes = plot(result, figure)
    assert [one.get_ylabel() for one in axes] == labels
    figure.canvas.draw()


@pytest.mark.parametrize("name", RESULTS)
def test_notebook_shows_picture_and_text_without_markup_from_data(name):
    html = RESULTS[name][0]._repr_html_()
    assert 'src="data:image/png;base64,iVBOR' in html
    assert set(re.findall(r"<(\w+)", html)) <= {"div", "b", "img", "table", "thead", "tbody", "tr", "th", "td"}


def test_plot_without_a_figure_is_one_of_pyplot():
    import matplotlib.pyplot as plt

    before = plt.get_fignums()
    axes = plot(FIT)
    assert axes[0].figure.number not in before
    plt.close(axes[0].figure)


def test_fit_is_drawn_with_the_measured_angles_and_its_curve():
    data, residual = plot(FIT, Figure())
    measured, curve = data.lines
    np.testing.assert_allclose(measured.get_ydata()[FIT.used], CLIP.position[FIT.used, 0])
    np.testing.assert_allclose(np.interp(T_S[200], *curve.get_data()), FIT.predicted[200, 0], atol=1e-3)
    np.testing.assert_array_equal(residual.lines[-1].get_ydata(), FIT.residual[:, 0])


def test_diagnosis_is_drawn_with_smaller_residuals_after():
    _, before, after = plot(DIAGNOSIS, Figure())
    spread = [np.nanstd(axes.lines[-1].get_ydata()) for axes in (before, after)]
    assert spread[1] < 0.2 * spread[0]


def test_prediction_is_drawn_in_the_order_of_time_beside_the_data():
    (axes,) = plot(PREDICTION, Figure())
    line = next(line for line in axes.lines if line.get_label() == "predicted")
    assert line.get_xdata().tolist() == sorted(PREDICTION.t_s)
    assert {text.get_text() for text in axes.get_legend().get_texts()} == {
        "measured",
        "fit",
        "predicted",
        "95 % of the equation",
    }
    html = to_html(PREDICTION)
    assert re.search(rf"<td>{T_S[-1] + 1.0:g}</td><td>[^<]* ± [^<]* °</td>", html)
    assert f"<td>{T_S[0] - 1.0:g}</td><td>undetermined</td>" in html  # before the fitted motion nothing is predicted


def test_plan_shows_what_is_in_question_and_what_to_do():
    assert "In question: quadratic-drag" in to_html(UNDECIDED)
    assert "Next:" in to_html(REPEATED)
    assert "<th>what to do</th>" in to_html(REPEATED)


def test_inputs_and_several_quantities_have_rows_of_their_own():
    position = np.column_stack([np.sin(T_S), np.cos(T_S)])
    known = np.sin(T_S)[:, None]
    quantities, pump = (Quantity("x", "m"), Quantity("z", "m")), (Quantity("u", "V"),)
    driven = Trajectory(T_S, quantities, position, np.full((N, 2), np.nan), np.ones(N, bool), pump, known)
    assert [axes.get_ylabel() for axes in plot(driven, Figure())] == ["x (m)", "z (m)", "u (V)"]


def test_notebook_has_the_numbers_with_their_errors():
    html = to_html(FIT)
    assert re.search(r"<td>length</td><td>0\.49\d* ± 0\.\d+ m</td>", html)
    assert "equation incomplete" in html
    assert "misfit" not in html
    assert "quadratic_drag" in to_html(DIAGNOSIS)
    assert "&lt;b&gt;pivot" in to_html(CLIP)
    assert "&lt;script&gt;lost" in to_html(TRACK)
    hostile = replace(FIT, model=replace(FIT.model, name="<img src=x>"))
    assert "<img src=x>" not in to_html(hostile)


def test_what_has_no_plot_is_refused():
    with pytest.raises(DataError, match="no plot of an object of type OdeModel"):
        plot(MODELS["pendulum"])


def test_long_record_is_drawn_by_the_extremes_of_short_parts():
    values = np.random.default_rng(0).standard_normal(100_000)
    values[[17, 60_001]] = np.nan, 50.0
    shown = outline(values)
    assert shown.size <= MAX_POINTS
    assert 60_001 in shown
    assert np.argmin(np.where(np.isfinite(values), values, 0.0)) in shown
    assert np.all(np.diff(shown) > 0)
    np.testing.assert_array_equal(outline(values[:MAX_POINTS]), np.arange(MAX_POINTS))
