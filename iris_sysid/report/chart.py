"""A chart of a page: as SVG, which needs no script and prints, and as data for the script that hovers and zooms."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np
from markupsafe import Markup

from iris_sysid.report.figures import outline
from iris_sysid.report.text import round_step
from iris_sysid.report.typeset import typeset
from iris_sysid.types import Array, Mask

WIDTH, HEIGHT = 720, 240  # of the SVG, in its own units
LEFT, RIGHT, TOP, BOTTOM = 78, 12, 12, 44  # margins for the labels
LINE = 17  # between two lines of text
LINES = 5  # lines of the grid along the height
DIGITS = 5  # of a number in the page
MARGIN = 0.05  # of the height, kept free above and below the curves
MIN_DOTS = 10  # dots in view: fewer are drawn larger, so that the legend names nothing that cannot be seen


@dataclass(frozen=True, eq=False, slots=True)
class Series:
    """One curve: ``x`` and ``y`` (n,) in the units of the axes, NaN in gaps; ``colour`` is a class of the page."""

    name: str
    x: Array
    y: Array
    colour: str
    style: Literal["dots", "line", "dashes"] = "dots"


@dataclass(frozen=True, eq=False, slots=True)
class Band:
    """A shaded band between ``lower`` and ``upper`` (n,) over ``x`` (n,); ``colour`` is a class of the page."""

    name: str
    x: Array
    lower: Array
    upper: Array
    colour: str


@dataclass(frozen=True, slots=True)
class ChartMark:
    """A ring at a point, with a text beside it; ``more`` is a second line, where there is room."""

    x: float
    y: float
    text: str
    more: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Chart:
    """Curves over one axis.

    ``title`` says in a sentence what is drawn, ``words`` what there is to see. A chart ``over_time``, in s, shows the
    frame of the clip under the pointer. ``reach`` is the part of the axis shown at first; None for all of it.
    ``shows_motion`` says that it is what was measured, rather than the residual.
    """

    name: str
    title: str
    x_label: str
    y_label: str
    series: Sequence[Series]
    bands: Sequence[Band] = ()
    marks: Sequence[ChartMark] = ()
    words: str = ""
    over_time: bool = False
    reach: tuple[float, float] | None = None
    shows_motion: bool = False

    @property
    def legend(self) -> list[tuple[str, str, str]]:
        """Name, class and style of each curve and band, each name once."""
        every = [(one.name, one.colour, one.style) for one in self.series]
        return list(dict.fromkeys([*every, *((band.name, band.colour, "band") for band in self.bands)]))

    @property
    def outside(self) -> set[str]:
        """The names of the curves that the first view lacks."""
        return {one.name for one in self.series if not _inside(one.x, self).any()}

    def has_few(self, one: Series) -> bool:
        """Whether a curve of dots has only a few in the first view."""
        return one.style == "dots" and int(np.isfinite(one.y[_inside(one.x, self)]).sum()) < MIN_DOTS

    def document(self) -> dict[str, Any]:
        """The chart for the script of the page."""
        return {
            "id": self.name,
            "labels": [typeset(self.x_label), typeset(self.y_label)],
            "overTime": self.over_time,
            "reach": self.reach,
            "series": [
                {"name": one.name, "colour": one.colour, "style": one.style, "few": self.has_few(one), "x": x, "y": y}
                for one in self.series
                for x, y in [(_numbers(one.x[shown]), _numbers(one.y[shown])) for shown in [outline(one.y)]]
            ],
            "bands": [
                {
                    "colour": band.colour,
                    "x": _numbers(band.x),
                    "lower": _numbers(band.lower),
                    "upper": _numbers(band.upper),
                }
                for band in self.bands
            ],
            "marks": [{"x": mark.x, "y": mark.y, "text": typeset(mark.text), "more": mark.more} for mark in self.marks],
        }

    def svg(self) -> Markup:
        """The chart as an SVG element, in the colours of the page's classes."""
        return Markup('<svg class="still" viewBox="0 0 {} {}" role="img" aria-label="{}">{}{}{}{}</svg>').format(
            WIDTH, HEIGHT, typeset(f"{self.title} {self.words}"), *_drawn(self)
        )


def _numbers(values: Array) -> list[float | None]:
    return [float(f"{value:.{DIGITS}g}") if math.isfinite(value) else None for value in values.tolist()]


@dataclass(frozen=True, slots=True)
class _Frame:
    """The ranges of both axes."""

    x: tuple[float, float]
    y: tuple[float, float]

    def at(self, x: Array, y: Array) -> tuple[Array, Array]:
        """Positions in the SVG."""
        across, up = (x - self.x[0]) / (self.x[1] - self.x[0]), (y - self.y[0]) / (self.y[1] - self.y[0])
        return LEFT + (WIDTH - LEFT - RIGHT) * across, HEIGHT - BOTTOM - (HEIGHT - TOP - BOTTOM) * up


def _range(parts: Sequence[Array], margin: float) -> tuple[float, float]:
    values = np.concatenate([part[np.isfinite(part)] for part in parts] or [np.zeros(0)])
    low, high = (float(values.min()), float(values.max())) if values.size else (0.0, 1.0)
    extent = high - low or abs(high) or 1.0
    return low - margin * extent, high + margin * extent


def _drawn(chart: Chart) -> tuple[Markup, Markup, Markup, Markup]:
    """Grid, bands, curves and marks."""
    tall = [part for band in chart.bands for part in (band.lower, band.upper)]
    frame = _Frame(
        chart.reach or _range([one.x[np.isfinite(one.y)] for one in chart.series], 0.01),
        _range([*(one.y[_inside(one.x, chart)] for one in chart.series), *tall], MARGIN),
    )
    join = Markup("").join
    return (
        _grid(chart, frame),
        join(_band(band, frame) for band in chart.bands),
        join(_curve(one, frame, _inside(one.x, chart), few=chart.has_few(one)) for one in chart.series),
        join(_mark(mark, frame) for mark in chart.marks),
    )


def _grid(chart: Chart, frame: _Frame) -> Markup:
    right, low = WIDTH - RIGHT, HEIGHT - BOTTOM
    parts = []
    for value in _ticks(frame.y, LINES):
        y = float(frame.at(np.zeros(1), np.array([value]))[1][0])
        parts.append(Markup('<path class="grid" d="M{} {:.1f}H{}"/>').format(LEFT, y, right))
        parts.append(_text(LEFT - 6, y + 4, typeset(f"{value:g}"), "end"))
    for value in _ticks(frame.x, 2 * LINES):
        x = float(frame.at(np.array([value]), np.zeros(1))[0][0])
        parts.append(Markup('<path class="grid" d="M{:.1f} {}V{}"/>').format(x, TOP, low))
        parts.append(_text(x, low + 18, typeset(f"{value:g}"), "middle"))
    parts.append(_text((LEFT + right) / 2, HEIGHT - 6, typeset(chart.x_label), "middle"))
    upright = Markup('<text transform="translate(14 {}) rotate(-90)" text-anchor="middle">{}</text>')
    parts.append(upright.format((TOP + low) / 2, typeset(chart.y_label)))
    return Markup("").join(parts)


def _ticks(reach: tuple[float, float], count: int) -> list[float]:
    step = round_step((reach[1] - reach[0]) / count)
    first, last = math.ceil(reach[0] / step), math.floor(reach[1] / step)
    return [float(f"{k * step:.10g}") for k in range(first, last + 1)]


def _text(x: float, y: float, text: str, anchor: str) -> Markup:
    return Markup('<text x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(x, y, anchor, text)


def _band(band: Band, frame: _Frame) -> Markup:
    x, y = frame.at(np.concatenate([band.x, band.x[::-1]]), np.concatenate([band.lower, band.upper[::-1]]))
    points = " ".join(f"{a:.1f},{b:.1f}" for a, b in zip(x, y, strict=True) if np.isfinite(a + b))
    return Markup('<polygon class="band {}" points="{}"/>').format(band.colour, points)


def _inside(x: Array, chart: Chart) -> Mask:
    return np.ones(x.size, np.bool_) if chart.reach is None else (x >= chart.reach[0]) & (x <= chart.reach[1])


def _curve(one: Series, frame: _Frame, inside: Mask, *, few: bool) -> Markup:
    """Dots are a path of lines without length, whose round ends are seen."""
    shown = outline(np.where(inside, one.y, np.nan))
    shown = shown[inside[shown]]
    x, y = frame.at(one.x[shown], one.y[shown])
    steps, pen = [], "M"
    for a, b in zip(x.tolist(), y.tolist(), strict=True):
        if not math.isfinite(a + b):
            pen = "M"
        elif one.style == "dots":
            steps.append(f"M{a:.1f} {b:.1f}h0")
        else:
            steps.append(f"{pen}{a:.1f} {b:.1f}")
            pen = "L"
    style = f"{one.style} few" if few else one.style
    return Markup('<path class="curve {} {}" d="{}"/>').format(style, one.colour, "".join(steps))


def _mark(mark: ChartMark, frame: _Frame) -> Markup:
    (x,), (y,) = frame.at(np.array([mark.x]), np.array([mark.y]))
    left = x < WIDTH / 2
    place = Markup('<circle class="mark" cx="{:.1f}" cy="{:.1f}" r="6"/>').format(x, y)
    low = min(max(y + 4, TOP + 14), HEIGHT - BOTTOM - 6 - (LINE if mark.more else 0))
    lines = [
        Markup('<text class="said" x="{:.1f}" y="{:.1f}" text-anchor="{}">{}</text>').format(
            x + (12 if left else -12), low + LINE * k, "start" if left else "end", typeset(text)
        )
        for k, text in enumerate(filter(None, (mark.text, mark.more)))
    ]
    return Markup("").join([place, *lines])
