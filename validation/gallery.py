"""The gallery of the docs: a page of all models and one of all effects, written from the registry alone."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from fitters.compose_effects import with_effect
from fitters.ode import simulate
from iris_sysid.errors import DataError
from iris_sysid.io.files import write_atomic
from iris_sysid.registry import EFFECTS, MODELS
from iris_sysid.report.typeset import typeset
from iris_sysid.types import Array, ComponentKind, Effect, OdeModel, Parameter, Quantity

# Okabe and Ito (2008): the three of their colours that are 3 times lighter or darker than white paper and a dark page.
LINES = ("#0072B2", "#D55E00", "#009E73")
INK = "#808080"  # of axes, and of what is compared with: 4 times from white and from a dark page
WIDTH_IN, HEIGHT_IN, LOW_IN = 6.6, 2.2, 1.0
MAX_POINTS = 400  # of a curve
STYLE: dict[Any, Any] = {
    **dict.fromkeys(("text.color", "axes.labelcolor", "axes.edgecolor", "xtick.color", "ytick.color"), INK),
    "svg.hashsalt": "iris-sysid",
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "legend.labelcolor": INK,
}
KINDS: dict[ComponentKind, str] = {
    "force-of-velocity": "Forces that depend on the velocity",
    "force-of-position": "Forces that depend on the position",
    "force-of-time": "Forces that depend on time",
    "own-force-drift": "Changes of the model's own force",
    "pulse": "Blows",
    "periodic-force": "Periodic forces",
    "zero-wander": "Slow changes of the zero",
    "reading-of-position": "Errors of the reading that depend on the position",
    "reading-of-velocity": "Errors of the reading that depend on the velocity",
    "clock": "Errors of the clock",
    "input": "Errors of a measured input",
}


def write_gallery(folder: str | Path) -> list[Path]:
    """Write ``models.md``, ``effects.md`` and a figure for each registered item.

    Parameters
    ----------
    folder
        Gets the pages, and ``figures/``.

    Returns
    -------
    list of Path
        The pages.
    """
    folder = Path(folder)
    (folder / "figures").mkdir(parents=True, exist_ok=True)
    pages = {
        "models.md": models_page(MODELS.values()),
        "effects.md": effects_page(EFFECTS.values()),
    }
    for model in MODELS.values():
        save(model_figure(model), figure_path(folder, model))
    for effect in EFFECTS.values():
        save(effect_figure(effect), figure_path(folder, effect))
    for name, text in pages.items():
        write_atomic(folder / name, text, overwrite=True)
    return [folder / name for name in pages]


def figure_path(folder: Path, item: OdeModel | Effect) -> Path:
    """Where the figure of an item goes."""
    return folder / "figures" / f"{item.name}.svg"


def save(figure: Figure, path: Path) -> None:
    """Write a figure as SVG on a transparent ground, the same bytes every time."""
    with mpl.rc_context({"svg.hashsalt": STYLE["svg.hashsalt"]}):
        figure.savefig(path, transparent=True, metadata={"Date": None})


# --------------------------------------------------------------------------- pages


def models_page(models: Iterable[OdeModel]) -> str:
    """The page of all models, in Markdown with LaTeX."""
    sections = [_model_section(model) for model in models]
    head = "# Models\n\nThe governing equations that `fit --model` knows. Each curve is the example of the model.\n"
    return "\n".join([head, *sections])


def effects_page(effects: Iterable[Effect]) -> str:
    """The page of all effects, by the part of a residual that they are."""
    head = (
        "# Effects\n\nWhat `diagnose` looks for. Grey: the model without the effect; orange: with it; below, the "
        "difference. $x$ is what is observed, $\\ddot x_0$ the model's own acceleration.\n"
    )
    parts = [head]
    by_kind: dict[ComponentKind | None, list[Effect]] = {}
    for effect in effects:
        by_kind.setdefault(effect.component, []).append(effect)
    for kind, title in KINDS.items():
        if kind in by_kind:
            parts += [f"## {title}\n", *(_effect_section(effect) for effect in by_kind.pop(kind))]
    if by_kind:
        parts += ["## Others\n", *(_effect_section(effect) for others in by_kind.values() for effect in others)]
    return "\n".join(parts)


def _model_section(model: OdeModel) -> str:
    states = ", ".join(f"${state.symbol or state.name}$ ({_unit(state.unit)})" for state in model.states)
    facts = [
        ("State", states),
        ("Values one meets", typeset(model.typical)),
        ("Source", model.source),
        ("In Python", f'`MODELS["{model.name}"]`'),
    ]
    return _section("##", model, f"example of {model.name}", facts)


def _effect_section(effect: Effect) -> str:
    facts = [
        ("Sizes one meets", typeset(effect.typical)),
        ("Easily confused with", effect.alike),
        ("Cause", effect.cause),
        ("Source", effect.source),
        ("In Python", f'`EFFECTS["{effect.name}"]`'),
    ]
    example = effect.example
    assert example is not None
    size = f"{effect.parameters[0].name} = {example.size:g}"
    return _section("###", effect, f"{example.model} without the effect and with {size}", facts)


def _section(level: str, item: OdeModel | Effect, caption: str, facts: Sequence[tuple[str, str]]) -> str:
    lines = [f"{level} {item.name}", "", f"{item.summary[0].upper()}{item.summary[1:]}.", ""]
    lines += [
        "$$",
        item.equation,
        "$$",
        "",
        f"![{caption}](figures/{item.name}.svg)",
        "",
        f"*{caption[0].upper()}{caption[1:]}*",
        "",
    ]
    lines += ["| symbol | parameter | unit | |", "|---|---|---|---|"]
    lines += [_parameter_row(parameter) for parameter in item.parameters]
    lines += ["", *(f"- **{name}**: {text}" for name, text in facts if text), ""]
    return "\n".join(lines)


def _parameter_row(parameter: Parameter) -> str:
    kind = {
        "location": "where or when it acts",
        "moment": "when it acts",
        "shape": "a scale of the motion",
        "form": "held unless the data call for another",
    }
    note = kind.get(parameter.role) or ("constant" if parameter.constant else "")
    if parameter.constant and parameter.source:
        note = f"{note}: {parameter.source}"
    return f"| ${parameter.symbol}$ | `{parameter.name}` | {_unit(parameter.unit)} | {note} |"


def _unit(unit: str) -> str:
    """A unit as text, where ``[x]`` is the unit of what is observed; 1 of a pure number."""
    return typeset(unit.replace("{x}", "[x]"))


# --------------------------------------------------------------------------- figures


def model_figure(model: OdeModel) -> Figure:
    """What the model observes, over time, in the motion of its example: one axes for each unit."""
    times, observed = _motion(model, {})
    units = list(dict.fromkeys(quantity.unit for quantity in model.observed))
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN), layout="constrained")
        rows = figure.subplots(len(units), 1, sharex=True, squeeze=False)[:, 0]
        for axes, unit in zip(rows, units, strict=True):
            columns = [k for k, quantity in enumerate(model.observed) if quantity.unit == unit]
            for line, k in enumerate(columns):
                axes.plot(times, observed[:, k], color=LINES[line % len(LINES)], label=_label(model.observed[k]))
            _finish(
                axes,
                ", ".join(_label(model.observed[k]) for k in columns) + f" ({typeset(unit)})",
                legend=len(columns) > 1,
            )
        rows[-1].set_xlabel("time (s)")
    return figure


def effect_figure(effect: Effect) -> Figure:
    """The example of an effect with and without it, and the difference, over time: the quantity that changes most."""
    model = example_model(effect)
    times, without = _motion(model, {})
    _, changed = _motion(with_effect(model, effect), _values_of(effect, times, without))
    k = int(np.argmax(np.ptp(changed - without, axis=0)))
    quantity = model.observed[k]
    with mpl.rc_context(STYLE):
        figure = Figure(figsize=(WIDTH_IN, HEIGHT_IN + LOW_IN), layout="constrained")
        top, bottom = figure.subplots(2, 1, sharex=True, height_ratios=(HEIGHT_IN, LOW_IN))
        top.plot(times, without[:, k], color=INK, label=model.name)
        top.plot(times, changed[:, k], color=LINES[1], label=f"with {effect.name}", linewidth=1.2)
        bottom.plot(times, (changed - without)[:, k], color=LINES[1], linewidth=1.2)
        _finish(top, f"{_label(quantity)} ({typeset(quantity.unit)})", legend=True)
        _finish(bottom, f"difference ({typeset(quantity.unit)})")
        bottom.set_xlabel("time (s)")
    return figure


def example_model(effect: Effect) -> OdeModel:
    """The model that an effect names in its example, in the unit that the example gives.

    Raises
    ------
    DataError
        When the effect has no example.
    """
    if effect.example is None:
        raise DataError(f"the effect {effect.name} has no example; give Effect(example=EffectExample(...))")
    model = MODELS[effect.example.model]
    if not effect.example.unit:
        return model
    states, observed = (
        tuple(replace(quantity, unit=effect.example.unit) for quantity in quantities)
        for quantities in (model.states, model.observed)
    )
    return replace(model, name=f"{model.name}-in-{effect.example.unit}", states=states, observed=observed)


def _motion(model: OdeModel, more: dict[str, float]) -> tuple[Array, Array]:
    """Times (n,) s and what is observed (n, d) in the example of a model, with further values."""
    assert model.example is not None
    times = model.example.t_s[:: -(-model.example.samples // MAX_POINTS)]
    driven = model.example.driven(times)
    return times, simulate(model, times, {**model.example.values, **more}, inputs=driven).observed


def _values_of(effect: Effect, times: Array, observed: Array) -> dict[str, float]:
    """The size of the example, and of the further parameters the middle one of the values that a diagnosis tries."""
    assert effect.example is not None
    names = [parameter.name for parameter in effect.parameters]
    tried = effect.trials(times, observed) if effect.trials is not None else ()
    further = tried[len(tried) // 2] if tried else ()
    return {names[0]: effect.example.size, **dict(zip(names[1:], further, strict=False))}


def _label(quantity: Quantity) -> str:
    return f"${quantity.symbol}$" if quantity.symbol else quantity.name


def _finish(axes: Axes, label: str, *, legend: bool = False) -> None:
    axes.set_ylabel(label)
    axes.margins(x=0.01)
    if legend:
        axes.legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), borderaxespad=0.0, ncols=3, fontsize=8)
