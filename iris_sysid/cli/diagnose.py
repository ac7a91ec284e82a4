"""The command ``iris-sysid diagnose``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import Force, Free, Json, Output, Settings

if TYPE_CHECKING:
    from iris_sysid.types import Trajectory

Clips = Annotated[
    list[Path],
    typer.Argument(help="CSV with t_s and <quantity>_<unit> columns; folders of them, of run, or a data set."),
]
Model = Annotated[str | None, typer.Option("--model", help="Governing equation; see list. Or FILE.py:NAME.")]
Effects = Annotated[list[str] | None, typer.Option("--effect", help="Try an effect of your own as well: FILE.py:NAME.")]
Phenomenon = Annotated[
    str | None, typer.Option("--phenomenon", help="What is filmed, for its model; see list. Or FILE.py:NAME.")
]


def diagnose(
    clips: Clips,
    output: Output,
    model: Model = None,
    phenomenon: Phenomenon = None,
    effect: Effects = None,
    known: Settings = None,
    free: Free = None,
    holdout: Annotated[float, typer.Option(help="Share to predict without fitting it.", min=0.0, max=0.9)] = 0.3,
    trials: Annotated[int | None, typer.Option(help="Of a data set, so many clips of each setting.")] = None,
    board: Annotated[str | None, typer.Option(help="Inner corners of a data set's checkerboards: 9x6.")] = None,
    square: Annotated[str | None, typer.Option(help="Side of their squares: 25mm or 25.0+-0.1mm.")] = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Find what a governing equation lacks, and add it. Reports the error before and after.

    Several clips of the same kind are questioned together; those of a data set are measured first, once. The model may
    be your own: FILE.py:NAME.

    \b
    Example:
      iris-sysid diagnose trajectory.csv --model pendulum -o diagnosis/
    """
    from iris_sysid.cli import _parsing
    from iris_sysid.diagnosis import diagnose as diagnosis
    from iris_sysid.io.json_documents import document_text
    from iris_sysid.registry import EFFECTS, MODELS, PHENOMENA
    from iris_sysid.report.diagnosis_page import check_folder, diagnosis_document, write_diagnosis
    from iris_sysid.report.text import diagnosis_sentence

    shown = None if phenomenon is None else PHENOMENA.named(phenomenon)
    if model is not None:
        chosen = MODELS.named(model)
    elif shown is not None:
        chosen = MODELS.named(shown.model)
    else:
        raise typer.BadParameter("Missing option '--model' or '--phenomenon'")
    check_folder(output, overwrite=force)
    fixed = _parsing.settings(known or (), chosen.units())
    asked = {"model": chosen.name if model is None else model, "set": known, "free": free, "holdout": holdout}
    measured = _measured(clips, phenomenon, output, trials, board, square)
    questioned = [_parsing.with_options(clip, **asked) for clip in measured]
    usual = shown.free if shown is not None and model is None else ()
    found = diagnosis.diagnose(
        questioned,
        chosen,
        fixed=fixed,
        free=[name for name in dict.fromkeys((*usual, *(free or ()))) if name not in fixed or name in (free or ())],
        effects=[*EFFECTS.values(), *map(EFFECTS.named, effect or ())],
        holdout=holdout,
        progress=lambda text: typer.echo(text, err=True),
    )
    page = write_diagnosis(found, questioned, output, overwrite=force)
    document = document_text(diagnosis_document(found, questioned)).rstrip("\n")
    typer.echo(document if json else diagnosis_sentence(found))
    typer.echo(f"report: {page}", err=True)


def _measured(
    clips: list[Path], phenomenon: str | None, output: Path, trials: int | None, board: str | None, square: str | None
) -> "list[Trajectory]":
    """The trajectories of tables and folders; clips of a data set are measured, and kept beside the output."""
    from iris_sysid.benchmark.clip_folders import clips_of, clips_of_dataset, is_dataset
    from iris_sysid.benchmark.groundtruth.direct import with_board
    from iris_sysid.cli import _parsing
    from iris_sysid.errors import DataError
    from iris_sysid.io.schemas.groundtruth import MeasuredDocument

    shown = MeasuredDocument()
    if board is not None or square is not None:
        shown = with_board(shown, _parsing.board(board, square))
    found: list[Trajectory] = []
    for path in clips:
        if not is_dataset(path):
            found += clips_of([path])
            continue
        if phenomenon is None:
            raise DataError(f"{path} is a data set: say which of its clips, e.g. --phenomenon pendulum")
        with _terminal.progress("measuring clips") as report_progress:
            found += clips_of_dataset(
                path,
                phenomenon,
                Path(f"{output}".rstrip("/") + ".work"),
                board=shown,
                trials=trials,
                tell=lambda text: typer.echo(_terminal.one_line(text), err=True),
                progress=report_progress,
            )
    return found
