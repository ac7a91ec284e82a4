"""The parts of a residual, drawn: what share each has, and the largest ones over what they depend on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure, SubFigure
from matplotlib.patches import Patch

from iris_sysid.report.component_colours import NOISE_COLOUR, SHADES, SIDE_COLOURS, shades_of
from iris_sysid.report.diagnosis_text import share_text, size_text
from iris_sysid.report.text import percent
from iris_sysid.types import KIND_NAMES, Component, ComponentCurve, ComponentKind, Components, ComponentSide

Colour = tuple[float, float, float]  # red, green, blue from 0 to 1
NOISE = to_rgb(NOISE_COLOUR)
MAX_CURVES = 2
WIDTH_IN, HEIGHT_IN, LINE_IN = 9.0, 2.4, 0.22
BAR_LINES = 1.5  # height of a bar in lines of its legend
AXES: dict[ComponentSide, str] = {
    "force": "force",
    "reading": "reading",
    "clock": "error of the time",
    "input": "input",
}
FORCES = {"m/s^2": "force per mass", "rad/s^2": "angular acceleration"}  # in a unit that is not one of force


def component_figure(components: Components, remaining: Components | None = None) -> Figure:
    """The shares of a residual as a bar (left), the largest parts over what they depend on (right).

    ``remaining`` are those of the residual with effects: a second bar, as long as its variance is of the first.
    """
    drawn = [part for part in components.parts if part.curve is not None][:MAX_CURVES]
    lines = len(components.parts) + 1 + (len(remaining.parts) + 2 if remaining is not None else 0)
    height = max(HEIGHT_IN * max(len(drawn), 1), 1.6 + LINE_IN * lines)
    figure = Figure(figsize=(WIDTH_IN, height), layout="constrained")
    colours = part_colours(components.parts)
    if not drawn:
        _draw_bars(figure, components, remaining, colours)
        return figure
    left, right = np.array(figure.subfigures(1, 2, width_ratios=(1.0, 1.15)), dtype=object)
    _draw_bars(left, components, remaining, colours)
    for axes, part in zip(right.subplots(len(drawn), 1, squeeze=False)[:, 0], drawn, strict=True):
        _draw_curve(axes, part, colours[part.kind])
    return figure


def component_caption(components: Components, *, added: bool) -> str:
    """What the figure shows, in words; ``added`` where a second bar shows the residual with effects."""
    bars = "shares of its variance" + (", without and with the added effects" if added else "")
    curves = [part for part in components.parts if part.curve is not None][:MAX_CURVES]
    over = "; right: the largest parts over what they depend on, with their 95 % band" if curves else ""
    imitated = "; what the fitted values can imitate is left out" if curves else ""
    return f"Parts of the residual: {bars}{over}{imitated}"


def part_colours(parts: Sequence[Component]) -> dict[ComponentKind, Colour]:
    """A colour for each kind: that of its side, lighter for each further part of the same side."""
    colours: dict[ComponentKind, Colour] = {}
    for part, shade in zip(parts, shades_of([part.side for part in parts]), strict=True):
        base, opacity = np.array(to_rgb(SIDE_COLOURS[part.side][0])), SHADES[shade]
        red, green, blue = 1 - opacity * (1 - base)  # on white
        colours[part.kind] = (float(red), float(green), float(blue))
    return colours


def axis_titles(side: ComponentSide, curve: ComponentCurve) -> tuple[str, str]:
    """What a part depends on, and what its curve gives, in the words of the axes, without units."""
    name, unit = curve.argument.name.replace("_", " "), curve.argument.unit
    if unit == "s":
        along = "time"
    elif name.endswith(" rate"):
        along = f"{'angular velocity' if unit.startswith('rad') else 'velocity'} of {name.removesuffix(' rate')}"
    else:
        along = name
    units = {quantity.unit for quantity in curve.quantities}
    return along, FORCES.get(units.pop(), AXES[side]) if side == "force" and len(units) == 1 else AXES[side]


def _draw_bars(
    figure: Figure | SubFigure,
    components: Components,
    remaining: Components | None,
    colours: dict[ComponentKind, Colour],
) -> None:
    """One bar, or two below each other, each with the legend of its parts."""
    bars = [("residual", components, 1.0)]
    if remaining is not None:
        scale = (
            min((remaining.residual_rms / components.residual_rms) ** 2, 1.0) if components.residual_rms > 0 else 1.0
        )
        bars = [("without effects", components, 1.0), ("with the added effects", remaining, scale)]
    ratios = [len(one.parts) + 1 + BAR_LINES for _, one, _ in bars]
    rows = figure.subplots(len(bars), 1, squeeze=False, height_ratios=ratios)[:, 0]
    for axes, (name, one, scale) in zip(rows, bars, strict=True):
        _draw_bar(axes, one, scale, {**part_colours(one.parts), **colours})
        axes.set_title(f"{name}: {size_text(one.residual_rms, one.unit)} rms", loc="left", fontsize=10)


def _draw_bar(axes: Axes, components: Components, scale: float, colours: dict[ComponentKind, Colour]) -> None:
    """One stacked bar; its legend, below it, has the share of each part with its range."""
    start, handles = 0.0, []
    segments = [
        (part.share, colours[part.kind], f"{share_text(part)} {KIND_NAMES[part.kind]}") for part in components.parts
    ]
    segments.append((components.noise_share, NOISE, f"{percent(components.noise_share)} noise"))
    for share, colour, label in segments:
        width = 100 * scale * max(share, 0.0)
        axes.barh(0.5, width, left=start, color=colour, height=1.0, edgecolor="white", linewidth=0.8)
        if width >= 8:  # narrower ones have no room for a number
            dark = colour != NOISE and sum(colour) < 1.9
            ink = "white" if dark else "black"
            axes.text(start + width / 2, 0.5, percent(share), ha="center", va="center", color=ink)
        start += width
        handles.append(Patch(color=colour, label=label))
    below = len(segments) / BAR_LINES  # room for the legend, in heights of the bar
    axes.set(xlim=(0, 100), ylim=(-below, 1), yticks=[], xticks=[])
    axes.spines[:].set_visible(False)
    place = (0, below / (1 + below))
    axes.legend(handles=handles, loc="upper left", bbox_to_anchor=place, frameon=False, borderaxespad=0.3)


def _draw_curve(axes: Axes, part: Component, colour: Colour) -> None:
    """One part over its own argument with its 95 % band; quantities after the first are dashed."""
    assert part.curve is not None
    curve = part.curve
    order, (lower, upper) = np.argsort(curve.at), curve.band
    axes.axhline(0, color="#888888", linewidth=0.6)
    for k, quantity in enumerate(curve.quantities):
        axes.fill_between(curve.at[order], lower[order, k], upper[order, k], color=colour, alpha=0.25, linewidth=0)
        style = "-" if k == 0 else "--"
        name = quantity.name if len(curve.quantities) > 1 else "estimate, 95 % band"
        axes.plot(curve.at[order], curve.values[order, k], style, color=colour, linewidth=1.4, label=name)
    if part.at is not None and curve.argument.unit == part.at.unit:
        axes.axvline(part.at.value, color="#888888", linewidth=0.8, linestyle=":")
    axes.margins(x=0.01)
    units = ", ".join(dict.fromkeys(quantity.unit for quantity in curve.quantities))
    along, up = axis_titles(part.side, curve)
    axes.set(xlabel=f"{along} ({curve.argument.unit})", ylabel=f"{up} ({units})")
    axes.set_title(f"{KIND_NAMES[part.kind]}, {share_text(part)}", loc="left", fontsize=10)
    if len(curve.quantities) > 1:
        axes.legend(frameon=False, fontsize=9)
