"""The notebook guide runs from top to bottom and prints what it says."""

import contextlib
import io
import re

import matplotlib
import pytest

from tests._project import ROOT

PAGE = ROOT / "docs" / "guide" / "notebook.md"
BLOCKS = re.findall(r"^```(python|text)\n(.*?)^```$", PAGE.read_text("utf-8"), re.MULTILINE | re.DOTALL)


@pytest.mark.slow
def test_cells_run_in_order_and_print_what_the_page_says(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    matplotlib.use("agg")
    namespace, printed, said = {"__name__": "__main__"}, [], []
    for language, block in BLOCKS:
        if language == "text":
            said.append(block.rstrip())
            continue
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(block, str(PAGE), "exec"), namespace)
        printed.append(out.getvalue().rstrip())
    matplotlib.pyplot.close("all")
    assert printed == said


def test_page_has_a_text_for_every_cell():
    assert [language for language, _ in BLOCKS] == ["python", "text"] * (len(BLOCKS) // 2)
    assert len(BLOCKS) >= 10
