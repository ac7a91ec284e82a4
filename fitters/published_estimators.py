"""The benchmark's own estimators, as its paper describes them: envelope, damped cosine, second-order polynomial.

They are compared with the fits of the full model to show their bias; they are not used for anything else.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from types import MappingProxyType

import numpy as np
from scipy.optimize import curve_fit
from scipy.signal import find_peaks

from iris_sysid.errors import FitError
from iris_sysid.types import Array, Estimate, Trajectory

MIN_SAMPLES = 5  # samples of a motion
MIN_PEAKS = 3  # two unknowns and one to spare
MAX_STEPS = 20_000  # evaluations that Levenberg-Marquardt may take
Known = Mapping[str, Estimate]
Estimator = Callable[[Trajectory, Known], dict[str, Estimate]]


def used_samples(trajectory: Trajectory, quantity: str) -> tuple[Array, Array]:
    """Times (s, from 0) and values of a quantity in the motion, gaps left out; FitError when there are too few.

    Both (n,).
    """
    used = trajectory.valid & trajectory.mask("motion") if trajectory.segments else trajectory.valid
    if used.sum() < MIN_SAMPLES:
        raise FitError(f"the motion has {int(used.sum())} samples, at least {MIN_SAMPLES} are needed")
    t_s = trajectory.t_s[used]
    return t_s - t_s[0], trajectory.position[used, trajectory.column(quantity)]


def envelope(trajectory: Trajectory, known: Known, quantity: str = "theta") -> dict[str, Estimate]:
    """Damping by the envelope A0 exp(-damping t / 2) through the peaks of the motion (section "Ground truth").

    Peaks are the largest distances from the mean between two crossings of it, as they are sampled.

    Parameters
    ----------
    trajectory
        An angle that swings.
    known
        Not used.
    quantity
        Its name.

    Returns
    -------
    dict
        ``damping`` in 1/s.

    Raises
    ------
    FitError
        With fewer than three peaks.
    """
    del known
    t_s, angle = used_samples(trajectory, quantity)
    away = np.abs(angle - np.mean(angle))
    peaks, _ = find_peaks(away, height=0.2 * float(away.max()), prominence=0.1 * float(away.max()))
    if peaks.size < MIN_PEAKS:
        raise FitError(f"the motion has {peaks.size} peaks, the envelope needs {MIN_PEAKS}; film longer")
    start = (float(away[peaks[0]]), 0.05)
    values, stderrs = _levenberg_marquardt(_decay, t_s[peaks], away[peaks], start)
    return {"damping": Estimate(float(values[1]), float(stderrs[1]), "1/s", "fitted", ENVELOPE)}


def _decay(t_s: Array, amplitude: float, damping: float) -> Array:
    return np.asarray(amplitude * np.exp(-damping * t_s / 2))


def damped_cosine(trajectory: Trajectory, known: Known, quantity: str = "theta") -> dict[str, Estimate]:
    """Stiffness and damping by Levenberg-Marquardt on the solution of theta'' + damping theta' + stiffness theta = 0.

    theta(t) = exp(-damping t / 2) (a cos(w t) + b sin(w t)) + rest, w^2 = stiffness - damping^2 / 4: the linear
    equation, whatever the angle ("Fitted parameters" of the supplement).

    Parameters
    ----------
    trajectory
        An angle that swings.
    known
        ``gravity``, for the length.
    quantity
        The angle's name.

    Returns
    -------
    dict
        ``stiffness`` 1/s^2, ``damping`` 1/s, and with gravity ``length`` m.

    Raises
    ------
    FitError
        When it does not converge to an oscillation.
    """
    t_s, angle = used_samples(trajectory, quantity)
    rest = float(np.mean(angle))
    start = (float(angle[0]) - rest, 0.0, 0.05, _frequency(t_s, angle - rest), rest)
    values, stderrs = _levenberg_marquardt(_oscillation, t_s, angle, start)
    damping, frequency = float(values[2]), abs(float(values[3]))
    stiffness = frequency**2 + damping**2 / 4
    stderr = math.hypot(2 * frequency * stderrs[3], damping / 2 * stderrs[2])
    estimates = {
        "stiffness": Estimate(stiffness, stderr, "1/s^2", "fitted", DAMPED_COSINE),
        "damping": Estimate(damping, float(stderrs[2]), "1/s", "fitted", DAMPED_COSINE),
    }
    if "gravity" in known:
        length = known["gravity"].value / stiffness
        estimates["length"] = Estimate(length, length * stderr / stiffness, "m", "fitted", DAMPED_COSINE)
    return estimates


def _oscillation(t_s: Array, a: float, b: float, damping: float, frequency: float, rest: float) -> Array:
    return np.asarray(np.exp(-damping * t_s / 2) * (a * np.cos(frequency * t_s) + b * np.sin(frequency * t_s)) + rest)


def _frequency(t_s: Array, angle: Array) -> float:
    """Angular frequency from the crossings of zero, else half a turn for the whole motion."""
    crossings = t_s[:-1][np.diff(np.sign(angle)) != 0]
    if crossings.size < 2:
        return math.pi / 2 / float(t_s[-1])
    return math.pi * (crossings.size - 1) / float(crossings[-1] - crossings[0])


def free_fall(trajectory: Trajectory, known: Known) -> dict[str, Estimate]:
    """Gravity by a second-order polynomial through the height.

    Parameters
    ----------
    trajectory
        Height z of a ball that falls.
    known
        Not used.

    Returns
    -------
    dict
        ``gravity``, in the unit of z per s^2.
    """
    del known
    value, stderr = _acceleration(trajectory, "z")
    unit = f"{trajectory.quantities[trajectory.column('z')].unit}/s^2"
    return {"gravity": Estimate(-value, stderr, unit, "fitted", POLYNOMIAL)}


def incline(trajectory: Trajectory, known: Known) -> dict[str, Estimate]:
    """Friction tan(angle) - a / (g cos(angle)), a by a second-order polynomial through the distance along the board.

    Parameters
    ----------
    trajectory
        The way s.
    known
        ``angle`` in rad and ``gravity``; without them only the acceleration is given.

    Returns
    -------
    dict
        ``acceleration`` and ``friction``, whose error is that of the acceleration alone, as published.
    """
    value, stderr = _acceleration(trajectory, "s")
    unit = f"{trajectory.quantities[trajectory.column('s')].unit}/s^2"
    estimates = {"acceleration": Estimate(value, stderr, unit, "fitted", POLYNOMIAL)}
    if unit == "m/s^2" and {"angle", "gravity"} <= known.keys():
        angle, gravity = known["angle"].value, known["gravity"].value
        slope = gravity * math.cos(angle)
        source = f"tan a - acceleration / (g cos a), {POLYNOMIAL}"
        estimates["friction"] = Estimate(math.tan(angle) - value / slope, stderr / slope, "1", "fitted", source)
    return estimates


def _acceleration(trajectory: Trajectory, quantity: str) -> tuple[float, float]:
    """Second derivative of the polynomial, and its standard error for white noise."""
    t_s, way = used_samples(trajectory, quantity)
    coefficients, covariance = np.polyfit(t_s, way, 2, cov=True)
    return 2 * float(coefficients[0]), 2 * math.sqrt(float(covariance[0, 0]))


def _levenberg_marquardt(
    curve: Callable[..., Array], t_s: Array, values: Array, start: Sequence[float]
) -> tuple[Array, Array]:
    """Values and standard errors for white noise; FitError when it does not converge."""
    try:
        fitted, covariance = curve_fit(curve, t_s, values, p0=start, method="lm", maxfev=MAX_STEPS)
    except RuntimeError as error:
        raise FitError(f"Levenberg-Marquardt does not converge: {error}") from error
    return np.asarray(fitted), np.sqrt(np.diag(covariance))


ENVELOPE = "envelope A0 exp(-damping t / 2) through the peaks"
DAMPED_COSINE = "Levenberg-Marquardt on the damped solution of the linear equation"
POLYNOMIAL = "second-order polynomial"


@dataclass(frozen=True, slots=True)
class PublishedRecipe:
    """An estimator, and how the paper makes one number of the clips of a setting.

    ``of`` are all clips, or the first alone as reference. ``uncertainty`` is the half width of the 95 % interval of
    the mean over clips, or their standard deviation. ``gives`` are the parameters that it estimates.
    """

    name: str
    estimator: Estimator
    of: str
    uncertainty: str
    gives: tuple[str, ...]


INTERVAL, DEVIATION = "half width of the 95 % interval over the clips", "standard deviation over the clips"
ALL, FIRST = "all clips", "the first clip"
RECIPES: Mapping[str, tuple[PublishedRecipe, ...]] = MappingProxyType(
    {
        "pendulum": (
            PublishedRecipe(ENVELOPE, envelope, ALL, INTERVAL, ("damping",)),
            PublishedRecipe(DAMPED_COSINE, damped_cosine, FIRST, DEVIATION, ("length", "damping")),
        ),
        "angular-oscillator": (
            PublishedRecipe(ENVELOPE, partial(envelope, quantity="phi"), ALL, INTERVAL, ("damping",)),
            PublishedRecipe(
                DAMPED_COSINE, partial(damped_cosine, quantity="phi"), FIRST, DEVIATION, ("stiffness", "damping")
            ),
        ),
        "free-fall": (PublishedRecipe(POLYNOMIAL, free_fall, ALL, DEVIATION, ("gravity",)),),
        "incline": (PublishedRecipe(POLYNOMIAL, incline, ALL, DEVIATION, ("friction",)),),
    }
)
