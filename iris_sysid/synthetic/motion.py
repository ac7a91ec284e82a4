"""True trajectories: equations of motion integrated piece by piece between events, kept as dense solutions.

Deliberately not the engine of ``fitters``: clips that test that engine must not share its code.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from iris_sysid.errors import DataError
from iris_sysid.types import Array

Rate = Callable[[float, Array], Array]  # (t s, state) -> d state / dt

# looser ones let the rounding of linear algebra change steps, then pixels, then what the encoder makes of them
RELATIVE_TOLERANCE, ABSOLUTE_TOLERANCE = 1e-13, 1e-14
MAX_EVENTS = 20_000
RESTING_SPEED = 0.01  # m/s; slower impacts end the bouncing


@dataclass(frozen=True, eq=False, slots=True)
class SceneEvent:
    """Something that happens when ``crossing(t, state)`` passes zero in ``direction`` (+1 upwards, -1 downwards).

    ``then(t, state)`` gives the state right after it and the phase that follows.
    """

    name: str
    crossing: Callable[[float, Array], float]
    direction: float
    then: Callable[[float, Array], tuple[Array, Phase]]


@dataclass(frozen=True, eq=False, slots=True)
class Phase:
    """An equation of motion that holds until one of its events; ``max_step_s`` keeps brief contacts in sight."""

    name: str
    rate: Rate
    events: tuple[SceneEvent, ...] = ()
    max_step_s: float = 0.1


def resting(states: int) -> Phase:
    """The phase in which nothing changes any more."""
    return Phase("rest", lambda t, state: np.zeros(states))


@dataclass(frozen=True, eq=False, slots=True)
class SceneMotion:
    """States over time: held at the first state before it starts, at the last after it stops.

    ``starts`` (p + 1,) are the times at which pieces begin, then the end; ``names`` of the phases (p,);
    ``happened`` lists the events as (time, name).
    """

    starts: Array
    pieces: tuple[Callable[[Array], Array], ...]
    names: tuple[str, ...]
    happened: tuple[tuple[float, str], ...]

    def __call__(self, t_s: Array) -> Array:
        """States (n, s) at times (n,)."""
        inside = np.clip(np.asarray(t_s, dtype=np.float64), self.starts[0], self.starts[-1])
        index = self._piece(inside)
        if index.size and index.min() == index.max():
            return self.pieces[index[0]](inside).T
        out: Array | None = None
        for piece in np.unique(index):
            in_piece = index == piece
            values = self.pieces[piece](inside[in_piece]).T
            out = np.empty((inside.size, values.shape[1])) if out is None else out
            out[in_piece] = values
        return np.empty((0, 0)) if out is None else out

    def state(self, column: int) -> Callable[[Array], Array]:
        """One state as a function of times (n,). Times are in s."""
        return lambda t_s: self(t_s)[:, column]

    def phase(self, t_s: Array) -> list[str]:
        """Name of the phase at each time; ``hand`` before the motion starts. ``t_s`` (n,), s."""
        names = [self.names[piece] for piece in self._piece(t_s)]
        return ["hand" if t < self.starts[0] else name for t, name in zip(t_s, names, strict=True)]

    def _piece(self, t_s: Array) -> Array:
        return np.clip(np.searchsorted(self.starts, t_s, side="right") - 1, 0, len(self.pieces) - 1)


def integrate(phase: Phase, state: Array, start_s: float, stop_s: float) -> SceneMotion:
    """Integrate from phase to phase (DOP853, relative tolerance 1e-10), stopping at each event exactly.

    Parameters
    ----------
    phase
        The equation that holds at first, with the events that end it.
    state
        State (s,) at the start.
    start_s, stop_s
        Time span, s.

    Raises
    ------
    DataError
        When the state grows beyond bounds, or events pile up without end.
    """
    starts, names = [start_s], list[str]()
    pieces, happened = list[Callable[[Array], Array]](), list[tuple[float, str]]()
    now, current = start_s, np.asarray(state, dtype=np.float64)
    while now < stop_s and len(pieces) < MAX_EVENTS:
        solution = _until_event(phase, now, current, stop_s)
        pieces.append(solution.sol)
        names.append(phase.name)
        now = float(solution.t[-1])
        starts.append(now)
        if solution.status == 1:
            which = next(k for k, times in enumerate(solution.t_events) if times.size)
            event = phase.events[which]
            happened.append((now, event.name))
            current, phase = event.then(now, solution.y[:, -1])
    if now < stop_s:
        raise DataError(f"more than {MAX_EVENTS} events before {now:.4g} s: the bodies never come to rest")
    return SceneMotion(np.array(starts), tuple(pieces), tuple(names), tuple(happened))


def _until_event(phase: Phase, now: float, state: Array, stop_s: float) -> Any:
    solution = solve_ivp(
        phase.rate,
        (now, stop_s),
        state,
        method="DOP853",
        rtol=RELATIVE_TOLERANCE,
        atol=ABSOLUTE_TOLERANCE,
        max_step=phase.max_step_s,
        dense_output=True,
        events=[_terminal(event) for event in phase.events],
    )
    if solution.status < 0 or not np.all(np.isfinite(solution.y)):
        raise DataError(f"the motion cannot be integrated beyond {solution.t[-1]:.4g} s: {solution.message}")
    return solution


def _terminal(event: SceneEvent) -> Callable[[float, Array], float]:
    def crossing(t: float, state: Array) -> float:
        return event.crossing(t, state)

    crossing.terminal = True  # type: ignore[attr-defined]
    crossing.direction = event.direction  # type: ignore[attr-defined]
    return crossing


Pull = Callable[[float, Array], float]  # (t s, state) -> an acceleration
Others = Callable[[float, Array], Array]


def moving(
    smooth: Pull,
    friction: Pull,
    t_s: float,
    state: Array,
    *,
    others: Others | None = None,
    events: tuple[SceneEvent, ...] = (),
) -> Phase:
    """Motion of the first two states (q, q') under dry friction, which sticks where it can hold the body.

    Parameters
    ----------
    smooth
        q'' without the friction, from (t, state).
    friction
        Size of the deceleration by friction (not negative), from (t, state).
    t_s, state
        The time, and the state (s,) at that time: its q' decides which way friction acts.
    others
        Rates of the states after the first two; None when there are none.
    events
        What else may end the motion.
    """
    sign = float(np.sign(state[1]) or np.sign(smooth(t_s, state)))
    if state[1] == 0 and abs(smooth(t_s, state)) <= friction(t_s, state):
        return resting(state.size)

    def rate(t: float, state: Array) -> Array:
        rest = others(t, state) if others else ()
        return np.array([state[1], smooth(t, state) - sign * friction(t, state), *rest])

    def turned(t: float, state: Array) -> tuple[Array, Phase]:
        halted = state.copy()
        halted[1] = 0.0
        return halted, moving(smooth, friction, t, halted, others=others, events=events)

    turn = SceneEvent("turn", lambda t, state: state[1], -sign, turned)
    return Phase("motion", rate, (*events, turn) if friction(t_s, state) > 0 else events)


def bouncing(fall: Pull, floor: float, restitution: float, gravity: float, speed: float = 1.0) -> Phase:
    """Motion of a height q (state 0) and its rate (state 1) over a floor that throws it back.

    Parameters
    ----------
    fall
        q'' in the air, from (t, state).
    floor
        Least value of q.
    restitution
        Speed after an impact over the speed before it.
    gravity
        Roughly how fast it falls back, m/s^2: says how long the shortest flight is.
    speed
        With which it last left the floor.
    """

    def rate(t: float, state: Array) -> Array:
        return np.array([state[1], fall(t, state)])

    def struck(t: float, state: Array) -> tuple[Array, Phase]:
        del t
        after = -restitution * state[1]
        if after < RESTING_SPEED:
            return np.array([floor, 0.0]), resting(2)
        return np.array([floor, after]), bouncing(fall, floor, restitution, gravity, after)

    event = SceneEvent("impact", lambda t, state: state[0] - floor, -1.0, struck)
    return Phase("motion", rate, (event,), float(np.clip(0.5 * speed / gravity, 1e-4, 0.05)))
