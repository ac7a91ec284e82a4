"""The command ``iris-sysid diagnose``."""

from typing import Annotated

import typer

from iris_sysid.cli.arguments import Force, Free, Json, ModelName, Output, Settings, Table


def diagnose(
    table: Table,
    model: ModelName,
    output: Output,
    known: Settings = None,
    free: Free = None,
    holdout: Annotated[float, typer.Option(help="Share to predict without fitting it.", min=0.0, max=0.9)] = 0.3,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find what a governing equation lacks, and add it. Reports the error before and after.

    \b
    Example:
      iris-sysid diagnose trajectory.csv --model pendulum -o diagnosis/
    """
    from iris_sysid import diagnosis, options
    from iris_sysid.documents import document_text
    from iris_sysid.registry import MODELS
    from iris_sysid.report.diagnosis_page import check_folder, diagnosis_document, write_diagnosis
    from iris_sysid.table_reading import read_trajectory
    from iris_sysid.wording import diagnosis_sentence

    chosen = MODELS[model]
    check_folder(output, overwrite=force)
    fixed = options.settings(known or (), options.units_of(chosen))
    trajectory = options.asked(read_trajectory(table), model=model, set=known, free=free, holdout=holdout)
    found = diagnosis.diagnose(
        trajectory,
        chosen,
        fixed=fixed,
        free=free or (),
        holdout=holdout,
        progress=lambda text: typer.echo(text, err=True),
    )
    page = write_diagnosis(found, trajectory, output, overwrite=force)
    document = document_text(diagnosis_document(found, trajectory)).rstrip("\n")
    typer.echo(document if json else diagnosis_sentence(found))
    typer.echo(f"report: {page}", err=True)
