"""Charts as SVG and as data, the words on a residual, and text as a reader expects it."""

import math
import re
from dataclasses import replace

import numpy as np
import pytest

from iris_sysid import MODELS, fit
from iris_sysid.registry import EFFECTS
from iris_sysid.report.chart import Band, Chart, ChartMark, Series
from iris_sysid.report.page import Bar, KeyValue
from iris_sysid.report.residual_charts import motion_chart, residual_chart
from iris_sysid.report.residual_words import residual_words
from iris_sysid.report.typeset import name_with_symbol, symbol_html, typeset
from iris_sysid.types import Estimate, Quantity, Segment, Trajectory

NAN = float("nan")


# --------------------------------------------------------------------------- text


@pytest.mark.parametrize(
    ("plain", "read"),
    [
        ("-9.80 ± 0.10 m/s^2", "−9.80 ± 0.10 m/s²"),
        ("-0.045 to -0.001", "−0.045 to −0.001"),
        ("0-34 (0.000-0.567 s)", "0-34 (0.000-0.567 s)"),
        ("clip-2.mp4 and --fps 30", "clip-2.mp4 and --fps 30"),
        ("2.1e+02 times", "210 times"),
        ("-3.4e-05 rad", "−3.4·10⁻⁵ rad"),
        ("0 +- 2.3e-05 1", "0 ± 2.3·10⁻⁵ 1"),
        ("0.02 1/s^2, 3 m^0.5/s", "0.02 1/s², 3 m⁰·⁵/s"),
        ("a2e+02b", "a2e+02b"),
        ("30.0 ± 0.1 ° at 2 °/s", "30.0 ± 0.1° at 2 °/s"),
    ],
)
def test_text_is_set_as_it_is_read(plain, read):
    assert typeset(plain) == read


@pytest.mark.parametrize(
    ("latex", "html"),
    [
        (r"\theta_{1}", "θ<sub>1</sub>"),
        (r"\varphi_0", "φ<sub>0</sub>"),
        ("m_2/m_1", "m<sub>2</sub>/m<sub>1</sub>"),
        (r"R\omega", "Rω"),
        ("e^2", "e²"),
        ("<b>", "&lt;b&gt;"),
        ("", ""),
    ],
)
def test_symbol_is_set_in_html(latex, html):
    assert str(symbol_html(latex)) == html


@pytest.mark.parametrize(
    ("stderr", "unit", "number", "shown"),
    [
        (0.01, "1/rad", "0.120 ± 0.010", "1/rad"),
        (0.01, "rad", "6.88 ± 0.57", "°"),
        (0.01, "1", "0.120 ± 0.010", ""),
        (math.inf, "m", "undetermined", ""),
    ],
)
def test_unit_of_a_large_number_is_apart_from_it(stderr, unit, number, shown):
    value = KeyValue("drag", "c", Estimate(0.12, stderr, unit, "fitted", "fit"))
    assert (value.number, value.unit) == (number, shown)


def test_small_part_of_a_bar_is_seen_beside_the_others():
    bar = Bar("residual", [("drag", 30.0, "force"), ("reading", 0.01, "reading"), ("noise", 69.99, "noise")])
    assert bar.drawn == [("force", 0.0, 30.0), ("reading", 30.0, 0.4), ("noise", 30.4, 69.99)]


def test_legend_says_what_the_first_view_lacks():
    t_s = np.linspace(0, 1, 11)
    series = [Series("hand", t_s[:3], t_s[:3], "input"), Series("motion", t_s[3:], t_s[3:], "body-1")]
    chart = Chart("motion-0", "Motion.", "time (s)", "x (m)", series, reach=(0.25, 1.0))
    assert [name for name, *_ in chart.legend] == ["hand", "motion"]
    assert chart.outside == {"hand"}


def test_every_symbol_of_the_library_can_be_set():
    parameters = [parameter for one in (*MODELS.values(), *EFFECTS.values()) for parameter in one.parameters]
    for parameter in parameters:
        assert not re.search(r"[\\{}]", symbol_html(parameter.symbol)), parameter.symbol


def test_name_has_its_symbol_where_that_says_more():
    assert name_with_symbol(Quantity("theta1", "rad", r"\theta_1")) == "theta1 θ₁"
    assert name_with_symbol(Quantity("z", "m", "z")) == "z"
    assert name_with_symbol(Quantity("z", "m")) == "z"


# --------------------------------------------------------------------------- charts


def a_chart(**changes):
    x = np.linspace(0.0, 10.0, 11)
    curve = Series("curve", x, x**2, "after", "line")
    dots = Series("dots", x, np.where(x == 5, NAN, -x), "before")
    band = Band("noise", x[[0, -1]], np.full(2, -2.0), np.full(2, 2.0), "noise")
    chart = Chart("c", "A chart.", "time (s)", "z (m)", [curve, dots], [band], [ChartMark(10.0, 100.0, "largest")])
    return replace(chart, **changes)


def test_chart_as_data_has_every_curve_with_gaps():
    document = a_chart().document()
    assert [one["name"] for one in document["series"]] == ["curve", "dots"]
    assert document["series"][1]["y"][4:7] == [-4.0, None, -6.0]
    assert document["bands"][0]["upper"] == [2.0, 2.0]


def test_chart_as_svg_draws_every_point_inside_the_frame():
    svg = str(a_chart().svg())
    curve = re.search(r'class="curve line after" d="([^"]*)"', svg)[1]
    points = [tuple(map(float, point.split())) for point in re.split("[ML]", curve)[1:]]
    assert len(points) == 11
    assert all(70 <= x <= 708 and 12 <= y <= 196 for x, y in points)
    assert [x for x, _ in points] == sorted(x for x, _ in points)
    assert [y for _, y in points] == sorted((y for _, y in points), reverse=True)  # upwards
    dots = re.search(r'class="curve dots before" d="([^"]*)"', svg)[1]
    assert dots.count("M") == 10  # without the gap
    assert ">largest</text>" in svg


def test_chart_shows_the_part_of_the_axis_that_it_was_told():
    svg = str(a_chart(reach=(2.0, 6.0)).svg())
    assert re.search(r'class="curve dots few before" d="([^"]*)"', svg)[1].count("M") == 4
    assert a_chart(reach=(2.0, 6.0)).document()["reach"] == (2.0, 6.0)


@pytest.mark.parametrize("values", [[NAN, NAN], [], [3.0, 3.0], [1e300, -1e300]])
def test_chart_of_nothing_or_of_one_value_can_be_drawn(values):
    y = np.array(values, float)
    chart = a_chart(series=[Series("one", np.arange(y.size, dtype=float), y, "before", "line")], bands=(), marks=())
    assert "nan" not in chart.svg()
    assert "inf" not in chart.svg()


def test_long_record_is_thinned_out_but_keeps_its_extremes():
    t_s = np.arange(100_000) / 1000
    y = np.sin(t_s)
    y[77_777] = 9.0
    chart = a_chart(series=[Series("long", t_s, y, "before", "line")])
    (series,) = chart.document()["series"]
    assert len(series["x"]) <= 5000
    assert max(series["y"]) == 9.0


# --------------------------------------------------------------------------- words


@pytest.fixture(scope="module")
def swinging():
    t_s = np.arange(240) / 40
    theta = 0.3 * np.cos(4.4 * t_s)
    theta += 1e-4 * np.random.default_rng(0).standard_normal(t_s.size)
    quantities = (Quantity("theta", "rad", r"\theta"),)
    clip = Trajectory(
        t_s,
        quantities,
        theta[:, None],
        np.full((240, 1), NAN),
        np.ones(240, bool),
        segments=(Segment("motion", 0, 240),),
    )
    return clip, fit(clip, MODELS["pendulum"])


def looks(fitted, residual):
    words = residual_words(replace(fitted, residual=residual[:, None], noise=np.array([1e-4])), 0)
    return words.looks


def test_residual_is_said_to_be_largest_where_it_is(swinging):
    _, fitted = swinging
    residual = np.full(240, 1e-3)
    residual[100] = -0.02
    words = residual_words(replace(fitted, residual=residual[:, None]), 0)
    assert (words.t_s, words.value) == (pytest.approx(2.5), -0.02)


def test_words_say_what_a_residual_looks_like(swinging):
    _, fitted = swinging
    t_s, motion = fitted.t_s, fitted.predicted[:, 0]
    noise = 1e-4 * np.random.default_rng(1).standard_normal(240)
    assert looks(fitted, noise) == "no more than noise"
    assert looks(fitted, 0.01 * np.gradient(motion, t_s) + noise) == "it goes with the velocity"
    assert looks(fitted, 0.05 * motion + noise) == "it goes with the position"
    assert looks(fitted, 0.01 * (t_s - 3) ** 2 + noise) == "it drifts slowly with time"
    assert "almost always in the right-hand swing" in looks(fitted, 0.01 * np.where(motion > 0.1, 1, 0) + noise)
    assert "almost always in the left-hand swing" in looks(fitted, 0.01 * np.where(motion < -0.1, 1, 0) + noise)
    assert "mostly in the first 1.2 s" in looks(fitted, np.where(t_s < 1, 0.01, 0) + noise)
    spike = noise.copy()
    spike[50] = 0.05
    assert looks(fitted, spike).startswith("almost all in a few samples")
    spike[50] = 4e-3  # below 1.5 times a noise that it has raised
    raised = replace(fitted, residual=spike[:, None], noise=np.array([np.sqrt(np.mean(spike**2))]))
    assert residual_words(raised, 0).looks == "almost all in a few samples"
    alternating = 0.01 * (-1.0) ** np.arange(240)
    assert looks(fitted, alternating) == "of no simple form"


def test_residual_of_a_motion_that_does_not_turn_follows_it(swinging):
    _, fitted = swinging
    fall = replace(fitted, predicted=-4.9 * fitted.t_s[:, None] ** 2)
    assert looks(fall, 0.01 * (fitted.t_s - 3) ** 4) == "it follows the motion, in a size that changes"


def test_chart_of_a_residual_carries_the_words_in_degrees(swinging):
    _, fitted = swinging
    residual = np.zeros((240, 1))
    residual[100] = np.radians(-3.0)
    chart = residual_chart(replace(fitted, residual=residual), 0, 1e-3, name="residual-0")
    assert chart.y_label == "residual (°)"
    (mark,) = chart.marks
    assert (mark.x, mark.y, mark.text) == (pytest.approx(2.5), pytest.approx(-3.0), "largest: -3° at 2.50 s")
    assert chart.words == "Largest: -3° at 2.50 s; almost all in a few samples."
    assert "largest: −3° at 2.50 s" in chart.svg()


def test_chart_of_a_motion_has_a_colour_for_each_body_and_each_part():
    t_s = np.arange(60) / 30
    theta = np.column_stack([0.3 * np.cos(4.4 * t_s), 0.2 * np.cos(3.9 * t_s)])
    theta += 1e-4 * np.random.default_rng(0).standard_normal(theta.shape)
    quantities = (Quantity("theta1", "rad"), Quantity("theta2", "rad"))
    parts = (Segment("hand", 0, 5), Segment("motion", 5, 60))
    clip = Trajectory(t_s, quantities, theta, np.full_like(theta, NAN), np.ones(60, bool), segments=parts)
    fitted = fit(clip, MODELS["coupled-pendulums"])
    first, second = (motion_chart(clip, [(fitted, "the model", "before")], k) for k in (0, 1))
    colours = {one.name: one.colour for one in first.series}
    assert len(set(colours.values())) == len(colours) == 3
    assert {one.name: one.colour for one in second.series}["motion"] != colours["motion"]
