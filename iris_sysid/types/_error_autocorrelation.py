"""How long the errors of a tracked position last, from frame to frame."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from iris_sysid.errors import DataError


@dataclass(frozen=True, slots=True)
class ErrorAutocorrelation:
    """Partial autocorrelations of a track's position errors, as the tracker measured them in single frames.

    ``partial`` (q,) holds those at lags of 1 to q frames, each between -1 and 1; ``stderr`` (q,) their standard errors.
    A fit of few samples needs them, because its residual does not show errors that last. Raises DataError where the
    two do not fit one another, or a value is not possible.
    """

    partial: tuple[float, ...]
    stderr: tuple[float, ...]

    def __post_init__(self) -> None:
        for name in ("partial", "stderr"):
            object.__setattr__(self, name, tuple(float(value) for value in getattr(self, name)))
        if not self.partial or len(self.partial) != len(self.stderr):
            raise DataError(
                f"an error autocorrelation has as many standard errors as values, at least one: "
                f"not {len(self.partial)} values and {len(self.stderr)} standard errors"
            )
        if not all(abs(value) < 1 for value in self.partial):
            raise DataError(f"partial autocorrelations lie between -1 and 1; not {self.partial}")
        if not all(math.isfinite(stderr) and stderr > 0 for stderr in self.stderr):
            raise DataError(f"standard errors of autocorrelations are positive numbers; not {self.stderr}")

    def with_model_error(self, stderr: float) -> ErrorAutocorrelation:
        """The same with a further standard error, common to all lags, added in quadrature."""
        return ErrorAutocorrelation(self.partial, tuple(float(np.hypot(own, stderr)) for own in self.stderr))


# of an apparent radius in a compressed clip. A coder hands an outline on from frame to frame, and neither its lobes nor
# the few frames of a fall show how long the errors of its radius last; on rendered balls (falls of 640x360 seeds 7360
# and 5513, of 960x540 seed 5512, circles of validation.subpixel) the partial autocorrelations are 0.2 to 0.9, 0 to 0.4
RADIUS_ERRORS = ErrorAutocorrelation((0.5, 0.25), (0.2, 0.15))
