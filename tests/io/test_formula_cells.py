"""Names that a spreadsheet would run as formulas: written so that it does not, read back as they were."""

import csv

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from iris_sysid.benchmark.sources.rows import flat_rows, read_rows, rows_text
from iris_sysid.benchmark.tables.table import Cell, Table, render
from iris_sysid.io.csv_read import read_track
from iris_sysid.io.csv_write import write_track
from iris_sysid.io.formula_cells import guarded, unguarded
from iris_sysid.types import Track

NAMES = ["=HYPERLINK(1)", "@SUM(1)", "+cmd|' /C calc'!A0", "-2+3+cmd|' /C calc'!A0", "'=1+1", "''=1"]
HARMLESS = ["1", "-1", "-0.5 (12)", "ball, red", "'", "--", ""]


@pytest.mark.parametrize("name", NAMES)
def test_formula_is_written_as_text_and_read_back(tmp_path, name):
    t_s, xy = np.arange(3.0), np.ones((3, 2))
    track = Track(t_s, xy, xy, np.ones(3, bool), np.arange(3), body=name)
    path = write_track([track], tmp_path / "track.csv")
    assert [row["body"][0] for row in csv.DictReader(path.read_text().splitlines())] == ["'"] * 3
    assert read_track(path)[0].body == name


@pytest.mark.parametrize("name", NAMES)
def test_formula_in_flat_rows_and_tables_is_text(tmp_path, name):
    rows = flat_rows([{"setting": name, "clip": "01", "method": "m", "parameter": "length", "status": "failed"}])
    path = tmp_path / "rows.csv"
    path.write_text(rows_text(rows))
    assert read_rows(path)["setting"].tolist() == [name]
    shown = render(Table("", ("a",), ((Cell(name),),)), "csv").splitlines()[1]
    assert shown.lstrip('"').startswith("'")


@pytest.mark.parametrize("text", HARMLESS)
def test_other_text_is_written_as_it_is(text):
    assert guarded(text) == text
    assert unguarded(text) == text


@given(st.text(alphabet="=+-@'\t(|a1", max_size=6))
def test_every_text_is_read_back(text):
    assert unguarded(guarded(text)) == text
