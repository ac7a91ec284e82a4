"""The JSON files: what is written reads back, what is wrong is refused with the key that is wrong."""

import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iris_sysid.errors import DataError, OutputError, UnknownNameError
from iris_sysid.io.json_documents import (
    checked,
    document_text,
    entries_of,
    fit_document,
    fit_json,
    read_document,
    schema,
    write_fit,
)
from iris_sysid.io.schemas import DOCUMENTS, CalibrationDocument, EstimateEntry, FitDocument
from iris_sysid.types import Estimate, FitProblem, FitResult, OdeModel, Parameter, Quantity, Segment, Trajectory
from tests._documents import read_fit

THETA = Quantity("theta", "rad", r"\theta")
LENGTH = Estimate(1.7, 0.01, "m")
GRAVITY = Estimate(9.80665, 0.0, "m/s^2", "assumed", "standard gravity")
KEYS_OTHERS_RELY_ON = ("model", "status", "message", "parameters", "noise", "rms", "n")
ENTRY_KEYS_OTHERS_RELY_ON = ("value", "stderr", "ci95", "unit", "measurement_type")


def pendulum(*observed):
    return OdeModel(
        name="pendulum",
        summary="Damped pendulum.",
        equation=r"\ddot\theta + \zeta\dot\theta + \frac{g}{L}\sin\theta = 0",
        source="textbook",
        states=(THETA, Quantity("omega", "rad/s")),
        parameters=(Parameter("length", "m", "L"),),
        observed=observed or (THETA,),
        rhs=lambda t, state, params: (state[1], -math.sin(state[0])),
        guess=lambda trajectory: {},
    )


def fit_result(n=5, used=slice(1, 4), observed=(THETA,), **changes):
    mask = np.zeros(n, dtype=bool)
    mask[used] = True
    d = len(observed)
    fields = {
        "model": pendulum(*observed),
        "status": "ok",
        "notes": ("fine",),
        "estimates": {"length": LENGTH, "gravity": GRAVITY},
        "free": ("length",),
        "covariance": np.array([[1e-4]]),
        "t_s": np.arange(n) / 10,
        "used": mask,
        "predicted": np.zeros((n, d)),
        "residual": np.zeros((n, d)),
        "noise": np.full(d, 0.003),
        "rms": np.full(d, 0.004),
        "aic": -10.0,
        "bic": -9.0,
        "jacobian": np.ones((3 * d, 1)),
        "fisher": np.eye(1),
        "condition": 1.0,
        "correlation": 0.1,
        "t0_s": 0.1,
        "budget": {"length": {"tracking": 0.008, "scale": 0.006}},
        "origin": {"source": "clip.mp4"},
    }
    return FitResult(**(fields | changes))


def trajectory(n=5, **changes):
    fields = {
        "t_s": np.arange(n) / 10,
        "quantities": (THETA,),
        "position": np.zeros((n, 1)),
        "sigma": np.full((n, 1), 0.003),
        "valid": np.ones(n, dtype=bool),
        "segments": (Segment("hand", 0, 1, "reaches in"), Segment("motion", 1, n)),
        "geometry": {"pivot_x": Estimate(0.2, 0.01, "m", "derived", "arc")},
        "first_frame": 100,
    }
    return Trajectory(**(fields | changes))


# --------------------------------------------------------------------------- fit.json


def test_fit_json_has_the_keys_others_rely_on():
    content = json.loads(fit_json(fit_result()))
    assert set(KEYS_OTHERS_RELY_ON) <= set(content)
    assert set(ENTRY_KEYS_OTHERS_RELY_ON) <= set(content["parameters"]["length"])
    assert content["n"] == 3
    assert content["noise"] == pytest.approx(0.003, rel=1e-15)
    assert content["parameters"]["length"]["ci95"] == list(LENGTH.interval)


def test_fit_json_says_which_samples_frames_and_times_were_used():
    content = json.loads(fit_json(fit_result(), trajectory()))
    assert content["samples"] == {
        "total": 5,
        "first_sample": 1,
        "last_sample": 3,
        "first_frame": 101,
        "last_frame": 103,
        "first_s": 0.1,
        "last_s": 0.3,
    }
    assert [(segment["label"], segment["n_used"], segment["reason"]) for segment in content["segments"]] == [
        ("hand", 0, "reaches in"),
        ("motion", 3, ""),
    ]
    assert content["geometry"]["pivot_x"]["source"] == "arc"


def test_fit_json_twice_is_the_same_bytes():
    assert fit_json(fit_result(), trajectory()) == fit_json(fit_result(), trajectory())


def test_write_fit_reads_back_equal(tmp_path):
    path = write_fit(fit_result(), trajectory(), tmp_path / "fit.json")
    assert read_fit(path) == fit_document(fit_result(), trajectory())
    assert read_fit(path).estimates() == {"length": LENGTH, "gravity": GRAVITY}


def test_write_fit_refuses_a_file_that_exists(tmp_path):
    write_fit(fit_result(), trajectory(), tmp_path / "fit.json")
    with pytest.raises(OutputError, match="--force"):
        write_fit(fit_result(), trajectory(), tmp_path / "fit.json")
    write_fit(fit_result(), trajectory(), tmp_path / "fit.json", overwrite=True)


def test_failed_fit_is_written_with_nulls_that_say_why(tmp_path):
    nothing = Estimate(math.nan, math.nan, "m")
    failed = fit_result(
        used=slice(0, 0),
        status="too-short",
        problems=(FitProblem("too-few-samples", "0 samples", remedy="Track more frames"),),
        estimates={"length": nothing, "gravity": Estimate(9.8, math.nan, "m/s^2")},
        covariance=np.full((1, 1), np.nan),
        noise=[np.nan],
        rms=[np.nan],
        aic=np.nan,
        condition=np.inf,
        budget={"length": {"tracking": np.nan}},
    )
    content = read_fit(write_fit(failed, trajectory(), tmp_path / "fit.json"))
    assert content.status == "too-short"
    assert content.parameters["length"].value is None
    assert content.parameters["length"].note == "no value was found (fit status too-short; see message)"
    assert content.parameters["gravity"].ci95 == (None, None)
    assert "do not determine its standard error" in content.parameters["gravity"].note
    assert (content.noise, content.aic, content.condition, content.covariance) == (None, None, None, [[None]])
    assert content.samples.first_sample is None


def test_noise_of_two_quantities_is_their_root_mean_square():
    two = (Quantity("x", "m"), Quantity("z", "m"))
    content = fit_document(fit_result(observed=two, noise=[3.0, 4.0], rms=[6.0, 8.0]))
    assert (content.noise, content.rms) == (math.sqrt(12.5), math.sqrt(50.0))
    assert [(quantity.name, quantity.noise, quantity.rms) for quantity in content.quantities] == [
        ("x", 3.0, 6.0),
        ("z", 4.0, 8.0),
    ]


def test_noise_of_quantities_in_different_units_is_null():
    mixed = (THETA, Quantity("z", "m"))
    content = fit_document(fit_result(observed=mixed))
    assert (content.noise, content.rms) == (None, None)
    assert len(content.quantities) == 2


def test_fit_document_of_another_trajectory_is_a_data_error():
    with pytest.raises(DataError, match="the fit has 5 samples but the trajectory 7: not the one fitted"):
        fit_document(fit_result(), trajectory(7))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"status": "fine"}, r"status: .*'fine'"),
        ({"estimates": {"length": Estimate(1.0, 0.1, "m", "guessed")}}, "length: measurement_type: .*'guessed'"),
        ({"origin": {"camera": object()}}, "as JSON"),
    ],
)
def test_fit_document_of_values_that_do_not_fit_the_schema_is_a_data_error(changes, message):
    with pytest.raises(DataError, match=message):
        fit_document(fit_result(**changes))


# --------------------------------------------------------------------------- estimates

numbers = st.floats(-1e6, 1e6)
maybe = numbers | st.just(math.nan)
ends = st.tuples(numbers, numbers) | st.tuples(numbers, st.just(math.inf)) | st.tuples(st.just(-math.inf), numbers)


@given(maybe, st.floats(0, 1e6) | st.just(math.nan), st.none() | ends)
def test_estimate_written_and_read_is_the_same(value, stderr, ci95):
    estimate = Estimate(value, stderr, "m", "fitted", "here", ci95)
    back = EstimateEntry.model_validate_json(EstimateEntry.model_validate(estimate).model_dump_json()).estimate()
    np.testing.assert_array_equal([back.value, back.stderr, *back.interval], [value, stderr, *estimate.interval])
    assert (back.unit, back.measurement_type, back.source) == ("m", "fitted", "here")


def test_entries_without_a_fit_give_no_status():
    entry = entries_of({"pivot": Estimate(1.0, math.nan, "m", "derived")})["pivot"]
    assert entry.note == "the data do not determine its standard error"


# --------------------------------------------------------------------------- bad files


def broken(**changes):
    content = json.loads(fit_json(fit_result(), trajectory()))
    content.update(changes)
    return json.dumps(content)


def without(key):
    content = json.loads(fit_json(fit_result()))
    del content[key]
    return json.dumps(content)


BAD_FILES = [
    ("", "Invalid JSON"),
    ("not json", "Invalid JSON"),
    ("[1, 2]", "Input should be an object"),
    ("null", "Input should be an object"),
    ("[" * 100_000, "Invalid JSON"),
    (fit_json(fit_result())[:200], "Invalid JSON: EOF"),
    (b"\xff\xfe{\x00}\x00", "Invalid JSON"),
    (b"\x89PNG\r\n\x1a\n\0\0", "Invalid JSON"),
    (without("parameters"), "parameters: Field required"),
    (broken(surplus=1), "surplus: Extra inputs are not permitted, not 1"),
    (broken(n="3"), "n: Input should be a valid integer, not '3'"),
    (broken(n=True), "n: Input should be a valid integer"),
    (broken(n=2.5), "n: Input should be a valid integer"),
    (broken(rms=math.nan), "rms: Input should be a finite number"),
    (broken(rms=1).replace('"rms": 1', '"rms": 1e999'), "rms: "),
    (broken(status="done"), "status: Input should be 'ok'.*not 'done'"),
    (broken(version=9), "version: .*another version of iris-sysid"),
    (broken(document="calibration"), r"document: .*this is not the file that is wanted here \(fit\)"),
    (broken(parameters={"length": 1.0}), r"parameters\.length: .*not 1\.0"),
    (broken(parameters={"length": {"value": "long"}}), r"parameters\.length\.value: .*not 'long' \(and 4 more\)"),
    (broken(message="x" * 1000, n="y" * 1000), "n: .{1,200}$"),
]


@pytest.mark.parametrize(("content", "message"), BAD_FILES)
def test_read_fit_bad_content_is_one_data_error_with_the_key(tmp_path, content, message):
    path = tmp_path / "fit.json"
    path.write_bytes(content if isinstance(content, bytes) else content.encode())
    with pytest.raises(DataError, match=message) as caught:
        read_fit(path)
    assert str(caught.value).startswith(f"{path}: ")
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["gone.json", "", "a\0b", "x" * 300])
def test_read_fit_of_no_file_is_a_data_error(tmp_path, name):
    with pytest.raises(DataError, match="cannot read"):
        read_fit(f"{tmp_path}/{name}")


def test_read_fit_accepts_a_byte_order_mark(tmp_path):
    (tmp_path / "fit.json").write_bytes(b"\xef\xbb\xbf" + fit_json(fit_result()).encode())
    assert read_fit(tmp_path / "fit.json").model == "pendulum"


# --------------------------------------------------------------------------- schemas


@pytest.mark.parametrize("name", DOCUMENTS)
def test_schema_describes_the_document_of_that_name(name):
    described = schema(name)
    assert described["$schema"].endswith("2020-12/schema")
    assert described["additionalProperties"] is False
    assert described["properties"]["document"]["const"] == name
    assert described["properties"]["version"]["default"] == DOCUMENTS[name].model_fields["version"].default
    assert json.loads(json.dumps(described, allow_nan=False)) == described


def test_schema_of_fit_explains_its_keys():
    properties = schema("fit")["properties"]
    assert set(KEYS_OTHERS_RELY_ON) <= set(properties)
    assert "Root mean square" in properties["rms"]["description"]


def test_schema_of_unknown_name_lists_the_names():
    with pytest.raises(
        UnknownNameError, match="no file is named 'fits'; there are: fit, diagnosis, discovery, calibration, origin"
    ):
        schema("fits")


def test_checked_reports_the_first_wrong_value():
    with pytest.raises(DataError, match=r"unit: Input should be 'm' or 'px', not 'furlong' \(and 2 more\)"):
        checked(CalibrationDocument, unit="furlong")


def test_document_text_reads_back_as_the_same_document(tmp_path):
    document = fit_document(fit_result(), trajectory())
    (tmp_path / "a.json").write_text(document_text(document), encoding="utf-8")
    assert read_document(tmp_path / "a.json", FitDocument) == document
