"""The boxes of the flow: each is frozen, checked when made, and read-only.

Arrays are float64 unless said otherwise and cannot be written to. NaN means "not known";
``valid`` says so explicitly. Pixels: x right, y down, origin at the centre of pixel (0, 0).
World: x right, z up.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Any, Literal, Protocol

import numpy as np
from numpy.typing import NDArray

from iris_sysid.arrays import Array as Array
from iris_sysid.arrays import Mask as Mask
from iris_sysid.arrays import frozen_array, frozen_mask, increasing_times
from iris_sysid.errors import DataError

NORMAL_975 = 1.959963984540054  # 97.5 % quantile of the standard normal


# --------------------------------------------------------------------------- names and numbers


@dataclass(frozen=True, slots=True)
class Quantity:
    """A named quantity with its unit, e.g. ``Quantity("theta", "rad", r"\\theta")``."""

    name: str
    unit: str
    symbol: str = ""

    @property
    def column(self) -> str:
        """Name of the column that holds it in a table, e.g. ``theta_rad``."""
        return f"{self.name}_{unit_suffix(self.unit)}"


def unit_suffix(unit: str) -> str:
    """Spell a unit as the end of a column name: ``m/s^2`` becomes ``m_s2``, no unit becomes ``1``."""
    return unit.replace("^", "").replace("/", "_").replace(" ", "_").replace("-", "") or "1"


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard error, unit and origin.

    ``measurement_type`` is ``fitted``, ``direct`` (measured by hand), ``assumed``, ``derived`` or
    ``metadata``. ``stderr`` is NaN where the data do not determine it. ``ci95`` is normal unless given.
    ``source`` says where the value comes from, in words.
    """

    value: float
    stderr: float
    unit: str
    measurement_type: str = "fitted"
    source: str = ""
    ci95: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval (lower, upper)."""
        if self.ci95 is not None:
            return self.ci95
        return (self.value - NORMAL_975 * self.stderr, self.value + NORMAL_975 * self.stderr)


# --------------------------------------------------------------------------- frames


@dataclass(frozen=True, eq=False, slots=True)
class Frame:
    """One decoded frame. ``luma`` is (h, w) uint8; ``bgr()`` converts to (h, w, 3) uint8 when asked."""

    index: int
    t_s: float
    luma: NDArray[np.uint8]
    bgr: Callable[[], NDArray[np.uint8]]


class FrameSource(Protocol):
    """What a tracker is given: frames in order, as often as it asks, with the container's exact times."""

    @property
    def width(self) -> int:
        """Width in pixels, as displayed (rotation applied)."""

    @property
    def height(self) -> int:
        """Height in pixels, as displayed."""

    @property
    def n_expected(self) -> int:
        """Number of frames that the container promises (0 when it does not say)."""

    def frames(self) -> Iterator[Frame]:
        """Decode every frame from the start, in display order."""

    def sample(self, count: int) -> list[Frame]:
        """About ``count`` frames spread evenly over the clip, as cheaply as the container allows."""


@dataclass(frozen=True, slots=True)
class TrackOptions:
    """What a user may tell any tracker.

    ``roi`` is (x, y, width, height) in px. ``colour`` is a name or ``#rrggbb``: only pixels of about
    that hue count. ``progress`` is called with (frames done, frames expected).
    """

    bodies: int = 1
    roi: tuple[int, int, int, int] | None = None
    colour: str | None = None
    progress: Callable[[int, int], None] | None = None


# --------------------------------------------------------------------------- track and trajectory


TRACK_SIGMAS = ("sigma_radius_px", "sigma_angle_rad", "sigma_intensity")


@dataclass(frozen=True, eq=False, slots=True)
class Track:
    """One body, in pixels, over the frames of a clip.

    ``t_s`` (n,) s; ``xy_px`` and ``sigma_px`` (n, 2) px, standard error of each coordinate;
    ``valid`` (n,). Optional (n,): ``radius_px`` apparent radius, ``angle_rad`` orientation
    (anticlockwise as seen), ``intensity`` grey levels, ``area_px`` pixels in the blob, ``hand``
    (true where something that reaches in from the edge of the picture touches the body), and the standard
    errors ``sigma_radius_px``, ``sigma_angle_rad``, ``sigma_intensity`` of what they are named after.
    ``frame`` (n,) is the number of each frame in the file. A gap is NaN and not valid.
    """

    t_s: Array
    xy_px: Array
    sigma_px: Array
    valid: Mask
    frame: NDArray[np.int64]
    body: str = "1"
    radius_px: Array | None = None
    angle_rad: Array | None = None
    intensity: Array | None = None
    area_px: Array | None = None
    hand: Mask | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)
    sigma_radius_px: Array | None = None
    sigma_angle_rad: Array | None = None
    sigma_intensity: Array | None = None

    def __post_init__(self) -> None:
        times = increasing_times(self.t_s)
        n = times.size
        valid = frozen_mask(self.valid, n, "valid")
        for name, value in (
            ("t_s", times),
            ("xy_px", frozen_array(self.xy_px, (n, 2), "xy_px")),
            ("sigma_px", frozen_array(self.sigma_px, (n, 2), "sigma_px")),
            ("valid", valid),
            ("origin", MappingProxyType(dict(self.origin))),
        ):
            object.__setattr__(self, name, value)
        frame = np.array(self.frame, dtype=np.int64)
        if frame.shape != (n,):
            raise DataError(f"frame must have shape ({n},), not {frame.shape}")
        frame.flags.writeable = False
        object.__setattr__(self, "frame", frame)
        for name in ("radius_px", "angle_rad", "intensity", "area_px", *TRACK_SIGMAS):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, frozen_array(getattr(self, name), (n,), name))
        if self.hand is not None:
            object.__setattr__(self, "hand", frozen_mask(self.hand, n, "hand"))
        if not np.all(np.isfinite(self.xy_px[valid])):
            raise DataError("a valid sample has a position that is not finite; mark it as a gap")

    @property
    def n_valid(self) -> int:
        """Number of frames in which the body was found."""
        return int(self.valid.sum())


MotionKind = Literal["oscillation", "slide", "flight", "any"]
SegmentLabel = Literal["hand", "release", "motion", "contact", "rest"]


@dataclass(frozen=True, slots=True)
class Segment:
    """Samples ``start`` to ``stop - 1`` of a trajectory, and what happens in them."""

    label: SegmentLabel
    start: int
    stop: int
    reason: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Smoothed:
    """Kalman/RTS estimate at each sample, gaps bridged.

    ``position`` and ``velocity`` (n, d); ``covariance`` (n, 2d, 2d), ordered positions then
    velocities; ``psd`` is the process noise chosen, one a quantity, in unit^2/s^3;
    ``nis`` is the mean normalised innovation squared per quantity (1 when the filter is consistent).
    """

    position: Array
    velocity: Array
    covariance: Array
    psd: Array
    nis: Array

    def __post_init__(self) -> None:
        position = np.asarray(self.position)
        if position.ndim != 2:
            raise DataError(f"smoothed position must be (n, d), not {position.shape}")
        n, d = position.shape
        object.__setattr__(self, "position", frozen_array(position, (n, d), "position"))
        object.__setattr__(self, "velocity", frozen_array(self.velocity, (n, d), "velocity"))
        object.__setattr__(self, "covariance", frozen_array(self.covariance, (n, 2 * d, 2 * d), "covariance"))
        object.__setattr__(self, "psd", frozen_array(self.psd, (d,), "psd"))
        object.__setattr__(self, "nis", frozen_array(self.nis, (d,), "nis"))


@dataclass(frozen=True, eq=False, slots=True)
class Trajectory:
    """Measured quantities over time, in SI (or in px where no scale is known; the unit says so).

    ``t_s`` (n,) s; ``position`` (n, d) as measured, in the units of ``quantities``; ``sigma`` (n, d)
    random standard error of each sample, NaN where unknown; ``valid`` (n,). ``inputs`` (n, m) are
    known inputs u(t) in the units of ``input_quantities``. ``segments`` say what happens when.
    ``geometry`` holds what was measured on the way here (pivot, angle of the board, scale), with its
    uncertainty, which is common to all samples. ``smoothed`` is there after :func:`iris_sysid.smooth`.
    """

    t_s: Array
    quantities: tuple[Quantity, ...]
    position: Array
    sigma: Array
    valid: Mask
    input_quantities: tuple[Quantity, ...] = ()
    inputs: Array | None = None
    segments: tuple[Segment, ...] = ()
    geometry: Mapping[str, Estimate] = field(default_factory=dict)
    smoothed: Smoothed | None = None
    origin: Mapping[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        times = increasing_times(self.t_s)
        n, d = times.size, len(self.quantities)
        if d == 0:
            raise DataError("a trajectory needs at least one quantity")
        position = frozen_array(self.position, (n, d), "position")
        valid = frozen_mask(self.valid, n, "valid")
        inputs = self.inputs
        if self.input_quantities:
            inputs = frozen_array(
                np.full((n, len(self.input_quantities)), np.nan) if inputs is None else inputs,
                (n, len(self.input_quantities)),
                "inputs",
            )
        if not np.all(np.isfinite(position[valid])):
            raise DataError("a valid sample has a position that is not finite; mark it as a gap")
        for segment in self.segments:
            if not 0 <= segment.start < segment.stop <= n:
                raise DataError(f"segment {segment} does not lie within the {n} samples")
        for name, value in (
            ("t_s", times),
            ("position", position),
            ("sigma", frozen_array(self.sigma, (n, d), "sigma")),
            ("valid", valid),
            ("inputs", inputs),
            ("quantities", tuple(self.quantities)),
            ("segments", tuple(self.segments)),
            ("geometry", MappingProxyType(dict(self.geometry))),
            ("origin", MappingProxyType(dict(self.origin))),
        ):
            object.__setattr__(self, name, value)

    @property
    def n(self) -> int:
        """Number of samples, gaps included."""
        return int(self.t_s.size)

    def column(self, name: str) -> int:
        """Index of the quantity of that name; DataError lists the names there are."""
        names = [quantity.name for quantity in self.quantities]
        if name not in names:
            raise DataError(f"the trajectory has no quantity {name!r}; it has {', '.join(names)}")
        return names.index(name)

    def mask(self, *labels: SegmentLabel) -> Mask:
        """True for samples in a segment of one of these labels (all samples when nothing is segmented)."""
        if not self.segments:
            return np.ones(self.n, dtype=np.bool_)
        inside = np.zeros(self.n, dtype=np.bool_)
        for segment in self.segments:
            if segment.label in labels:
                inside[segment.start : segment.stop] = True
        return inside

    def with_(self, **changes: Any) -> Trajectory:
        """A copy with some fields replaced."""
        return replace(self, **changes)


# --------------------------------------------------------------------------- calibration


@dataclass(frozen=True, eq=False, slots=True)
class Calibration:
    """How pixels become metres in the plane of motion; :func:`iris_sysid.to_world` applies it.

    ``homography`` (3, 3) maps homogeneous (x, y, 1) px, y down, to metres, z up. ``scale`` is px per
    ``unit`` with its standard error, which is common to all samples. ``unit`` is ``m``, or ``px``
    when no scale is known: then angles and times are still right, lengths are not.
    """

    homography: Array
    scale: Estimate
    unit: Literal["m", "px"] = "m"
    source: str = ""

    def __post_init__(self) -> None:
        object.__setattr__(self, "homography", frozen_array(self.homography, (3, 3), "homography"))


# --------------------------------------------------------------------------- models


@dataclass(frozen=True, slots=True)
class Parameter:
    """A parameter of a model: name, unit, LaTeX symbol, bounds.

    ``default`` is used where a model's guess gives no value. ``constant`` parameters are held at
    their default unless freed (``--free``); ``source`` says where the default comes from and
    ``stderr`` how well it is known.
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


# dstate/dt as a tuple, from (t, state, params): scalars and tuples only, so that numba can compile it.
# A model that declares inputs takes a fourth argument: (t, state, params, inputs).
RightHandSide = Callable[..., tuple[float, ...]]


@dataclass(frozen=True, eq=False, slots=True)
class OdeModel:
    """A governing equation with its parameters: what the ODE engine fits.

    ``states`` in the order that ``rhs`` takes them; the initial value of state ``theta`` is a
    parameter named ``theta_0``. ``rhs(t, state, params)`` returns the derivatives as a tuple;
    ``params`` is in the order of ``parameters``. The observed quantities are ``observed``: names of
    states, unless ``observe(t_s, states (n, s), params (p,)) -> (n, d)`` is given, which must accept
    arrays. ``guess(trajectory)`` returns starting values by name for parameters and initial states.
    ``derive(values)`` returns further quantities (declared in ``derived``) from all values by name.
    ``first_integral(states (n, s), params (p,)) -> (n,)`` is conserved when the parameters named in
    ``dissipative`` are zero. ``warp(t_s, params (p,))``, where given, returns the times of the motion
    that the samples at ``t_s`` show.
    """

    name: str
    summary: str
    equation: str
    source: str
    states: tuple[Quantity, ...]
    parameters: tuple[Parameter, ...]
    observed: tuple[Quantity, ...]
    rhs: RightHandSide
    guess: Callable[[Trajectory], Mapping[str, float]]
    inputs: tuple[Quantity, ...] = ()
    observe: Callable[[Array, Array, Array], Array] | None = None
    derived: tuple[Quantity, ...] = ()
    derive: Callable[[Mapping[str, float]], Mapping[str, float]] | None = None
    first_integral: Callable[[Array, Array], Array] | None = None
    dissipative: tuple[str, ...] = ()
    warp: Callable[[Array, Array], Array] | None = None

    @property
    def second_order(self) -> bool:
        """Whether the states are positions followed by their velocities, in the same order."""
        half, odd = divmod(len(self.states), 2)
        pairs = zip(self.states[:half], self.states[half : 2 * half], strict=True)
        return not odd and half > 0 and all(rate.unit == f"{place.unit}/s" for place, rate in pairs)

    def parameter(self, name: str) -> Parameter:
        """The parameter of that name; DataError lists the names there are."""
        for parameter in self.parameters:
            if parameter.name == name:
                return parameter
        names = ", ".join(parameter.name for parameter in self.parameters)
        raise DataError(f"model {self.name!r} has no parameter {name!r}; it has {names}")


@dataclass(frozen=True, eq=False, slots=True)
class Effect:
    """Something that a governing equation may lack; one of its four maps acts, the others are None.

    ``parameters``: the first is the size, and at zero the effect is absent. In a unit, ``{x}`` stands
    for the unit of the observed quantity: quadratic drag of an angle has the unit 1/rad.

    ``acceleration(t, position, velocity, speed, base, params)`` returns what is added to one second
    derivative ``base`` of a model of second order, or to one rate of a model of first order (there
    ``velocity`` is that rate). It is called for each component of each body; ``speed`` is the norm of
    the body's velocity, and all are numbers, so that numba can compile it.
    ``observe(t_s, observed (n, d), velocity (n, d), params)`` returns what the camera sees (n, d).
    ``warp(t_s, params)`` returns the times (n,) at which the motion really was.
    ``applies(model)`` says whether the effect makes sense for a model.
    ``alike`` names effects and parameters that do nearly the same, in words.
    """

    name: str
    summary: str
    equation: str
    source: str
    parameters: tuple[Parameter, ...]
    applies: Callable[[OdeModel], bool]
    acceleration: Callable[..., float] | None = None
    observe: Callable[[Array, Array, Array, Array], Array] | None = None
    warp: Callable[[Array, Array], Array] | None = None
    alike: str = ""


FitStatus = Literal["ok", "at-bound", "singular", "diverged", "too-short", "not-converged", "misfit"]


@dataclass(frozen=True, eq=False, slots=True)
class FitResult:
    """A model fitted to a trajectory.

    ``estimates`` by name: fitted parameters, constants, initial states and derived quantities.
    ``free`` names the fitted ones, in the order of ``covariance`` (p, p), which allows for
    autocorrelated residuals. ``predicted`` and ``residual`` (n, d) at every sample of the
    trajectory, residual = observed - predicted, NaN outside ``used`` (n,). ``noise`` (d,) is the
    standard deviation of the measurement estimated independently of the model, ``rms`` (d,) that of
    the residual. ``jacobian`` (n_used * d, p) is d predicted / d free, time-major.
    ``fisher`` (p, p) is the Fisher information for white noise, ``condition`` its condition number
    after scaling each parameter to unit information. ``budget[name][source]`` is the standard error
    of a parameter from each source. ``t0_s`` is the time at which the initial states hold.
    """

    model: OdeModel
    status: FitStatus
    message: str
    estimates: Mapping[str, Estimate]
    free: tuple[str, ...]
    covariance: Array
    t_s: Array
    used: Mask
    predicted: Array
    residual: Array
    noise: Array
    rms: Array
    aic: float
    bic: float
    jacobian: Array
    fisher: Array
    condition: float
    correlation: float
    t0_s: float
    budget: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    origin: Mapping[str, Any] = field(default_factory=dict)

    @property
    def ok(self) -> bool:
        """Whether the estimates can be used as they are."""
        return self.status == "ok"

    @property
    def usable(self) -> bool:
        """Whether there are estimates at all; with a status other than ok they come with a reservation."""
        return self.status in ("ok", "misfit", "at-bound", "singular")

    @property
    def n(self) -> int:
        """Number of samples used."""
        return int(self.used.sum())


# --------------------------------------------------------------------------- plugins


@dataclass(frozen=True, eq=False, slots=True)
class Tracker:
    """A tracking algorithm: frames in, one Track a body out. One file in ``trackers`` holds one."""

    name: str
    summary: str
    track: Callable[[FrameSource, TrackOptions], list[Track]]


@dataclass(frozen=True, eq=False, slots=True)
class Phenomenon:
    """One row of the benchmark: which tracker, how positions become the observable, which model.

    ``observe(world, settings)`` turns trajectories of x and z (one a body, segmented) into the one
    the model observes; ``settings`` holds what the user stated (ball radius, board angle, pivot).
    ``motion`` is the kind of motion that the segmentation looks for. ``free`` names constants of the
    model that a video leaves open, e.g. the direction of the vertical. ``refine(fit, trajectory)``
    returns settings that the fit knows better than the geometry did, for another pass. ``settings``
    names what ``observe`` may be told beside the parameters of the model.
    """

    name: str
    summary: str
    tracker: str
    model: str
    observe: Callable[[Sequence[Trajectory], Mapping[str, Estimate]], Trajectory]
    motion: MotionKind = "any"
    bodies: int = 1
    free: tuple[str, ...] = ()
    refine: Callable[[FitResult, Trajectory], Mapping[str, Estimate]] | None = None
    settings: tuple[str, ...] = ()
