"""An equation of motion, and an effect that one may lack."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Literal, get_args

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types._arrays import Array
from iris_sysid.types._components import ComponentKind
from iris_sysid.types._display import text_of, with_units
from iris_sysid.types._motion import Trajectory
from iris_sysid.types._numbers import Quantity
from iris_sysid.types._pickling import Portable
from iris_sysid.types._taken_from import driven_by, upwards
from iris_sysid.types._view import Sensor, View

ParameterRole = Literal[
    "physical",
    "gravity",
    "damping",
    "magnification",
    "offset",
    "vertical",
    "pivot",
    "inclination",
    "location",
    "moment",
    "shape",
    "form",
]


METRE = re.compile(r"\bm\b")  # in a unit
MOVES = re.compile(r"\b(m|px|rad)\b")  # in the unit of a place or a speed, which laws of motion describe
EffectCause = Literal["physics", "measurement", "clock"]
Recurrence = Literal["always", "anew", "once"]
ANY_SENSOR: frozenset[Sensor] = frozenset(get_args(Sensor))


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a model: name, unit, LaTeX symbol, bounds.

    ``default`` is used where a model's guess gives no value. ``constant`` parameters are held at
    their default unless freed (``--free``); ``source`` says where the default comes from and
    ``stderr`` how well it is known. ``role`` says what the fitters need to know of it beyond its value:
    ``gravity`` (the acceleration of gravity), ``damping`` (a loss in proportion to the speed; below zero it adds
    energy), ``magnification`` (observed length over true length; carries the error of the scale), ``offset`` (the
    value of the observed quantity at rest), ``vertical`` (direction of the true vertical), ``pivot`` (position of a
    pivot), ``inclination`` (angle of a line from the horizontal), ``location`` (of an effect: the time or the position
    at which it acts), ``moment`` (of an effect: the time of something sudden, which no step of the integrator passes
    over), ``shape`` (of an effect: a scale that a diagnosis takes from the motion, in the data's unit), ``form`` (of an
    effect: an exponent or a width, held unless the data call for another); ``physical`` for everything else.
    """

    name: str
    unit: str
    symbol: str
    lower: float = -np.inf
    upper: float = np.inf
    default: float | None = None
    constant: bool = False
    stderr: float = 0.0
    source: str = ""
    role: ParameterRole = "physical"


# dstate/dt as a tuple, from (t, state, params): scalars and tuples only, so that numba can compile it.
# A model that declares inputs takes a fourth argument: (t, state, params, inputs).
RightHandSide = Callable[..., tuple[float, ...]]


@dataclass(frozen=True, eq=False, slots=True)
class Event(Portable):
    """Something sudden: it happens where ``crossing`` falls through zero, and ``reset`` gives the state right after.

    Both are called as the model's ``rhs`` is, and numba must be able to compile them. In a model with events ``state``
    ends with the mode, a whole number that says which equation holds (0 at the start): ``crossing(t, state, params)``
    returns a number, above zero as long as the event does not happen or cannot happen in this mode;
    ``reset(t, state, params)`` returns the states and the mode after it.
    """

    name: str
    crossing: Callable[..., float]
    reset: Callable[..., tuple[float, ...]]


@dataclass(frozen=True, slots=True)
class ModelExample:
    """A motion that a model describes well: what the tests and the guide simulate.

    ``values`` holds parameters and initial states by name; constants may be left out. The motion is sampled
    ``samples`` times, ``rate_hz`` times a second, from 0 s on. ``inputs(t_s (n,))``, where the model has some, gives
    them at these times, (n, m), on a line in between.
    """

    values: Mapping[str, float]
    samples: int
    rate_hz: float
    inputs: Callable[[Array], Array] | None = None

    def driven(self, t_s: Array) -> Array | None:
        """The inputs (n, m) at times ``t_s`` (n,) s; None where the model has none."""
        return None if self.inputs is None else self.inputs(t_s)

    @property
    def t_s(self) -> Array:
        """Sample times (samples,) s."""
        return np.arange(self.samples) / self.rate_hz


def no_guess(trajectory: Trajectory) -> Mapping[str, float]:
    """The guess of a model that has none."""
    return {}


@dataclass(frozen=True, eq=False, slots=True)
class OdeModel(Portable):
    """A governing equation with its parameters: what the ODE engine fits.

    ``states`` in the order that ``rhs`` takes them; the initial value of state ``theta`` is a
    parameter named ``theta_0``. ``rhs(t, state, params)`` returns the derivatives as a tuple;
    ``params`` is in the order of ``parameters``. The observed quantities are ``observed``: names of
    states, unless ``observe(t_s, states (n, s), params (p,)) -> (n, d)`` is given, which must accept
    arrays. ``guess(trajectory)`` returns starting values by name for parameters and initial states; without one, and
    for names that it leaves out, a fit finds them from the data.
    ``derive(values)`` returns further quantities (declared in ``derived``) from all values by name.
    ``first_integral(states (n, s), params (p,)) -> (n,)`` is conserved when the parameters named in
    ``dissipative`` are zero. ``warp(t_s, params (p,))``, where given, returns the times of the motion
    that the samples at ``t_s`` show. ``drive(t_s, inputs (n, m), params (p,))``, where given, returns the
    inputs (n, m) that really act at these times. With ``events``, ``state`` ends with the mode; see :class:`Event`.
    The last ``hidden`` states are those of effects: nothing observes them, and they begin at zero unless freed.
    ``ties`` holds parameters that were taken out as expressions of the others, each name with its expression; they are
    among the ``derived``.
    ``typical``, which every registered model has, says which values one meets, in words. ``example``, which every
    registered model has, is a motion for the contract tests.
    """

    name: str
    summary: str
    equation: str
    source: str
    states: tuple[Quantity, ...]
    parameters: tuple[Parameter, ...]
    observed: tuple[Quantity, ...]
    rhs: RightHandSide
    guess: Callable[[Trajectory], Mapping[str, float]] = no_guess
    inputs: tuple[Quantity, ...] = ()
    observe: Callable[[Array, Array, Array], Array] | None = None
    derived: tuple[Quantity, ...] = ()
    derive: Callable[[Mapping[str, float]], Mapping[str, float]] | None = None
    first_integral: Callable[[Array, Array], Array] | None = None
    dissipative: tuple[str, ...] = ()
    warp: Callable[[Array, Array], Array] | None = None
    drive: Callable[[Array, Array, Array], Array] | None = None
    events: tuple[Event, ...] = ()
    hidden: int = 0
    ties: tuple[tuple[str, str], ...] = ()
    typical: str = ""
    example: ModelExample | None = None

    @property
    def second_order(self) -> bool:
        """Whether the own states are positions followed by their velocities, in the same order."""
        half, odd = divmod(len(self.own_states), 2)
        pairs = zip(self.states[:half], self.states[half : 2 * half], strict=True)
        return not odd and half > 0 and all(rate.unit == f"{position.unit}/s" for position, rate in pairs)

    @property
    def of_speeds(self) -> bool:
        """Whether the model is of first order and begins with a speed: forces act on it wherever the body is."""
        return not self.second_order and self.states[0].unit.endswith("/s")

    @property
    def has_velocity(self) -> bool:
        """Whether a velocity is a state: in a model of second order, or of speeds."""
        return self.second_order or self.of_speeds

    @property
    def degrees_of_freedom(self) -> int:
        """Number of highest derivatives, on which forces act: one a position, or one a state of first order."""
        return len(self.own_states) // 2 if self.second_order else len(self.own_states)

    @property
    def own_states(self) -> tuple[Quantity, ...]:
        """The states without the hidden ones of effects."""
        return self.states[: len(self.states) - self.hidden]

    @property
    def forced_states(self) -> slice:
        """Which states have the highest derivatives as their rates: velocities, or all of a model of first order."""
        count = len(self.own_states)
        return slice(count - self.degrees_of_freedom, count)

    @property
    def initial_names(self) -> tuple[str, ...]:
        """Names of the initial values, ``<state>_0``, in the order of the states."""
        return tuple(f"{state.name}_0" for state in self.states)

    def velocities(self, states: Array, slopes: Array) -> Array:
        """The velocities (n, f) of states (n, s) and their rates ``slopes`` (n, s); the rates where it has none."""
        moving = states if self.has_velocity else slopes
        return np.asarray(moving[:, self.forced_states])

    def with_role(self, role: ParameterRole) -> tuple[Parameter, ...]:
        """The parameters of that role; none where the model has none."""
        return tuple(parameter for parameter in self.parameters if parameter.role == role)

    def units(self) -> dict[str, str]:
        """The unit of each parameter and initial value by name, for values that are stated without one."""
        initial = {name: state.unit for name, state in zip(self.initial_names, self.states, strict=True)}
        return {parameter.name: parameter.unit for parameter in self.parameters} | initial

    def taken_from(self, trajectory: Trajectory) -> tuple[Trajectory, str]:
        """The trajectory with the quantities that fit under the names that the model uses, and what to say of it.

        A model of one quantity takes the only one of its unit, whatever its name, and of one input likewise; one of any
        unit takes the only one there is. y in metres is z beside x. The text names what is not used; it is empty where
        everything is used under its own name.
        """
        observed = [quantity.name for quantity in self.observed]
        trajectory, driven = driven_by(trajectory, self.inputs, observed)
        trajectory, turned = upwards(trajectory, observed)
        trajectory, said = self._observed_from(trajectory, observed)
        taken = "; ".join(part for part in (driven, turned) if part)
        return trajectory, "; ".join(part for part in (taken and f"{taken} for the model {self.name}", said) if part)

    def _observed_from(self, trajectory: Trajectory, observed: Sequence[str]) -> tuple[Trajectory, str]:
        """The same for what the model observes."""
        idle = [quantity.name for quantity in trajectory.quantities if quantity.name not in observed]
        if len(idle) < len(trajectory.quantities):
            unused = f"{', '.join(idle)} is not observed by the model {self.name}: not used" if idle else ""
            return trajectory, unused
        wanted = self.observed[0]
        units = (wanted.unit, METRE.sub("px", wanted.unit))
        same = [quantity for quantity in trajectory.quantities if quantity.unit in units]
        same = same or [quantity for quantity in trajectory.quantities if self.of_any_unit]
        if len(observed) > 1 or len(same) != 1:
            return trajectory, ""
        quantities = tuple(
            replace(wanted, unit=quantity.unit) if quantity is same[0] else quantity
            for quantity in trajectory.quantities
        )
        rest = f"; {', '.join(name for name in idle if name != same[0].name)} not used" if len(idle) > 1 else ""
        return trajectory.with_(quantities=quantities), f"{wanted.name} of the model {self.name} = {same[0].name}{rest}"

    @property
    def of_any_unit(self) -> bool:
        """Whether the equation holds of one quantity in any unit: only its state and its zero are in one."""
        own = [quantity.unit for quantity in self.observed]
        scaled = [each for each in self.parameters if METRE.search(each.unit) or [each.unit] == own]
        return (
            own in (["1"], ["m"])
            and bool(self.with_role("offset"))
            and all(parameter.role == "offset" for parameter in scaled)
        )

    def may_be_of(self, unit: str) -> bool:
        """Whether the equation holds of a quantity in this unit because it holds in any; not of a place or a speed."""
        return self.of_any_unit and not MOVES.search(unit)

    def in_unit_of(self, trajectory: Trajectory) -> OdeModel:
        """The model in the unit of a trajectory, if it holds in any: its state, what is observed, and its zero."""
        own = self.observed[0].unit
        (unit,) = [each.unit for each in trajectory.quantities if each.name == self.observed[0].name] or (own,)
        if not self.of_any_unit or unit in ("", own, METRE.sub("px", own)):
            return self

        def told(text: str) -> str:
            return unit if text == own else METRE.sub(unit, text)

        return replace(
            self,
            states=tuple(replace(state, unit=told(state.unit)) for state in self.states),
            observed=(replace(self.observed[0], unit=unit),),
            parameters=tuple(replace(each, unit=told(each.unit)) for each in self.parameters),
        )

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; DataError lists the names there are."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        names = ", ".join(parameter.name for parameter in self.parameters)
        raise DataError(f"model {self.name!r} has no parameter {name!r}; it has {names}")

    def __repr__(self) -> str:
        given = f"; inputs {with_units(self.inputs)}" if self.inputs else ""
        return text_of(
            f"OdeModel {self.name}: {self.summary}",
            f"states {with_units(self.states)}; observed {with_units(self.observed)}{given}",
            "parameters " + ", ".join(f"{parameter.name} ({parameter.unit})" for parameter in self.parameters),
        )


@dataclass(frozen=True, slots=True)
class EffectExample:
    """A model that may lack an effect, and a size at which the effect is seen in the example of that model.

    ``unit``, where given, takes the place of the unit of the model's states and observed quantities, for effects of a
    sensor that does not read metres.
    """

    model: str
    size: float
    unit: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Effect(Portable):
    """Something that a governing equation may lack; one of its maps acts, the others are None.

    ``parameters``: the first is the size, and at zero the effect is absent. In a unit, ``{x}`` stands
    for the unit of the observed quantity, or of a force on a speed for that of the place: quadratic drag of an angle,
    and of an angular velocity, has the unit 1/rad.

    ``acceleration(t, position, velocity, speed, base, params)`` returns what is added to one second
    derivative ``base`` of a model of second order, or to one rate of a model of first order (there
    ``velocity`` is that rate, or the state itself where that is a speed). It is called for each component of each body;
    ``speed`` is the norm of the body's velocity. It must accept numbers, so that numba can compile it, and arrays of
    them.
    ``acts_at_rest(model)``, where given, says for which models ``base`` is what their own force is at zero velocity: a
    spring that weakens leaves the damping as it is.
    An effect with a memory has ``hidden`` states, which begin at zero. It acts on one degree of freedom:
    ``acceleration`` takes them, a tuple, as a seventh argument, and ``memory(t, position, velocity, base, params,
    hidden)`` returns their rates as a tuple of numbers.
    ``observe(t_s, observed (n, d), velocity (n, d), params)`` returns what the sensor reads (n, d).
    ``image(t_s (n,), points_px (n, 2), params, view)`` returns the points (n, 2) px of the picture at which a camera
    shows what a perfect one would show at ``points_px``; the :class:`View` says how coordinates lie in the picture.
    ``warp(t_s, params)`` returns the times (n,) at which the motion really was.
    ``drive(t_s, inputs (n, m), params)`` returns what acts of the known inputs (n, m).
    ``applies(model)`` says whether the effect makes sense for a model, ``sensors`` which sensors can have it. Where all
    clips have ``measured`` one of these quantities of their geometry, its error stands in the equation already.
    ``cause`` says where it comes from: the ``physics`` of the motion, its ``measurement`` (camera, scale, zero of a
    sensor), or the ``clock``.
    ``plausibility`` are its odds, before the data, against plain drag (1): where the data cannot tell effects apart,
    the more plausible one is named first.
    ``alike`` names effects and parameters that do nearly the same, in words; ``typical`` the sizes that one meets.
    ``trials(t_s (n,), observed (n, d))``, where given, returns the values of the parameters after the first to
    try, e.g. times at which something may have happened: at size zero nothing tells one from another. With ``drive``,
    it is given the inputs (n, m) instead, of a force on speeds the way that they go.
    ``nearby(t_s (n,), shape)``, where given, returns others around such values, which are then chosen, not fitted.
    ``sensible(t_s (n,), params)``, where given, says whether fitted parameters still mean the effect in a clip.
    ``example``, which every registered effect has, is a case for the contract tests.
    ``component`` is the part of a residual that it is: it competes with the other effects of that part. ``absorbs``:
    it can imitate a piece of anything (a force of any frequency, a blow at any moment), so that it is named only where
    the equation with it explains the data to the noise. ``largest`` is the largest plausible size, in root mean
    squares: its force over the model's own or the whole, or its error of a reading over the spread of the motion;
    beyond it, it only cancels another effect or a fitted value.
    ``recurrence`` says what a second clip of the same set-up has of it: ``always`` the same size, ``anew`` a size of
    its own (a drift, a force of any phase), or ``once`` nothing, because it was an accident.
    ``scaling`` holds the powers of the body's ``mass`` and ``radius``, of a cord's ``length``, and of the stiffness of
    its ``spring``, with which the size goes, where they are known.
    """

    name: str
    summary: str
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    applies: Callable[[OdeModel], bool]
    acceleration: Callable[..., float] | None = None
    acts_at_rest: Callable[[OdeModel], bool] | None = None
    hidden: tuple[Quantity, ...] = ()
    memory: Callable[..., tuple[float, ...]] | None = None
    observe: Callable[[Array, Array, Array, Array], Array] | None = None
    image: Callable[[Array, Array, Array, View], Array] | None = None
    warp: Callable[[Array, Array], Array] | None = None
    drive: Callable[[Array, Array, Array], Array] | None = None
    sensors: frozenset[Sensor] = ANY_SENSOR
    measured: frozenset[str] = frozenset()
    alike: str = ""
    typical: str = ""
    trials: Callable[[Array, Array], Sequence[tuple[float, ...]]] | None = None
    nearby: Callable[[Array, tuple[float, ...]], Sequence[tuple[float, ...]]] | None = None
    example: EffectExample | None = None
    cause: EffectCause = "physics"
    plausibility: float = 1.0
    sensible: Callable[[Array, Sequence[float]], bool] | None = None
    recurrence: Recurrence = "always"
    scaling: Mapping[str, float] = field(default_factory=dict)
    component: ComponentKind | None = None
    absorbs: bool = False
    largest: float = 10.0

    @property
    def is_placed(self) -> bool:
        """Whether the moment or the place at which it acts is chosen among many, and not fitted."""
        located = any(parameter.constant and parameter.role == "location" for parameter in self.parameters)
        return located and self.nearby is not None

    @property
    def has_one_place(self) -> bool:
        """Whether the place or the level at which it acts is fitted, and the same in all clips."""
        located = any(parameter.role == "location" and not parameter.constant for parameter in self.parameters)
        return located and self.recurrence == "always"

    @property
    def has_fixed_form(self) -> bool:
        """Whether only its size is fitted, perhaps with a moment that is chosen: no wrong form is to be made up for."""
        return sum(not parameter.constant for parameter in self.parameters) == 1

    @property
    def is_flexible(self) -> bool:
        """Whether its shape can imitate a piece of anything; what has only a size is one curve, as a formula is."""
        return self.absorbs and (self.is_placed or not self.has_fixed_form)

    def is_meant(self, t_s: Array, params: Sequence[float]) -> bool:
        """Whether its parameters, in order, still mean the effect in a clip with samples at ``t_s`` (n,), s.

        A moment must lie within the clip.
        """
        moments = [value for each, value in zip(self.parameters, params, strict=True) if each.role == "moment"]
        if not all(t_s[0] <= moment <= t_s[-1] for moment in moments):
            return False
        return self.sensible is None or self.sensible(t_s, params)

    def factor(self, body: Mapping[str, float]) -> float | None:
        """The factor on the size with another body, from those on its mass, radius or cord; None where not known."""
        changed = {name: factor for name, factor in body.items() if factor != 1.0}
        if not changed or self.cause != "physics":
            return 1.0
        if not changed.keys() <= self.scaling.keys():
            return None
        return math.prod(factor ** self.scaling[name] for name, factor in changed.items())

    def __repr__(self) -> str:
        return text_of(
            f"Effect {self.name}: {self.summary}",
            "parameters " + ", ".join(f"{parameter.name} ({parameter.unit})" for parameter in self.parameters),
        )
