"""The figure of a validation: measured and simulated, then the residual's correlations with bands of 99 %."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from iris_sysid.report.figures import COLOURS, FIT_COLOUR, outline
from iris_sysid.types import Array, Validation

BAND_COLOUR = "#009E73"
CAPTION = (
    "A record that was not fitted, simulated by the model from its inputs alone; the residual's correlation with "
    "itself and with the inputs, and the bands within which 99 % of those of white noise lie"
)


@dataclass(frozen=True, eq=False, slots=True)
class ValidatedDiagnosis:
    """The validation of a diagnosis by the ``record`` of that name: the models without effects, and with them."""

    record: str
    before: Validation
    after: Validation


def validation_figure(validation: Validation) -> Figure:
    """For each quantity: the record with the simulation over time, and the residual's correlations over lags.

    A row a quantity: the motion, its residual's autocorrelation, and its correlation with each input.
    """
    d, m = len(validation.quantities), len(validation.inputs)
    figure = Figure(figsize=(4.5 + 3.0 * (1 + m), 3.0 * d), layout="constrained")
    ratios = [1.5, *[1.0] * (1 + m)]
    rows = figure.subplots(d, 2 + m, squeeze=False, gridspec_kw={"width_ratios": ratios})
    for k, axes in enumerate(rows):
        _draw_motion(axes[0], validation, k)
        lags = np.arange(1, validation.autocorrelation.shape[1] + 1)
        _draw_lags(axes[1], lags, validation.autocorrelation[k], validation.autocorrelation_band)
        axes[1].set(title="residual: autocorrelation", xlabel="lag (samples)")
        for i, name in enumerate(quantity.name for quantity in validation.inputs):
            both = np.arange(-lags.size, lags.size + 1)
            _draw_lags(axes[2 + i], both, validation.input_correlation[k, i], validation.input_band[k, i])
            axes[2 + i].set(title=f"residual: correlation with {name}", xlabel=f"{name} comes first by (samples)")
    return figure


def _draw_motion(axes: Axes, validation: Validation, k: int) -> None:
    """Draw one quantity of the record, and what is simulated of it."""
    simulated, quantity = validation.simulated, validation.quantities[k]
    observed = np.where(simulated.used, simulated.predicted[:, k] + simulated.residual[:, k], np.nan)
    shown = outline(observed)
    axes.plot(simulated.t_s[shown], observed[shown], ".", color=COLOURS["motion"], markersize=3, label="measured")
    axes.plot(simulated.t_s, simulated.predicted[:, k], color=FIT_COLOUR, linewidth=0.9, label="simulated")
    axes.set(
        title=f"fit {validation.fit_percent[k]:.1f} %", xlabel="time (s)", ylabel=f"{quantity.name} ({quantity.unit})"
    )
    axes.legend(loc="upper right", framealpha=0.8)


def _draw_lags(axes: Axes, lags: NDArray[np.int_], values: Array, band: float) -> None:
    """Draw correlations over lags, with the band within which 99 % of those of nothing lie."""
    axes.axhspan(-band, band, color=BAND_COLOUR, alpha=0.15, label="99 %")
    axes.axhline(0, color="#888888", linewidth=0.6)
    axes.vlines(lags, 0.0, values, color=COLOURS["motion"], linewidth=1.2)
    axes.plot(lags, values, ".", color=COLOURS["motion"], markersize=4)
    largest = max(float(np.max(np.abs(values), initial=0.0)), band)
    axes.set_ylim(-1.15 * largest, 1.15 * largest)
    axes.legend(loc="upper right", framealpha=0.8)
