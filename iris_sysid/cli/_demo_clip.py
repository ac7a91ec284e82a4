"""A clip with an effect hidden in it, and the table that compares what was found with what is true."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pandas as pd

from iris_sysid.diagnosis.diagnose import diagnose
from iris_sysid.pipeline import check_folder, run, save
from iris_sysid.report.diagnosis_page import check_folder as check_diagnosis_folder
from iris_sysid.report.diagnosis_page import write_diagnosis
from iris_sysid.report.text import diagnosis_sentence, residual_text
from iris_sysid.synthetic import Truth, render_clip
from iris_sysid.types import FitResult

CLIP = "pendulum.mp4"
HIDDEN = {"quadratic-drag": 0.12}  # 1/rad; the real footage of the benchmark's pendulum shows about as much


def render_demo(
    folder: str | Path,
    *,
    size: tuple[int, int] = (960, 540),
    seconds: float = 12.0,
    seed: int = 7,
    progress: Callable[[int, int], None] | None = None,
    overwrite: bool = False,
) -> tuple[Path, Truth]:
    """Render a pendulum released at 60 degrees, with a drag hidden in it that the pendulum's equation lacks.

    Parameters
    ----------
    folder
        Where ``pendulum.mp4`` goes, with its truth beside it; made when missing.
    size
        Width and height, px.
    seconds
        Length of the clip, at 60 frames per second.
    seed
        Same seed, same bytes.
    progress
        Called with (frames done, frames in all).
    overwrite
        Replace an earlier clip.

    Returns
    -------
    clip : Path
        The clip.
    truth : Truth
        Everything that is true of it.
    """
    clip = Path(folder) / CLIP
    truth = render_clip(
        "pendulum",
        clip,
        effects=HIDDEN,
        size=size,
        fps=60.0,
        duration_s=seconds,
        seed=seed,
        overrides={"theta_0": -1.0472, "damping": 0.04},
        progress=progress,
        overwrite=overwrite,
    )
    return clip, truth


def compare(truth: Truth, fit: FitResult) -> pd.DataFrame:
    """Set what a fit estimated beside what is true.

    Parameters
    ----------
    truth
        Of the clip.
    fit
        Of the clip's trajectory, with or without effects.

    Returns
    -------
    DataFrame
        One row per fitted parameter whose truth is known, indexed by ``parameter``: ``estimate``, ``stderr``,
        ``truth``, ``unit``, and ``off``, the difference in standard errors (NaN where there is none).
    """
    known = {**truth.parameters, **truth.hidden}
    known_effects = {name.replace("-", "_"): size for name, size in truth.effects.items()}
    rows = []
    for name, estimate in fit.estimates.items():
        if name not in fit.free or name not in {*known, *known_effects} or name.endswith("_0"):
            continue  # constants that were put in; initial states, which hold at the fit's own start
        true = known[name].value if name in known else known_effects[name]
        off = (estimate.value - true) / estimate.stderr if estimate.stderr > 0 else float("nan")
        rows.append((name, estimate.value, estimate.stderr, true, estimate.unit, off))
    columns = ["parameter", "estimate", "stderr", "truth", "unit", "off"]
    return pd.DataFrame(rows, columns=columns).set_index("parameter")


def demo(folder: str | Path, *, overwrite: bool = False, progress: Callable[[int, int], None] | None = None) -> str:
    """Render a clip with an effect hidden in it, run the chain on it, find the effect, compare all with the truth.

    Parameters
    ----------
    folder
        Gets the clip, ``report/`` of the fit and ``diagnosis/`` of what it leaves over.
    overwrite
        Replace an earlier demo.
    progress
        Called with (frames rendered, frames in all).

    Returns
    -------
    str
        What was found beside what is true, and where the pages are.
    """
    report, diagnosis = Path(folder) / "report", Path(folder) / "diagnosis"
    check_folder(report, overwrite=overwrite)
    check_diagnosis_folder(diagnosis, overwrite=overwrite)
    clip, truth = render_demo(folder, progress=progress, overwrite=overwrite)
    result = run(clip, "pendulum")
    found = diagnose(result.trajectory, result.fit.model, free=result.phenomenon.free)
    pages = [
        save(result, report, overwrite=overwrite),
        write_diagnosis(found, result.trajectory, diagnosis, overwrite=overwrite),
    ]
    return "\n".join(
        [
            "The pendulum's equation as the books have it, fitted to the clip, beside the truth:",
            _table(compare(truth, result.fit)),
            f"What it leaves over: {residual_text(result.fit)}.",
            "",
            f"{diagnosis_sentence(found)}",
            _table(compare(truth, found.final)),
            "",
            *(f"open {page}" for page in pages),
        ]
    )


def _table(frame: pd.DataFrame) -> str:
    return frame.to_string(float_format=lambda value: f"{value:.5g}")
