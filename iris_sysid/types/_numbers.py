"""Names and numbers: a quantity with its unit, an estimate with its standard error."""

from __future__ import annotations

import re
from dataclasses import dataclass

NORMAL_975 = 1.959963984540054  # 97.5 % quantile of the standard normal
GREEK = ("alpha", "beta", "gamma", "delta", "theta", "phi", "psi", "omega", "tau")


@dataclass(frozen=True, slots=True)
class Quantity:
    """A named quantity with its unit, e.g. ``Quantity("theta", "rad", r"\\theta")``."""

    name: str
    unit: str
    symbol: str = ""

    @property
    def column(self) -> str:
        """Name of the column that holds it in a table, e.g. ``theta_rad``."""
        return f"{self.name}_{unit_suffix(self.unit)}"

    @property
    def title(self) -> str:
        """Name and unit as people write them above a column, e.g. ``theta [rad]``."""
        return f"{self.name} [{self.unit}]" if self.unit else self.name


def unit_suffix(unit: str) -> str:
    """Spell a unit as the end of a column name: ``m/s^2`` becomes ``m_s2``, no unit becomes ``1``."""
    return unit.replace("^", "").replace("/", "_").replace(" ", "_").replace("-", "") or "1"


def with_unit(number: str, unit: str) -> str:
    """A number with its unit, if it has one."""
    return number if unit in ("", "1") else f"{number} {unit}"


def symbol_of(name: str) -> str:
    r"""The LaTeX symbol that a name suggests: ``theta1`` gives ``\theta_{1}``."""
    letters, digits = re.fullmatch(r"(.*?)([0-9]*)", name, re.S).groups()  # type: ignore[union-attr]  # always matches
    symbol = f"\\{letters}" if letters in GREEK else letters
    return f"{symbol}_{{{digits}}}" if digits else symbol


@dataclass(frozen=True, slots=True)
class Estimate:
    """A number with its standard error, unit and origin.

    ``measurement_type`` is ``fitted``, ``direct`` (measured by hand), ``assumed``, ``derived`` or
    ``metadata``. ``stderr`` is NaN where the data do not determine it. ``ci95`` is normal unless given.
    ``source`` says where the value comes from, in words.
    """

    value: float
    stderr: float
    unit: str
    measurement_type: str = "fitted"
    source: str = ""
    ci95: tuple[float, float] | None = None

    @property
    def interval(self) -> tuple[float, float]:
        """The 95 % interval (lower, upper)."""
        if self.ci95 is not None:
            return self.ci95
        return (self.value - NORMAL_975 * self.stderr, self.value + NORMAL_975 * self.stderr)

    @property
    def interval_stderr(self) -> float:
        """The standard error of a normal distribution with this 95 % interval."""
        low, high = self.interval
        return (high - low) / 2 / NORMAL_975

    def __str__(self) -> str:
        """Value, standard error and unit, e.g. ``0.5 ± 0.001 m``."""
        error = f" ± {self.stderr:.2g}" if self.stderr > 0 else ""
        return with_unit(f"{self.value:.6g}{error}", self.unit)
