"""From a request to a fit that is prepared to run, and the error of one that cannot."""

from __future__ import annotations

from collections.abc import Mapping

from fitters.integrator.initial_value_problem import value_names
from fitters.ode.fit_problem import (
    PreparedFit,
    check_columns,
    check_names,
    in_units_of,
    known_values,
    prepare,
    priors_of,
    select,
)
from fitters.ode.request import FitRequest
from fitters.ode.result import failed
from fitters.ode.status import needed_samples, too_few_samples
from iris_sysid.errors import FitError
from iris_sysid.types import Estimate, FitProblem, FitResult, FitStatus, OdeModel


class NoMinimumError(FitError):
    """A failed fit; ``result`` says why."""

    def __init__(self, result: FitResult) -> None:
        super().__init__(result.message)
        self.result = result


def task_of(request: FitRequest) -> PreparedFit:
    """The checked and prepared request; NoMinimumError when it has too few samples for its unknowns."""
    trajectory, model = request.trajectory, request.model.in_unit_of(request.trajectory)
    check_names(model, fixed=list(request.fixed), free=list(request.free), start=list(request.start))
    check_columns(trajectory, model)
    known = known_values(model, trajectory, request.fixed, request.free)
    priors = priors_of(model, trajectory, request.fixed, request.free)
    model = in_units_of(trajectory, model)
    selection = select(trajectory, request.options.segments)
    n_free = len(value_names(model)) - len(known)
    n, needed = int(selection.used.sum()), needed_samples(len(model.observed), n_free)
    if n < needed:
        raise no_minimum(request, model, known, "too-short", too_few_samples(n, needed, n_free))
    return prepare(trajectory, model, selection, known, priors)


def no_minimum(
    request: FitRequest, model: OdeModel, known: Mapping[str, Estimate], status: FitStatus, problem: FitProblem
) -> NoMinimumError:
    """The error that ends a fit.

    Parameters
    ----------
    request, model
        The request, and its model in the units of the data.
    known
        The values held, by name.
    status, problem
        Why there is no minimum.
    """
    return NoMinimumError(failed(request.trajectory, model, known, status, problem))
