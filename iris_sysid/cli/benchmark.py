"""The command ``iris-sysid benchmark``."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import Force, Fps, Output, TransferCurve, WorkArguments
from iris_sysid.errors import DataError

if TYPE_CHECKING:
    from iris_sysid.benchmark.dataset_rows import DatasetRows, RowPlan

Dataset = Annotated[Path | None, typer.Argument(help="Folder of <Class>/<setting>/<clip>.mp4.")]
Latent = Annotated[list[str] | None, typer.Option("--latent", help="Results of a latent pipeline: NAME=CSV.")]
Predictions = Annotated[
    list[str] | None, typer.Option("--predictions", help="Classes predicted by a VLM or classifier: NAME=CSV.")
]
Rows = Annotated[Path | None, typer.Option("--rows", help="Add the rows of an earlier rows.csv.")]
Name = Annotated[str | None, typer.Option(help="Name of the data set in the tables; default: its folder's name.")]
Measured = Annotated[Path | None, typer.Option(help="Direct measurements; see iris-sysid gt --template.")]
Work = Annotated[Path | None, typer.Option(help="Folder of the measurements, as in gt --work; default OUTPUT/work.")]
Studies = Annotated[
    list[str] | None, typer.Option("--study", help="Run only this study, e.g. sindy; repeatable; 'none' for no study.")
]
Studied = Annotated[int | None, typer.Option(help="Study only this many clips of each setting.", min=1)]
Trials = Annotated[int | None, typer.Option(help="Measure only this many clips of each setting.", min=1)]
NO_STUDY = "none"


@with_groups
def benchmark(
    output: Output,
    processes: WorkArguments,
    dataset: Dataset = None,
    latent: Latent = None,
    predictions: Predictions = None,
    rows: Rows = None,
    name: Name = None,
    measured: Measured = None,
    work: Work = None,
    study: Studies = None,
    studied: Studied = None,
    trials: Trials = None,
    fps: Fps = None,
    transfer: TransferCurve = None,
    force: Force = False,
) -> None:
    """Compare methods on a data set: one table of rows, all benchmark tables from it.

    Writes CSV, Markdown, LaTeX and HTML. A second run repeats only what is missing or has changed.

    \b
    Example:
      iris-sysid benchmark DATASET/ --latent baseline=iris_baseline.csv -o out/
    """
    if dataset is not None:
        _terminal.check_dataset(dataset)
    from iris_sysid.benchmark.build import Inputs, build, can_write
    from iris_sysid.benchmark.dataset_rows import ALL_STUDIES, RowPlan
    from iris_sysid.benchmark.groundtruth.clip import Conditions
    from iris_sysid.cli import _parsing
    from iris_sysid.io.json_documents import read_document
    from iris_sysid.io.schemas.groundtruth import MeasuredDocument

    latent_files = named_files(latent or (), "--latent")
    prediction_files = named_files(predictions or (), "--predictions")
    can_write(output, overwrite=force)
    plan = RowPlan(
        name=name or (dataset.resolve().name if dataset else ""),
        measured=MeasuredDocument() if measured is None else read_document(measured, MeasuredDocument),
        conditions=Conditions(fps=fps, trials=trials, transfer=_parsing.transfer(transfer)),
        studies=tuple(choice for choice in study if choice != NO_STUDY) if study else ALL_STUDIES,
        studied=studied,
        workers=_terminal.workers_of(processes),
    )
    measurements = _rows_of(dataset, work or output / "work", plan) if dataset else None
    inputs = Inputs(latent_files, prediction_files, rows, measurements)
    written = build(inputs, output, options=_options(plan), overwrite=force)
    for path in written.values():
        typer.echo(str(path), err=True)


def named_files(arguments: Sequence[str], option: str) -> dict[str, Path]:
    """Parse arguments ``NAME=FILE`` of an ``option``; DataError when one has another form or repeats a name."""
    files: dict[str, Path] = {}
    for argument in arguments:
        name, equals, path = (part.strip() for part in argument.partition("="))
        if not (equals and name and path):
            raise DataError(f"cannot read {argument!r}: write {option} as NAME=FILE, e.g. baseline=iris_baseline.csv")
        if name in files:
            raise DataError(f"{option} gives the name {name!r} twice; give each file its own name")
        files[name] = Path(path)
    return files


def _options(plan: RowPlan) -> dict[str, object]:
    """The options that the rows depend on, for the manifest."""
    return {
        "name": plan.name,
        "studies": plan.studies,
        "studied": plan.studied,
        "trials": plan.conditions.trials,
        "fps": plan.conditions.fps,
        "transfer": plan.conditions.transfer.text if plan.conditions.transfer else None,
        "measured": plan.measured.model_dump(mode="json"),
    }


def _rows_of(dataset: Path, work: Path, plan: RowPlan) -> DatasetRows:
    from iris_sysid.benchmark.dataset_rows import dataset_rows

    with _terminal.progress("measuring and studying") as report_progress:
        return dataset_rows(
            dataset,
            work,
            plan,
            progress=report_progress,
            tell=_terminal.tell,
        )
