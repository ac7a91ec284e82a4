"""Candidate terms for each kind of observable, dimensionally consistent, and the model of any choice of terms.

Candidates for an angle are its sine, cosine and the angle itself; for a position its powers; for a level its square
root. For all moving bodies also v, |v| v and the sign of v; for bodies of one kind their difference; for all an input.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from fitters.compose_effects import bodies_of
from fitters.starting_values import samples, start_of
from iris_sysid.errors import DataError
from iris_sysid.types import Array, OdeModel, Parameter, Quantity, Trajectory, picklable, symbol_of
from iris_sysid.units import rate_of

Kind = Literal["angle", "position", "size", "amount"]

# The function of a term: of its own value a, another value b, its rate v and the body's speed w.
(
    ONE,
    LINEAR,
    SIN,
    COS,
    CUBE,
    ROOT,
    SQUARE,
    DIFFERENCE,
    RATE,
    DRAG,
    DRY,
    INPUT,
    OTHER_ROOT,
    SQUARE_RATE,
    PRODUCT,
    FOURTH,
) = range(16)

CODES: dict[Kind, tuple[int, ...]] = {
    "angle": (ONE, LINEAR, SIN, COS, RATE, DRAG, DRY),
    "position": (ONE, LINEAR, CUBE, RATE, DRAG, DRY, SQUARE_RATE),
    "size": (ONE, LINEAR, RATE),
    "amount": (ONE, LINEAR, ROOT, SQUARE),
}
TEMPERATURE = (ONE, LINEAR, FOURTH)  # amounts in K: Newton's cooling, and Stefan (1879): radiation goes with T^4
COUPLED = (DIFFERENCE, OTHER_ROOT, PRODUCT)  # these take the value of another variable
# Below this fraction of the usual speed, sign(v) changes smoothly, so that the integrator can follow it.
TURNOVER = 0.1
NAMES = {
    ONE: "constant", LINEAR: "linear", SIN: "sin", COS: "cos", CUBE: "cube", ROOT: "root", SQUARE: "square",
    RATE: "rate", DRAG: "drag", DRY: "dry", SQUARE_RATE: "square_rate", FOURTH: "fourth",
}  # fmt: skip
# The effect that adds this term to an acceleration.
EFFECTS = {
    ONE: "constant-force",
    CUBE: "cubic-stiffness",
    RATE: "linear-drag",
    DRAG: "quadratic-drag",
    DRY: "coulomb-friction",
}


@dataclass(frozen=True, slots=True)
class Variable:
    """The variable of an equation: an observed quantity, or its reciprocal for an apparent size.

    ``order`` is that of the equation; ``name`` is the observed quantity's, ``state`` and ``rate`` are the model's.
    """

    quantity: Quantity
    kind: Kind
    order: int
    state: Quantity
    rate: Quantity

    @property
    def left(self) -> str:
        """The left side of the equation as text."""
        return self.state.name + "'" * self.order

    @property
    def left_latex(self) -> str:
        """The left side of the equation as LaTeX."""
        return rf"\{'d' * self.order}ot {{{self.state.symbol}}}"


@dataclass(frozen=True, slots=True)
class Term:
    """One candidate: ``code`` is its function, ``own`` and ``other`` are the variables (or input) that it takes.

    ``pushed`` says whether it takes a known input.
    """

    equation: int
    code: int
    other: int
    parameter: Parameter
    text: str
    latex: str
    pushed: bool = False


@dataclass(frozen=True, eq=False, slots=True)
class Library:
    """The variables and candidates for trajectories of some quantities; terms are in order of their equation.

    ``partner`` says with which variable each one moves in a plane (itself where there is none), ``turnover`` is the
    speed below which sign(v) turns over smoothly.
    """

    variables: tuple[Variable, ...]
    terms: tuple[Term, ...]
    inputs: tuple[Quantity, ...]
    partner: tuple[int, ...]
    turnover: float

    @property
    def names(self) -> tuple[str, ...]:
        """The parameter of each term."""
        return tuple(term.parameter.name for term in self.terms)

    def effect(self, index: int) -> str:
        """The named effect that adds the term of this index to an acceleration; empty where there is none."""
        term = self.terms[index]
        moves = self.variables[term.equation].kind in ("angle", "position")
        return EFFECTS.get(term.code, "") if moves else ""

    def of_equation(self, equation: int) -> list[int]:
        """Indices of the terms of one equation."""
        return [k for k, term in enumerate(self.terms) if term.equation == equation]


# --------------------------------------------------------------------------- which variables


def kind_of(quantity: Quantity) -> Kind:
    """The kind of observable, by its unit and, for a level or a radius, its name."""
    letters = quantity.name.rstrip("0123456789")
    if quantity.unit == "rad":
        return "angle"
    if quantity.unit == "px" and letters in ("r", "radius"):
        return "size"
    if quantity.unit in ("m", "px") and letters not in ("h", "level"):
        return "position"
    return "amount"


def variable_of(quantity: Quantity, moving: bool = False) -> Variable:
    """The variable of an observed quantity: itself, or 1/r (a distance) for an apparent radius.

    With ``moving`` an amount is the reading of a position, whose unit does not say so.
    """
    kind = kind_of(quantity)
    kind = "position" if moving and kind == "amount" else kind
    symbol = quantity.symbol or symbol_of(quantity.name)
    if kind == "size":
        state = Quantity(f"q_{quantity.name}", f"1/{quantity.unit}", rf"(1/{symbol})")
        return Variable(
            quantity, kind, 2, state, Quantity(f"d_{state.name}", f"{state.unit}/s", rf"\dot {state.symbol}")
        )
    state = Quantity(quantity.name, quantity.unit, symbol)
    rate = Quantity(f"d_{quantity.name}", rate_of(quantity.unit), rf"\dot {{{symbol}}}")
    return Variable(quantity, kind, 1 if kind == "amount" else 2, state, rate)


def turnover_of(rates: Array) -> float:
    """The speed below which sign(v) changes smoothly, for rates (n, d): a power of 4, so that few models differ.

    In the unit of the rates.
    """
    speed = max(float(np.sqrt(np.mean(rates**2))), 1e-12)
    return float(4.0 ** np.round(np.log(TURNOVER * speed) / np.log(4.0)))


def value_of(variable: Variable, observed: Array) -> Array:
    """The variable's values of observed ones (n,). In the unit of the variable."""
    return 1.0 / observed if variable.kind == "size" else observed


@functools.lru_cache(maxsize=64)
def library_of(
    quantities: tuple[Quantity, ...],
    inputs: tuple[Quantity, ...] = (),
    turnover: float = TURNOVER,
    moving: bool = False,
) -> Library:
    """The candidates for trajectories of these quantities and inputs; DataError when equations of two orders mix.

    Parameters
    ----------
    quantities, inputs
        What is observed, and what drives it.
    turnover
        Speed below which sign(v) turns over.
    moving
        As for :func:`variable_of`.
    """
    variables = tuple(variable_of(quantity, moving) for quantity in quantities)
    orders = {variable.order for variable in variables}
    if len(orders) > 1:
        listed = ", ".join(f"{variable.quantity.name} ({variable.quantity.unit})" for variable in variables)
        raise DataError(
            f"{listed}: positions and angles have equations of second order, levels and amounts of first; "
            "discover on one sort at a time"
        )
    partner = _partners(variables)
    terms = [
        term
        for equation, variable in enumerate(variables)
        for term in _terms(equation, variable, variables, inputs, partner)
    ]
    return Library(variables, tuple(terms), inputs, partner, turnover)


def _partners(variables: tuple[Variable, ...]) -> tuple[int, ...]:
    """For each variable, the other coordinate of the same body in a plane; the variable itself where there is none."""
    bare = bare_model(variables)
    bodies = bodies_of(bare)
    partners = {k: next((j for j in body if j != k), k) for body in bodies for k in body}
    return tuple(partners[k] for k in range(len(variables)))


def _terms(
    equation: int,
    own: Variable,
    variables: tuple[Variable, ...],
    inputs: tuple[Quantity, ...],
    partner: tuple[int, ...],
) -> list[Term]:
    codes = TEMPERATURE if own.kind == "amount" and own.state.unit == "K" else CODES[own.kind]
    terms = [_term(equation, own, code, equation) for code in codes]
    for k, other in enumerate(variables):
        if k in (equation, partner[equation]):
            continue
        if other.state.unit == own.state.unit:
            terms.append(_term(equation, own, DIFFERENCE, k, other.state))
            if own.kind == "amount" and ROOT in codes:
                terms.append(_term(equation, own, OTHER_ROOT, k, other.state))
        if own.kind == "amount":
            terms.append(_term(equation, own, PRODUCT, k, other.state))
    return terms + [_term(equation, own, INPUT, k, quantity) for k, quantity in enumerate(inputs)]


def _term(equation: int, own: Variable, code: int, other: int, second: Quantity | None = None) -> Term:
    text, latex, dimension = _spelling(own, code, second)
    with_other = {DIFFERENCE: "to", OTHER_ROOT: "root", PRODUCT: "times", INPUT: "input"}
    label = NAMES.get(code) or f"{with_other[code]}_{_name(second)}"
    unit = _coefficient_unit(own, dimension, second if code in (INPUT, PRODUCT) else None)
    symbol = rf"c_{{{own.state.symbol},{label.replace('_', ' ')}}}"
    parameter = Parameter(f"{own.quantity.name}_{label}", unit, symbol, default=0.0)
    return Term(equation, code, other, parameter, text, latex, pushed=code == INPUT)


def _name(quantity: Quantity | None) -> str:
    return "" if quantity is None else quantity.name


def _spelling(own: Variable, code: int, second: Quantity | None) -> tuple[str, str, tuple[float, int]]:
    """Text, LaTeX, and the dimension: the power of the variable's unit and of 1/s."""
    a, v, x, y = own.state.name, f"{own.state.name}'", own.state.symbol, rf"\dot {{{own.state.symbol}}}"
    b, z = (_name(second), (second.symbol or symbol_of(second.name)) if second else "")
    angle = 0 if own.kind == "angle" else 1
    spelled: dict[int, tuple[str, str, tuple[float, int]]] = {
        ONE: ("1", "", (0, 0)),
        LINEAR: (a, x, (angle, 0)),
        SIN: (f"sin({a})", rf"\sin {x}", (0, 0)),
        COS: (f"cos({a})", rf"\cos {x}", (0, 0)),
        CUBE: (f"{a}^3", f"{x}^3", (3, 0)),
        ROOT: (f"sqrt({a})", rf"\sqrt{{{x}}}", (0.5, 0)),
        SQUARE: (f"{a}^2", f"{x}^2", (2, 0)),
        DIFFERENCE: (f"({a} - {b})", f"({x} - {z})", (angle, 0)),
        RATE: (v, y, (angle, 1)),
        DRAG: (f"|{v}| {v}", rf"|{y}|\,{y}", (2 * angle, 2)),
        DRY: (f"sign({v})", rf"\mathrm{{sign}}\,{y}", (0, 0)),
        FOURTH: (f"{a}^4", f"{x}^4", (4, 0)),
        PRODUCT: (f"{a} {b}", f"{x} {z}", (1, 0)),  # Lotka (1925), Volterra (1926): what meets what
        SQUARE_RATE: (f"{a}^2 {v}", rf"{x}^2 {y}", (3, 1)),  # van der Pol (1926): damping that grows with the swing
        INPUT: (b, z, (0, 0)),
        OTHER_ROOT: (f"sqrt({b})", rf"\sqrt{{{z}}}", (0.5, 0)),
    }
    return spelled[code]


def _coefficient_unit(own: Variable, dimension: tuple[float, int], per: Quantity | None) -> str:
    """The unit that makes coefficient times term a rate of the variable; an angle has no dimension in it.

    ``per`` is what a term takes besides the variable.
    """
    base = "" if own.kind == "angle" or own.state.unit == "1" else own.state.unit
    power, times = 1 - dimension[0] if base else 0, own.order - dimension[1]
    if own.kind == "size":
        base, power = own.quantity.unit, -power
    unit = unit_of(base, power, times)
    return f"{unit}/{per.unit}" if per is not None and per.unit not in ("", "1") else unit


def unit_of(base: str, power: float, times: int) -> str:
    """The unit base^power / s^times, written without negative powers.

    Parameters
    ----------
    base
        A unit; empty when there is none.
    power
        Of the base, any number.
    times
        Power of 1/s, from 0.
    """
    above = f"{base}^{power:g}" if power > 0 and power != 1 else base if power == 1 else "1"
    below = [f"{base}^{-power:g}" if power != -1 else base] if power < 0 else []
    below += [f"s^{times}" if times > 1 else "s"] if times > 0 else []
    return "/".join([above, *below])


# --------------------------------------------------------------------------- their values


def term_value(  # noqa: C901 - one line a function; a table of functions is nothing that numba could compile
    code: int, own: Any, other: Any, velocity: Any, speed: Any, pushed: Any, turnover: Any
) -> Any:  # numbers in the integrator, arrays over samples elsewhere
    """Value of a term.

    Parameters
    ----------
    code
        The function of the term, see the constants of this module.
    own, other
        Value of the equation's variable, and of the other one of a coupling.
    velocity, speed
        Rate of the variable, and the speed of its body.
    pushed
        Value of the input.
    turnover
        Speed below which the sign of the velocity turns over.
    """
    if code == ONE:
        return 1.0 + 0.0 * own
    if code == LINEAR:
        return own
    if code == SIN:
        return np.sin(own)
    if code == COS:
        return np.cos(own)
    if code == CUBE:
        return own * own * own
    if code == ROOT:
        return np.sqrt(np.maximum(own, 0.0))
    if code == SQUARE:
        return own * own
    if code == DIFFERENCE:
        return own - other
    if code == RATE:
        return velocity
    if code == DRAG:
        return speed * velocity
    if code == DRY:
        return velocity / np.sqrt(speed * speed + turnover * turnover)
    if code == SQUARE_RATE:
        return own * own * velocity
    if code == INPUT:
        return pushed
    if code == PRODUCT:
        return own * other
    if code == FOURTH:
        return own * own * own * own
    return np.sqrt(np.maximum(other, 0.0))


def evaluated(library: Library, values: Array, rates: Array, inputs: Array | None) -> Array:
    """All terms at samples (n, k).

    Parameters
    ----------
    library
        The candidates.
    values, rates
        (n, d) of the variables; rates are not used in equations of first order.
    inputs
        (n, m), None where there are none.
    """
    columns = []
    for term in library.terms:
        k, other = term.equation, term.other
        velocity, along = rates[:, k], rates[:, library.partner[k]]
        speed = np.abs(velocity) if library.partner[k] == k else np.hypot(velocity, along)
        second = values[:, other] if term.code in COUPLED else values[:, k]
        pushed = inputs[:, other] if term.code == INPUT and inputs is not None else values[:, k]
        columns.append(term_value(term.code, values[:, k], second, velocity, speed, pushed, library.turnover))
    return np.column_stack(columns) if columns else np.zeros((len(values), 0))


# --------------------------------------------------------------------------- a model without terms


def bare_model(variables: tuple[Variable, ...], rhs: Callable[..., Any] = tuple, **more: Any) -> OdeModel:
    """A model of these variables (``variables``), with a right-hand side ``rhs`` and ``more`` of its fields."""
    states = tuple(variable.state for variable in variables)
    if variables[0].order == 2:
        states += tuple(variable.rate for variable in variables)
    fields: dict[str, Any] = {
        "name": "discovered",
        "summary": "an equation found in the data by sparse regression",
        "equation": "",
        "source": "Brunton, Proctor and Kutz (2016), PNAS 113, 3932, refined by trajectory fitting",
        "parameters": (),
        "observed": tuple(variable.quantity for variable in variables),
        "guess": _guess(variables),
    }
    return OdeModel(states=states, rhs=rhs, **(fields | more))


@picklable
def _guess(variables: tuple[Variable, ...]) -> Callable[[Trajectory], Mapping[str, float]]:
    """Initial states from the first samples; coefficients need a given start."""

    def guess(trajectory: Trajectory) -> Mapping[str, float]:
        start = {}
        for variable in variables:
            t_s, observed = samples(trajectory, variable.quantity.name)
            values = value_of(variable, observed)
            value, slope, *_ = start_of(t_s, values, (t_s[-1] - t_s[0]) / 20, degree=2)
            start[f"{variable.state.name}_0"] = float(value)
            if variable.order == 2:
                start[f"{variable.rate.name}_0"] = float(slope)
        return start

    return guess
