"""The least squares against NIST's certified nonlinear regressions, all 27, from the far start."""

import re

import numpy as np
import pytest

from iris_sysid.errors import FitError
from tests._project import recording
from tests.fitters.curve_fit import fit_curve


def decays(x, b):
    return b[0] * np.exp(-b[1] * x) + b[2] * np.exp(-b[3] * x) + b[4] * np.exp(-b[5] * x)


def peaks(x, b):
    first, second = b[2] * np.exp(-((x - b[3]) ** 2) / b[4] ** 2), b[5] * np.exp(-((x - b[6]) ** 2) / b[7] ** 2)
    return b[0] * np.exp(-b[1] * x) + first + second


def cubics(x, b):
    return (b[0] + b[1] * x + b[2] * x**2 + b[3] * x**3) / (1 + b[4] * x + b[5] * x**2 + b[6] * x**3)


def cycles(x, b):
    def wave(period, cosine, sine):
        return cosine * np.cos(2 * np.pi * x / period) + sine * np.sin(2 * np.pi * x / period)

    return b[0] + wave(12, b[1], b[2]) + wave(b[3], b[4], b[5]) + wave(b[6], b[7], b[8])


def chwirut(x, b):
    return np.exp(-b[0] * x) / (b[1] + b[2] * x)


FORMULAS = {
    "Bennett5": lambda x, b: b[0] * (b[1] + x) ** (-1 / b[2]),
    "BoxBOD": lambda x, b: b[0] * (1 - np.exp(-b[1] * x)),
    "Chwirut1": chwirut,
    "Chwirut2": chwirut,
    "DanWood": lambda x, b: b[0] * x ** b[1],
    "ENSO": cycles,
    "Eckerle4": lambda x, b: b[0] / b[1] * np.exp(-0.5 * ((x - b[2]) / b[1]) ** 2),
    "Gauss1": peaks,
    "Gauss2": peaks,
    "Gauss3": peaks,
    "Hahn1": cubics,
    "Kirby2": lambda x, b: (b[0] + b[1] * x + b[2] * x**2) / (1 + b[3] * x + b[4] * x**2),
    "Lanczos1": decays,
    "Lanczos2": decays,
    "Lanczos3": decays,
    "MGH09": lambda x, b: b[0] * (x**2 + x * b[1]) / (x**2 + x * b[2] + b[3]),
    "MGH10": lambda x, b: b[0] * np.exp(b[1] / (x + b[2])),
    "MGH17": lambda x, b: b[0] + b[1] * np.exp(-x * b[3]) + b[2] * np.exp(-x * b[4]),
    "Misra1a": lambda x, b: b[0] * (1 - np.exp(-b[1] * x)),
    "Misra1b": lambda x, b: b[0] * (1 - (1 + b[1] * x / 2) ** (-2)),
    "Misra1c": lambda x, b: b[0] * (1 - (1 + 2 * b[1] * x) ** (-0.5)),
    "Misra1d": lambda x, b: b[0] * b[1] * x / (1 + b[1] * x),
    "Nelson": lambda x, b: b[0] - b[1] * x[:, 0] * np.exp(-b[2] * x[:, 1]),
    "Rat42": lambda x, b: b[0] / (1 + np.exp(b[1] - b[2] * x)),
    "Rat43": lambda x, b: b[0] / (1 + np.exp(b[1] - b[2] * x)) ** (1 / b[3]),
    "Roszman1": lambda x, b: b[0] - b[1] * x - np.arctan(b[2] / (x - b[3])) / np.pi,
    "Thurber": cubics,
}
HARDEST = ("Lanczos1", "Bennett5")  # data exact to 14 digits: the residual is rounding; a valley without a floor
ROW = re.compile(r"^\s*b\d+\s*=\s*(\S+)\s+(\S+)\s+(\S+)\s+(\S+)\s*$", re.M)


def certified(name):
    """x, y, the first start, and the certified values and standard errors."""
    lines = recording(f"nist_strd/{name}.dat").read_text().splitlines()
    table = np.array([row.split() for row in lines[60:] if row.strip()], dtype=np.longdouble)
    start, _, values, stderr = np.array(ROW.findall("\n".join(lines[:60])), dtype=float).T
    x = table[:, 1] if table.shape[1] == 2 else table[:, 1:]
    return x, np.log(table[:, 0]) if name == "Nelson" else table[:, 0], start, values, stderr


def digits(fitted, true):
    """Number of significant digits that agree, of the worst value."""
    with np.errstate(divide="ignore"):
        return float(np.min(-np.log10(np.abs(fitted - true) / np.abs(true))))


QUICK = ("Misra1a", "MGH09", "BoxBOD")


@pytest.mark.parametrize("name", [n if n in QUICK else pytest.param(n, marks=pytest.mark.slow) for n in FORMULAS])
def test_certified_values_and_standard_errors_are_reached_from_the_far_start(name):
    x, y, start, values, stderr = certified(name)
    fitted = fit_curve(FORMULAS[name], x, y, start)
    assert digits(fitted.values, values) > (4 if name in HARDEST else 6)
    assert digits(fitted.stderr, stderr) > 4


def test_too_few_values_are_refused():
    with pytest.raises(FitError, match="2 values cannot determine 3 parameters"):
        fit_curve(chwirut, [1.0, 2.0], [1.0, 2.0], [1.0, 1.0, 1.0])


def test_start_without_finite_values_is_refused():
    with pytest.raises(FitError, match="no finite values at the start"):
        fit_curve(lambda x, b: np.sqrt(b[0] - x), [1.0, 2.0, 3.0], [1.0, 2.0, 3.0], [-1.0], multistart=0)
