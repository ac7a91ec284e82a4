"""The model that a command is about: named, of a phenomenon, an equation, a run, the bank, or a fit on disk."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from iris_sysid.cli import _own_equation, _terminal
from iris_sysid.errors import DataError

if TYPE_CHECKING:
    from iris_sysid.cli.arguments import EquationArguments, RecordArguments
    from iris_sysid.io.schemas import FitDocument
    from iris_sysid.types import OdeModel, Trajectory

AUTO = "auto"


def stated_model(
    stated: EquationArguments, phenomenon: str | None, clips: Sequence[Path], record: RecordArguments
) -> tuple[OdeModel, Sequence[str]]:
    """The model to diagnose, and the constants that its phenomenon estimates by default.

    Without a model, an equation and a phenomenon it is that of run.
    """
    from iris_sysid.pipeline.clip_folders import tables_in
    from iris_sysid.registry import MODELS, PHENOMENA

    if stated.equation is not None:
        _own_equation.check_one(stated, phenomenon)
        return _own_equation.model_of(stated, tables_in(clips[0])[0], record.columns), ()
    described = None if phenomenon is None else PHENOMENA.named(phenomenon)
    if stated.model == AUTO:
        return _chosen(clips, record), ()
    if stated.model is not None:
        return MODELS.named(stated.model), ()
    if described is None:
        return MODELS.named(model_of_runs(clips)), ()
    return MODELS.named(described.model), described.free


def model_of_runs(clips: Sequence[Path]) -> str:
    """The model in fit.json of each folder of run, or beside its table."""
    from iris_sysid.io.json_documents import read_document
    from iris_sysid.io.schemas import FitDocument

    fits = [(path if path.is_dir() else path.parent) / "fit.json" for path in clips]
    if not all(fit.is_file() for fit in fits):
        raise typer.BadParameter("Missing option '--model' or '--phenomenon'; only a folder of run can do without")
    models = {read_document(fit, FitDocument).model for fit in fits}
    if len(models) > 1:
        raise DataError(f"these runs have different models: {', '.join(sorted(models))}; diagnose them one by one")
    return models.pop()


def model_of_fit(document: FitDocument, clip: Trajectory) -> OdeModel:
    """The model of a fit on disk, without effects: registered, of a FILE.py, or of an equation, as it was typed then.

    The clip gives an equation its units.
    """
    from iris_sysid.registry import MODELS, PHENOMENA

    typed = document.origin.get("options", {})
    options: dict[str, Any] = typed if isinstance(typed, dict) else {}
    if options.get("equation"):
        bounds, known = options.get("bound") or [], options.get("set") or []
        return _own_equation.model_for(options["equation"], bounds, known, clip)
    if document.model in MODELS:
        return MODELS[document.model]
    phenomenon = options.get("phenomenon")
    return MODELS.named(PHENOMENA.named(phenomenon).model if phenomenon else options.get("model") or document.model)


def _chosen(clips: Sequence[Path], record: RecordArguments) -> OdeModel:
    """The model of the bank that describes the first clip."""
    from fitters.selection.select import select_model
    from iris_sysid.pipeline.clip_folders import tables_in
    from iris_sysid.registry import MODELS

    choice = select_model(_terminal.read_tables(tables_in(clips[0])[:1], record)[0])
    if choice.chosen is None:
        raise DataError(f"{choice.message}; name a model with --model")
    typer.echo(f"model: {choice.message}", err=True)
    return MODELS[choice.chosen.model]
