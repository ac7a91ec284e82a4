"""A discovered equation as a fitted model of pysindy: it predicts, simulates, scores and prints itself there.

pysindy knows equations of first order only: an equation of second order is one of values and their rates.
"""

from __future__ import annotations

import re
from typing import Any, NamedTuple

import numpy as np

from iris_sysid.errors import DataError
from iris_sysid.types import Array, Discovery, OdeModel


def to_pysindy(discovery: Discovery) -> Any:
    """The equation as a fitted ``pysindy.SINDy``, for its ``predict``, ``simulate``, ``score``, ``print``.

    Parameters
    ----------
    discovery
        What :func:`discover` found.

    Returns
    -------
    pysindy.SINDy
        ``feature_names`` are the states of ``discovery.model`` in its order, in their units: for an equation of second
        order the values and then their rates (``theta``, ``d_theta``); for an apparent radius the reciprocal. Inputs
        are its control variables. Features are the terms of the equation. ``coefficients()`` (states, features) holds
        the fitted values, without their errors; ``fit`` on other data estimates them anew by pysindy.

    Raises
    ------
    DataError
        When the discovery has no usable fit.

    Examples
    --------
    >>> import numpy as np
    >>> from iris_sysid import MODELS, Trajectory, discover, simulate, to_pysindy
    >>> spring, t_s = MODELS["linear-oscillator"], np.arange(300) / 60
    >>> z = simulate(spring, t_s, {"stiffness": 20.0, "damping": 0.3, "z_0": 0.2, "vz_0": 0.0}).observed
    >>> z += 1e-4 * np.random.default_rng(0).standard_normal(z.shape)
    >>> clip = Trajectory(t_s, spring.observed, z, np.full_like(z, np.nan), np.ones(300, bool))
    >>> to_pysindy(discover(clip, resampled=10)).get_feature_names()
    ['d_z', 'z']
    """
    from pysindy import STLSQ, SINDy  # two seconds to import

    from fitters.sindy.term_library import TermLibrary

    if not all(fitted.usable for fitted in discovery.fits):
        raise DataError(f"the discovery has no usable fit: {discovery.message}")
    model, terms = discovery.model, _terms(discovery)
    names = list(dict.fromkeys(term.name for term in terms))
    places = {term.name: (term.state, term.parameter) for term in reversed(terms)}
    coefficients = np.zeros((len(model.states), len(names)))
    for term in terms:
        coefficients[term.state, names.index(term.name)] = term.coefficient
    library = TermLibrary(model, names, [places[name] for name in names])
    return _with_shapes(SINDy(STLSQ(threshold=0.0, alpha=0.0, unbias=False), library), model, coefficients)


class _Term(NamedTuple):
    name: str
    state: int
    parameter: int | None
    coefficient: float


def _terms(discovery: Discovery) -> list[_Term]:
    """What adds to the slope of each state: for values their rates, for the highest derivatives the terms found."""
    model, left = discovery.model, [equation.lhs for equation in discovery.equations]
    first = len(model.states) - len(left)  # the values, whose slopes are rates
    parameters = [parameter.name for parameter in model.parameters]
    rates = [_Term(model.states[first + k].name, k, None, 1.0) for k in range(first)]
    return rates + [
        _Term(
            re.sub(r"(\w+)'", r"d_\1", term.term),
            first + left.index(term.equation),
            parameters.index(term.parameter),
            term.coefficient.value,
        )
        for term in discovery.selected
    ]


def _with_shapes(made: Any, model: OdeModel, coefficients: Array) -> Any:
    """The model of pysindy with these coefficients (states, features), in the units of the terms.

    Its ``fit`` sets all shapes and names: here to rows that have the coefficients exactly, up to rounding.
    """
    rows, count = 4 * coefficients.size, len(model.states)
    x = np.random.default_rng(0).uniform(0.1, 1.0, (rows, count + len(model.inputs)))
    slopes = made.feature_library.fit(x).transform(x) @ coefficients.T
    inputs = x[:, count:] if model.inputs else None
    names = [quantity.name for quantity in (*model.states, *model.inputs)]
    made.fit(x[:, :count], t=1.0, x_dot=np.asarray(slopes), u=inputs, feature_names=names)
    made.optimizer.coef_ = coefficients
    return made
