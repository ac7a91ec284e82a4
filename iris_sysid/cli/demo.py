"""The command ``iris-sysid demo``: a clip with a hidden effect, its diagnosis, and a comparison with the truth."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Output

if TYPE_CHECKING:
    import pandas as pd

    from iris_sysid.synthetic import Truth
    from iris_sysid.types import FitResult

CLIP = "pendulum.mp4"
HIDDEN = {"quadratic-drag": 0.12}  # 1/rad; the real footage of the benchmark's pendulum shows a similar value


def demo(output: Output = Path("demo-output"), force: Force = False) -> None:
    """Render a clip with a hidden effect, find the effect, and compare all estimates with the truth.

    \b
    Example:
      iris-sysid demo -o demo-output
    """
    with _terminal.progress("rendering", then="tracking, fitting, diagnosing") as report_progress:
        text = run_demo(output, overwrite=force, progress=report_progress)
    typer.echo(text)


def run_demo(folder: Path, *, overwrite: bool = False, progress: Callable[[int, int], None] | None = None) -> str:
    """Render a clip with a hidden effect, fit the textbook equation, diagnose it, compare both fits with the truth.

    Returns the estimates beside the truth, without and with the effect, and the paths of the pages.
    """
    from iris_sysid.diagnosis.diagnose import diagnose
    from iris_sysid.io.files import check_folder
    from iris_sysid.pipeline.one_clip import FILES, run, save
    from iris_sysid.report import diagnosis_files, diagnosis_page
    from iris_sysid.report.diagnosis_text import diagnosis_text
    from iris_sysid.report.text import residual_text, verdict_lines

    report, diagnosis_folder = folder / "report", folder / "diagnosis"
    check_folder(report, FILES, overwrite=overwrite)
    check_folder(diagnosis_folder, diagnosis_files.FILES, overwrite=overwrite)
    clip, truth = render_demo(folder, progress=progress, overwrite=overwrite)
    result = run(clip, "pendulum")
    diagnosis = diagnose(result.trajectory, result.fit.model, free=result.phenomenon.free)
    # the error of a size that the sentence tells, not that of a model which nothing else could explain
    final = replace(diagnosis.final, estimates={**diagnosis.final.estimates, **diagnosis.sizes})
    pages = [
        save(result, report, overwrite=overwrite),
        diagnosis_page.write_diagnosis(
            diagnosis,
            result.trajectory,
            diagnosis_folder,
            footage=result,
            overwrite=overwrite,
        ),
    ]
    return "\n".join(
        [
            "The textbook pendulum equation, fitted to the clip:",
            _table(compare(truth, result.fit)),
            f"{residual_text(result.fit)}.",
            "",
            diagnosis_text(diagnosis),
            *verdict_lines(diagnosis.verdict),
            _table(compare(truth, final)),
            "",
            *(f"open {page}" for page in pages),
        ]
    )


def render_demo(
    folder: Path,
    *,
    size: tuple[int, int] = (960, 540),
    seconds: float = 12.0,
    progress: Callable[[int, int], None] | None = None,
    overwrite: bool = False,
) -> tuple[Path, Truth]:
    """Render a pendulum released at 60 degrees, with a quadratic drag that its equation lacks: clip and truth."""
    from iris_sysid.synthetic import render_clip

    clip = folder / CLIP
    truth = render_clip(
        "pendulum",
        clip,
        effects=HIDDEN,
        size=size,
        fps=60.0,
        duration_s=seconds,
        seed=7,
        overrides={"theta_0": -1.0472, "damping": 0.04},
        progress=progress,
        overwrite=overwrite,
    )
    return clip, truth


def compare(truth: Truth, fit: FitResult) -> pd.DataFrame:
    """The fitted parameters whose truth is known, indexed by ``parameter``.

    Columns: ``estimate``, ``stderr``, ``truth``, ``unit``, and ``off``, the difference in standard errors (NaN where
    there is none).
    """
    import pandas as pd

    true_values = {name: estimate.value for name, estimate in {**truth.parameters, **truth.hidden}.items()}
    true_values = {name.replace("-", "_"): size for name, size in truth.effects.items()} | true_values
    # constants are inputs of the fit, and initial states refer to the start of the fit, not of the clip
    names = {*fit.free} & true_values.keys() - {*fit.model.initial_names}
    rows = []
    for name, estimate in fit.estimates.items():
        if name not in names:
            continue
        true = true_values[name]
        deviation = (estimate.value - true) / estimate.stderr if estimate.stderr > 0 else float("nan")
        rows.append((name, estimate.value, estimate.stderr, true, estimate.unit, deviation))
    columns = ["parameter", "estimate", "stderr", "truth", "unit", "off"]
    return pd.DataFrame(rows, columns=columns).set_index("parameter")


def _table(frame: pd.DataFrame) -> str:
    return frame.to_string(float_format=lambda value: f"{value:.5g}")
