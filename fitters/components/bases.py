"""What each component of a residual can look like: columns of a linear basis on a fitted motion.

A force is a sum of given functions of the velocity, the position or the time; its columns are the linear response of
the fitted motion to each of them. An error of the reading or of the clock is seen as it is. Functions of the state have
the same coefficients in all clips, functions of time their own in each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.polynomial import legendre

from fitters.compose_effects import bodies_of
from fitters.effect_sensitivity import EffectMotion, rates
from iris_sysid.types import Array, Quantity
from iris_sysid.units import rate_of

JUMP = 0.03  # of the largest speed: below it dry friction is rounded off, as its reversal is between two samples
SLOW = 0.7  # of the motion's own frequency: what is faster may be the motion itself
MAX_WAVES = 24  # half cycles of a slow course in a clip
WAVES_OF_A_FALL = 8  # the same where the motion does not repeat
MIN_TURNS = 3  # reversals of a velocity from which a motion repeats: then the zero of its position has a meaning
CLOCK_WAVES = 16
DRIFT_WAVES = 6
MOMENTS = 48  # at which a pulse is tried
MAX_CYCLES = 100.0  # of a periodic force in a clip
SAMPLES_A_CYCLE = 4
APART = 1.0  # cycles in the clip by which a periodic force differs from the motion and its harmonics
HARMONICS = 5
GRID = 61  # points of a curve


TIME = Quantity("t", "s")


@dataclass(frozen=True, eq=False, slots=True)
class Basis:
    """The columns of one component in one clip.

    ``kind`` is that of a component, or the name of an effect; ``columns`` (n, d, k) is what a unit of each coefficient
    changes in what is observed. ``shared``: the coefficients
    are the same in all clips. ``curve`` (g, f, k) is the component itself at the arguments ``at`` (g,), in the units of
    ``quantities`` (f,). ``choices`` (k,): the columns belong to rival shapes, one is chosen (the moment of a
    pulse, the frequency of a sine); empty where all act together.
    """

    kind: str
    columns: Array
    shared: bool = False
    argument: Quantity = TIME
    at: Array | None = None
    quantities: tuple[Quantity, ...] = ()
    curve: Array | None = None
    choices: Array | None = None


@dataclass(frozen=True, eq=False, slots=True)
class Scale:
    """What is common to the clips: lowest and highest (2, d) of positions, velocities, readings and their rates.

    ``repeats``: it passes a place more than once; ``has_speed``: a velocity is a state, not a function of the position.
    """

    position: Array
    velocity: Array
    observed: Array
    rate: Array
    repeats: bool
    has_speed: bool

    @classmethod
    def of(cls, motions: Sequence[EffectMotion], seen: Sequence[Array], rates_seen: Sequence[Array]) -> Scale:
        """The scale of some motions, of the observed values (n, d) of each and of their rates (n, d)."""
        count = motions[0].model.degrees_of_freedom
        return cls(
            _reached([motion.states[:, :count] for motion in motions]),
            _reached([_velocity(motion) for motion in motions]),
            _reached(seen),
            _reached(rates_seen),
            all(_turns(motion) >= MIN_TURNS for motion in motions),
            motions[0].model.has_velocity,
        )

    def about(self, reached: Array) -> tuple[Array, Array]:
        """Middle and half width (d,) of what is reached (2, d); about zero where a motion that repeats passes it."""
        passed = self.repeats & (reached[0] <= 0) & (reached[1] >= 0)
        middle = np.where(passed, 0.0, 0.5 * (reached[0] + reached[1]))
        return middle, _largest(reached - middle)


def _reached(values: Sequence[Array]) -> Array:
    every = np.concatenate(list(values))
    return np.stack([every.min(axis=0), every.max(axis=0)])


def _largest(reached: Array) -> Array:
    """The largest size (d,) of what is reached (2, d)."""
    return np.asarray(np.maximum(np.max(np.abs(reached), axis=0), 1e-300))


def _velocity(motion: EffectMotion) -> Array:
    return motion.model.velocities(motion.states, motion.slopes)


def _turns(motion: EffectMotion) -> int:
    """How often the velocity that turns least often changes its sign."""
    velocity = _velocity(motion)
    return int(np.min(np.sum(np.diff(np.sign(velocity), axis=0) != 0, axis=0)))


def own_frequency(motion: EffectMotion) -> float:
    """How often the motion repeats, Hz."""
    elapsed_s = float(motion.grid[-1] - motion.grid[0])
    velocity = _velocity(motion)
    return float(np.max(np.sum(np.diff(np.sign(velocity), axis=0) != 0, axis=0))) / 2.0 / elapsed_s


def bases_of(motion: EffectMotion, seen: Array, seen_rate: Array, scale: Scale) -> list[Basis]:
    """The components that make sense for a motion.

    Parameters
    ----------
    motion
        Of a fit.
    seen, seen_rate
        (n, d) what is predicted at the samples used, and its rate, 1/s.
    scale
        Of all clips.
    """
    readings = [
        wander(motion, seen),
        _reading_of_position(seen, scale, motion),
        _reading_of_velocity(seen, seen_rate, scale, motion),
        _clock(motion, seen_rate),
    ]
    forces = [_force_of_time(motion), _own_drift(motion)]
    if not motion.model.of_speeds:
        forces = [_force_of_position(motion, scale), *forces]
    if motion.response is not None:  # else each response is an integration, and these have hundreds
        forces += [_pulse(motion), _periodic(motion)]
    if scale.has_speed:
        forces = [_force_of_velocity(motion, scale), *forces]
    if motion.inputs is not None:
        forces.append(_input(motion))
    found = [*readings, *(basis for basis in forces if basis.columns.size)]
    return [basis for basis in found if np.all(np.isfinite(basis.columns)) and np.any(basis.columns)]


# Functions ----------------------------------------------------------------------------------------------------------


def _share(motion: EffectMotion, t_s: Array) -> Array:
    return np.asarray((t_s - motion.grid[0]) / (motion.grid[-1] - motion.grid[0]))


def _waves(share: Array, count: int) -> Array:
    """Slow courses (m, k) of time, ``share`` (m,) of the clip: a line, a parabola, half cycles, the slower the larger.

    Half cycles alone have no slope at the ends of the clip.
    """
    number = np.arange(1, count + 1)
    half_cycles = np.cos(np.pi * np.outer(share, number)) / number
    return np.concatenate([_polynomials(2.0 * share - 1.0, (1, 2)), half_cycles], axis=1)


def _slow_waves(motion: EffectMotion) -> int:
    """Half cycles in the clip below the motion's own frequency."""
    cycles = own_frequency(motion) * float(motion.grid[-1] - motion.grid[0])
    return int(np.clip(2 * SLOW * cycles, 3, MAX_WAVES)) if _turns(motion) >= MIN_TURNS else WAVES_OF_A_FALL


def _polynomials(values: Array, degrees: Sequence[int]) -> Array:
    """Legendre polynomials (m, k) of values (m,) within -1 and 1, the higher the smaller."""
    return np.column_stack(
        [legendre.legval(values, np.eye(degree + 1)[degree]) / max(degree - 1, 1) for degree in degrees]
    )


def _each(courses: Array, count: int) -> Array:
    """Courses (m, k) as (m, count, k * count): one column for each of ``count`` quantities or degrees of freedom."""
    return np.asarray(np.einsum("mk,fg->mfkg", courses, np.eye(count)).reshape(len(courses), count, -1))


def _own(values: Array, functions: Callable[[Array], Array]) -> Array:
    """Functions (m,) -> (m, k) of each column of values (m, f), as (m, f, f * k): each column has its own."""
    parts = [functions(column) for column in values.T]
    out = np.zeros((len(values), values.shape[1], sum(part.shape[1] for part in parts)))
    start = 0
    for k, part in enumerate(parts):
        out[:, k, start : start + part.shape[1]] = part
        start += part.shape[1]
    return out


def _answers(motion: EffectMotion, forces: Array) -> Array:
    """What is seen (n, d, k) of forces (m, f, k)."""
    return np.moveaxis(motion.answers(np.ascontiguousarray(np.moveaxis(forces, 2, 0))), 0, 2)


def _force_units(motion: EffectMotion) -> tuple[Quantity, ...]:
    forced = motion.model.states[motion.model.forced_states]
    named = motion.model.states[: len(forced)]
    return tuple(Quantity(state.name, rate_of(slope.unit)) for state, slope in zip(named, forced, strict=True))


def _argument(motion: EffectMotion, of_velocity: bool) -> Quantity:
    """The position, or the velocity, of the first degree of freedom."""
    first = motion.model.states[0]
    return _rate_of(first) if of_velocity and not motion.model.of_speeds else first


# Reading and clock --------------------------------------------------------------------------------------------------


def wander(motion: EffectMotion, seen: Array) -> Basis:
    """The zero of the reading moves slowly."""
    count, d = _slow_waves(motion), seen.shape[1]
    t_s = motion.grid[motion.at_samples]
    at = np.linspace(t_s[0], t_s[-1], 4 * GRID)
    curve = _each(_waves(_share(motion, at), count), d)
    columns = _each(_waves(_share(motion, t_s), count), d)
    return Basis("zero-wander", columns, at=at, quantities=tuple(motion.model.observed), curve=curve)


def _reading_of_position(seen: Array, scale: Scale, motion: EffectMotion) -> Basis:
    """The reading depends on the position: a wrong zero, scale, pivot or plane, a lens, the curve of a gauge."""
    middle, width = scale.about(scale.observed)
    degrees = range(6)

    def functions(values: Array) -> Array:
        scaled = (values - middle) / width
        own = _own(scaled, lambda column: _polynomials(column, degrees))
        return np.concatenate([own, _crossed(scaled)], axis=2)

    at, along = _line(scale.observed)
    return Basis(
        "reading-of-position", functions(seen), True, motion.model.observed[0], at,
        tuple(motion.model.observed), functions(along),
    )  # fmt: skip


def _crossed(scaled: Array) -> Array:
    """What two coordinates of a plane do to one another (m, 2, 6): u v, u^2 and v^2 of each; nothing of others."""
    if scaled.shape[1] != 2:
        return np.zeros((*scaled.shape, 0))
    u, v = scaled.T
    return _each(np.column_stack([u * v, v, u, v**2 * u, u**2 * v]), 2)


def _line(reached: Array) -> tuple[Array, Array]:
    """The range (g,) that the first quantity reaches, and all quantities (g, d) along theirs; ``reached`` (2, d)."""
    along = np.linspace(reached[0], reached[1], GRID)
    return along[:, 0], along


def _reading_of_velocity(seen: Array, seen_rate: Array, scale: Scale, motion: EffectMotion) -> Basis:
    """The reading depends on the velocity: a shift in time, a long exposure, rows of the picture read one by one."""
    (middle, width), fastest = scale.about(scale.observed), _largest(scale.rate)

    def functions(values: Array, positions: Array) -> Array:
        own = _own(values / fastest, lambda column: _polynomials(column, range(1, 5)))
        rows = _own(values / fastest * (positions - middle) / width, lambda column: column[:, None])
        return np.concatenate([own, rows], axis=2)

    at, along = _line(scale.rate)
    curve = functions(along, np.broadcast_to(middle, along.shape))
    return Basis(
        "reading-of-velocity", functions(seen_rate, seen), True, _rate_of(motion.model.observed[0]), at,
        tuple(motion.model.observed), curve,
    )  # fmt: skip


def _rate_of(quantity: Quantity) -> Quantity:
    return Quantity(f"{quantity.name} rate", rate_of(quantity.unit))


def _clock(motion: EffectMotion, seen_rate: Array) -> Basis:
    """The clock goes wrong by a course of time: lost frames, a drifting rate (Brownian motion)."""
    t_s = motion.grid[motion.at_samples]
    number = np.arange(CLOCK_WAVES) + 0.5

    def courses(share: Array) -> Array:
        return np.asarray(np.sin(np.pi * np.outer(share, number)) / number)

    at = np.linspace(t_s[0], t_s[-1], 4 * GRID)
    columns = seen_rate[:, :, None] * courses(_share(motion, t_s))[:, None]
    curve = courses(_share(motion, at))[:, None]
    return Basis("clock", columns, at=at, quantities=(Quantity("t", "s"),), curve=curve)


# Forces -------------------------------------------------------------------------------------------------------------


def _force_of_velocity(motion: EffectMotion, scale: Scale) -> Basis:
    """A force along the velocity of each body, a function of its speed with a jump at zero; of a speed also even."""
    fastest = _largest(scale.velocity)

    def functions(velocity: Array) -> Array:
        parts = []
        for body in bodies_of(motion.model):
            speed = np.linalg.norm(velocity[:, body] / fastest[body].max(), axis=1)
            direction = velocity[:, body] / fastest[body].max() / np.maximum(speed, 1e-300)[:, None]
            sizes = np.column_stack([speed / np.hypot(speed, JUMP), speed, speed**2, speed**3])
            part = np.zeros((*velocity.shape, sizes.shape[1]))
            part[:, body] = direction[:, :, None] * sizes[:, None]
            parts.append(part)
        if motion.model.of_speeds:
            parts.append(_own(velocity / fastest, lambda column: _polynomials(column, (0, 2))))
        return np.concatenate(parts, axis=2)

    at, along = _line(scale.velocity)
    return Basis(
        "force-of-velocity", _answers(motion, functions(_velocity(motion))), True, _argument(motion, True), at,
        _force_units(motion), functions(along),
    )  # fmt: skip


def _force_of_position(motion: EffectMotion, scale: Scale) -> Basis:
    """A force that is a function of the position of each degree of freedom."""
    middle, width = scale.about(scale.position)

    def functions(positions: Array) -> Array:
        return _own((positions - middle) / width, lambda column: _polynomials(column, range(6)))

    count = motion.model.degrees_of_freedom
    at, along = _line(scale.position)
    return Basis(
        "force-of-position", _answers(motion, functions(motion.states[:, :count])), True, _argument(motion, False), at,
        _force_units(motion), functions(along),
    )  # fmt: skip


def _force_of_time(motion: EffectMotion) -> Basis:
    """A force that changes slowly with time."""
    at = np.linspace(motion.grid[0], motion.grid[-1], 4 * GRID)
    count, freedoms = _slow_waves(motion), motion.model.degrees_of_freedom
    forces, curve = (_each(_waves(_share(motion, times), count), freedoms) for times in (motion.grid, at))
    return Basis("force-of-time", _answers(motion, forces), at=at, quantities=_force_units(motion), curve=curve)


def _own_drift(motion: EffectMotion) -> Basis:
    """The model's own force changes slowly with time, by a factor."""
    at = np.linspace(motion.grid[0], motion.grid[-1], 4 * GRID)
    own = motion.slopes[:, motion.model.forced_states]
    factors, curve = (_waves(_share(motion, times), DRIFT_WAVES) for times in (motion.grid, at))
    columns = _answers(motion, own[:, :, None] * factors[:, None])
    return Basis("own-force-drift", columns, at=at, quantities=(Quantity("factor", "1"),), curve=curve[:, None])


def _pulse(motion: EffectMotion) -> Basis:
    """A short force at one moment."""
    moments_s = np.linspace(motion.grid[0], motion.grid[-1], MOMENTS + 2)[1:-1]
    width_s = max(2.0 * float(np.median(np.diff(motion.grid[motion.at_samples]))), moments_s[1] - moments_s[0])
    pulses = np.maximum(1.0 - np.abs(motion.grid[:, None] - moments_s) / width_s, 0.0)
    count = motion.model.degrees_of_freedom
    columns = _answers(motion, _each(pulses, count))
    return Basis("pulse", columns, choices=np.repeat(moments_s, count))


def _periodic(motion: EffectMotion) -> Basis:
    """A sine of any phase, at a frequency away from the motion's own and its harmonics."""
    elapsed_s = float(motion.grid[-1] - motion.grid[0])
    most = max(min(MAX_CYCLES, motion.at_samples.size / SAMPLES_A_CYCLE), 1.5)
    cycles = np.arange(1.0, most, 0.5)
    own = own_frequency(motion) * elapsed_s * np.arange(1, HARMONICS + 1)
    cycles = cycles[np.min(np.abs(cycles[:, None] - own), axis=1) > APART] if motion.inputs is None else cycles
    phase = 2 * np.pi * np.outer(motion.grid - motion.grid[0], cycles) / elapsed_s
    courses = np.stack([np.sin(phase), np.cos(phase)], axis=2).reshape(motion.grid.size, -1)
    count = motion.model.degrees_of_freedom
    columns = _answers(motion, _each(courses, count)) if cycles.size else np.zeros((motion.at_samples.size, 1, 0))
    return Basis("periodic-force", columns, choices=np.repeat(cycles / elapsed_s, 2 * count))


def _input(motion: EffectMotion) -> Basis:
    """A measured input has another gain, comes later, or enters by its square."""
    assert motion.inputs is not None
    forced, columns = motion.model.forced_states, []
    for k in range(motion.inputs.shape[1]):
        given = motion.inputs[:, k]
        largest = max(float(np.max(np.abs(given))), 1e-300)
        late = np.gradient(given, motion.grid)
        late *= largest / max(float(np.max(np.abs(late))), 1e-300)
        for change in (given, late, given * np.abs(given) / largest):
            columns.append(_changed_rates(motion, k, 1e-4 * change)[:, forced] / 1e-4)
    return Basis("input", _answers(motion, np.stack(columns, axis=2)), True)


def _changed_rates(motion: EffectMotion, k: int, change: Array) -> Array:
    """By how much the rates (m, s) change with a small change (m,) of an input."""
    assert motion.inputs is not None
    sides = []
    for sign in (1.0, -1.0):
        inputs = motion.inputs.copy()
        inputs[:, k] += sign * change
        sides.append(rates(motion.model, motion.grid, motion.states, motion.values, inputs))
    return np.asarray(0.5 * (sides[0] - sides[1]))
