"""The page of a class: the value of all, the groups to look at with the cause, one picture, one table."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any
from urllib.parse import quote

import jinja2

from iris_sysid.classroom.picture import PHONE_IN, class_figure, svg_of
from iris_sysid.classroom.summary import ClassResult, GroupResult, shown_name
from iris_sysid.io.files import write_atomic
from iris_sysid.report.text import as_sentence, interval_text, shown_unit, two_digits, with_error
from iris_sysid.report.typeset import typeset
from iris_sysid.types import SPOKEN, Estimate, Population

NOTHING: Mapping[str, str] = MappingProxyType({})
FAR = 100.0  # standard errors, beyond which decimals say nothing
CAPTION = (
    "The value of each group with its 95 % interval. Orange squares are groups to look at; an open square is left out "
    "of the mean, and an arrow stands for a value beyond the edge."
)


def write_page(
    result: ClassResult,
    title: str,
    path: str | Path,
    *,
    reviews: Mapping[str, str] = NOTHING,
    overwrite: bool = False,
) -> Path:
    """Write the page of a class as one HTML file that needs no other.

    Parameters
    ----------
    result
        The class.
    title
        Of the page.
    path
        File to write.
    reviews
        By name of a group, the command that opens its track in the browser to be corrected.
    overwrite
        Replace a file that exists.

    Raises
    ------
    OutputError
        When the file exists or cannot be written.
    """
    return write_atomic(path, page_text(result, title, reviews), overwrite=overwrite)


def page_text(
    result: ClassResult,
    title: str,
    reviews: Mapping[str, str] = NOTHING,
    served: Mapping[str, str] | None = None,
) -> str:
    """The page as HTML; every text in it is escaped.

    Parameters
    ----------
    result, title, reviews
        As of :func:`write_page`.
    served
        By name of a group, the address of its review, where the page is served; links then lead there and nowhere else.
    """
    every = [*result.groups, *([] if result.teacher is None else [result.teacher])]
    pages = {group.name: _page_of(group) for group in every} if served is None else served
    environment = jinja2.Environment(
        loader=jinja2.PackageLoader("iris_sysid.classroom", "templates"),
        autoescape=True,
        trim_blocks=True,
        lstrip_blocks=True,
        undefined=jinja2.StrictUndefined,
    )
    others = list(result.others)
    return environment.get_template("class.html").render(
        title=title,
        headline=typeset(as_sentence(result.sentence)),
        comparisons=[typeset(as_sentence(item.text)) for item in result.comparisons],
        named=[_named(group, pages, reviews) for group in result.named],
        served=served is not None,
        picture=svg_of(class_figure(result)),
        narrow=svg_of(class_figure(result, PHONE_IN)),
        caption=CAPTION,
        columns=_columns(result, others),
        rows=[_row(group, others, pages) for group in result.groups],
        teacher=None if result.teacher is None else _row(result.teacher, others, pages),
        means=_means(result),
        value=shown_name(result.value),
        model=as_sentence(result.model.summary),
    )


def _named(group: GroupResult, pages: Mapping[str, str], reviews: Mapping[str, str]) -> dict[str, str]:
    page, review = pages.get(group.name, ""), reviews.get(group.name, "")
    return {"name": group.name, "cause": typeset(group.cause), "page": page, "review": review}


def _page_of(group: GroupResult) -> str:
    """The address of a group's page beside this one; empty for a group without a page."""
    return quote(group.page) if group.document.usable else ""


def _columns(result: ClassResult, others: Sequence[str]) -> list[dict[str, Any]]:
    further = [{"title": shown_name(name), "number": True} for name in others]
    return [
        {"title": "group", "number": False},
        {"title": shown_name(result.value), "number": True},
        {"title": "deviation (standard errors)", "number": True},
        {"title": "what is wrong", "number": False},
        {"title": "numbers", "number": False},
        *further,
        {"title": "file", "number": False},
    ]


def _row(group: GroupResult, others: Sequence[str], pages: Mapping[str, str]) -> dict[str, Any]:
    verdict = group.document.verdict
    word = "" if verdict is None else SPOKEN[verdict.word]
    distance = typeset(f"{group.in_errors:+z.{0 if abs(group.in_errors) > FAR else 1}f}")
    cells = [
        {"text": group.name, "key": group.name, "link": pages.get(group.name, "")},
        _number(group.value),
        {"text": distance if math.isfinite(group.in_errors) else "", "key": _key(group.in_errors), "link": ""},
        {"text": typeset(group.cause), "key": group.cause or "~", "link": ""},
        {"text": word, "key": word, "link": ""},
        *(_number(group.document.estimate(name)) for name in others),
        {"text": group.document.source, "key": group.document.source, "link": ""},
    ]
    return {"named": group.named, "cells": cells}


def _number(estimate: Estimate | None) -> dict[str, str]:
    if estimate is None:
        return {"text": "none", "key": "", "link": ""}
    return {"text": typeset(with_error(estimate)), "key": _key(estimate.value), "link": ""}


def _key(value: float) -> str:
    """A number to sort by; empty for one that is not known, which comes last."""
    return repr(value) if math.isfinite(value) else ""


def _means(result: ClassResult) -> list[Mapping[str, str]]:
    rows = [(shown_name(result.value), "without outliers", result.pooled)]
    if any(group.outlying for group in result.groups):
        rows.append((shown_name(result.value), "with outliers", result.every))
    rows += [(shown_name(name), "without outliers", population) for name, population in result.others.items()]
    return [
        {"name": name, "of": of, **_population(population)} for name, of, population in rows if population is not None
    ]


def _population(population: Population) -> dict[str, str]:
    unit, factor = shown_unit(population.mean.unit)
    scatter = factor * population.between.value
    between = f"{two_digits(scatter)} {unit}".strip() if scatter > 0 else "none seen"
    return {
        "mean": typeset(with_error(population.mean)),
        "interval": typeset(interval_text(population.mean)),
        "between": between,
        "within": f"{two_digits(factor * population.within)} {unit}".strip(),
    }
