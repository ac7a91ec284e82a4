"""How a fitted model does on a record that was not used to fit it."""

from __future__ import annotations

from dataclasses import dataclass

from iris_sysid.types._arrays import Array
from iris_sysid.types._display import text_of
from iris_sysid.types._numbers import Quantity
from iris_sysid.types._result import FitResult

NORMAL_995 = 2.5758293035489004  # 99.5 % quantile of the standard normal: 99 % bands


@dataclass(frozen=True, eq=False, slots=True)
class LinearModel:
    """A linear model of the same order, fitted to the same record: what the equation must beat.

    ``order`` of its difference equation; ``rms`` (d,) and ``fit_percent`` (d,) of its simulation of the validation
    record, as those of :class:`Validation`.
    """

    order: int
    rms: Array
    fit_percent: Array


@dataclass(frozen=True, eq=False, slots=True)
class Validation:
    """How well a fitted model simulates a record that was not used, and whether its residual is white.

    ``rms`` (d,): simulation error, root mean square, in the units of the ``quantities`` (d,). ``fit_percent`` (d,):
    100 (``1 - |error| / |observed - mean|``), 100 for a perfect simulation and 0 for one no better than the mean.
    ``autocorrelation`` (d, l): of the residual at lags of 1 to l samples; of white noise 99 % lie within
    ``autocorrelation_band``. ``input_correlation`` (d, m, 2 l + 1): of the residual with each of the ``inputs`` (m,) at
    lags of -l to l samples, above zero where the input comes first; of a residual that does not depend on the input
    99 % lie within ``input_band`` (d, m). ``simulated`` has the predicted motion and its residual. ``linear`` is None
    where the record has no inputs, or its times are uneven.
    """

    quantities: tuple[Quantity, ...]
    inputs: tuple[Quantity, ...]
    rms: Array
    fit_percent: Array
    autocorrelation: Array
    autocorrelation_band: float
    input_correlation: Array
    input_band: Array
    simulated: FitResult
    linear: LinearModel | None = None

    @property
    def coloured(self) -> Array:
        """Share of the lags (d,) at which the autocorrelation lies outside its band; 0.01 for white noise."""
        return (abs(self.autocorrelation) > self.autocorrelation_band).mean(axis=1)

    @property
    def input_left(self) -> Array:
        """Share of the lags (d, m) at which the correlation with an input lies outside its band; 0.01 for none."""
        return (abs(self.input_correlation) > self.input_band[:, :, None]).mean(axis=2)

    def __repr__(self) -> str:
        parts = zip(self.quantities, self.rms, self.fit_percent, strict=True)
        each = (f"{quantity.name}: {rms:.3g} {quantity.unit} rms, fit {fit:.1f} %" for quantity, rms, fit in parts)
        return text_of(f"Validation of {self.simulated.model.name} by simulation", *each)
