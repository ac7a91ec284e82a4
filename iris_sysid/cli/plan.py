"""The command ``iris-sysid plan``."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli.arguments import TABLE, Columns, Force, Json

if TYPE_CHECKING:
    from iris_sysid.diagnosis.planning.plan import Plan
    from iris_sysid.diagnosis.planning.rivals import Question
    from iris_sysid.io.schemas import DiagnosisDocument
    from iris_sysid.types import Trajectory

FILES = ("plan.json", "plan.png")

Diagnosed = Annotated[Path, typer.Argument(help="diagnosis.json, or the folder that holds it.")]
Clips = Annotated[list[Path], typer.Argument(help=f"The clips that were diagnosed. {TABLE}.")]
Names = Annotated[
    list[str] | None, typer.Option("--name", help="Tell these apart instead: quadratic-drag, nothing. Repeat it.")
]
Costs = Annotated[list[str] | None, typer.Option("--cost", help="Cost of a change, 1 for others: release75=3.")]
Filmed = Annotated[Path | None, typer.Option("--filmed", help="The new clip, made with the change --change.")]
Change = Annotated[str, typer.Option("--change", help="The change that the new clip was made with.")]
Folder = Annotated[Path | None, typer.Option("-o", "--output", help="Folder for plan.json and plan.png.")]


def plan(
    diagnosis: Diagnosed,
    clips: Clips,
    output: Folder = None,
    name: Names = None,
    cost: Costs = None,
    filmed: Filmed = None,
    change: Change = "repeat",
    columns: Columns = None,
    force: Force = False,
    json: Json = False,
) -> None:
    """Rank what to film next: how likely each change of the set-up tells the possible effects apart.

    With --filmed, weigh the effects with the new clip, which was made with one of the changes.

    \b
    Example:
      iris-sysid plan diagnosis/ trajectory.csv -o plan/
    """
    from iris_sysid.io.files import check_writable, json_text

    if output is not None:
        for file in FILES:
            check_writable(output / file, overwrite=force)
    question = _question(diagnosis, tuple(name or ()))
    trajectories = _terminal.read_tables(clips, columns, question.model)
    new = _terminal.read_tables([filmed], columns, question.model) if filmed is not None else []
    # imported after the clips are read, so that an unreadable file is reported without delay
    from iris_sysid.diagnosis.planning.plan import plan as rank_changes
    from iris_sysid.report.plan_text import decision_text, plan_entry, plan_text

    planned = rank_changes(question, trajectories, costs=_costs(cost or ()))
    document = plan_entry(planned)
    said = plan_text(planned)
    if new:
        from iris_sysid.diagnosis.planning.decide import decide

        decision = decide(question, trajectories, new, planned.named(change).change)
        document["decision"] = dict(decision.probabilities)
        said += f"\n{decision_text(decision)}"
    if output is not None:
        _write(planned, json_text(document), trajectories[0], output, force)
    typer.echo(json_text(document).rstrip("\n") if json else said)


def _question(path: Path, names: tuple[str, ...]) -> "Question":
    """What a diagnosis left open; ``names``, where given, are asked about instead."""
    from dataclasses import replace

    from iris_sysid.io.json_documents import read_document
    from iris_sysid.io.schemas import DiagnosisDocument

    document = read_document(path / "diagnosis.json" if path.is_dir() else path, DiagnosisDocument)
    question = _asked(document)
    return replace(question, names=names) if names else question


def _asked(document: "DiagnosisDocument") -> "Question":
    """The question that a diagnosis on disk leaves open: the added effect with the least certain name."""
    from iris_sysid.diagnosis.planning.rivals import Question, least_certain
    from iris_sysid.registry import MODELS

    model = MODELS[document.base.model]
    values = document.base.parameters
    own = {parameter.name: parameter for parameter in model.parameters}
    fixed = {
        name: values[name].estimate()
        for name in own
        if name in values and name not in document.base.free and values[name].value not in (None, own[name].default)
    }
    free = tuple(name for name in own if name in document.base.free and own[name].constant)
    added = [each.effect for each in document.added]
    names, beside = least_certain(added, document.indistinguishable, document.probabilities)
    return Question(model, names, beside, fixed, free)


def _costs(texts: "list[str] | tuple[()]") -> dict[str, float]:
    """Costs by change, from NAME=NUMBER."""
    costs = {}
    for text in texts:
        change, _, number = text.rpartition("=")
        try:
            costs[change] = float(number)
        except ValueError:
            raise typer.BadParameter(f"--cost {text}: give CHANGE=NUMBER") from None
        if not (change and costs[change] > 0):
            raise typer.BadParameter(f"--cost {text}: give CHANGE=NUMBER, with a number above zero")
    return costs


def _write(planned: "Plan", text: str, clip: "Trajectory", folder: Path, force: bool) -> None:
    from iris_sysid.io.files import write_atomic
    from iris_sysid.report.page import png_of
    from iris_sysid.report.plan_figure import plan_figure

    folder.mkdir(parents=True, exist_ok=True)
    write_atomic(folder / "plan.json", text.encode(), overwrite=force)
    if planned.best.differences:
        write_atomic(folder / "plan.png", png_of(plan_figure(planned)), overwrite=force)
        typer.echo(f"picture: {folder / 'plan.png'}", err=True)
