"""The constants that several models share, each with its origin."""

from __future__ import annotations

from iris_sysid.types import Parameter

STANDARD_GRAVITY = 9.80665  # m/s^2

GRAVITY = Parameter(
    "gravity",
    "m/s^2",
    "g",
    lower=1e-3,
    upper=1e6,  # wide, so that px/s^2 fit in
    default=STANDARD_GRAVITY,
    constant=True,
    source="standard acceleration of gravity, 3rd CGPM (1901)",
    role="gravity",
)

MAGNIFICATION = Parameter(
    "magnification",
    "1",
    "M",
    lower=1e-2,
    upper=1e2,
    default=1.0,
    constant=True,
    source="observed length / true length: 1 by definition of the scale, whose error it carries",
    role="magnification",
)
