"""A trajectory in world units, its segments, and its smoothed states."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any, Literal, get_args

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types._arrays import Array, Mask, check_size, frozen_array, frozen_mask, increasing_times
from iris_sysid.types._display import Shown, text_of, with_units
from iris_sysid.types._error_autocorrelation import ErrorAutocorrelation
from iris_sysid.types._numbers import Estimate, Quantity
from iris_sysid.types._pickling import Portable
from iris_sysid.types._verdict import Doubt
from iris_sysid.types._view import Sensor, View

if TYPE_CHECKING:
    import pandas as pd

MotionKind = Literal["oscillation", "slide", "flight", "any", "whole"]
SegmentLabel = Literal["hand", "release", "motion", "contact", "rest"]
Hold = Literal["linear", "zero-order"]  # how an input varies between samples


@dataclass(frozen=True, slots=True)
class Segment:
    """Samples ``start`` to ``stop - 1`` of a trajectory, and what happens in them."""

    label: SegmentLabel
    start: int
    stop: int
    reason: str = ""


@dataclass(frozen=True, eq=False, slots=True)
class Smoothed(Shown, Portable):
    """Kalman/RTS estimate at each sample, gaps bridged.

    ``position`` and ``velocity`` (n, d); ``covariance`` (n, 2d, 2d), ordered positions then
    velocities; ``psd`` is the process noise chosen, one a quantity, in unit^2/s^5;
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

    def __repr__(self) -> str:
        n, d = self.position.shape
        return f"Smoothed state of {d} quantit{'y' if d == 1 else 'ies'} at {n} samples"


@dataclass(frozen=True, eq=False, slots=True)
class Trajectory(Shown, Portable):
    """Measured quantities over time, in SI (or in px where no scale is known; the unit says so).

    ``t_s`` (n,) s; ``position`` (n, d) as measured, in the units of ``quantities``; ``sigma`` (n, d)
    random standard error of each sample, NaN where unknown; ``valid`` (n,). ``inputs`` (n, m) are
    known inputs u(t) in the units of ``input_quantities``; between samples they vary on a line (``hold`` is ``linear``)
    or keep the value of the last sample (``zero-order``). ``segments`` say what happens when.
    ``geometry`` holds what was measured on the way here (pivot, angle of the board, scale), with its
    uncertainty, which is common to all samples. ``systematic`` holds, by source, what errors of the positions have in
    common: (r, n, d), r independent patterns, each the change of every position for one standard error; an average over
    samples does not shrink them. ``smoothed`` is there after :func:`iris_sysid.smooth`. ``error_autocorrelation`` says
    how long the random errors of the positions last, ``first_frame`` is the number in the video of the first sample
    (None where frames were left out); both None where not known. ``sensor`` is what measured, and ``view``, where it is
    known, how the quantities lie in the image of a camera. ``doubts`` are those about the track that it was made from.
    ``known`` and ``free``: constants of an equation that were stated, and those that were left open, when it was made;
    a fit of a model that has them holds or estimates them, unless told otherwise. ``origin`` records the source
    of the trajectory; nothing is computed from it.
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
    systematic: Mapping[str, Array] = field(default_factory=dict)
    error_autocorrelation: ErrorAutocorrelation | None = None
    first_frame: int | None = None
    sensor: Sensor = "unknown"
    view: View | None = None
    doubts: tuple[Doubt, ...] = ()
    known: Mapping[str, Estimate] = field(default_factory=dict)
    free: tuple[str, ...] = ()
    hold: Hold = "linear"

    def __post_init__(self) -> None:
        if self.hold not in get_args(Hold):
            raise DataError(f"hold must be {' or '.join(get_args(Hold))}, not {self.hold!r:.40}")
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
        check_size(position[valid], "a position")
        if self.input_quantities:
            check_size(np.asarray(inputs), "an input")
        for segment in self.segments:
            if not 0 <= segment.start < segment.stop <= n:
                raise DataError(f"segment {segment} does not lie within the {n} samples")
        systematic = {
            source: frozen_array(patterns, (None, n, d), f"systematic[{source!r}]")
            for source, patterns in self.systematic.items()
        }
        for name, value in (
            ("t_s", times),
            ("position", position),
            ("sigma", frozen_array(self.sigma, (n, d), "sigma")),
            ("valid", valid),
            ("inputs", inputs),
            ("quantities", tuple(self.quantities)),
            ("segments", tuple(self.segments)),
            ("geometry", MappingProxyType(dict(self.geometry))),
            ("systematic", MappingProxyType(systematic)),
            ("origin", MappingProxyType(dict(self.origin))),
            ("known", MappingProxyType(dict(self.known))),
            ("free", tuple(self.free)),
        ):
            object.__setattr__(self, name, value)

    @classmethod
    def from_frame(cls, frame: pd.DataFrame, columns: Mapping[str, str] | None = None) -> Trajectory:
        """Make a trajectory of a pandas DataFrame; see :func:`iris_sysid.from_frame`."""
        from iris_sysid import from_frame  # the front door: tables are read by a package above this one

        return from_frame(frame, columns)

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

    def inputs_at(self, t_s: Array) -> Array | None:
        """The inputs (k, m) at times ``t_s`` (k,) s, on a line or held between samples; None where there are none."""
        if self.inputs is None or not self.input_quantities:
            return None
        if self.hold == "zero-order":
            last = np.searchsorted(self.t_s, t_s, side="right") - 1
            return np.asarray(self.inputs[np.maximum(last, 0)])
        return np.column_stack([np.interp(t_s, self.t_s, column) for column in self.inputs.T])

    def mask(self, *labels: SegmentLabel) -> Mask:
        """True for samples in a segment of one of these labels (all samples when nothing is segmented). Shape (n,)."""
        if not self.segments:
            return np.ones(self.n, dtype=np.bool_)
        inside = np.zeros(self.n, dtype=np.bool_)
        for segment in self.segments:
            if segment.label in labels:
                inside[segment.start : segment.stop] = True
        return inside

    def with_(self, **changes: Any) -> Trajectory:
        """A copy with some fields replaced; other positions drop ``systematic``, other quantities ``view``."""
        if "position" in changes:
            changes = {"systematic": {}, **changes}
        if "quantities" in changes:
            changes = {"view": None, **changes}
        return replace(self, **changes)

    def __repr__(self) -> str:
        gaps = self.n - int(self.valid.sum())
        beside = {
            "inputs": ", ".join(quantity.name for quantity in self.input_quantities),
            "segments": ", ".join(f"{part.label} {part.start}-{part.stop - 1}" for part in self.segments),
            "geometry": ", ".join(self.geometry),
            "doubts": ", ".join(doubt.kind for doubt in self.doubts),
        }
        return text_of(
            f"Trajectory of {with_units(self.quantities)}: {self.n} samples from {self.t_s[0]:g} to {self.t_s[-1]:g} s"
            + (f", {gaps} of them gaps" if gaps else ""),
            "; ".join(f"{name}: {names}" for name, names in beside.items() if names),
        )
