"""The result of model selection: the models of the bank, ranked by their prediction error."""

from __future__ import annotations

from dataclasses import dataclass

from iris_sysid.types._display import text_of
from iris_sysid.types._result import FitResult
from iris_sysid.types._verdict import Completeness, Doubt, Verdict, worst_verdict


@dataclass(frozen=True, eq=False, slots=True)
class ModelCandidate:
    """One model of the bank under one observable of the track.

    ``observable`` is the interpretation of the track, e.g. ``angle``. ``heldout`` and ``residual``: root mean square,
    in units of the measurement's noise, of all raw channels over the samples held out and over all of them; ``bic``
    over all samples. ``fit`` is that of all samples, None when it failed; ``adequate`` when its residual is near the
    noise. ``count`` numbers describe the samples: those of the model and of the observable. ``idle``: the model has
    events, but none happens in these samples, so the data do not test them.
    """

    model: str
    observable: str
    heldout: float
    residual: float
    bic: float
    adequate: bool
    fit: FitResult | None
    note: str = ""
    count: int = 0
    idle: bool = False

    @property
    def unknowns(self) -> int:
        """Number of fitted values of the equation."""
        return 0 if self.fit is None else len(self.fit.free)


@dataclass(frozen=True, eq=False, slots=True)
class ModelChoice:
    """The ranked models, the best first, and the choice.

    ``chosen`` is None when none of them fits. ``heldout_margin`` is the held-out error of the next model over that of
    the first, ``bic_margin`` how much larger its BIC is.
    """

    chosen: ModelCandidate | None
    ranking: tuple[ModelCandidate, ...]
    heldout_margin: float
    bic_margin: float
    message: str

    @property
    def nearest(self) -> ModelCandidate:
        """The first of the ranking, adequate or not."""
        return self.ranking[0]

    @property
    def verdict(self) -> Verdict:
        """That of the first model's fit; doubtful, of an incomplete equation, where no model fits."""
        fitted = self.nearest.fit
        own = Verdict("failed") if fitted is None else fitted.verdict
        if self.chosen is not None:
            return own
        incomplete = Completeness(float("nan") if fitted is None else fitted.explained, complete=False)
        return worst_verdict([own, Verdict("doubtful", (Doubt("incomplete", self.message, ""),), incomplete)])

    def __repr__(self) -> str:
        return text_of(
            f"ModelChoice: {self.chosen.model if self.chosen is not None else 'none of these'}",
            f"ranking: {', '.join(candidate.model for candidate in self.ranking)}",
            self.message,
        )
