"""The command ``iris-sysid discover``."""

from pathlib import Path
from typing import Annotated

import typer

from iris_sysid.cli import _completion, _terminal
from iris_sysid.cli._groups import as_typed, typed, with_groups
from iris_sysid.cli.arguments import TABLE, Force, Json, Output, RecordArguments, Settings, Strict

Tables = Annotated[list[Path], typer.Argument(help=f"{TABLE}; several clips of one.")]


@with_groups
def discover(
    tables: Tables,
    output: Output,
    record: RecordArguments,
    quantity: Annotated[list[str] | None, typer.Option(help="Use only this quantity, e.g. theta.")] = None,
    known: Settings = None,
    residual_of: Annotated[
        str | None,
        typer.Option(help="Keep this model's terms; find the missing ones.", autocompletion=_completion.models),
    ] = None,
    plot: Annotated[Path | None, typer.Option(help="Also draw terms and fit to this PNG file.")] = None,
    seed: Annotated[int, typer.Option(help="Random seed of the resampling.", min=0)] = 0,
    force: Force = False,
    json: Json = False,
    strict: Strict = False,
) -> None:
    """Find the governing equation itself, with error bars on its terms, and its name. Writes discovery.json.

    \b
    Example:
      iris-sysid discover trajectory.csv -o discovery.json --plot discovery.png
      iris-sysid discover trajectory.csv --residual-of pendulum -o lacking.json
    """
    _terminal.check_sources(tables)
    from fitters.input_hold import residual_over_noise
    from fitters.sindy import discover as find
    from iris_sysid.cli import _parsing, _records
    from iris_sysid.io import discovery_json, json_documents
    from iris_sysid.registry import MODELS
    from iris_sysid.report.text import discovery_sentence, discovery_text

    record = _records.checked(record)
    for table in tables:
        _terminal.check_outputs(table, [output, plot], overwrite=force)
    _terminal.check_suffix(plot, ".png")
    units = {parameter.name: parameter.unit for model in MODELS.values() for parameter in model.parameters}
    kept = None if residual_of is None else MODELS.named(residual_of)
    constants = _parsing.settings(known or (), units)
    read = _terminal.read_tables(tables, record)
    read = read if kept is None else [_terminal.from_positions(clip, kept)[0] for clip in read]
    options = typed(record, quantity=quantity, set=known, residual_of=residual_of, seed=seed)
    clips = [_parsing.with_options(clip, **options) for clip in read]
    with _terminal.phases("searching for the equation"):
        found = {
            each: find(held, quantities=quantity or (), known=constants, residual_of=residual_of, seed=seed)
            for each, held in _records.each_hold(clips, record.hold).items()
        }
    if len(found) > 1:
        _records.tell_hold({each: residual_over_noise(discovery.fits) for each, discovery in found.items()})
    discovery = min(found.values(), key=lambda each: residual_over_noise(each.fits))
    document = discovery_json.discovery_document(discovery, discovery_sentence(discovery))
    json_documents.write_document(document, output, overwrite=force)
    if plot is not None:
        from iris_sysid.report.plots import figure_of

        _terminal.draw(figure_of(discovery), plot, overwrite=force)
    _terminal.show_verdict(discovery.verdict, json)
    typer.echo(json_documents.document_text(document).rstrip("\n") if json else discovery_text(discovery))
    if discovery.matched is not None:
        model, fitted = discovery.matched.model, output.parent / "fit.json"
        same = [*_terminal.repeated("--set", _of(model, known)), *as_typed(record)]
        _terminal.suggest("fit", *tables, "--model", model, *same, "-o", fitted, json=json)
    _terminal.end(discovery.verdict, strict)


def _of(model: str, known: list[str] | None) -> list[str]:
    """The texts ``name=value`` that are about parameters of a model."""
    from iris_sysid.registry import MODELS

    units = MODELS[model].units()
    return [text for text in known or () if text.partition("=")[0].strip() in units]
