"""A pump fills the upper of two tanks, which drains into the lower one, whose level is measured."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.integrate import cumulative_trapezoid
from scipy.signal import lfilter

from fitters.models._inputs import input_of, pump, slow_pump
from fitters.starting_values import samples, start_of, weak_regression
from iris_sysid.types import Array, ModelExample, OdeModel, Parameter, Quantity, Trajectory

LAGS = np.geomspace(0.002, 1.0, 12)  # of the record's length, tried for the upper tank


def rhs(
    t: float, state: tuple[float, float], params: tuple[float, float, float], inputs: tuple[float]
) -> tuple[float, float]:
    """Give upper' = pump u - falling and lower' = falling - lower_outflow sqrt(lower)."""
    upper, lower = state
    upper_outflow, lower_outflow, pump = params
    falling = upper_outflow * np.sqrt(max(upper, 0.0))
    return pump * inputs[0] - falling, falling - lower_outflow * np.sqrt(max(lower, 0.0))


def guess(trajectory: Trajectory) -> Mapping[str, float]:
    """Outflow of the lower tank and pump by regression of the weak form; both tanks begin at one level.

    What falls into the lower tank lags behind the pump by about 2 sqrt(h) / outflow of the upper one. Of several lags
    the one with which the lower level follows best is taken.
    """
    t_s, level = samples(trajectory, "lower")
    given, span_s = input_of(trajectory, t_s), float(np.ptp(t_s))
    start = float(start_of(t_s, level, span_s / 20, degree=1)[0])
    best, found = np.inf, {"upper_0": start, "lower_0": start}
    for lag_s in LAGS * span_s:
        terms = np.column_stack([_lagging(t_s, given, lag_s), -np.sqrt(np.maximum(level, 0.0))])
        rates, _ = weak_regression(t_s, level, terms, order=1)
        error = float(np.std(level - cumulative_trapezoid(terms @ rates, t_s, initial=0)))
        if np.all(rates > 0) and error < best:
            best, (filling, outflow) = error, rates.tolist()
            upper_outflow = 2.0 * np.sqrt(max(float(np.mean(level)), 0.0)) / lag_s
            found |= {"upper_outflow": float(upper_outflow), "lower_outflow": outflow, "pump": filling}
    return found


def _lagging(t_s: Array, values: Array, lag_s: float) -> Array:
    """Values (n,) at ``t_s`` (n,) s after a lag of first order that begins with their mean."""
    even_s = np.linspace(t_s[0], t_s[-1], t_s.size)
    kept = float(np.exp(-(even_s[1] - even_s[0]) / lag_s))
    offset = values - values.mean()
    followed = lfilter([1.0 - kept], [1.0, -kept], np.interp(even_s, t_s, offset))
    return np.asarray(np.interp(t_s, even_s, followed) + values.mean())


MODEL = OdeModel(
    name="two-tanks",
    summary="a pump fills a tank that drains into a second one; the level of the second, lower one is measured",
    equation=r"\dot h_1 = k_u u - k_1\sqrt{h_1},\quad \dot h_2 = k_1\sqrt{h_1} - k_2\sqrt{h_2}",
    source="Torricelli (1644), De motu gravium; Schoukens and Noel (2017), IFAC-PapersOnLine 50, 446",
    states=(Quantity("upper", "m", "h_1"), Quantity("lower", "m", "h_2")),
    parameters=(
        Parameter("upper_outflow", "m^0.5/s", "k_1", lower=0.0, default=0.05),
        Parameter("lower_outflow", "m^0.5/s", "k_2", lower=0.0, default=0.05),
        pump("m/s/V"),
    ),
    observed=(Quantity("lower", "m", "h_2"),),
    rhs=rhs,
    guess=guess,
    inputs=(Quantity("u", "V", "u"),),
    typical="28 cm^2 with holes of 0.07 cm^2: 0.011 m^0.5/s; a pump of 3.3 cm^3/s at 1 V: 0.0012 m/s/V",
    example=ModelExample(
        {"upper_outflow": 0.014, "lower_outflow": 0.011, "pump": 0.0012, "upper_0": 0.06, "lower_0": 0.1},
        samples=800,
        rate_hz=2.0,
        inputs=slow_pump,
    ),
)
