"""The HTML page of every report: the answer first, then the picture and the charts; tables last, folded."""

from __future__ import annotations

import base64
import hashlib
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from itertools import accumulate
from typing import Any

import jinja2
import matplotlib as mpl
from markupsafe import Markup
from matplotlib.figure import Figure

from iris_sysid.io.files import json_text
from iris_sysid.report.chart import Chart
from iris_sysid.report.component_colours import colour_style
from iris_sysid.report.figures import equation_figure
from iris_sysid.report.film import Film, base64_of
from iris_sysid.report.glossary import TERMS, terms_in
from iris_sysid.report.text import (
    as_sentence,
    equation_lines,
    interval_text,
    number_and_unit,
    number_lines,
    shown_estimates,
    table_names,
    with_error,
)
from iris_sysid.report.typeset import symbol_html, typeset
from iris_sysid.types import Estimate, FitResult, OdeModel, Verdict

DPI = 130
THINNEST = 0.4  # percent of a bar: a part of it is seen
ASSETS = files("iris_sysid") / "report" / "assets"


@dataclass(frozen=True, slots=True)
class PageImage:
    """A drawn figure with its description: a PNG file beside the page."""

    name: str
    png: bytes
    caption: str


@dataclass(frozen=True, slots=True)
class PageColumn:
    """The head of a table's column; a column of numbers is aligned on the right."""

    title: str
    number: bool = False

    @property
    def meaning(self) -> str:
        """What the head means, where it is a term."""
        return next(iter(terms_in(self.title).values()), "")


def words(*titles: str) -> tuple[PageColumn, ...]:
    """Columns of text with these heads."""
    return tuple(PageColumn(title) for title in titles)


def numbers(*titles: str) -> tuple[PageColumn, ...]:
    """Columns of numbers with these heads."""
    return tuple(PageColumn(title, number=True) for title in titles)


@dataclass(frozen=True, slots=True)
class Section:
    """A folded part of a page: a table, lines of text, an equation, a figure.

    ``more`` are rows that are out of sight until the reader opens them.
    """

    title: str
    columns: Sequence[PageColumn] = ()
    rows: Sequence[Sequence[str]] = ()
    lines: Sequence[str] = ()
    equation: str = ""
    more: Sequence[Sequence[str]] = ()
    image: PageImage | None = None


@dataclass(frozen=True, slots=True)
class KeyValue:
    """A number that a person came for, with its name and LaTeX symbol."""

    name: str
    symbol: str
    estimate: Estimate

    @property
    def number(self) -> str:
        """Value and standard error."""
        return number_and_unit(self.estimate)[0]

    @property
    def unit(self) -> str:
        """Its unit; empty where it has none, or the value is not determined."""
        return number_and_unit(self.estimate)[1]

    @property
    def interval(self) -> str:
        """Its 95 % interval; empty where there is none."""
        return interval_text(self.estimate)


@dataclass(frozen=True, slots=True)
class Bar:
    """A residual as a bar of its parts: name, percent of the whole and class of the colour of each."""

    title: str
    parts: Sequence[tuple[str, float, str]]

    @property
    def drawn(self) -> list[tuple[str, float, float]]:
        """Class of the colour, begin and width of each part, percent of the bar; a small one is widened to be seen."""
        widths = [max(percent, THINNEST) for _, percent, _ in self.parts]
        begins = (end - width for end, width in zip(accumulate(widths), widths, strict=True))
        return [
            (colour, round(begin, 2), round(width, 2))
            for (_, _, colour), begin, width in zip(self.parts, begins, widths, strict=True)
        ]


@dataclass(frozen=True, slots=True)
class Page:
    """The content of a page, before it becomes HTML.

    ``headline`` says the result in a sentence, ``values`` are the numbers beside it; ``statements``, ``bars`` and
    ``charts`` say what the residual is made of. ``sections`` are folded, and come last. ``warnings`` are there only
    where something is wrong. ``images`` become files beside the page.
    """

    title: str
    headline: str
    summary: str
    origin: Mapping[str, Any]
    values: Sequence[KeyValue] = ()
    verdict: Verdict | None = None
    warnings: Sequence[str] = ()
    film: Film | None = None
    statements: Sequence[str] = ()
    bars: Sequence[Bar] = ()
    charts: Sequence[Chart] = ()
    sections: Sequence[Section] = ()
    images: Sequence[PageImage] = field(default=())

    @property
    def picture(self) -> Chart | None:
        """The chart beside the answer, where there is no clip: the motion."""
        motions = (chart for chart in self.charts if chart.shows_motion)
        return None if self.film is not None else next(motions, None)

    @property
    def further_charts(self) -> list[Chart]:
        """The charts below."""
        return [chart for chart in self.charts if chart is not self.picture]


def png_of(figure: Figure, dpi: float = DPI) -> bytes:
    """Draw a figure as PNG bytes with ``dpi`` dots an inch, the same bytes for the same figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=dpi, metadata={"Software": None})
    return buffer.getvalue()


@cache
def _equation_svg(equation: str) -> str:
    """An equation as an SVG without a background, as base64; the same bytes for the same equation."""
    buffer = io.BytesIO()
    with mpl.rc_context({"svg.hashsalt": "equation"}):
        equation_figure(equation).savefig(
            buffer, format="svg", transparent=True, bbox_inches="tight", pad_inches=0.02, metadata={"Date": None}
        )
    return base64_of(buffer.getvalue())


def html_of(page: Page) -> str:
    """The page as one HTML file that needs no other: every text in it is escaped, and only our own script may run."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("iris_sysid", "report"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    environment.filters |= {"typeset": typeset, "symbol": symbol_html, "sentence": as_sentence, "base64": base64_of}
    environment.globals["equation_svg"] = _equation_svg
    style = _asset("uplot/uPlot.min.css") + _asset("page.css") + colour_style()
    script = f"/*\n{_asset('uplot/LICENSE').strip()}\n*/\n{_asset('uplot/uPlot.iife.min.js')}\n{_asset('page.js')}"
    template = environment.get_template("page.html")
    content = {
        "page": page,
        "verdict": [] if page.verdict is None else _verdict(page.verdict),
        "origin": json_text(dict(page.origin)),
        "data": _data(page),
        "style": Markup(style),
        "script": Markup(script),
        "policy": f"default-src 'none'; img-src data:; style-src {_hash(style)}; script-src {_hash(script)}; "
        "base-uri 'none'; form-action 'none'",
    }
    html = template.render(**content, terms={})
    text = jinja2.filters.do_striptags(html.partition("<main>")[2].partition("<script")[0])
    return template.render(**content, terms=terms_in(text) or TERMS)


def _asset(name: str) -> str:
    return ASSETS.joinpath(*name.split("/")).read_text(encoding="utf-8")


def _hash(text: str) -> str:
    """The source of a Content Security Policy that allows this text and no other."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"


def _data(page: Page) -> Markup:
    """Charts and film as JSON that no text in it can end."""
    content = {"charts": [chart.document() for chart in page.charts], "film": page.film and page.film.document()}
    text = json.dumps(content, ensure_ascii=True, separators=(",", ":"), allow_nan=False)
    return Markup(text.replace("<", "\\u003c").replace(">", "\\u003e").replace("&", "\\u0026"))


def _verdict(verdict: Verdict) -> list[dict[str, Any]]:
    """Both axes: the question, the lines of the answer, and the class of the colour."""
    axes = [{"question": "Can the number be used?", "lines": number_lines(verdict), "class": verdict.word}]
    if verdict.equation is not None:
        colour = "good" if verdict.complete else "incomplete"
        axes.append({"question": "Is the equation complete?", "lines": equation_lines(verdict), "class": colour})
    return axes


def symbols_of(model: OdeModel) -> dict[str, str]:
    """The LaTeX symbol of each parameter, initial value, derived and observed quantity of a model, by name."""
    states = {
        name: f"{state.symbol}(0)" if state.symbol else ""
        for name, state in zip(model.initial_names, model.states, strict=True)
    }
    quantities = {quantity.name: quantity.symbol for quantity in (*model.derived, *model.observed)}
    return quantities | states | {parameter.name: parameter.symbol for parameter in model.parameters}


def estimates_section(
    title: str,
    estimates: Mapping[str, Estimate],
    equation: str = "",
    *,
    symbols: Mapping[str, str] | None = None,
    main: Sequence[str] | None = None,
) -> Section:
    """A table of estimates by name: value and standard error, 95 % interval, kind and source.

    Parameters
    ----------
    title
        Heading of the section.
    estimates
        By name, in the order of the rows.
    equation
        LaTeX math of the equation they belong to.
    symbols
        LaTeX symbol by name.
    main
        Names to show; the others are out of sight until the reader opens them. None shows all.
    """
    rows = {
        name: (
            name,
            (symbols or {}).get(name, ""),
            with_error(estimate),
            interval_text(estimate),
            estimate.measurement_type,
            estimate.source,
        )
        for name, estimate in estimates.items()
    }
    columns = (
        *words("quantity", SYMBOL),
        *numbers("value ± standard error", "95 % interval"),
        *words("kind", "source"),
    )
    shown = [row for name, row in rows.items() if main is None or name in main]
    rest = [row for name, row in rows.items() if main is not None and name not in main]
    return Section(title, columns, shown, equation=equation, more=rest)


def fit_section(title: str, fit: FitResult) -> Section:
    """The table of a ``fit``: its equation, the values that a person came for, and the others when asked for."""
    return estimates_section(
        title, shown_estimates(fit), fit.model.equation, symbols=symbols_of(fit.model), main=table_names(fit)
    )


SYMBOL = "symbol"  # the column whose cells are LaTeX
