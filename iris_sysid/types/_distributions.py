"""Quantiles and tails of the normal, Student's t and chi-square distributions.

By ``scipy.special``, whose functions ``scipy.stats`` wraps: importing the latter takes half a second.
"""

from __future__ import annotations

from typing import Any


def normal_cdf(value: Any) -> Any:
    """Probability that a standard normal number is below a value, or an array of values of any shape."""
    from scipy.special import ndtr

    return ndtr(value)


def normal_isf(level: float) -> float:
    """Value that a standard normal number exceeds with probability ``level``."""
    from scipy.special import ndtri

    return float(-ndtri(level))


def student_ppf(level: float, degrees: float) -> float:
    """Value that Student's t with ``degrees`` of freedom stays below with probability ``level``."""
    from scipy.special import stdtrit

    return float(stdtrit(degrees, level))


def student_sf(value: float, degrees: float) -> float:
    """Probability that Student's t with ``degrees`` of freedom exceeds a value."""
    from scipy.special import stdtr

    return float(stdtr(degrees, -value))


def chi2_sf(value: float, degrees: float) -> float:
    """Probability that chi-square with ``degrees`` of freedom exceeds a value."""
    from scipy.special import chdtrc

    return float(chdtrc(degrees, value))


def chi2_isf(level: float, degrees: float) -> float:
    """Value that chi-square with ``degrees`` of freedom exceeds with probability ``level``."""
    from scipy.special import chdtri

    return float(chdtri(degrees, level))


def chi2_ppf(level: float, degrees: float) -> float:
    """Value that chi-square with ``degrees`` of freedom stays below with probability ``level``."""
    from scipy.special import gammaincinv

    return float(2.0 * gammaincinv(degrees / 2.0, level))
