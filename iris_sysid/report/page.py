"""The HTML page of every report: a headline, images, then sections of tables and lines."""

from __future__ import annotations

import base64
import io
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import jinja2
from matplotlib.figure import Figure

from iris_sysid.io.files import json_text
from iris_sysid.report.figures import equation_figure
from iris_sysid.report.text import as_sentence, equation_lines, interval_text, number_lines, with_error
from iris_sysid.types import Estimate, Verdict

DPI = 130


@dataclass(frozen=True, slots=True)
class PageImage:
    """A drawn figure with its description."""

    name: str
    png: bytes
    caption: str


@dataclass(frozen=True, slots=True)
class Column:
    """The head of a table's column; a column of numbers is aligned on the right."""

    title: str
    number: bool = False


def words(*titles: str) -> tuple[Column, ...]:
    """Columns of text with these heads."""
    return tuple(Column(title) for title in titles)


def numbers(*titles: str) -> tuple[Column, ...]:
    """Columns of numbers with these heads."""
    return tuple(Column(title, number=True) for title in titles)


@dataclass(frozen=True, slots=True)
class Section:
    """One part of a page: a table, lines of text, an equation.

    A ``folded`` section shows its title only, until it is opened.
    """

    title: str
    columns: Sequence[Column] = ()
    rows: Sequence[Sequence[str]] = ()
    lines: Sequence[str] = ()
    equation: str = ""
    folded: bool = False


@dataclass(frozen=True, slots=True)
class Page:
    """The content of a page, before it becomes HTML.

    ``headline`` says the result in a sentence, ``statements`` say more, a line each. ``first`` are images and sections
    that come before the other ``images`` and ``sections``; the verdict is then below the sentences.
    """

    title: str
    headline: str
    summary: str
    images: Sequence[PageImage]
    sections: Sequence[Section]
    origin: Mapping[str, Any]
    notes: Sequence[str] = field(default=())
    verdict: Verdict | None = None
    statements: Sequence[str] = field(default=())
    first: Sequence[PageImage | Section] = field(default=())

    @property
    def every_image(self) -> list[PageImage]:
        """The images in the order of the page."""
        return [*(item for item in self.first if isinstance(item, PageImage)), *self.images]


def png_of(figure: Figure) -> bytes:
    """Draw a figure as PNG bytes, the same bytes for the same figure."""
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI, metadata={"Software": None})
    return buffer.getvalue()


def html_of(page: Page) -> str:
    """The page as one HTML file that needs no other; every text in it is escaped."""
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("iris_sysid", "report"),
        autoescape=True,
        trim_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    first = [_image(item) if isinstance(item, PageImage) else _section(item) for item in page.first]
    return environment.get_template("page.html").render(
        title=page.title,
        headline=page.headline,
        summary=as_sentence(page.summary),
        notes=page.notes,
        verdict=[] if page.verdict is None else _verdict(page.verdict),
        statements=page.statements,
        first=first,
        images=[_image(image) for image in page.images],
        sections=[_section(section) for section in page.sections],
        origin=json_text(dict(page.origin)),
    )


def _image(image: PageImage) -> dict[str, Any]:
    return {"png": _base64(image.png), "caption": image.caption}


def _verdict(verdict: Verdict) -> list[dict[str, Any]]:
    """The lines of a verdict; each says whether it is a warning."""
    numbers_of = [{"text": line, "warn": not verdict.good} for line in number_lines(verdict)]
    return [*numbers_of, *({"text": line, "warn": not verdict.complete} for line in equation_lines(verdict))]


def _section(section: Section) -> dict[str, Any]:
    equation = _base64(png_of(equation_figure(section.equation))) if section.equation else ""
    return {
        "title": section.title,
        "columns": section.columns,
        "rows": section.rows,
        "lines": section.lines,
        "equation": equation,
        "equation_text": section.equation,
        "folded": section.folded,
    }


def _base64(png: bytes) -> str:
    return base64.b64encode(png).decode("ascii")


def estimates_section(title: str, estimates: Mapping[str, Estimate], equation: str = "") -> Section:
    """A table of estimates by name: value and standard error, 95 % interval, kind and source.

    Parameters
    ----------
    title
        Heading of the section.
    estimates
        By name, in the order of the rows.
    equation
        LaTeX math of the equation they belong to.
    """
    rows = [
        (
            name,
            with_error(estimate),
            interval_text(estimate),
            estimate.measurement_type,
            estimate.source,
        )
        for name, estimate in estimates.items()
    ]
    columns = (*words("quantity"), *numbers("value ± standard error", "95 % interval"), *words("kind", "source"))
    return Section(title, columns, rows, equation=equation)
