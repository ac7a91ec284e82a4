"""The command ``iris-sysid benchmark``."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Fps, Output

if TYPE_CHECKING:
    from iris_sysid.benchmark.dataset_rows import DatasetRows, Plan

Dataset = Annotated[Path | None, typer.Argument(help="Folder of <Class>/<setting>/<clip>.mp4.")]
Latent = Annotated[list[str] | None, typer.Option("--latent", help="Runs of a latent pipeline: NAME=CSV.")]
Predictions = Annotated[
    list[str] | None, typer.Option("--predictions", help="What a VLM or classifier named: NAME=CSV, one line a video.")
]
Rows = Annotated[Path | None, typer.Option("--rows", help="Earlier rows.csv: its tables again.")]
Reference = Annotated[str | None, typer.Option(help="Method that the differences of the long table are against.")]
Published = Annotated[Path | None, typer.Option("--audit", help="Derive the published numbers again from this folder.")]
Name = Annotated[str | None, typer.Option(help="Name of the data set in the tables; that of its folder if not given.")]
Measured = Annotated[Path | None, typer.Option(help="What was measured by hand; see iris-sysid gt --template.")]
Work = Annotated[Path | None, typer.Option(help="Where measurements are kept: OUTPUT/work; shared with gt --work.")]
Studies = Annotated[
    list[str] | None, typer.Option("--study", help="Only this beside the bank's fit, e.g. sindy; none for nothing.")
]
Studied = Annotated[int | None, typer.Option(help="Only so many clips of each setting in the studies.", min=1)]
Trials = Annotated[int | None, typer.Option(help="Only so many clips of each setting at all.", min=1)]
Robustness = Annotated[int, typer.Option(help="So many clips are made worse and measured again.", min=0)]
Workers = Annotated[int, typer.Option(help="Processes side by side.", min=1)]
Seed = Annotated[int, typer.Option(help="Of added noise and dropped frames.", min=0)]


def benchmark(
    output: Output,
    dataset: Dataset = None,
    latent: Latent = None,
    predictions: Predictions = None,
    rows: Rows = None,
    audit: Published = None,
    name: Name = None,
    measured: Measured = None,
    work: Work = None,
    study: Studies = None,
    studied: Studied = None,
    trials: Trials = None,
    robustness: Robustness = 0,
    reference: Reference = None,
    fps: Fps = None,
    workers: Workers = 1,
    seed: Seed = 0,
    force: Force = False,
) -> None:
    """Build the benchmark's tables from a data set and latent runs, or audit the published ones.

    One flat row a value; CSV, Markdown, LaTeX, HTML. A second run does only what is missing.

    \b
    Example:
      iris-sysid benchmark DATASET/ --latent baseline=iris_baseline.csv --robustness 8 -o out/
    """
    from iris_sysid.benchmark import write_audit
    from iris_sysid.benchmark.build import Inputs, build, can_write
    from iris_sysid.benchmark.dataset_rows import ALL_STUDIES, Plan
    from iris_sysid.benchmark.groundtruth.measure import Conditions
    from iris_sysid.benchmark.sources.inputs import named_files
    from iris_sysid.io.json_documents import read_document
    from iris_sysid.io.schemas.groundtruth import MeasuredDocument

    written: dict[str, Path] = {}
    if audit is not None:
        written |= write_audit(audit, output, overwrite=force)
    files = named_files(latent or (), "--latent"), named_files(predictions or (), "--predictions")
    if audit is None or any(files) or rows is not None or dataset is not None:
        can_write(output, overwrite=force)
        by_hand = MeasuredDocument() if measured is None else read_document(measured, MeasuredDocument)
        plan = Plan(
            name=name or (dataset.resolve().name if dataset else ""),
            measured=by_hand,
            conditions=Conditions(fps=fps, trials=trials),
            studies=tuple(one for one in study if one != "none") if study else ALL_STUDIES,
            studied=studied,
            robustness=robustness,
            workers=workers,
            seed=seed,
        )
        found = _rows_of(dataset, work or output / "work", plan) if dataset else None
        asked: dict[str, object] = {
            "name": plan.name,
            "studies": plan.studies,
            "studied": studied,
            "trials": trials,
            "seed": seed,
        }
        asked |= {"robustness": robustness, "fps": fps, "measured": by_hand.model_dump(mode="json")}
        written |= build(Inputs(*files, rows, found), output, reference=reference, options=asked, overwrite=force)
    for path in written.values():
        typer.echo(str(path), err=True)


def _rows_of(dataset: Path, work: Path, plan: Plan) -> DatasetRows:
    from iris_sysid.benchmark.dataset_rows import dataset_rows

    with _terminal.progress("measuring and studying") as report_progress:
        return dataset_rows(
            dataset,
            work,
            plan,
            progress=report_progress,
            tell=lambda text: typer.echo(_terminal.one_line(text), err=True),
        )
