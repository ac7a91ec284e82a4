"""What parameters.json says: pooled with what the clips share, read by the benchmark, never over a direct value."""

import json
import math

import numpy as np
import pytest

from fitters.noise.random_effects import random_effects
from iris_sysid.benchmark.groundtruth.measure import Measurements
from iris_sysid.benchmark.groundtruth.parameters import parameters_document
from iris_sysid.benchmark.groundtruth.pool import ALIKE, regenerate
from iris_sysid.errors import DataError
from iris_sysid.io.json_documents import document_text, read_document, schema
from iris_sysid.io.schemas.groundtruth import MeasuredDocument, ParametersDocument
from tests._clip_documents import clip_measured

RANDOM, SCALE = 0.002, 0.003


def lengths(values, *, random=RANDOM, common=SCALE):
    stderr = math.hypot(random, common)
    budget = {"length": {"random": random, "calibration: corners": common}}
    return [
        clip_measured(f"{k + 1:02d}", {"length": (float(value), stderr, "m")}, budget) for k, value in enumerate(values)
    ]


def accurate(values):
    return lengths(values, random=1e-4, common=1e-4)


def document(clips, measured=None, gaps=()):
    return parameters_document(Measurements(tuple(clips), tuple(gaps), 0), measured)


def by_hand(**changes):
    row = {"class": "Pendulum", "parameter": "rope_length", "value": 0.5, "uncertainty": 0.002, "unit": "m"}
    return MeasuredDocument.model_validate({"values": [row | changes]})


def test_pooled_value_is_the_random_effects_mean_and_its_error_has_the_common_part_once():
    values = np.random.default_rng(1).normal(0.5, RANDOM, 10)
    regenerated = regenerate(lengths(values), "length")
    mean = random_effects(values, np.full(10, RANDOM), "m").mean
    assert regenerated.value == mean.value
    alike = math.sqrt(ALIKE) * RANDOM
    assert regenerated.standard_uncertainty == pytest.approx(math.hypot(mean.stderr, SCALE, alike))
    assert regenerated.budget["calibration: corners"] == pytest.approx(SCALE)
    assert regenerated.budget["tracking errors of clips filmed alike"] == pytest.approx(alike)
    assert regenerated.interval[1] - regenerated.value == pytest.approx(regenerated.expanded_uncertainty)
    assert regenerated.n == 10


def test_pooled_interval_holds_the_truth_in_95_percent_of_data_sets():
    rng = np.random.default_rng(2)
    hits = 0
    for _ in range(600):
        shift = rng.normal(0, SCALE) + math.sqrt(ALIKE) * rng.normal(0, RANDOM)
        regenerated = regenerate(lengths(0.5 + shift + math.sqrt(1 - ALIKE) * rng.normal(0, RANDOM, 4)), "length")
        hits += regenerated.interval[0] <= 0.5 <= regenerated.interval[1]
    assert 0.93 <= hits / 600 <= 0.98  # a share of 600 is uncertain by 0.9 %


def test_one_clip_keeps_its_own_interval():
    clip = lengths([0.5])[0]
    regenerated = regenerate([clip], "length")
    low, high = clip.document.parameters["length"].ci95
    assert regenerated.interval == pytest.approx((low, high))
    assert regenerated.method == "one clip"


def test_clips_that_failed_or_ended_at_a_bound_are_shown_but_not_used():
    odd = clip_measured("03", {"length": (7.0, 0.1, "m")}, {"length": {"random": 0.1}}, status="at-bound")
    failed = clip_measured("04", {}, status="failed")
    regenerated = regenerate([*lengths([0.50, 0.51]), odd, failed], "length")
    assert [name for name, clip in regenerated.clips.items() if clip.used] == ["01", "02"]
    assert regenerated.clips["03"].message == "at-bound: at-bound for a reason"
    assert regenerated.clips["04"].value is None
    assert regenerated.clips["01"].sha256 == "0" * 64


def test_clips_that_the_equation_does_not_fit_count_only_where_it_fits_none():
    odd = clip_measured("03", {"length": (7.0, 0.1, "m")}, {"length": {"random": 0.1}}, status="misfit")
    assert regenerate([*lengths([0.50, 0.51]), odd], "length").n == 2
    assert regenerate([odd], "length").value == 7.0
    entry = document([odd]).classes["pendulum"]["pendulum_45"]["rope_length"]
    assert "fits no clip to within the noise" in entry.notes[1]


def test_nothing_but_failed_clips_is_an_entry_without_a_value():
    entry = document([clip_measured("01", {}, status="failed")]).classes["pendulum"]["pendulum_45"]["rope_length"]
    assert (entry.mean, entry.n, entry.method) == (None, 0, "no clip gave a value")


def test_angles_are_in_degrees():
    budget = {"angle": {"random": 0.01}}
    clips = [
        clip_measured(f"{k}", {"angle": (1.0, 0.01, "rad")}, budget, class_name="Sliding_cone", setting="cone_60")
        for k in (1, 2)
    ]
    regenerated = regenerate(clips, "angle")
    assert regenerated.unit == "deg"
    assert regenerated.value == pytest.approx(math.degrees(1.0))
    assert regenerated.within == pytest.approx(math.degrees(0.01))


def test_error_of_a_boards_angle_does_not_average_out():
    rows = [clip_measured(f"{k}", {"angle": (1.0, 0.01, "rad")}, class_name="Sliding_cone") for k in range(9)]
    assert regenerate(rows, "angle").standard_uncertainty > math.degrees(0.01)


def test_an_assumed_constant_is_never_reported_as_measured():
    clips = [
        clip_measured(f"{k}", {"gravity": (9.80665, 0.0, "m/s^2", "assumed")}, class_name="Falling_ball", setting="big")
        for k in (1, 2)
    ]
    entry = document(clips).classes["falling_ball"]["big"]["g"]
    assert (entry.measurement_type, entry.mean, entry.n) == ("assumed", 9.80665, 0)


def test_direct_value_stays_and_both_are_stated_with_their_difference():
    entry = document(lengths([0.540, 0.542]), by_hand()).classes["pendulum"]["pendulum_45"]["rope_length"]
    assert (entry.mean, entry.measurement_type) == (0.5, "direct")
    assert entry.direct.standard_uncertainty == pytest.approx(0.002 / math.sqrt(3))
    assert entry.regenerated.value == pytest.approx(0.541)
    assert entry.difference.value == pytest.approx(0.041)
    assert "leaves out the ball's radius" in entry.notes[0]


@pytest.mark.parametrize(
    ("radius", "explanation"), [(0.041, "0.041 m, explains it"), (0.01, "0.01 m, does not explain all")]
)
def test_note_says_whether_the_balls_radius_explains_a_longer_pendulum(radius, explanation):
    rope, ball = by_hand().values[0], by_hand(parameter="ball_radius", value=radius, uncertainty=0.001).values[0]
    entry = document(accurate([0.540, 0.542]), MeasuredDocument(values=[rope, ball])).classes["pendulum"]["pendulum_45"]
    assert explanation in entry["rope_length"].notes[1]


def test_note_says_when_an_angle_is_nearer_to_the_other_convention():
    budget = {"angle": {"random": 0.002}}
    clip = clip_measured("01", {"angle": (0.51, 0.002, "rad")}, budget, class_name="Sliding_cone", setting="cone_60")
    row = {"class": "Sliding_cone", "parameter": "angle", "value": 60.0, "uncertainty": 0.5, "unit": "deg"}
    entry = document([clip], by_hand(**row)).classes["sliding_cone"]["cone_60"]["angle"]
    assert entry.notes[0].endswith("30 deg, is nearer: was it measured from the vertical?")


def test_no_note_where_clips_and_direct_value_agree():
    entry = document(accurate([0.5, 0.501]), by_hand()).classes["pendulum"]["pendulum_45"]["rope_length"]
    assert len(entry.notes) == 1  # what length it is


def test_other_direct_values_have_entries_of_their_own():
    truth = document(lengths([0.5, 0.5]), by_hand(parameter="ball_radius", value=0.0335))
    entry = truth.classes["pendulum"]["pendulum_45"]["ball_radius"]
    assert (entry.mean, entry.regenerated) == (0.0335, None)


def test_direct_value_in_another_unit_is_refused():
    with pytest.raises(DataError, match="rope_length was measured in cm, but the clips give it in m"):
        document(lengths([0.5, 0.5]), by_hand(unit="cm", value=50.0))


def test_benchmark_scripts_find_their_means():
    """As compare_baseline_unified.py reads the file: by class and setting in lower case, what is a dict with a mean."""
    content = json.loads(document_text(document(lengths([0.5, 0.51]))))
    setting = content.get("pendulum").get("pendulum_45")
    means = {name: entry["mean"] for name, entry in setting.items() if isinstance(entry, dict) and "mean" in entry}
    assert means["rope_length"] == pytest.approx(0.505)
    assert setting["rope_length"]["std"] == pytest.approx(0.01 / math.sqrt(2))
    assert (setting["rope_length"]["min"], setting["rope_length"]["max"]) == (0.5, 0.51)
    assert r"\zeta" in setting["rope_length"]["equation"]


def test_document_reads_back_and_has_a_schema(tmp_path):
    made = document(lengths([0.5, 0.51]), gaps=[("Pendulum/pendulum_90", "this setting is missing")])
    (tmp_path / "p.json").write_text(document_text(made), encoding="utf-8")
    again = read_document(tmp_path / "p.json", ParametersDocument)
    assert document_text(again) == document_text(made)
    assert again.gaps == {"Pendulum/pendulum_90": "this setting is missing"}
    assert "ParameterEntry" in schema("parameters")["$defs"]


def test_two_classes_of_one_name_are_refused():
    clip = lengths([0.5])[0]
    other = type(clip)(
        type(clip.clip)("pendulum", "pendulum_45", "01", clip.clip.path, "pendulum"), clip.document, clip.folder
    )
    with pytest.raises(DataError, match="two of these have one name"):
        document([clip, other])
