"""The flat row: one value a key, error = value - truth, failures without a value."""

import numpy as np
import pandas as pd
import pytest

from iris_sysid.benchmark.sources.null_baselines import null_rows
from iris_sysid.benchmark.sources.rows import COLUMNS, check_rows, flat_rows
from iris_sysid.errors import DataError

ROW = {"phenomenon": "Pendulum", "setting": "pendulum_45", "clip": "01", "method": "classical", "parameter": "length"}


def test_columns_are_the_agreed_ones():
    assert ",".join(COLUMNS) == (
        "study,dataset,phenomenon,setting,clip,method,condition,parameter,seed,value,stderr,unit,truth,truth_source,"
        "error,status,answer,source"
    )


def test_error_is_value_minus_truth():
    rows = flat_rows([{**ROW, "value": 0.54, "truth": 0.5, "status": "ok"}])
    assert rows["error"].iloc[0] == pytest.approx(0.04)


def test_missing_numbers_are_nan_and_missing_texts_empty():
    row = flat_rows([{**ROW, "status": "failed"}]).iloc[0]
    assert np.isnan(row["value"])
    assert np.isnan(row["error"])
    assert pd.isna(row["seed"])
    assert row["unit"] == ""


def test_no_row_is_a_table_with_all_columns():
    assert list(flat_rows([]).columns) == list(COLUMNS)


@pytest.mark.parametrize(
    ("records", "message"),
    [
        ([{**ROW, "status": "ok"}], "status ok but no finite value"),
        ([{**ROW, "value": 0.0, "status": "failed"}], "a failed run has NaN"),
        ([{**ROW, "value": 1.0, "status": "ok"}] * 2, "s/Pendulum/pendulum_45/01/classical/length occurs twice"),
        ([{**ROW, "colour": "red"}], "no column 'colour'"),
    ],
)
def test_row_that_means_nothing_is_refused(records, message):
    with pytest.raises(DataError, match=message):
        flat_rows(records)


def test_table_without_a_column_is_refused():
    with pytest.raises(DataError, match="lack the column 'study'"):
        check_rows(pd.DataFrame({"setting": ["a"]}))


def test_null_baselines_read_the_start_values_and_the_metadata():
    rows = flat_rows([{**ROW, "phenomenon": "pendulum", "value": 0.4, "truth": 0.45, "status": "ok"}])
    nulls = null_rows(rows).set_index("method")["value"]
    assert nulls["initial value only (10, code)"] == pytest.approx(0.980665)
    assert nulls["initial value only (0.5, 0.05, stated)"] == pytest.approx(19.6133)
    assert nulls["metadata only"] == 0.45  # Delfys75 names the rope's length in cm


def test_release_angle_in_a_name_is_no_length():
    rows = flat_rows([{**ROW, "value": 0.4, "truth": 0.5, "status": "ok"}])
    assert "metadata only" not in set(null_rows(rows)["method"])
