"""The parts of a residual in text, picture, page and file."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
from matplotlib.colors import to_rgb

from iris_sysid import diagnose, to_html
from iris_sysid.io.json_documents import read_document
from iris_sysid.io.schemas import DiagnosisDocument
from iris_sysid.registry import EFFECTS
from iris_sysid.report.component_figure import component_caption, component_figure, part_colours
from iris_sysid.report.diagnosis_charts import component_charts
from iris_sysid.report.diagnosis_page import diagnosis_page, write_diagnosis
from iris_sysid.report.diagnosis_text import diagnosis_sentence, diagnosis_sentences, parts_sentence
from iris_sysid.report.page import html_of, png_of
from iris_sysid.review.views import residual_parts
from iris_sysid.types import Estimate, Finding, Quantity
from tests._split_residuals import GROUP, LOCATED, OPEN, components, drag_part, dragged, split_diagnosis, wander_part

NAN = float("nan")
NOTHING = "The residual is noise: nothing is missing that these data could show."


@pytest.fixture(scope="module")
def split():
    return split_diagnosis()


# --------------------------------------------------------------------------- sentences


def test_sentence_of_the_parts_gives_every_part_its_share_its_size_and_its_meaning():
    narrow = components(drag_part(share_range=(0.8, 0.82)), wander_part())
    assert parts_sentence(narrow) == (
        "81 % of the residual depends on the velocity like drag or friction (0.23°); 8 % is a slow wander of the zero "
        "(0.069°, about 11 s): the support, the camera or the sensor moves; 11 % is noise."
    )


def test_sentence_of_the_parts_gives_the_range_of_a_share_where_it_is_wide_and_what_may_take_its_place():
    unsure = wander_part(share=0.6, share_range=(0.2, 0.9), similar=("force-of-time", "input"))
    assert parts_sentence(components(unsure, noise_share=0.4)).startswith(
        "60 % (20 to 90 %) of the residual is a slow wander of the zero, or is a slow force in time or an error of the "
        "measured input (0.069°"
    )


def test_sentence_of_the_parts_says_when_a_pulse_acts():
    pulse = drag_part(kind="pulse", at=Estimate(3.217, 0.012, "s"), curve=None, share_range=(0.8, 0.82))
    assert "is a pulse at 3.217 ± 0.012 s (0.23°): an impact, a push or a late release" in parts_sentence(
        components(pulse)
    )


def test_sentence_of_the_parts_sums_up_parts_that_are_too_small_to_name():
    small = [wander_part(share=0.02), drag_part(kind="clock", share=0.01, curve=None)]
    text = parts_sentence(components(drag_part(), *small, noise_share=0.16))
    assert "; 3 % lies in smaller parts; 16 % is noise." in text
    assert "clock" not in text


def test_residual_far_above_the_noise_is_not_called_noise_where_no_part_is_found():
    whole = components(noise_share=1.0)
    said = parts_sentence(whole, noise=whole.residual_rms / 270)
    assert said == "The residual is 270 times the noise, and no part of it has a form that these data show."


def test_sentence_of_the_parts_of_noise_says_that_nothing_is_missing():
    whole = components(noise_share=1.0)
    assert parts_sentence(whole) == NOTHING
    assert parts_sentence(whole, noise=whole.residual_rms) == NOTHING
    assert parts_sentence(None) == ""


def test_sentences_are_the_parts_then_the_findings_then_the_errors(split):
    parts, named, located, errors, remaining = diagnosis_sentences(split)
    assert parts.startswith("81 % (74 to 86 %) of the residual depends on the velocity")
    assert named.startswith("Quadratic drag (0.200")
    assert named.endswith(" 1/rad) is named: it removes 80 % of the residual in samples held out.")
    assert located == (
        "No effect of the library is named for the wander of the zero: it has no simple form; its curve is on the page."
    )
    assert errors.startswith("With quadratic drag the held-out error falls from 0.")
    assert "; the noise is 0.06" in errors
    assert remaining.startswith("62 % (30 to 80 %) of the residual that remains is a slow wander of the zero")
    assert diagnosis_sentence(split) == " ".join([parts, named, located, errors, remaining])


@pytest.mark.parametrize(
    ("finding", "text"),
    [
        (
            GROUP,
            "Quadratic drag or cubic drag acts, and the data cannot tell them apart: the swing hardly decays; the best "
            "of them removes 74 % of the residual in samples held out.",
        ),
        (
            replace(GROUP, effects=("friction",), share=NAN),
            "Friction or something like it acts: the swing hardly decays.",
        ),
        (OPEN, "Something is missing, and the data do not say where: each part explains it about as well."),
        (
            replace(LOCATED, reason=""),
            "No effect of the library is named for the wander of the zero; its curve is on the page.",
        ),
        (Finding("named", "force-of-velocity", ("quadratic-drag",), NAN), "Quadratic drag is named."),
    ],
)
def test_every_word_of_a_finding_has_a_sentence(finding, text, split):
    plain = replace(split, findings=(finding,), added=(), sizes={}, remaining=None)
    assert diagnosis_sentences(plain)[1] == text


def test_effects_without_a_finding_and_nuisances_are_said(split):
    told = diagnosis_sentences(replace(split, findings=(), nuisances=(EFFECTS["periodic-forcing"],)))
    assert told[1].startswith("Added as well: quadratic drag (")
    assert told[2] == "In the fit as well, without being named: periodic forcing."


def test_residual_of_a_run_that_leaves_the_motion_is_not_split(split):
    base = split.base
    lost = replace(base, predicted=np.zeros_like(base.predicted), residual=base.predicted + base.residual)
    told = diagnosis_sentences(replace(split, components=None, remaining=None, bases=(lost,)))
    assert told[0] == "The equation does not follow the motion: where its residual lies, these data cannot tell."
    assert told[1].startswith("Quadratic drag (")


def test_clip_that_is_too_short_to_be_split_has_the_sentences_of_its_effects(split):
    text = diagnosis_sentence(replace(split, components=None))
    assert text.startswith("The cause is the physics (99 %). Adding quadratic drag (")
    assert text.endswith(" The residual is too short to be split into parts.")
    assert "over 99 %" not in text


# --------------------------------------------------------------------------- verdict


def test_force_that_remains_makes_the_equation_incomplete(split):
    assert split.verdict.complete  # a reading that wanders is no matter of the equation
    lacking = replace(split, remaining=components(drag_part(share=0.5), noise_share=0.5))
    assert lacking.verdict.good
    assert not lacking.verdict.complete
    assert lacking.verdict.equation.rest == "50 % of it depends on the velocity like drag or friction"
    unsure = replace(split, remaining=components(drag_part(share=0.5, probability=0.6), noise_share=0.5))
    assert unsure.verdict.complete


# --------------------------------------------------------------------------- picture


def test_figure_has_two_bars_and_the_curves_of_the_largest_parts(split):
    figure = component_figure(split.components, split.remaining)
    titles = [axes.get_title(loc="left") for part in figure.subfigs for axes in part.axes]
    assert titles == [
        "without effects: 0.25° rms",
        "with the added effects: 0.11° rms",
        "force by velocity, 81 % (74 to 86 %)",
        "wander of the zero, 8 %",
    ]
    bars, remaining = figure.subfigs[0].axes
    widths = [patch.get_width() for patch in bars.patches]
    assert widths == pytest.approx([81, 8, 11])
    assert sum(patch.get_width() for patch in remaining.patches) == pytest.approx(100 * (1.9 / 4.4) ** 2)
    labels = [text.get_text() for text in bars.get_legend().get_texts()]
    assert labels == ["81 % (74 to 86 %) force by velocity", "8 % wander of the zero", "11 % noise"]
    curve = figure.subfigs[1].axes[0].lines[1]
    np.testing.assert_allclose(curve.get_ydata(), split.components.parts[0].curve.values[:, 0])


def test_figure_without_curves_is_the_bar_alone():
    figure = component_figure(components(drag_part(curve=None), wander_part(curve=None)))
    assert len(figure.axes) == 1
    picture = cv2.imdecode(np.frombuffer(png_of(figure), np.uint8), cv2.IMREAD_COLOR)
    assert picture.std() > 5
    assert "right" not in component_caption(components(drag_part(curve=None)), added=False)


def test_parts_of_one_side_have_different_colours():
    parts = [drag_part(), drag_part(kind="force-of-position"), wander_part()]
    colours = part_colours(parts)
    assert len(set(colours.values())) == 3
    assert sum(colours["force-of-position"]) > sum(colours["force-of-velocity"])


# --------------------------------------------------------------------------- page and file


def test_page_begins_with_the_answer_and_then_the_parts(split):
    page = diagnosis_page(split, [dragged()])
    assert page.headline.startswith("The equation lacks quadratic drag (0.200")
    assert page.headline.endswith(" 1/rad): drag that grows with the square of the speed.")
    assert page.headline not in page.statements
    assert page.statements[0].startswith("81 % (74 to 86 %) of the residual")
    assert [value.name for value in page.values][:2] == ["quadratic_drag", "length"]
    before, after = page.bars
    assert [(name, percent, colour) for name, percent, colour in before.parts] == [
        ("81 % (74 to 86 %) force by velocity", pytest.approx(81), "force"),
        ("8 % wander of the zero", pytest.approx(8), "reading"),
        ("11 % noise", pytest.approx(11), "rest"),
    ]
    assert sum(percent for _, percent, _ in after.parts) == pytest.approx(100 * (1.9 / 4.4) ** 2)
    names = ["component-0", "component-1", "residual-0-0", "residual-0-1", "motion-0"]
    assert [chart.name for chart in page.charts] == names
    speed = page.charts[0]
    assert speed.x_label == "omega (°/s)"
    assert speed.y_label == "angular acceleration (°/s^2)"
    assert speed.series[0].x[-1] == pytest.approx(np.degrees(2.0))
    assert not speed.over_time
    assert page.charts[1].over_time


def test_page_without_a_clip_shows_the_motion_beside_the_answer(split):
    page = diagnosis_page(split, [dragged()])
    assert page.picture is not None
    assert page.picture.name == "motion-0"
    html = html_of(page)
    assert html.count('id="chart-motion-0"') == 1
    assert html.index('id="chart-motion-0"') < html.index('class="answer"') < html.index('id="chart-residual-0-0"')


def test_curve_over_the_velocity_ends_where_the_motion_does(split):
    part = split.components.parts[0]
    part = replace(part, curve=replace(part.curve, argument=Quantity("theta rate", "rad/s")))
    speeds = np.gradient(split.base.predicted[:, 0], split.base.t_s)
    falling = replace(split.base, predicted=-np.abs(split.base.predicted).cumsum(axis=0))
    for base, both in ((split.base, True), (falling, False)):
        components = replace(split.components, parts=(part,))
        (chart, *_) = component_charts(replace(split, components=components, bases=(base,)))
        assert chart.x_label == "angular velocity of theta (°/s)"
        assert (chart.series[0].x.max() > 0.5 * np.degrees(min(speeds.max(), 2.0))) == both


def test_page_has_the_parts_as_a_table(split):
    parts, remaining, *_ = diagnosis_page(split, [dragged()]).sections
    assert (parts.title, remaining.title) == ("Parts of the residual", "Parts of the residual with the added effects")
    assert [tuple(row[:4]) for row in parts.rows] == [
        ("force by velocity", "81 %", "74 to 86 %", "0.23°"),
        ("wander of the zero", "8 %", "5 to 12 %", "0.069°"),
        ("noise", "11 %", "", "0.084°"),
    ]
    assert parts.rows[0][-1] == "named: quadratic-drag; removes 80 % in samples held out"
    assert parts.lines[0].endswith("81 % lies in the forces, 8 % lies in the reading, 11 % is noise.")
    assert {len(row) for row in parts.rows} == {len(parts.columns)}
    assert {len(row) for row in remaining.rows} == {len(remaining.columns)}


@pytest.mark.parametrize(("word", "first"), [("group", GROUP), ("open", OPEN)])
def test_headline_is_the_surest_finding(split, word, first):
    page = diagnosis_page(replace(split, findings=(replace(LOCATED, reason=""), first)), [dragged()])
    if word == "group":
        assert page.headline.startswith("Quadratic drag or cubic drag acts")
    else:
        assert page.headline.startswith("No effect of the library is named for the wander of the zero")


def test_page_of_noise_has_a_table_and_no_picture(split):
    whole = components(noise_share=1.0)
    noise = replace(split, components=whole, remaining=None, findings=(), added=(), noise_floor=whole.residual_rms)
    page = diagnosis_page(noise, [dragged()])
    assert page.headline == NOTHING
    assert page.sections[0].title == "Parts of the residual"
    assert "components" not in {image.name for image in page.images}


def test_page_of_a_clip_that_is_too_short_to_be_split_has_no_parts():
    clip = dragged()
    short = clip.with_(valid=np.arange(clip.n) < 9)
    found = diagnose(short, "pendulum", effects=["quadratic-drag"])
    assert found.components is None
    page = diagnosis_page(found, [short])
    assert page.statements[-1] == "The residual is too short to be split into parts."
    assert page.bars == []
    assert page.sections[0].title == "Error"


def test_page_and_notebook_escape_what_a_finding_says(split, tmp_path):
    hostile = replace(split, findings=(replace(LOCATED, reason="<script>alert(1)</script>"),))
    html = write_diagnosis(hostile, dragged(), tmp_path).read_text("utf-8")
    assert (tmp_path / "components.png").is_file()
    assert "<script>alert" not in html
    assert "&lt;script&gt;alert(1)" in html
    assert "<script>" not in to_html(hostile)
    assert to_html(hostile).count("<img ") == 2


def test_file_holds_the_parts_the_findings_and_the_verdict_on_two_axes(split, tmp_path):
    write_diagnosis(replace(split, nuisances=(EFFECTS["periodic-forcing"],)), dragged(), tmp_path)
    content = json.loads((tmp_path / "diagnosis.json").read_text("utf-8"))
    document = read_document(tmp_path / "diagnosis.json", DiagnosisDocument)
    first = content["components"]["parts"][0]
    assert (first["kind"], first["side"], first["share"]) == ("force-of-velocity", "force", 0.81)
    assert first["share_range"] == [0.74, 0.86]
    assert set(first["curve"]) == {"argument", "unit", "at", "quantities", "values", "stderr"}
    assert len(first["curve"]["values"]) == len(first["curve"]["at"]) == 41
    assert set(content["components"]) == {
        "residual_rms", "noise_rms", "motion_rms", "unit", "noise_share", "correlation", "motion_explained", "parts",
        "explanations",
    }  # fmt: skip
    assert document.remaining.parts[0].similar == ["force-of-time"]
    assert content["findings"][0] == {
        "word": "named", "component": "force-of-velocity", "effects": ["quadratic-drag"], "share": 0.8, "reason": "",
    }  # fmt: skip
    assert content["findings"][1]["share"] is None
    assert content["nuisances"] == ["periodic-forcing"]
    assert document.verdict.equation.complete
    assert document.sentence == diagnosis_sentence(replace(split, nuisances=(EFFECTS["periodic-forcing"],)))


def test_part_has_one_colour_in_figure_page_and_review(split, tmp_path):
    html = write_diagnosis(split, dragged(), tmp_path).read_text("utf-8")
    force, *_, noise = residual_parts(tmp_path)
    light, dark = force["inks"]
    assert f"--force: {light};" in html
    assert f"--force: {dark};" in html
    assert f"--grey: {noise['inks'][0]};" in html
    assert part_colours(split.components.parts)["force-of-velocity"] == pytest.approx(to_rgb(light))
