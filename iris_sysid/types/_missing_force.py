"""The force that a model lacks, estimated without a formula for it, and the simple form that it has."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from iris_sysid.types._arrays import Array
from iris_sysid.types._display import Brief
from iris_sysid.types._numbers import NORMAL_975, Estimate, Quantity

DECISIVE = 4.605170185988092  # ln 100: reached in at most 1 % of complete models (Ville 1939)

ForceKind = Literal[
    "against-velocity", "odd-in-position", "even-in-position", "drift", "own-force-drift", "pulse", "sine"
]


@dataclass(frozen=True, slots=True)
class ForceForm:
    """A simple form of a missing force.

    ``kind``: ``against-velocity`` is -c |v|^p in the direction of the velocity, ``odd-in-position`` c sign(x) |x|^p,
    ``even-in-position`` c |x|^p, ``drift`` grows evenly with time, ``own-force-drift`` is the model's own force times a
    factor that does, ``pulse`` acts at one moment, ``sine`` is periodic. ``size`` is the force to first order, where
    |v| or |x| has its root mean square (of a drift: at the end); NaN where it has a phase or several directions.
    ``shape`` is the power p, the moment in s or the frequency in Hz; None for a drift, or where a refit gives no power.
    ``share`` is the fraction of the explainable sum of squares (the residual beyond the noise) that this form explains.
    ``similar`` are kinds that the data cannot tell from it.
    """

    kind: ForceKind
    size: float
    shape: Estimate | None
    share: float
    similar: tuple[ForceKind, ...] = ()


@dataclass(frozen=True, eq=False, slots=True, repr=False)
class MissingForce(Brief):
    """The acceleration (of a first-order model: the rate) that a model lacks, at m times along its fitted motion.

    ``t_s`` (m,) s; ``position`` and ``velocity`` (m, f) of the f degrees of freedom ``quantities``; ``force`` (m, f) in
    ``units`` (f,), freed of what the fitted parameters of the model can imitate, and ``stderr`` (m, f) its standard
    error. ``by_effects`` (m, f) is what the effects that were added afterwards contribute, in the same sense; None
    where none of them is a force. ``log_odds`` is the natural logarithm of the Bayes factor of some missing force over
    none. ``rho`` is the likeliest correlation of the noise from sample to sample, and ``noise_variance`` its variance
    in units of the stated one. ``whole`` is False where only the beginning of the clip is covered, as far as the times
    resolve its motion. ``form`` is the simple form of the force, where it has one.
    """

    t_s: Array
    quantities: tuple[Quantity, ...]
    units: tuple[str, ...]
    position: Array
    velocity: Array
    force: Array
    stderr: Array
    log_odds: float
    rho: float = 0.0
    noise_variance: float = 1.0
    whole: bool = True
    by_effects: Array | None = None
    form: ForceForm | None = None

    @property
    def band(self) -> tuple[Array, Array]:
        """Lower and upper end (m, f) of the pointwise 95 % band."""
        half = NORMAL_975 * self.stderr
        return self.force - half, self.force + half

    @property
    def significant(self) -> bool:
        """Whether the data make a missing force a hundred times as probable as none, relative to before."""
        return self.log_odds > DECISIVE
