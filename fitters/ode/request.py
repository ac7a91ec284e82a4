"""The request for a fit: one type for a single clip, several clips, model selection and diagnosis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from fitters.ode.rest_position import held_zeros, off_zero
from iris_sysid.trajectory.consistency.angle_unit import with_degrees_doubt

if TYPE_CHECKING:
    from fitters.ode.least_squares import Loss
    from iris_sysid.types import Estimate, OdeModel, SegmentLabel, Trajectory

NOTHING: Mapping[str, float] = MappingProxyType({})


@dataclass(frozen=True, slots=True)
class FitOptions:
    """Options of a fit that are rarely changed.

    ``segments``: labels of the segments whose samples are used. ``loss``: ``linear`` (least squares) or ``soft_l1``
    (large residuals count less); with both, single samples far from their neighbours' residual are left out, and a
    note says how many. ``multistart``: number of random starts to try when no start explains the data.
    ``local``: the start is near the minimum, e.g. that of a simpler model; minimise from it without a global search.
    ``growing``: with ``local``, fit the first samples first, then ever more of them.
    ``discrepancy``: where the residual is more than noise, add to the errors what the equation may lack.
    ``unseen_drag``: with ``discrepancy``, add to the errors of a fall with gravity estimated the drag that its data
    cannot rule out; false where there is none, as in a vacuum.
    ``rough``: with ``local`` and a linear loss, to compare models: stop where a step changes the sum of squares by
    less than 1e-4, and leave out only samples that stand out of the data, whatever the model.
    """

    segments: tuple[SegmentLabel, ...] = ("motion",)
    loss: Loss = "linear"
    multistart: int = 8
    local: bool = False
    growing: bool = False
    discrepancy: bool = True
    unseen_drag: bool = True
    rough: bool = False


DEFAULT_OPTIONS = FitOptions()


@dataclass(frozen=True, eq=False, slots=True)
class FitRequest:
    """A trajectory, the model to fit to it, and what is known beforehand; see :func:`fitters.ode.fit`."""

    trajectory: Trajectory
    model: OdeModel
    fixed: Mapping[str, float | Estimate] = field(default_factory=dict)
    free: Sequence[str] = ()
    start: Mapping[str, float] = field(default_factory=dict)
    uncertainty: Sequence[str] = ("robust",)
    options: FitOptions = DEFAULT_OPTIONS

    @classmethod
    def stated(
        cls,
        trajectory: Trajectory,
        model: OdeModel,
        fixed: Mapping[str, float | Estimate] = NOTHING,
        free: Sequence[str] = (),
    ) -> FitRequest:
        """The request with what the trajectory states and leaves open; ``fixed`` and ``free`` go before that.

        A rest position that nobody states is estimated where the motion swings without passing zero.

        Parameters
        ----------
        trajectory
            Its ``known`` and ``free`` count where the model has a parameter of that name.
        model
            The governing equation.
        fixed, free
            As for :func:`fitters.ode.fit`. A value that the trajectory knows exactly is estimated where it is free.
        """
        trajectory = with_degrees_doubt(trajectory, model)
        names = {parameter.name for parameter in model.parameters}
        stated = {name: value for name, value in trajectory.known.items() if name in names}
        known = {name: value for name, value in stated.items() if value.stderr or name not in free}
        held = {**known, **fixed}
        opened = [name for name in trajectory.free if name in names and name not in held]
        rests = held_zeros(trajectory, model, {*held, *free, *opened})
        opened += rests if rests and off_zero(trajectory, model) else ()
        return cls(trajectory, model, held, list(dict.fromkeys([*free, *opened])))

    def with_(self, **changes: Any) -> FitRequest:
        """A copy with some fields replaced."""
        return replace(self, **changes)

    def roughly(self) -> FitRequest:
        """The request for a fit that only compares models."""
        return self.with_(options=replace(self.options, rough=True))

    def from_near(self, start: Mapping[str, float]) -> FitRequest:
        """A copy that starts near its minimum and skips the global search, and the errors of a discrepancy."""
        return replace(self, start=start, options=replace(self.options, local=True, discrepancy=False))
