"""The command ``iris-sysid diagnose``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli.arguments import Force, Free, Json, ModelName, Output, Settings


def diagnose(
    tables: Annotated[list[Path], typer.Argument(help="CSV with t_s and <quantity>_<unit> columns; one a clip.")],
    model: ModelName,
    output: Output,
    known: Settings = None,
    free: Free = None,
    holdout: Annotated[float, typer.Option(help="Share to predict without fitting it.", min=0.0, max=0.9)] = 0.3,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find what a governing equation lacks, and add it. Reports the error before and after.

    Several clips of the same kind are questioned together. The model may be your own: FILE.py:NAME.

    \b
    Example:
      iris-sysid diagnose trajectory.csv --model pendulum -o diagnosis/
    """
    from iris_sysid import diagnosis, options
    from iris_sysid.documents import document_text
    from iris_sysid.report.diagnosis_page import check_folder, diagnosis_document, write_diagnosis
    from iris_sysid.table_reading import read_trajectory
    from iris_sysid.user_models import model_named
    from iris_sysid.wording import diagnosis_sentence

    chosen = model_named(model)
    check_folder(output, overwrite=force)
    fixed = options.settings(known or (), options.units_of(chosen))
    asked = {"model": model, "set": known, "free": free, "holdout": holdout}
    clips = [options.asked(read_trajectory(table), **asked) for table in tables]
    found = diagnosis.diagnose(
        clips,
        chosen,
        fixed=fixed,
        free=free or (),
        holdout=holdout,
        progress=lambda text: typer.echo(text, err=True),
    )
    page = write_diagnosis(found, clips, output, overwrite=force)
    document = document_text(diagnosis_document(found, clips)).rstrip("\n")
    typer.echo(document if json else diagnosis_sentence(found))
    typer.echo(f"report: {page}", err=True)
