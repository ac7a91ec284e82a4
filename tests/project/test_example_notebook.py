"""The notebook for engineers runs from top to bottom, prints what it shows, and draws the figure that it shows."""

import base64
import contextlib
import io
import json

import numpy as np
import pytest
from matplotlib.image import imread

from tests._project import ROOT

CELLS = json.loads((ROOT / "examples" / "mat_to_validated_model.ipynb").read_text("utf-8"))["cells"]
CODE = [cell for cell in CELLS if cell["cell_type"] == "code"]


def shown(kind):
    """What the cells of the file show as ``text`` or ``image/png``, one a cell."""
    for cell in CODE:
        for output in cell["outputs"]:
            if kind in output.get("data", output):
                yield output.get("data", output)[kind]


@pytest.mark.slow
def test_cells_run_in_order_and_show_what_the_file_shows(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    namespace, printed = {"__name__": "__main__"}, []
    for cell in CODE:
        out = io.StringIO()
        with contextlib.redirect_stdout(out):
            exec(compile("".join(cell["source"]), "mat_to_validated_model.ipynb", "exec"), namespace)
        printed += [out.getvalue()] if out.getvalue() else []
    assert printed == ["".join(text) for text in shown("text")]
    namespace["figure"].savefig("figure.png", dpi=72)
    (kept,) = shown("image/png")
    before, after = (imread(data)[:, :, :3] for data in (io.BytesIO(base64.b64decode(kept)), "figure.png"))
    assert before.shape == after.shape
    assert np.mean(np.abs(before - after)) < 0.01
    assert np.mean(before < 0.9) > 0.02  # not a blank picture


def test_cells_were_run_in_order():
    assert [cell["execution_count"] for cell in CODE] == [*range(1, len(CODE) + 1)]
