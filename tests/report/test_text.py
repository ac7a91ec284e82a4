"""Numbers and results as people read them."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from iris_sysid import MODELS, Estimate, fit
from iris_sysid.registry import EFFECTS
from iris_sysid.report.clip_page import headline
from iris_sysid.report.diagnosis_text import changed_parameters, diagnosis_sentence, diagnosis_text
from iris_sysid.report.text import (
    fit_table,
    interval_text,
    main_names,
    rounded_to_error,
    samples_text,
    two_digits,
    verdict_lines,
    with_error,
)
from iris_sysid.types import (
    Completeness,
    DiagnosticNote,
    Doubt,
    Quantity,
    Segment,
    Trajectory,
    Verdict,
)
from tests._motions import pendulum_angle

NAN = float("nan")
INF = float("inf")
TOO_SHORT = "The residual is too short to be split into parts."


@pytest.mark.parametrize(
    ("value", "stderr", "expected"),
    [
        (1.70342, 0.0042, ("1.7034", "0.0042")),
        (9.79, 0.01, ("9.790", "0.010")),
        (1.7, 0.00999, ("1.700", "0.010")),
        (1.0, 9.96, ("1", "10")),
        (123456.0, 150.0, ("123460", "150")),
        (16.42, 130.0, ("20", "130")),
        (0.0, 250.0, ("0", "250")),
        (-0.00001, 0.1, ("0.00", "0.10")),
        (1e9, 3e5, ("1.00000e+09", "3.0e+05")),
        (1e-12, 1e-13, ("1.00e-12", "1.0e-13")),
        (0.0, 1e-12, ("0.0e+00", "1.0e-12")),
        (5.0, 1e8, ("5.0e+00", "1.0e+08")),
        (9.80665, 0.0, ("9.80665", "")),
        (0.5, NAN, ("0.5", "")),
        (NAN, 0.1, ("undetermined", "")),
        (INF, 0.1, ("undetermined", "")),
    ],
)
def test_value_is_rounded_to_the_second_digit_of_its_error(value, stderr, expected):
    assert rounded_to_error(value, stderr) == expected


@pytest.mark.parametrize(("size", "text"), [(3.2e-5, "0.000032"), (0.0144, "0.014"), (123.0, "120"), (1.0, "1.0")])
def test_size_is_written_out_with_two_digits(size, text):
    assert two_digits(size) == text


def test_rounding_loses_less_than_a_twentieth_of_the_error():
    rng = np.random.default_rng(5)
    values = rng.choice([-1, 1], 500) * 10 ** rng.uniform(-12, 12, 500)
    for value, stderr in zip(values, 10 ** rng.uniform(-12, 12, 500), strict=True):
        shown, error = rounded_to_error(value, stderr)
        assert abs(float(shown) - value) <= 0.0501 * stderr + 1e-15 * abs(value)
        assert float(error) == pytest.approx(stderr, rel=0.05)


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        (Estimate(1.70342, 0.0042, "m"), "1.7034 ± 0.0042 m"),
        (Estimate(0.3, 0.01, "1"), "0.300 ± 0.010"),
        (Estimate(9.80665, 0.0, "m/s^2", "assumed"), "9.80665 m/s^2"),
        (Estimate(1.7, NAN, "m"), "undetermined"),
        (Estimate(1.7, INF, "m"), "undetermined"),
        (Estimate(1.7, NAN, "m", "derived"), "undetermined"),
        (Estimate(1.7, NAN, "m", "direct"), "1.7 m"),
        (Estimate(NAN, NAN, "m", "assumed"), "undetermined"),
    ],
)
def test_estimate_is_spelled_with_error_and_unit(estimate, expected):
    assert with_error(estimate) == expected


@pytest.mark.parametrize(
    ("estimate", "expected"),
    [
        (Estimate(1.7, 0.01, "m", ci95=(1.6811, 1.7209)), "1.681 to 1.721"),
        (Estimate(1.7, 0.0, "m", "assumed"), ""),
        (Estimate(1.7, NAN, "m"), ""),
        (Estimate(1.7, INF, "m"), ""),
    ],
)
def test_interval_is_spelled_where_there_is_one(estimate, expected):
    assert interval_text(estimate) == expected


def test_segment_is_spelled_with_its_samples_and_times():
    t_s = np.arange(5) / 10
    trajectory = Trajectory(t_s, (Quantity("z", "m"),), np.zeros((5, 1)), np.zeros((5, 1)), np.ones(5, bool))
    assert samples_text(Segment("hand", 0, 3, ""), trajectory) == "0-2 (0.000-0.200 s)"


def angles_trajectory(n=200):
    t_s = np.arange(n) / 25
    theta = pendulum_angle(t_s, 0.5) + np.random.default_rng(0).normal(0, 0.002, n)
    shape = (n, 1)
    return Trajectory(t_s, (Quantity("theta", "rad"),), theta[:, None], np.full(shape, NAN), np.ones(n, bool))


@pytest.fixture(scope="module")
def good_fit():
    return fit(angles_trajectory(), MODELS["pendulum"])


@pytest.fixture(scope="module")
def failed_fit():
    return fit(angles_trajectory(4), MODELS["pendulum"])


def test_headline_of_a_good_fit_is_the_first_number_and_what_to_think_of_it(good_fit):
    assert headline(good_fit).startswith("Length is 0.")
    assert headline(good_fit).endswith(" m, and the equation is complete as far as the data show.")
    lacking = replace(good_fit, status="misfit")
    assert headline(lacking).endswith(" m; the equation lacks something, and the error allows for it.")
    doubt = Doubt("clock", "the clock seems 8 times too slow", "give --fps 240")
    assert headline(replace(good_fit, doubts=(doubt,))).endswith(" m, but there is reason to doubt it.")


def test_headline_keeps_the_case_of_a_name_that_is_a_symbol(good_fit):
    named = replace(good_fit, estimates={"h": good_fit.estimates["length"]}, free=("h",))
    assert headline(named).startswith("h is 0.")


def test_headline_of_a_failed_fit_says_why(failed_fit):
    assert headline(failed_fit).startswith("No number could be measured: ")


def test_main_names_are_the_results_without_initial_states_and_constants(good_fit):
    names = main_names(good_fit)
    assert names[0] == "length"
    assert not {"theta_0", "gravity"} & set(names)


def test_table_of_a_good_fit_is_aligned_and_ends_with_the_residual(good_fit):
    *rows, last = fit_table(good_fit).splitlines()
    assert len({row.index(row.split()[1]) for row in rows}) == 1
    assert last.startswith("theta: residual 0.1")
    assert " ° rms, 1.0" in last
    assert "times the noise of" in last


def test_table_of_a_failed_fit_shows_no_nan(failed_fit):
    text = fit_table(failed_fit)
    assert "nan" not in text
    assert "undetermined" in text
    assert text.endswith("theta: residual unknown")


def a_diagnosis(
    unit="rad",
    before=(0.01, 0.02),
    after=(0.005, 0.006),
    added=True,
    name="length",
    base_unit="m",
    notes=(),
    stderr=0.001,
):
    drag = EFFECTS["quadratic-drag"]
    held = {each.name: Estimate(each.default, 0.0, each.unit, "assumed") for each in drag.parameters[1:]}
    size = {**held, "quadratic_drag": Estimate(0.12, stderr, "1/rad")}
    after_it = {name: Estimate(1.1, 0.01, base_unit), "quadratic_drag": Estimate(0.12, 0.001, "1/rad")}
    final = SimpleNamespace(free=(name,), estimates=after_it)
    return SimpleNamespace(
        unit=unit,
        before=SimpleNamespace(fitted=before[0], heldout=before[1]),
        after=SimpleNamespace(fitted=after[0], heldout=after[1]),
        noise_floor=0.001,
        proposed=(),
        notes=notes,
        residual_ratio=after[0] / 0.001,
        incomplete=after[0] > 0.002,
        added=(drag,) if added else (),
        sizes=size,
        indistinguishable={"quadratic-drag": ("cubic-stiffness",)} if added else {},
        base=SimpleNamespace(model=MODELS["pendulum"], free=(name,), estimates={name: Estimate(1.0, 0.01, base_unit)}),
        bases=(SimpleNamespace(follows=True),),
        final=final,
        finals=(final,),
        causes={},
        components=None,
    )


def test_sentence_names_the_effect_the_errors_its_alternatives_and_what_remains():
    assert diagnosis_sentence(a_diagnosis()) == (
        "Adding quadratic drag (0.1200 ± 0.0010 1/rad) reduces the held-out error from 1.15° to 0.344°. "
        "Quadratic drag is indistinguishable from cubic stiffness. "
        f"The model is still incomplete: the residual is 5.0 times the noise. {TOO_SHORT}"
    )


def test_sentence_of_a_complete_model_compares_the_residual_with_the_noise():
    text = diagnosis_sentence(a_diagnosis(after=(0.00104, 0.0011)))
    assert text.endswith(f" The remaining residual is 1.0 times the noise. {TOO_SHORT}")


def test_sentence_gives_both_errors_where_other_missing_effects_make_the_size_much_less_certain():
    assert "quadratic drag (0.120 ± 0.010 1/rad, ± 0.0010 assuming no further missing effect) reduces" in (
        diagnosis_sentence(a_diagnosis(stderr=0.01))
    )
    assert "assuming" not in diagnosis_sentence(a_diagnosis(stderr=0.0012))


def test_sentence_counts_the_alternatives_that_are_too_many_to_name():
    diagnosis = a_diagnosis()
    diagnosis.indistinguishable["quadratic-drag"] = tuple("abcdefg")
    assert "indistinguishable from a or b or c or d or e or 2 more." in diagnosis_sentence(diagnosis)


def test_sentence_when_no_effect_is_missing():
    at_the_noise = (0.001, 0.0011)
    assert diagnosis_sentence(a_diagnosis("m", at_the_noise, at_the_noise, added=False)) == (
        f"No effect in the library is significant. The held-out error is 0.0011 m, the noise 0.001 m. {TOO_SHORT}"
    )


def test_sentence_when_the_model_is_incomplete_but_no_effect_is_significant():
    unexplained = (0.01, 0.02)
    assert diagnosis_sentence(a_diagnosis("m", unexplained, unexplained, added=False)) == (
        "The model is incomplete; no effect in the library is significant. "
        f"The held-out error is 0.02 m, the noise 0.001 m. {TOO_SHORT}"
    )


@pytest.mark.parametrize("added", [True, False])
def test_sentence_is_at_most_four_and_notes_are_lines_of_their_own(added):
    diagnosis = a_diagnosis("m", added=added, notes=(DiagnosticNote("refit-failed", "the refit failed"),) * 2)
    assert diagnosis_sentence(diagnosis).count(". ") + 1 <= 4
    *sentences, first, second = diagnosis_text(diagnosis).splitlines()
    assert " ".join(sentences) == diagnosis_sentence(diagnosis)
    assert first == second == "Note: The refit failed."


# the last: found with all samples only, so that the held-out error is without it
@pytest.mark.parametrize(
    ("before", "after"), [((0.01, NAN), (0.005, NAN)), ((0.01, 0.02), (0.005, NAN)), ((0.01, 0.02), (0.005, 0.02))]
)
def test_sentence_without_held_out_error_gives_the_residual(before, after):
    text = diagnosis_sentence(a_diagnosis("m", before, after))
    assert "reduces the residual from 0.01 m to 0.005 m" in text
    assert "nan" not in text


def test_sentence_keeps_digits_of_numbers_without_unit():
    assert "from 11 to 0.1." in diagnosis_sentence(a_diagnosis("1", (0.3, 11.0), (0.1, 0.1)))


def test_parameters_that_change_are_listed_before_and_after():
    ((name, before, after),) = changed_parameters(a_diagnosis())
    assert (name, before.value, after.value) == ("length", 1.0, 1.1)


@pytest.mark.parametrize("name", ["pivot_across", "theta_0"])
def test_offsets_of_the_geometry_and_initial_states_are_not_listed_as_changed(name):
    assert changed_parameters(a_diagnosis(name=name, base_unit="1")) == []


def test_angles_are_shown_in_degrees_and_their_intervals_too():
    angle = Estimate(np.radians(30.0), np.radians(0.1), "rad")
    assert with_error(angle) == "30.00 ± 0.10 °"
    assert interval_text(angle) == "29.804 to 30.196"
    assert with_error(Estimate(0.1, 0.01, "1/rad")) == "0.100 ± 0.010 1/rad"


def test_verdict_says_its_word_first_and_every_reason_with_what_to_do():
    reasons = (Doubt("clock", "the clock seems 8 times too slow", "give --fps 240"), Doubt("missed", "lost", "mark it"))
    assert verdict_lines(Verdict("good")) == ["usable"]
    assert verdict_lines(Verdict("doubtful", reasons)) == [
        "doubtful: The clock seems 8 times too slow. Give --fps 240.",
        "  also: Lost. Mark it.",
    ]


def test_verdict_says_of_each_axis_what_to_do():
    above = Doubt("residual-above-noise", "the residual is far above the noise", "diagnose it")
    accuracy = {"length": 0.0068, "ball_mass": 0.123}
    assert verdict_lines(Verdict("good", (above,), Completeness(0.994, False, 3.14), accuracy)) == [
        "usable: length good to 0.68 %, ball mass to 12 %",
        "equation incomplete: it explains 99.4 % of the motion; the residual is 3.1 times the noise. Diagnose it.",
    ]
    assert verdict_lines(Verdict("good", (), Completeness(0.99991, True, 1.04), {"length": 0.00012})) == [
        "usable: length good to 0.012 %",
        "equation complete: it explains 99.991 % of the motion; the residual is 1.0 times the noise",
    ]
