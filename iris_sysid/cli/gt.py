"""The command ``iris-sysid gt``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import Force, Fps, KeepPartial, TimeBase, TransferCurve, WorkArguments

if TYPE_CHECKING:
    from iris_sysid.benchmark.groundtruth.measure import ClipMeasurement, Measurements
    from iris_sysid.io.schemas.groundtruth import ParameterEntry, ParametersDocument


@with_groups
def gt(
    processes: WorkArguments,
    dataset: Annotated[Path | None, typer.Argument(help="Folder of <Class>/<setting>/<clip>.mp4.")] = None,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="File to write: parameters.json.")] = None,
    measured: Annotated[Path | None, typer.Option(help="Direct measurements; --template prints a file.")] = None,
    board: Annotated[str | None, typer.Option(help="Inner corners of the checkerboards, e.g. 9x6.")] = None,
    square: Annotated[str | None, typer.Option(help="Side of their squares: 25mm or 25.0+-0.1mm.")] = None,
    trials: Annotated[int | None, typer.Option(help="Measure only this many clips of each setting.")] = None,
    work: Annotated[Path | None, typer.Option(help="Folder of the measurements; default OUTPUT.work.")] = None,
    fps: Fps = None,
    time_base: TimeBase = "0%",
    keep_partial: KeepPartial = False,
    transfer: TransferCurve = None,
    diagnose: Annotated[bool, typer.Option("--diagnose", help="Look for effects missing in the equations.")] = False,
    template: Annotated[bool, typer.Option("--template", help="Print a template for --measured and stop.")] = False,
    force: Force = False,
) -> None:
    """Measure the ground truth of a data set: one value of each parameter and setting, beside direct measurements.

    A second run measures only clips that are new or have changed.

    \b
    Example:
      iris-sysid gt DATASET/ --measured measured.json -o parameters.json
    """
    if dataset is not None:
        _terminal.check_dataset(dataset)
    from iris_sysid.benchmark.dataset import BOARD
    from iris_sysid.benchmark.groundtruth import direct
    from iris_sysid.benchmark.groundtruth.clip import Conditions
    from iris_sysid.benchmark.groundtruth.effects import lacking_effects
    from iris_sysid.benchmark.groundtruth.measure import measure
    from iris_sysid.benchmark.groundtruth.parameters import parameters_document
    from iris_sysid.cli import _parsing
    from iris_sysid.io.files import check_writable
    from iris_sysid.io.json_documents import document_text, write_document
    from iris_sysid.io.schemas.groundtruth import MeasuredDocument

    if template:
        typer.echo(document_text(direct.template()).rstrip("\n"))
        return
    if dataset is None or output is None:
        raise typer.BadParameter("Missing argument 'DATASET' or option '-o'")
    check_writable(output, overwrite=force)
    by_hand = MeasuredDocument() if measured is None else direct.read_measured(measured)
    if board is not None or square is not None:
        by_hand = direct.with_board(by_hand, _parsing.board(board, square))
    conditions = Conditions(
        fps=fps,
        clock_stderr=_parsing.fraction(time_base),
        keep_partial=keep_partial,
        trials=trials,
        transfer=_parsing.transfer(transfer),
    )
    workers = _terminal.workers_of(processes)
    with _terminal.progress("measuring clips") as report_progress:
        measurements = measure(
            dataset,
            work or output.with_suffix(".work"),
            measured=by_hand,
            conditions=conditions,
            workers=workers,
            progress=report_progress,
            tell=_terminal.tell,
        )
    document = parameters_document(measurements, by_hand, lacking_effects if diagnose else None)
    write_document(document, output, overwrite=force)
    _terminal.print_rows(_rows(document, measurements), json=False, header=True)
    for place, reason in (gap for gap in measurements.gaps if gap[0].endswith(f"/{BOARD}")):
        _terminal.tell(f"gap: {place}: {reason}")
    clips, gaps = len(measurements.clips), len(measurements.gaps)
    typer.echo(f"{clips} clips, {measurements.now} measured now; {gaps} gaps", err=True)
    given = {"--measured": measured, "--trials": trials, "--fps": fps, "--transfer": transfer}
    same = [text for name, value in given.items() if value is not None for text in (name, value)]
    folder = work or output.with_suffix(".work")
    _terminal.suggest("benchmark", dataset, "--work", folder, *same, "-o", output.with_name("tables"))


def _rows(document: "ParametersDocument", measurements: "Measurements") -> list[dict[str, str]]:
    """One row for each parameter of each setting: its value with its error, and the doubts about it."""
    from iris_sysid.benchmark.groundtruth.verdicts import SettingVerdict, verdict_on
    from iris_sysid.io.schemas import number
    from iris_sysid.report.text import with_error
    from iris_sysid.types import Estimate

    def value(entry: "ParameterEntry") -> Estimate:
        return Estimate(number(entry.mean), number(entry.standard_uncertainty), entry.unit, entry.measurement_type)

    places: dict[tuple[str, str], list[ClipMeasurement]] = {}
    for clip in measurements.clips:
        places.setdefault((clip.clip.class_name.lower(), clip.clip.setting.lower()), []).append(clip)
    nothing = SettingVerdict("", "", "")
    verdicts = {place: verdict_on(clips) for place, clips in places.items()}

    def said(class_name: str, setting: str, entry: "ParameterEntry") -> SettingVerdict:
        return verdicts.get((class_name, setting), nothing) if entry.regenerated is not None else nothing

    return [
        {
            "setting": setting,
            "parameter": name,
            "value": with_error(value(entry)),
            "measured": entry.measurement_type,
            "clips": str(entry.n),
            "numbers": said(class_name, setting, entry).numbers,
            "equation": said(class_name, setting, entry).equation,
            "doubts": _terminal.one_line(said(class_name, setting, entry).doubts),
        }
        for class_name, settings in document.classes.items()
        for setting, parameters in settings.items()
        for name, entry in parameters.items()
    ]
