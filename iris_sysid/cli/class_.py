"""The command ``iris-sysid class``."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from iris_sysid.cli import _terminal
from iris_sysid.cli._groups import with_groups
from iris_sysid.cli.arguments import Columns, FilmArguments, Force, Json, Output, PhenomenonName, WorkArguments

if TYPE_CHECKING:
    from iris_sysid.classroom.groups import Source
    from iris_sysid.classroom.summary import ClassResult

PAGE, WORKBOOK = "class.html", "class.xlsx"


@with_groups
def class_(
    folder: Annotated[
        Path, typer.Argument(help="Folder with a clip or a table of each group, or one table with a column of groups.")
    ],
    phenomenon: PhenomenonName,
    output: Output,
    film: FilmArguments,
    work: WorkArguments,
    value: Annotated[str | None, typer.Option(help="The value to compare, e.g. length; default: the first.")] = None,
    expected: Annotated[
        list[str] | None, typer.Option("--known", help="What the class should find: length=0.5+-0.001.")
    ] = None,
    teacher: Annotated[str | None, typer.Option(help="The teacher's own group, or a file: it is in no mean.")] = None,
    group_column: Annotated[str | None, typer.Option(help="Column of a table that names the groups.")] = None,
    columns: Columns = None,
    serve: Annotated[
        bool, typer.Option("--serve", help="Then open the page in the browser, each clip with its review.")
    ] = False,
    force: Force = False,
    json: Json = False,
) -> None:
    """Compare the groups of a class: each group's value, what is wrong with those that stand out, the value of all.

    Writes class.html and class.xlsx, and a page for each group. A second run measures only groups that are new or have
    changed. A file groups.csv in the folder gives single groups their own options.

    \b
    Example:
      iris-sysid class clips/ --phenomenon pendulum --scale 640px=1m --known length=0.5+-0.001 -o class/
    """
    _terminal.check_sources([folder])
    from iris_sysid.classroom.measure import measure_groups, page_of
    from iris_sysid.classroom.page import write_page
    from iris_sysid.classroom.summary import summary_of
    from iris_sysid.classroom.workbook import write_workbook
    from iris_sysid.cli import _class_request
    from iris_sysid.errors import IrisError
    from iris_sysid.io.files import check_folder
    from iris_sysid.registry import PHENOMENA
    from iris_sysid.review.opening import is_result

    # a folder that an interrupted run began holds groups but no page: it goes on
    check_folder(output, (PAGE, WORKBOOK), overwrite=force or (output / "groups").is_dir())
    described = PHENOMENA.named(phenomenon)
    references = _class_request.references(described, expected or (), value)
    options = _class_request.ClassOptions(described, film, columns)
    groups, own = _class_request.groups_of(folder, options, group_column, teacher)
    with _terminal.progress("measuring groups") as report_progress:
        documents, now = measure_groups(
            [*groups, *([own] if own else [])],
            output,
            workers=_terminal.workers_of(work),
            progress=report_progress,
            tell=_terminal.tell,
        )
    measured = documents[: len(groups)]
    if not any(document.usable for document in measured):
        raise IrisError(f"no group of {folder} could be measured; the first: {measured[0].message}")
    result = summary_of(
        measured,
        [page_of(group) for group in groups],
        value=value,
        known=references,
        teacher=None if own is None else (documents[-1], page_of(own)),
    )
    opened = {
        group.name: ("review", output / Path(page_of(group)).parent, "--clip", group.source.path)
        for group in groups
        if not group.source.is_table and is_result(output / Path(page_of(group)).parent)
    }
    reviews = {name: _terminal.command(*arguments) for name, arguments in opened.items()}
    title = f"{folder.absolute().name}: {described.name}"
    page = write_page(result, title, output / PAGE, reviews=reviews, overwrite=True)
    write_workbook(result, output / WORKBOOK, overwrite=True)
    _show(result, json)
    count = f"{len(groups)} groups{'' if own is None else ' and the teacher'}"
    typer.echo(f"{count}, {now} measured now; page: {page}", err=True)
    if serve:
        _serve(result, title, {group.name: group.source for group in groups if group.name in reviews}, output)
    else:
        named = [opened[group.name] for group in result.named if group.name in opened]
        for first in named[:1]:  # the page says it of each
            _terminal.suggest(*first, json=json)


def _serve(result: ClassResult, title: str, clips: Mapping[str, Source], output: Path) -> None:
    """Serve the page of a class until it is interrupted; ``clips``, those that have a track, open in a review."""
    import webbrowser
    from functools import partial
    from urllib.parse import quote

    from iris_sysid.classroom.measure import GROUPS
    from iris_sysid.classroom.page import page_text
    from iris_sysid.review.class_app import ClassReviews, class_app
    from iris_sysid.review.opening import open_result
    from iris_sysid.review.server import serve

    places = {name: output / GROUPS / clip.folder for name, clip in clips.items()}
    reviews = ClassReviews(
        {clips[name].folder: partial(open_result, place, clips[name].path) for name, place in places.items()}
    )

    def page(token: str) -> str:
        links = {name: f"review/{quote(clips[name].folder)}/?token={quote(token)}" for name in places}
        return page_text(result, title, served=links)

    def ready(address: str) -> None:
        typer.echo(f"class: {address}", err=True)
        typer.echo("Ctrl-C ends it; run the command again to compare what was saved", err=True)
        webbrowser.open(address)

    serve(partial(class_app, page, reviews), 0, ready, reviews.close)


def _show(result: ClassResult, json: bool) -> None:
    rows = [_row(result, group.name) for group in result.groups]
    _terminal.print_rows(rows, json, header=True)
    for text in [result.sentence, *(item.text for item in result.comparisons)]:
        typer.echo(_terminal.one_line(text), err=json)


def _row(result: ClassResult, name: str) -> dict[str, Any]:
    from iris_sysid.report.text import with_error

    group = next(item for item in result.groups if item.name == name)
    return {
        "group": _terminal.one_line(group.name),
        result.value: "none" if group.value is None else with_error(group.value),
        "in the mean": "yes" if group.pooled else "no",
        "what is wrong": _terminal.one_line(group.cause),
    }
