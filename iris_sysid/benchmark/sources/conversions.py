"""How the latent pipeline's alpha and beta convert to physical parameters; a length has two conversions.

The publication converts every pendulum file by L = g/alpha (tab:calibration). The baseline's pendulum block takes
alpha as the length itself (a'' = -g/alpha sin a), the unified one as g/L. Both readings are therefore given.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

GRAVITY = 9.80665  # m/s^2, standard gravity, the constant in the benchmark's code; its text prints 9.81

Values = NDArray[np.float64]


def alpha_itself(alpha: ArrayLike, beta: ArrayLike) -> Values:
    """The first fitted value (n,), alpha, in the unit of the publication's latent parameter; beta is not used."""
    return np.asarray(alpha, dtype=np.float64)


def beta_itself(alpha: ArrayLike, beta: ArrayLike) -> Values:
    """The second fitted value (n,), beta, in the unit of the publication's latent parameter; alpha is not used."""
    return np.asarray(beta, dtype=np.float64)


def negated_beta(alpha: ArrayLike, beta: ArrayLike) -> Values:
    """Minus beta (n,), the sign of the publication's damping (tab:calibration), in its unit; alpha is not used."""
    return -np.asarray(beta, dtype=np.float64)


def gravity_over_alpha(alpha: ArrayLike, beta: ArrayLike) -> Values:
    """Length g/alpha in m; NaN where alpha <= 0, which corresponds to no length. beta is not used.

    Arrays of alpha and beta (n,), 1/s^2 and 1/s.
    """
    alpha = np.asarray(alpha, dtype=np.float64)
    return np.divide(GRAVITY, alpha, out=np.full(alpha.shape, np.nan), where=alpha > 0)


@dataclass(frozen=True, slots=True)
class LatentReading:
    """One conversion of (alpha, beta) to a parameter.

    ``published`` marks the reading that the publication's own tables use for this parameter, ``floor_zero`` that
    its comparison sets a negative estimate to 0 before computing the error.
    """

    parameter: str
    unit: str
    conversion: str
    convert: Callable[[ArrayLike, ArrayLike], Values]
    published: bool = True
    floor_zero: bool = True


def _length(parameter: str) -> tuple[LatentReading, LatentReading]:
    return (
        LatentReading(parameter, "m", "g/alpha", gravity_over_alpha),
        LatentReading(parameter, "m", "alpha as length", alpha_itself, published=False),
    )


_GRAVITY = (LatentReading("gravity", "m/s^2", "alpha", alpha_itself),)
_PAIR = (*_length("length_1"), *_length("length_2"))  # one alpha serves both

READINGS: Mapping[str, tuple[LatentReading, ...]] = {
    "Dropping_ball": _GRAVITY,
    "Falling_ball": _GRAVITY,
    "Pendulum": _length("length"),
    "Rotation": (
        LatentReading("stiffness", "1/s^2", "alpha", alpha_itself),
        LatentReading("damping", "1/s", "beta", beta_itself),
    ),
    "Two_Moving_Pendulums": _PAIR,
    "Two_Moving_Pendulum_One_Static": _PAIR,
    # the published statistics of kappa are those of this column
    "Hitting_cones": (LatentReading("coupling", "1/s^2", "alpha", alpha_itself),),
    "dropped_ball": _GRAVITY,
    "free_fall": _GRAVITY,
    "led": (
        LatentReading("decay_rate", "1/s", "beta", beta_itself),
        LatentReading("decay_rate", "1/s", "alpha", alpha_itself, published=False),
    ),
    "pendulum": (*_length("length"), LatentReading("damping", "1/s", "-beta", negated_beta, floor_zero=False)),
    "sliding_block": (LatentReading("friction", "1", "beta", beta_itself),),
    "torricelli": (LatentReading("outflow", "m^0.5/s", "alpha", alpha_itself),),
}
