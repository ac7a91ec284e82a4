"""The notebook guide and the tutorial run from top to bottom and print what they say."""

import contextlib
import io
import re

import matplotlib
import pytest

from tests._project import ROOT

MIN_CELLS = {"notebook": 5, "tutorial": 5}
pages = pytest.mark.parametrize("page", [ROOT / "docs" / "guide" / f"{name}.md" for name in MIN_CELLS], ids=MIN_CELLS)


def cells_of(page):
    """Language and content of the cells, and of what they print, in order."""
    return re.findall(r"^```(python|text)\n(.*?)^```$", page.read_text("utf-8"), re.MULTILINE | re.DOTALL)


@pages
@pytest.mark.slow
def test_cells_run_in_order_and_print_what_the_page_says(page, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    matplotlib.use("agg")
    namespace, printed, said = {"__name__": "__main__"}, [], []
    for language, block in cells_of(page):
        if language == "text":
            said.append(block.rstrip())
            continue
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile(block, str(page), "exec"), namespace)
        printed.append(out.getvalue().rstrip())
    matplotlib.pyplot.close("all")
    assert printed == said


@pages
def test_page_has_a_text_for_every_cell(page):
    languages = [language for language, _ in cells_of(page)]
    assert languages == ["python", "text"] * (len(languages) // 2)
    assert len(languages) >= 2 * MIN_CELLS[page.stem]
