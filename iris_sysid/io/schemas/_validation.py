"""A fitted model on a record that was not used."""

from __future__ import annotations

from iris_sysid.io.schemas._parts import Number, Part, QuantityEntry


class LinearModelEntry(Part):
    """A linear model of the same order, fitted to the same record."""

    order: int
    rms: list[Number]
    fit_percent: list[Number]


class ValidationEntry(Part):
    """A free simulation of a record that was not fitted, and tests of its residual; one row a quantity."""

    record: str
    """What was simulated: a table, or a share of the fitted one."""
    n: int
    """Number of samples compared."""
    quantities: list[QuantityEntry]
    inputs: list[QuantityEntry]
    rms: list[Number]
    """Simulation error, root mean square, in the unit of each quantity."""
    fit_percent: list[Number]
    """100 (1 - |error| / |observed - mean|)."""
    autocorrelation: list[list[Number]]
    """Of the residual, at lags of 1, 2, ... samples."""
    autocorrelation_band: Number
    """99 % of those of white noise lie within this of zero."""
    input_correlation: list[list[list[Number]]]
    """Of the residual with each input, at lags of -l to l samples; above zero the input comes first."""
    input_band: list[list[Number]]
    """99 % of those of a residual that does not depend on the input lie within this of zero."""
    linear: LinearModelEntry | None = None
    """null without inputs, or at uneven times."""
