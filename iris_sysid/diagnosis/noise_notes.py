"""Notes on the form of the noise: a sensor that reads in steps, and noise that depends on the level."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fitters.noise.reading_step import STEP_TO_SD, reading_step
from fitters.ode import FitRequest
from iris_sysid.diagnosis.measurement_errors import observed_columns, unit_noise
from iris_sysid.types import Array, DiagnosticNote, FitResult, chi2_isf, with_unit

MIN_SHARE = 0.5  # of the residual's variance that steps must make for a note
FALSE_ALARM = 1e-4  # probability of a note on the level where the noise is the same everywhere
MIN_RATIO = 1.5  # of the noise at two levels: less changes no value by more than its error
MAX_CORRELATION = 0.5  # of the residual over one sample: beyond it, it is not noise
MIN_SAMPLES = 50
LEVELS = (0.05, 0.95)  # shares of the samples that lie below the levels whose noise a note states
NORMAL_MEAN = np.sqrt(2.0 / np.pi)  # mean absolute value of normal noise over its standard deviation


def noise_notes(clips: Sequence[FitRequest], finals: Sequence[FitResult]) -> tuple[DiagnosticNote, ...]:
    """Say of each quantity of the first clip where its noise is that of steps, or grows with its level.

    Parameters
    ----------
    clips
        The requests, one a clip.
    finals
        Their fits with all effects: what these lack is not noise.
    """
    return tuple(_notes_of(clips[0], finals[0]))


def _notes_of(clip: FitRequest, final: FitResult) -> Iterator[DiagnosticNote]:
    used = final.used
    noise = unit_noise(final, clip.trajectory)[used]
    for k, column in enumerate(observed_columns(final, clip.trajectory)):
        quantity, residual = final.model.observed[k], final.residual[used, k]
        step = reading_step(clip.trajectory.position[used, column])
        error, rms = STEP_TO_SD * step, float(np.sqrt(np.mean(residual**2)))
        if error**2 >= MIN_SHARE * rms**2 > 0:
            share = f"{100 * min((error / rms) ** 2, 1.0):.0f} % of the residual"
            in_steps, off = with_unit(f"{step:.3g}", quantity.unit), with_unit(f"{error:.2g}", quantity.unit)
            text = f"{quantity.name} is read in steps of {in_steps}, which err by {off}: {share}"
            yield DiagnosticNote("quantisation", text)
            continue
        found = noise_by_level(final.predicted[used, k], residual / noise[:, k], abs(final.correlation))
        if found is not None:
            middle = float(np.median(noise[:, k]))
            at = [f"{with_unit(f'{times * middle:.2g}', quantity.unit)} at {level:.2g}" for level, times in found]
            remedy = "weigh the samples by a column of their errors"
            text = f"the noise of {quantity.name} depends on its level: {', '.join(at)}; {remedy}"
            yield DiagnosticNote("level-noise", text)


def noise_by_level(level: Array, residual: Array, correlation: float) -> tuple[tuple[float, float], ...] | None:
    """The quietest and the noisiest level, each with the standard deviation there; None where noise is alike.

    A regression of the absolute residual on the level and its square (Glejser 1969, J. Am. Stat. Assoc. 64, 316),
    tested by n R^2, which no outlier and no form of the distribution decides (Koenker 1981, J. Econometrics 17, 107).

    Parameters
    ----------
    level, residual
        (n,), each in its own unit, which the result has too.
    correlation
        Of the residual over one sample.
    """
    if residual.size < MIN_SAMPLES or correlation > MAX_CORRELATION or not np.std(level) > 0:
        return None
    low, high = np.quantile(level, LEVELS)
    size, at = np.abs(residual), (level - level.mean()) / np.std(level)
    forms = np.column_stack([np.ones_like(at), at, at**2])
    values, *_ = np.linalg.lstsq(forms, size, rcond=None)
    explained = 1.0 - float(np.var(size - forms @ values) / max(float(np.var(size)), 1e-300))
    independent = residual.size * (1.0 - correlation**2) / (1.0 + correlation**2)
    if explained * independent < chi2_isf(FALSE_ALARM, 2):
        return None
    levels = np.linspace(low, high, 50)
    told = np.interp(levels, np.sort(level), (forms @ values)[np.argsort(level)]) / NORMAL_MEAN
    least, most = int(np.argmin(told)), int(np.argmax(told))
    if not told[most] > MIN_RATIO * max(told[least], 0.0):
        return None
    return (float(levels[least]), max(float(told[least]), 0.0)), (float(levels[most]), float(told[most]))
