"""Results as HTML for a notebook: a line of text, a picture, and a table of numbers; all text is escaped."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from html import escape
from typing import Any

from matplotlib.figure import Figure

from fitters.ode.prediction import Prediction
from iris_sysid.diagnosis.planning.plan import Plan
from iris_sysid.report.component_figure import component_figure
from iris_sysid.report.diagnosis_text import diagnosis_sentences
from iris_sysid.report.film import base64_of
from iris_sysid.report.page import png_of
from iris_sysid.report.plan_text import advice, plan_rows
from iris_sysid.report.plots import Result, figure_of
from iris_sysid.report.text import (
    discovery_sentence,
    interval_text,
    shown_estimates,
    verdict_lines,
    with_error,
)
from iris_sysid.types import Diagnosis, Discovery, Estimate, FitResult, Run, Track, Trajectory, Verdict

DPI = 72
MAX_ROWS = 12  # of a prediction; the picture shows them all
VALUE_COLUMNS = ("", "value ± standard error", "95 % interval")

Table = tuple[Sequence[str], Sequence[Sequence[str]]]  # head, rows


def to_html(result: Result) -> str:
    """Show a result as a piece of HTML, as notebooks do: a line of text, the picture of :func:`plot`, a table.

    Parameters
    ----------
    result
        A trajectory, its smoothed state, a track, a fit, a prediction, a diagnosis, a plan, a discovery, or the run
        of a clip.

    Returns
    -------
    str
        HTML that needs no other file; names and texts in it are escaped.

    Raises
    ------
    DataError
        When there is no picture of such an object.
    """
    first, *lines = _lines(result)
    text = "".join(f"<div>{escape(line)}</div>" for line in lines)
    pictures = "".join(_picture(figure, type(result).__name__) for figure in _figures(result))
    return f"<div><b>{escape(first)}</b>{text}{pictures}{_table(*_rows(result))}</div>"


def _figures(result: Result) -> list[Figure]:
    """The picture of :func:`plot`; before it, of a diagnosis, the parts of the residual."""
    if isinstance(result, Diagnosis) and result.components is not None and result.components.parts:
        remaining = result.remaining if result.added else None
        return [component_figure(result.components, remaining), figure_of(result)]
    return [figure_of(result)]


def _picture(figure: Figure, name: str) -> str:
    return f'<img alt="{escape(name)}" src="data:image/png;base64,{base64_of(png_of(figure, DPI))}">'


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    if not rows:
        return ""
    cells = "".join(f"<th>{escape(title)}</th>" for title in head)
    body = "".join(f"<tr>{''.join(f'<td>{escape(cell)}</td>' for cell in row)}</tr>" for row in rows)
    return f"<table><thead><tr>{cells}</tr></thead><tbody>{body}</tbody></table>"


def _values(estimates: Mapping[str, Estimate]) -> Table:
    rows = [(name, with_error(estimate), interval_text(estimate)) for name, estimate in estimates.items()]
    return VALUE_COLUMNS, rows


def _judged(title: str, verdict: Verdict, *lines: str) -> list[str]:
    return [title, *verdict_lines(verdict), *lines]


# --------------------------------------------------------------------------- lines


@functools.singledispatch
def _lines(result: Any) -> list[str]:
    return repr(result).splitlines()


@_lines.register
def _(result: FitResult) -> list[str]:
    return _judged(f"Fit of {result.model.name}: {result.n} of {result.used.size} samples", result.verdict)


@_lines.register
def _(result: Plan) -> list[str]:
    names = ", ".join(f"{name} ({100 * share:.0f} %)" for name, share in result.probabilities.items())
    return ["What to film next", *([f"In question: {names}"] if len(result.probabilities) > 1 else []), *advice(result)]


_lines.register(
    Diagnosis,
    lambda it: [f"Diagnosis of {it.base.model.name}", *diagnosis_sentences(it), *verdict_lines(it.verdict)],
)
_lines.register(Discovery, lambda it: _judged("Discovery", it.verdict, discovery_sentence(it)))
_lines.register(Run, lambda it: [f"{it.source.name}: {it.phenomenon.name}", *_lines(it.fit), *it.notes])


# --------------------------------------------------------------------------- rows


@functools.singledispatch
def _rows(result: Any) -> Table:
    return (), ()


@_rows.register
def _(result: Track) -> Table:
    doubts = result.quality.doubts if result.quality is not None else ()
    return ("doubt", "what to do"), [(doubt.finding, doubt.remedy) for doubt in doubts]


@_rows.register
def _(result: Prediction) -> Table:
    quantities = result.fitted.model.observed
    head = ["time (s)", *(quantity.name for quantity in quantities)]
    units = [quantity.unit for quantity in quantities]
    rows = [
        [f"{t_s:g}", *map(with_error, map(Estimate, result.observed[k], result.stderr[k], units))]
        for k, t_s in enumerate(result.t_s[:MAX_ROWS])
    ]
    return head, rows


@_rows.register
def _(result: Plan) -> Table:
    rows = plan_rows(result)
    return tuple(rows[0]), [tuple(row.values()) for row in rows]


_rows.register(Trajectory, lambda it: _values(it.geometry))
_rows.register(FitResult, lambda it: _values(shown_estimates(it)) if it.usable else ((), ()))
_rows.register(Diagnosis, lambda it: _values({name: size for name, size in it.sizes.items() if size.stderr > 0}))
_rows.register(Discovery, lambda it: _values({f"{one.equation}: {one.term}": one.coefficient for one in it.selected}))
_rows.register(Run, lambda it: _rows(it.fit))
